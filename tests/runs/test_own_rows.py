"""A user's own measurement kinds in whole runs: in an outage, with the heading open, live, smoothed, saved."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.config.flight import GivenStart
from insgnss.config.library import filter_config
from insgnss.errors import MeasurementError
from insgnss.filter.own_rows.declared import own_measurements
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import Measurement
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import run_blocks
from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.flight import FlightInMemory
from insgnss.report.digest import digest
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from insgnss.simulation.faults import outage, range_ramp
from insgnss.simulation.sample_trajectories import AIRFIELD, static
from insgnss.simulation.simulated_log import Simulator
from insgnss.status import NAMES
from insgnss.tables import Float64, Int64
from tests.filter.test_engine import epochs, no_delay, stream
from tests.runs.own_kinds import Compass, MapHeight, ZeroVelocity
from tests.runs.scenes import (
    START_NS,
    START_S,
    WEEK,
    even_sky,
    flight,
    kinds,
    row_at,
    simulator,
    true_start,
    turns,
    with_faults,
    without_samples,
)
from tests.runs.test_heading_at_rest import CONSUMER
from tests.statistics_bounds import mean_chi_square_bounds, share_below_bounds

REST_S = 130.0
GONE = (60.0, 120.0)  # seconds from the start in which all satellites are gone
SEEDS = 10
FEW_SEEDS = 4  # of rests that need no bounds


def ticks(first_s: float, last_s: float, every_s: float = 1.0) -> Int64:
    """Return times from the simulation's start on [ns]."""
    return START_NS + np.round(np.arange(first_s, last_s + 1e-9, every_s) * 1e9).astype(np.int64)


@cache
def parked() -> Simulator:
    """Return a vehicle at rest with a telephone's sensors, all satellites gone for a minute."""
    base = simulator(static(REST_S, *AIRFIELD), REST_S, navigation=even_sky(), grade=CONSUMER)
    return with_faults(base, [outage(None, *GONE)])


def given_start(base: Simulator) -> GivenStart:
    return true_start(base, 2.0)


def zero_velocity(rng: np.random.Generator, sigma_mps: float = 0.02) -> ZeroVelocity:
    times_ns = ticks(61.3, 119.3)
    return ZeroVelocity(times_ns, sigma_mps * rng.standard_normal((len(times_ns), 3)), sigma_mps)


# ------------------------------------------------------------------------------------------- what a kind is worth


@cache
def rests(with_rows: bool) -> tuple[Float64, Float64, list[Run]]:
    """Return horizontal errors and their sigmas (seeds, 2) [m] at the end of the outage, and the runs."""
    errors, sigmas, runs = [], [], []
    base = parked()
    for seed in range(SEEDS if with_rows else FEW_SEEDS):
        rng = np.random.default_rng([17, seed])
        flown = flight(base, base.draw(rng), start=given_start(base))
        measurements = [zero_velocity(rng)] if with_rows else []
        run = insgnss.replay(flown, output=1.0, measurements=measurements)
        assert run.errors is not None
        at = run.errors[(run.errors["time_s"] - START_S - 119.0).abs() < 1e-6].iloc[0]
        errors.append([at["d_n_m"], at["d_e_m"]])
        sigmas.append([at["sd_n_m"], at["sd_e_m"]])
        runs.append(run)
    return np.array(errors), np.array(sigmas), runs


def test_minute_without_satellites_at_rest_does_not_drift_with_zero_velocities() -> None:
    """59 s after the last epoch: tens of metres without, about a metre with rows of 0.02 m/s once a second."""
    free, sd_free, _ = rests(with_rows=False)
    held, sd_held, _ = rests(with_rows=True)

    assert np.sqrt(np.mean(free**2)) > 10.0
    assert np.sqrt(np.mean(held**2)) < 1.5
    assert (sd_held < 2.0).all() and (sd_free > 10.0).all()


def test_errors_in_the_outage_are_as_large_as_their_sigma() -> None:
    held, sigma, _ = rests(with_rows=True)
    low, high = mean_chi_square_bounds(1, held.size)
    ratio2 = np.mean((held / sigma) ** 2)

    assert max(low, 0.25) < ratio2 < min(high, 2.25), ratio2


def test_normalised_innovations_of_own_rows_are_chi_square() -> None:
    _, _, runs = rests(with_rows=True)
    nis = np.concatenate(
        [run.measurements.query("kind == 'zero_velocity'")["nis"].to_numpy() for run in runs]
    )
    low, high = mean_chi_square_bounds(1, len(nis))
    share = share_below_bounds(0.95, len(nis))

    assert len(nis) == SEEDS * 59 * 3
    assert low < nis.mean() < high
    assert share[0] < np.mean(nis < 3.841) < share[1]


def test_outage_is_told_to_be_one_of_gnss_alone() -> None:
    run, free = rests(with_rows=True)[2][0], rests(with_rows=False)[2][0]
    told = {which.events.set_index("kind")["detail"]["no_measurements"] for which in (run,)}
    assert told == {"no GNSS measurement is used: inertial samples and zero_velocity alone"}
    assert "coasts" in free.events.set_index("kind")["detail"]["no_measurements"]


def at_rest_unknown(measurements: list[Measurement], seed: int = 1) -> Run:
    """Return a run that starts by itself at rest, with twelve headings open."""
    base = simulator(static(100.0, *AIRFIELD), 100.0, navigation=even_sky(), grade=CONSUMER)
    return insgnss.replay(flight(base, base.draw(np.random.default_rng(seed))), measurements=measurements)


@pytest.mark.parametrize("seed", range(4))
def test_heading_rows_decide_between_the_open_headings(seed: int) -> None:
    base = simulator(static(100.0, *AIRFIELD), 100.0, navigation=even_sky(), grade=CONSUMER)
    times_ns, sigma = ticks(20.25, 60.25), np.radians(10.0)
    yaw = np.radians(true_start(base, 2.0).rpy_deg[2])
    noise = np.random.default_rng([3, seed]).standard_normal(len(times_ns))
    run = at_rest_unknown([Compass(times_ns, yaw + sigma * noise, sigma)], seed)

    assert run.errors is not None
    before = run.errors[run.errors["time_s"] < START_S + 20.0]
    last = run.errors[run.errors["time_s"] <= START_S + 61.0].iloc[-1]
    assert before["sd_yaw_deg"].min() > 90.0
    assert last["sd_yaw_deg"] < 4.0  # 41 rows of 10 deg, and the drift of the gyro
    assert abs(last["d_yaw_deg"]) < 3.5 * last["sd_yaw_deg"]
    assert {"heading_single", "heading_known"} <= set(kinds(run))
    assert START_S + 20.25 <= (run.heading_known_s() or 0.0) < START_S + 40.0


def test_rows_that_say_nothing_of_the_heading_do_not_choose_one_at_rest() -> None:
    """Zero velocities for 80 s: the headings' velocities differ by the sensors' noise alone."""
    times_ns = ticks(15.0, 95.0, 0.5)
    noise = 0.005 * np.random.default_rng(5).standard_normal((len(times_ns), 3))
    run = at_rest_unknown([ZeroVelocity(times_ns, noise, 0.005)])

    assert run.nav["sd_yaw_deg"].min() > 90.0
    assert not {"heading_single", "heading_known"} & set(kinds(run))
    assert run.status_counts().loc["used", "zero_velocity"] > 450


# ------------------------------------------------------------------------------------------------ ledger and report


def heights(base: Simulator, times_ns: Int64, sigma_m: float, seed: int = 8) -> MapHeight:
    """Return noisy heights of the truth."""
    seconds = (times_ns - START_NS) * 1e-9
    truth = [true_start(base, float(s)).h_m for s in seconds]
    noise = np.random.default_rng(seed).standard_normal(len(times_ns))
    return MapHeight(times_ns, np.array(truth) + sigma_m * noise, sigma_m)


@cache
def flown_with_heights() -> tuple[FlightInMemory, MapHeight, Run]:
    """Return turns with heights before the samples, before the start, between epochs, at them, after all."""
    base = with_faults(turns(60.0), [outage(None, 30.0, 40.0)])
    flown = flight(base)
    inside = heights(base, ticks(0.5, 59.5, 0.5), 2.0)
    times_ns = np.concatenate([ticks(-3.0, -2.0), inside.times_ns, ticks(70.0, 71.0)])
    own = dataclasses.replace(inside, times_ns=times_ns, h_m=np.pad(inside.h_m, 2))
    return flown, own, insgnss.replay(flown, measurements=[own])


def test_every_row_stands_in_the_ledger_with_what_became_of_it() -> None:
    flown, own, run = flown_with_heights()
    ledger = run.measurements
    mine = ledger[ledger["kind"] == "map_height"]

    np.testing.assert_allclose(mine["time_s"], (own.times_ns - START_NS) * 1e-9 + START_S, atol=1e-9)
    assert (mine["sv"] == "").all() and (mine["signal"] == "").all()
    start_s = run.nav["time_s"].iloc[0]
    status = mine["status"].to_numpy(dtype=str)
    times_s = mine["time_s"].to_numpy()
    outside = (times_s < START_S) | (times_s > START_S + 60.0)
    assert (status[outside] == "no_imu").all() and outside.sum() == 4
    assert (status[~outside & (times_s <= start_s)] == "not_started").all()
    assert (status[~outside & (times_s > start_s)] == "used").all()
    assert np.isfinite(mine[mine["status"] == "used"][["innovation", "nis"]].to_numpy()).all()
    assert mine[mine["status"] != "used"][["innovation", "nis"]].isna().to_numpy().all()
    assert (np.diff(ledger["time_s"]) >= 0.0).all()
    n_gnss = len(ledger) - len(mine)
    assert n_gnss == len(insgnss.replay(flown).measurements)


def test_own_rows_tell_what_their_sigma_says() -> None:
    flown, own, run = flown_with_heights()
    plain = insgnss.replay(flown, output=[START_S + 39.5])
    told = insgnss.replay(flown, output=[START_S + 39.5], measurements=[own])
    assert told.nav["sd_d_m"].iloc[0] < 0.9 * plain.nav["sd_d_m"].iloc[0]
    nis = run.nis_summary().loc["map_height"]
    low, high = mean_chi_square_bounds(1, int(nis["used"]))
    assert low < nis["mean_nis"] < high


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_run_with_own_rows_comes_back_from_its_folder(tmp_path: Path, form: str) -> None:
    _, own, run = flown_with_heights()
    run.save(tmp_path / "run", form)  # type: ignore[arg-type]
    back = insgnss.Run.load(tmp_path / "run")
    pd.testing.assert_frame_equal(back.measurements, run.measurements)
    described = {"name": "map_height", "times": len(own.times_ns), "gate_sigma": None, "unit": "m"}
    assert back.settings["measurements"][0].items() >= described.items()
    pd.testing.assert_frame_equal(back.nis_summary(), run.nis_summary())


def test_report_and_comparison_know_own_rows_and_no_satellite_of_that_name(tmp_path: Path) -> None:
    flown, _, run = flown_with_heights()
    page = run.report(tmp_path / "run.html").read_text(encoding="utf-8")
    assert "Innovations: map height" in page
    assert "chart-nis-map_height" not in page
    plain = insgnss.replay(flown)
    assert "measurements[0].name" in str(insgnss.compare(plain, run))
    assert digest(run)["measurements"]["map_height"]["used"] > 100
    assert digest(run)["satellites_used"] == digest(plain)["satellites_used"]


def test_rows_without_a_gnss_epoch_move_an_output_between_the_samples_as_one_at_them() -> None:
    """What the filter is asked for changes nothing of it: 'imu', a rate, times; each row after the own row it meets."""
    flown, own, _ = flown_with_heights()
    times_s = [START_S + s for s in (31.0, 31.5, 31.503, 39.5)]
    runs = [insgnss.replay(flown, output=output, measurements=[own]) for output in ("imu", 2.0, times_s)]
    by_time = [run.nav.set_index(run.nav["time_s"].round(6)) for run in runs]
    for time_s in np.round([START_S + 31.5, START_S + 39.5], 6):
        pd.testing.assert_series_equal(by_time[0].loc[time_s], by_time[1].loc[time_s])
        pd.testing.assert_series_equal(by_time[0].loc[time_s], by_time[2].loc[time_s])
    apart = by_time[2]["h_m"].to_numpy()
    before = by_time[0].loc[np.round(START_S + 31.49, 6)]
    assert by_time[2]["sd_d_m"].iloc[1] < before["sd_d_m"]
    assert abs(apart[2] - apart[1]) < 0.1


@pytest.mark.parametrize("output", ["gnss", 10.0])
def test_covariances_of_rows_after_own_rows_are_those_behind_their_sigmas(output: str | float) -> None:
    flown, own, _ = flown_with_heights()
    run = insgnss.replay(flown, output=output, covariance=True, measurements=[own])  # type: ignore[arg-type]
    np.testing.assert_allclose(np.sqrt(run.nav["cov_d_d_m2"]), run.nav["sd_d_m"], rtol=1e-9)


def test_defect_in_a_users_code_ends_the_replay_with_its_own_error() -> None:
    flown, own, _ = flown_with_heights()

    class Broken(MapHeight):
        def rows(self, state: insgnss.StateEstimate, layout: insgnss.StateLayout) -> tuple:  # type: ignore[type-arg]
            raise KeyError(state.t_ns)

    with pytest.raises(MeasurementError, match=r"'map_height' at .* s of the week") as raised:
        insgnss.replay(flown, measurements=[Broken(own.times_ns, own.h_m, 1.0)])
    assert isinstance(raised.value.__cause__, KeyError)


# ------------------------------------------------------------------------------------------------------------ live


def batch(setup: FilterSetup, flown: FlightInMemory) -> tuple[dict[int, bytes], list[OwnEntry]]:
    """Return each epoch's navigation row in bytes, and the entries of own rows."""
    entries: list[OwnEntry] = []
    rows = setup.rows(flown.logs.gnss, setup.navigation)
    out, _, _ = run_blocks(setup, flown.logs.imu, [rows], "gnss", own=entries)
    nav = out.nav[: out.counts[0].nav]
    return {int(row["t_ns"]): row.tobytes() for row in nav}, entries


def assert_stream_is_batch(flown: FlightInMemory, own: list[Measurement], delays_ns: Iterator[int]) -> None:
    setup = setup_filter(flown, flown.logs, filter_config("tight"))
    engine = insgnss.Engine(setup, measurements=own)
    stream(engine, flown.logs, delays_ns)
    early = engine.take_measurements()
    results = engine.take_results(all_of_them=True)
    entries = [*early, *engine.take_measurements(all_of_them=True)]
    nav, wanted = batch(dataclasses.replace(setup, own=own_measurements(own)), flown)
    written = {r.t_ns: r.out.nav[0].tobytes() for r in results if r.out.counts[0].nav == 1}
    assert written == nav and len(nav) > 20
    assert len(early) > 10
    # NaN is not equal to itself
    assert [str(entry) for entry in entries] == [str(entry) for entry in wanted]


def random_delays() -> Iterator[int]:
    """Yield delays below the latency."""
    rng = np.random.default_rng(4)
    while True:
        yield int(rng.integers(0, 990_000_000))


@pytest.mark.parametrize(("start", "delays"), [("automatic", random_delays), ("given", no_delay)])
def test_stream_with_own_rows_gives_the_bits_of_replay(start: str, delays: object) -> None:
    """Rows between epochs and samples, at them, in an outage of 15 s, and after the last epoch."""
    base = with_faults(turns(75.0), [outage(None, 40.0, 55.0), outage(None, 72.0, 76.0)])
    begin = given_start(base) if start == "given" else None
    flown = flight(base, start=begin)
    times_ns = np.concatenate([ticks(0.5, 74.5, 0.5), ticks(33.003, 74.0)])
    times_ns = np.unique(times_ns)
    own = heights(base, times_ns, 2.0)
    assert callable(delays)
    assert_stream_is_batch(flown, [own], delays())


def test_stream_over_a_gap_in_the_samples_gives_the_bits_of_replay() -> None:
    base = with_faults(turns(75.0), [outage(None, 72.0, 76.0)])  # none is late beyond the last sample
    log = base.draw(np.random.default_rng(1))
    flown = flight(base, log, imu=without_samples(log.imu, 35.0, 44.0))
    assert_stream_is_batch(flown, [heights(base, ticks(0.25, 74.5, 0.5), 2.0)], random_delays())


def test_stream_with_open_headings_that_own_rows_resolve_gives_the_bits_of_replay() -> None:
    base = with_faults(
        simulator(static(60.0, *AIRFIELD), 60.0, navigation=even_sky(), grade=CONSUMER),
        [outage(None, 20.5, 45.5)],
    )
    yaw = np.full(35, np.radians(true_start(base, 2.0).rpy_deg[2]))
    own = Compass(ticks(22.25, 56.25), yaw, np.radians(8.0))
    assert_stream_is_batch(flight(base), [own], no_delay())


def test_state_of_the_engine_in_an_outage_has_the_rows_that_the_samples_have_reached() -> None:
    """To 1e-12: gravity in the covariance's last part is that of a second earlier where the filter has settled."""
    flown, own, _ = flown_with_heights()
    setup = setup_filter(flown, flown.logs, filter_config("tight"))
    wanted = insgnss.replay(flown, output="imu", measurements=[own]).nav
    wanted = wanted.set_index(np.round((wanted["time_s"] - START_S) * 100.0).astype(int))
    engine, tables, compared = insgnss.Engine(setup, measurements=[own]), epochs(flown.logs.gnss), 0
    by_time = {int(table.t_ns[0]): table for table in tables}
    for t_ns, w, f in zip(flown.logs.imu.t_ns, flown.logs.imu.w_ib_b, flown.logs.imu.f_b, strict=True):
        engine.imu(int(t_ns), w, f)
        if int(t_ns) in by_time:
            engine.gnss(by_time[int(t_ns)])
        step = round((int(t_ns) - START_NS) / 1e7)
        if 3100 < step < 3900 and step % 25 == 1:
            values = engine.state.values
            row = wanted.loc[step]
            np.testing.assert_allclose(
                list(values.values()), row[list(values)], rtol=1e-12, err_msg=str(step)
            )
            compared += 1
    assert compared == 32


# ------------------------------------------------------------------------------------------------ others that look on


def test_satellite_that_creeps_is_found_beside_own_rows() -> None:
    """The last minute is run once more with them: what they tell is in both of what is compared."""
    base = with_faults(turns(120.0), [range_ramp("G10", 3.0, 60.0)])
    flown = flight(base)
    own = heights(base, ticks(0.25, 119.5, 0.5), 1.0)
    plain, told = insgnss.replay(flown), insgnss.replay(flown, measurements=[own])
    for run in (plain, told):
        late = run.measurements.query("sv == 'G10' and kind == 'pseudorange' and time_s > @START_S + 90.0")
        assert (late["status"] != "used").all()
        assert not {"reset", "restart", "lockout"} & set(kinds(run))


def test_week_and_place_of_the_scenario_are_those_of_the_flight() -> None:
    flown, own, _ = flown_with_heights()
    np.testing.assert_array_equal(
        flown.gps_ns([START_S, START_S + 0.5]), START_NS + np.array([0, 500_000_000])
    )
    assert flown.gps_ns(1.5) == week_seconds_to_ns(WEEK, 1.5)
    assert NAMES and own.name == "map_height" and row_at(flown_with_heights()[2], 50.0)["n_used"] > 4


def test_smoothed_run_uses_own_rows_in_an_outage_and_while_the_heading_was_open() -> None:
    """An automatic start with twelve headings; heights from then on, also for half a minute without satellites."""
    base = with_faults(turns(110.0), [outage(None, 60.0, 90.0)])
    flown = flight(base)
    own = heights(base, ticks(4.25, 109.5, 0.5), 1.0)
    plain = insgnss.replay(flown, smooth=True, output=2.0)
    told = insgnss.replay(flown, smooth=True, output=2.0, measurements=[own])

    assert plain.errors is not None and told.errors is not None and told.filtered is not None
    since_s = told.errors["time_s"] - START_S
    gone = since_s.between(60.0, 90.0).to_numpy()
    assert np.sqrt((told.errors["d_d_m"][gone] ** 2).mean()) < 0.7
    assert told.errors["sd_d_m"][gone].max() < 0.6 * plain.errors["sd_d_m"][gone].max()
    for name in ("n_m", "e_m", "d_m", "vn_mps", "ve_mps", "vd_mps", "roll_deg", "pitch_deg", "yaw_deg"):
        ratio2 = float(((told.errors[f"d_{name}"] / told.errors[f"sd_{name}"])[gone] ** 2).mean())
        assert ratio2 < 5.0, (name, ratio2)
    early = since_s.between(5.0, 25.0).to_numpy()
    assert told.errors["sd_yaw_deg"][early].max() < 5.0  # the one heading that was found has gone over them
    assert (
        told.filtered["sd_d_m"].to_numpy() >= told.nav["sd_d_m"].to_numpy()[: len(told.filtered)] - 1e-9
    ).all()


def test_aiding_in_an_outage_rests_on_own_rows() -> None:
    flown, own, _ = flown_with_heights()
    plain = insgnss.replay(flown, aiding=2.0)
    told = insgnss.replay(flown, aiding=2.0, measurements=[own])
    assert plain.aiding is not None and told.aiding is not None
    high, lower = (
        table[table["time_s"].between(START_S + 39.01, START_S + 39.99)]
        for table in (plain.aiding, told.aiding)
    )
    assert len(high) == len(lower) > 10
    assert lower["sd_pseudorange_m"].mean() < high["sd_pseudorange_m"].mean()
