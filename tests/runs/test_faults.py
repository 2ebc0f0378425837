"""Faults of the receiver, its clock and the satellites: no NaN, no lost row, an event, a state right or honestly wide.

The flight is an aircraft over the airfield at 100 m/s, 10 s straight and then turns of 35 deg of bank.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import insgnss
from insgnss.errors import StartError
from insgnss.gpstime import week_seconds_to_ns
from insgnss.runs.result import Run
from insgnss.simulation.faults import outage, range_ramp, range_step, reversed_range_rate
from insgnss.simulation.oscillator import MILLISECOND_M
from insgnss.simulation.sample_trajectories import airborne_turns
from insgnss.simulation.simulated_log import ClockStart, SimulatedLog
from insgnss.tables import EphemerisTable, GnssTable, NavigationData
from tests.runs.scenes import (
    START_NS,
    START_S,
    WEEK,
    FlightInMemory,
    after,
    assert_honest,
    assert_sound,
    even_sky,
    flight,
    kinds,
    paper_sky,
    position_error_m,
    row_at,
    simulator,
    true_start,
    turns,
    with_faults,
)

VICTIM = "G13"
SETTLED_S = 15.0  # the heading is found in the first turn


@pytest.fixture(scope="module")
def log() -> SimulatedLog:
    return turns().draw(np.random.default_rng(1))


@pytest.fixture(scope="module")
def clean(log: SimulatedLog) -> Run:
    return replayed(flight(turns(), log))


def replayed(flown: FlightInMemory) -> Run:
    """Return the run after the checks that hold whatever was wrong."""
    run = insgnss.replay(flown)
    assert_sound(run, flown)
    return run


def statuses(
    run: Run, sv: str, from_s: float = 0.0, to_s: float = np.inf, kind: str = "pseudorange"
) -> set[str]:
    rows = run.measurements
    t = rows["time_s"] - START_S
    mine = (rows["sv"] == sv) & (rows["kind"] == kind) & (t >= from_s - 1e-6) & (t < to_s - 1e-6)
    return set(rows.loc[mine, "status"])


def test_flight_without_faults_is_right_throughout(clean: Run) -> None:
    assert_honest(clean, 0.0)
    assert position_error_m(after(clean, SETTLED_S)).max() < 2.0
    assert kinds(clean) == ["start", "heading_single", "heading_known"]


# ------------------------------------------------------------------------------------------------ pseudoranges


@pytest.mark.parametrize("size_m", [50.0, 5000.0, MILLISECOND_M, -50.0, -MILLISECOND_M])
def test_one_wrong_pseudorange_is_gated_and_leaves_no_trace(clean: Run, size_m: float) -> None:
    run = replayed(flight(with_faults(turns(), [range_step(VICTIM, size_m, 60.0, 61.0)])))
    assert statuses(run, VICTIM, 60.0, 61.0) == {"gated"}
    assert statuses(run, VICTIM, 61.0) == {"used"}
    # one satellite of eleven is missing once: the solution moves by a fraction of its sigma of 0.7 m
    moved = run.nav["h_m"].to_numpy() - clean.nav["h_m"].to_numpy()
    assert np.abs(moved).max() < 0.3
    assert_honest(run, 0.0)


@pytest.mark.parametrize("size_m", [50.0, 5000.0, MILLISECOND_M])
@pytest.mark.parametrize("from_s", [0.0, 60.0], ids=["from the start", "in flight"])
def test_satellite_with_a_permanent_error_stays_out(size_m: float, from_s: float) -> None:
    run = replayed(flight(with_faults(turns(), [range_step(VICTIM, size_m, from_s)])))
    assert statuses(run, VICTIM, max(from_s, 3.0)) == {"gated"}
    if from_s == 0.0:
        assert statuses(run, VICTIM, 2.0, 3.0) == {"refused_at_start"}
    assert statuses(run, VICTIM, 3.0, kind="range_rate") == {"used"}
    assert_honest(run, 0.0)


def test_satellite_that_runs_away_is_refused_before_it_pulls_the_position_along() -> None:
    run = replayed(flight(with_faults(turns(), [range_ramp(VICTIM, 1.0, 40.0)])))
    assert statuses(run, VICTIM, 60.0) == {"gated"}
    assert position_error_m(after(run, SETTLED_S)).max() < 3.0
    assert_honest(run, 0.0)


def test_range_rates_of_the_wrong_sign_are_refused_and_the_pseudoranges_navigate() -> None:
    run = replayed(flight(with_faults(turns(), [reversed_range_rate()])))
    assert "kind_refused" in kinds(run) and not {"reset", "restart"} & set(kinds(run))
    rates = run.measurements[run.measurements["kind"] == "range_rate"]
    assert (rates["status"] == "used").mean() < 0.05  # satellites whose distance hardly changes
    assert_honest(run, 0.0)


# ------------------------------------------------------------------------------------------------ too few satellites


@pytest.mark.parametrize("count", [1, 2, 3])
def test_minute_with_few_satellites_is_bridged_with_an_honest_sigma(clean: Run, count: int) -> None:
    kept = ("G13", "G20", "G04")[:count]
    hidden = [sv for sv in paper_sky().ephemerides.sv_names if sv not in kept]
    run = replayed(flight(with_faults(turns(), [outage(hidden, 50.0, 110.0)])))
    few = run.nav["time_s"].between(START_S + 49.5, START_S + 109.5)
    assert few.sum() == 60 and (run.nav.loc[few, "n_used"] == count).all()
    assert row_at(run, 109.0)["sd_n_m"] > 1.5 * row_at(clean, 109.0)["sd_n_m"]
    assert_honest(run, 0.0)


def test_fewer_satellites_mean_a_larger_sigma() -> None:
    sigma = []
    for count in (3, 2, 1):
        hidden = [sv for sv in paper_sky().ephemerides.sv_names if sv not in ("G13", "G20", "G04")[:count]]
        run = replayed(flight(with_faults(turns(), [outage(hidden, 50.0, 110.0)])))
        row = row_at(run, 109.0)
        sigma.append(float(np.linalg.norm(row[["sd_n_m", "sd_e_m", "sd_d_m"]])))
    assert sigma[0] < sigma[1] < sigma[2]


def test_whole_outage_of_a_minute_is_told_and_bridged() -> None:
    """No row of any satellite for 60 s, as a receiver writes it that lost everything."""
    run = insgnss.replay(flight(with_faults(turns(), [outage(None, 50.0, 110.0)])), output=1.0)
    before, during, afterwards = (row_at(run, s)["sd_n_m"] for s in (49.0, 109.0, 112.0))
    assert during > 3.0 * before > afterwards
    assert_honest(run, 0.0)
    assert {"no_measurements", "measurements_back"} <= set(kinds(run))


def test_epoch_of_empty_cells_is_coasted_over(log: SimulatedLog) -> None:
    gnss = log.gnss
    empty = gnss.t_ns == START_NS + 60 * 10**9
    nothing = {name: np.where(empty, np.nan, getattr(gnss, name)) for name in ("pseudorange_m", "doppler_hz")}
    run = replayed(flight(turns(), log, gnss=replace(gnss, **nothing)))
    assert row_at(run, 60.0)["n_used"] == 0
    assert {"no_measurements", "measurements_back"} <= set(kinds(run))
    assert_honest(run, 0.0)


def test_log_without_range_rates_is_started_and_navigated(log: SimulatedLog) -> None:
    gnss = replace(log.gnss, doppler_hz=np.full(len(log.gnss.t_ns), np.nan))
    run = replayed(flight(turns(), log, gnss=gnss))
    assert_honest(run, 0.0)


def test_log_without_pseudoranges_is_a_typed_error(log: SimulatedLog) -> None:
    gnss = replace(log.gnss, pseudorange_m=np.full(len(log.gnss.t_ns), np.nan))
    with pytest.raises(StartError):
        insgnss.replay(flight(turns(), log, gnss=gnss))


# ------------------------------------------------------------------------------------------------ receiver clock


def test_clock_jumps_of_a_millisecond_are_absorbed() -> None:
    jumps = tuple((30.0 * k, MILLISECOND_M) for k in (1, 2, 3))
    run = replayed(flight(with_faults(turns(), clock=ClockStart(90_000.0, 50.0, jumps=jumps))))
    told = run.events[run.events["kind"] == "clock_jump"]
    assert (told["time_s"] - START_S).round(6).tolist() == [30.0, 60.0, 90.0]
    assert "gated" not in set(run.measurements["status"])
    assert_honest(run, 0.0)


def test_clock_that_drifts_by_300_metres_a_second_and_is_stepped_back_is_followed() -> None:
    clock = ClockStart(140_000.0, 300.0, jump_beyond_m=0.5 * MILLISECOND_M)
    run = replayed(flight(with_faults(turns(), clock=clock)))
    assert kinds(run).count("clock_jump") == 1
    assert "gated" not in set(run.measurements["status"])
    assert run.nav["clock_drift_mps"].iloc[-1] == pytest.approx(300.0, abs=30.0)
    assert_honest(run, 0.0)


@pytest.mark.parametrize("late_s", [5e-3, -5e-3, 0.04])
def test_receiver_clock_that_is_off_does_not_change_the_solution(late_s: float) -> None:
    """The same noise at other instants: a banked turn of 17 m/s^2 moves the velocity by 8 cm/s within 5 ms.

    A third of sigma may be left: what counts as motion changes with the instants.
    """
    base = simulator(airborne_turns(120.0, bank_deg=60.0), 120.0)
    on_time, late = (
        replayed(flight(with_faults(base, clock=ClockStart(bias_m=299_792_458.0 * bias_s)))).errors
        for bias_s in (0.0, late_s)
    )
    assert on_time is not None and late is not None
    settled = (late["time_s"] > START_S + 30.0).to_numpy()
    for name in ("vn_mps", "ve_mps", "vd_mps", "n_m", "e_m", "d_m"):
        moved = (late[f"d_{name}"] - on_time[f"d_{name}"])[settled].abs()
        assert (moved / on_time[f"sd_{name}"][settled]).max() < 1.0 / 3.0, name


# ------------------------------------------------------------------------------------------------ rows and sigmas


def doubled(gnss: GnssTable, sv: str) -> GnssTable:
    """Return the log with every row of a satellite written twice."""
    twice = np.flatnonzero(gnss.sv == gnss.sv_names.index(sv))
    return gnss.take(np.sort(np.concatenate([np.arange(len(gnss.t_ns)), twice]), kind="stable"))


def test_satellite_that_stands_twice_in_an_epoch_counts_once(clean: Run, log: SimulatedLog) -> None:
    run = replayed(flight(turns(), log, gnss=doubled(log.gnss, VICTIM)))
    assert run.status_counts().loc["duplicate"].tolist() == [120, 120]
    assert np.array_equal(run.nav.to_numpy(), clean.nav.to_numpy())


@pytest.mark.parametrize("bad", [0.0, -1.0, 3.4e38, np.inf])
def test_row_with_an_impossible_sigma_is_refused(log: SimulatedLog, bad: float) -> None:
    gnss = log.gnss
    victim = gnss.sv == gnss.sv_names.index(VICTIM)
    sigma = np.where(victim, bad, 2.0)
    run = replayed(flight(turns(), log, gnss=replace(gnss, sigma_pseudorange_m=sigma)))
    assert statuses(run, VICTIM) == {"bad_sigma"}
    assert statuses(run, VICTIM, 3.0, kind="range_rate") == {"used"}
    assert_honest(run, 0.0)


def test_sigma_column_filled_with_huge_numbers_is_refused_by_name(log: SimulatedLog) -> None:
    huge = np.full(len(log.gnss.t_ns), 1e12)
    run = replayed(flight(turns(), log, gnss=replace(log.gnss, sigma_range_rate_mps=huge)))
    assert set(run.status_counts().query("range_rate > 0").index) == {"bad_sigma"}
    assert_honest(run, 0.0)


def test_doppler_of_a_signal_that_nobody_knows_stands_in_the_ledger(log: SimulatedLog) -> None:
    """Its wavelength is not known, so there is no range rate to use; it is in the log all the same."""
    gnss = log.gnss
    victim = gnss.sv == gnss.sv_names.index(VICTIM)
    signal = np.where(victim, len(gnss.signal_names), gnss.signal).astype(np.int16)
    run = replayed(
        flight(turns(), log, gnss=replace(gnss, signal=signal, signal_names=(*gnss.signal_names, "C9Z")))
    )
    assert statuses(run, VICTIM) == statuses(run, VICTIM, kind="range_rate") == {"signal_not_used"}
    assert_honest(run, 0.0)


@pytest.mark.parametrize("given", [False, True], ids=["automatic start", "given start"])
@pytest.mark.parametrize("share", [0.2, 1.0 / 160.0, 1e-6])
def test_sigmas_that_are_far_too_small_make_the_filter_no_surer(share: float, given: bool) -> None:
    """A receiver has been seen that stated a sigma 160 times too small. At first the model's sigmas count."""
    squares = []
    for seed in (21, 22, 23):
        drawn = turns().draw(np.random.default_rng(seed))
        count = len(drawn.gnss.t_ns)
        small = replace(
            drawn.gnss,
            sigma_pseudorange_m=np.full(count, 2.0 * share),
            sigma_range_rate_mps=np.full(count, 0.08 * share),
        )
        flown = flight(turns(), drawn, gnss=small, start=true_start(turns(), 2.0) if given else None)
        run = replayed(flown)
        assert_honest(run, 0.0)
        late = after(run, 30.0)
        squares.append(
            np.mean([(late[f"d_{n}"] / late[f"sd_{n}"]) ** 2 for n in ("vn_mps", "ve_mps", "vd_mps")])
        )
    assert np.mean(squares) < 2.0


def test_one_satellite_with_a_sigma_far_too_small_does_not_stop_the_filter(log: SimulatedLog) -> None:
    gnss = log.gnss
    sigma = np.where(gnss.sv == gnss.sv_names.index(VICTIM), 1e-6, 2.0)
    run = replayed(flight(turns(), log, gnss=replace(gnss, sigma_pseudorange_m=sigma)))
    assert position_error_m(after(run, 30.0)).max() < 10.0


# ------------------------------------------------------------------------------------------------ ephemerides


def sky_with(change: dict[str, np.ndarray], keep: np.ndarray | None = None) -> NavigationData:
    """Return the sky with some columns changed and only the rows ``keep`` (bool) left."""
    sky = paper_sky()
    table = replace(sky.ephemerides, **change)
    if keep is not None:
        rows = np.flatnonzero(keep)
        columns = {f.name: getattr(table, f.name) for f in fields(EphemerisTable)}
        table = EphemerisTable(
            **{n: tuple(c[i] for i in rows) if isinstance(c, tuple) else c[rows] for n, c in columns.items()}
        )
    return replace(sky, ephemerides=table)


def is_victim() -> np.ndarray:
    return np.array(paper_sky().ephemerides.sv_names) == VICTIM


def test_satellite_without_ephemeris_is_named_and_left_out(log: SimulatedLog) -> None:
    run = replayed(flight(turns(), log, navigation=sky_with({}, keep=~is_victim())))
    assert statuses(run, VICTIM) == statuses(run, VICTIM, kind="range_rate") == {"no_ephemeris"}
    assert_honest(run, 0.0)


def test_satellite_with_an_ephemeris_of_yesterday_is_named_and_left_out(log: SimulatedLog) -> None:
    old = np.where(is_victim(), 24 * 3600 * 10**9, 0)
    table = paper_sky().ephemerides
    run = replayed(
        flight(
            turns(), log, navigation=sky_with({"toe_ns": table.toe_ns - old, "toc_ns": table.toc_ns - old})
        )
    )
    assert statuses(run, VICTIM) == {"stale_ephemeris"}
    assert_honest(run, 0.0)


def test_unhealthy_satellite_is_named_and_left_out(log: SimulatedLog) -> None:
    run = replayed(flight(turns(), log, navigation=sky_with({"health": np.where(is_victim(), 63.0, 0.0)})))
    assert statuses(run, VICTIM) == {"unhealthy"}
    assert_honest(run, 0.0)


def test_only_stale_ephemerides_are_a_typed_error(log: SimulatedLog) -> None:
    day_ns, table = 24 * 3600 * 10**9, paper_sky().ephemerides
    old = sky_with({"toe_ns": table.toe_ns - day_ns, "toc_ns": table.toc_ns - day_ns})
    with pytest.raises(StartError, match="ephemeris"):
        insgnss.replay(flight(turns(), log, navigation=old))


# ------------------------------------------------------------------------------------------------ time


@pytest.mark.parametrize("first_tag_s", [1.0, 1.005, 1.0037])
def test_epochs_on_and_off_the_inertial_grid_are_equally_right(first_tag_s: float) -> None:
    run = replayed(flight(turns(first_tag_s=first_tag_s)))
    fraction = (run.nav["time_s"] - START_S) % 1.0
    assert np.allclose(fraction, first_tag_s % 1.0, atol=1e-9)
    assert_honest(run, 0.0)
    assert position_error_m(after(run, SETTLED_S)).max() < 2.0


def test_week_may_end_inside_the_log() -> None:
    start_ns, toe_ns = (int(week_seconds_to_ns(WEEK, 604_800.0 + s)) for s in (-50.0, 900.0))
    base = simulator(airborne_turns(120.0), 120.0, navigation=even_sky(toe_ns), start_ns=start_ns)
    run = replayed(flight(base))
    assert run.nav["time_s"].iloc[-1] == pytest.approx(604_800.0 + 70.0)
    assert len(run.nav) == 119
    assert_honest(run, 0.0)


def test_given_start_may_lie_inside_the_log(log: SimulatedLog) -> None:
    run = replayed(flight(turns(), log, start=true_start(turns(), 60.0)))
    assert run.nav["time_s"].iloc[0] == pytest.approx(START_S + 60.0)
    assert_honest(run, 60.0)
