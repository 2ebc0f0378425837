"""Carriers that slip, step, stop or are something else: no run is dragged, the ledger says why, nothing is lost.

The flight is that of ``test_faults``: an aircraft at 100 m/s, 10 s straight and then turns. The velocity with carriers
is good to millimetres per second, so a slip of a single cycle that got in would show as ten of its sigmas.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import insgnss
from insgnss.constants import C_MPS
from insgnss.gnss.signals import L1_HZ, L5_HZ
from insgnss.runs.result import Run
from insgnss.simulation.faults import (
    carrier_alone,
    carrier_without_clock_step,
    cycle_slip,
    half_cycle,
    range_step,
)
from insgnss.simulation.observations import Fault, NoiseTerms
from insgnss.simulation.oscillator import MILLISECOND_M
from insgnss.simulation.simulated_log import ClockStart, Simulator
from insgnss.tables import GnssTable
from tests.runs.scenes import (
    START_NS,
    START_S,
    FlightInMemory,
    after,
    assert_honest,
    assert_sound,
    flight,
    kinds,
    paper_sky,
    rows_where,
    turns,
    with_faults,
)

PHASE_NOISE = NoiseTerms(floor=0.0015, elevation=0.0007, cn0=0.0015)
AT_S, SETTLED_S = 60.0, 30.0
HEADING_FOUND_S = 15.0  # in the second in which it is found, its sigma may be several times too small
ALL = paper_sky().ephemerides.sv_names
ONE, THREE, MOST = ("G13",), ("G13", "G04", "G20"), ("G13", "G04", "G20", "G23", "G30", "G32")
GOOD_MPS = 0.012  # largest component of the velocity's error, of 270 after the first turn: 4 sigmas of 3 mm/s
L5_OVER_L1 = L5_HZ / L1_HZ


def faulty(*faults: Fault, signals: tuple[str, ...] = ("C1C",), clock: ClockStart | None = None) -> Simulator:
    """Return the flight with carriers and with faults."""
    base = with_faults(turns(), faults, clock)
    receiver = dataclasses.replace(base.scenario.receiver, signals=signals, carrier_noise=PHASE_NOISE)
    base.scenario = dataclasses.replace(base.scenario, receiver=receiver)
    return base


def replayed(simulator: Simulator, change: Callable[[GnssTable], GnssTable] | None = None) -> Run:
    """Return the run of a drawn log after what must hold whatever was wrong; ``change`` spoils the table."""
    log = simulator.draw(np.random.default_rng(1))
    flown = flight(simulator, log, gnss=log.gnss if change is None else change(log.gnss))
    run = insgnss.replay(flown)
    assert_whole(run, flown)
    return run


def assert_whole(run: Run, flown: FlightInMemory) -> None:
    """Fail unless each measurement of the input, carriers too, has one entry in the ledger."""
    assert_sound(run, flown)
    cycles = flown.logs.gnss.carrier_cycles
    assert cycles is not None
    counts = run.status_counts()["carrier_difference"]
    assert counts.sum() == np.count_nonzero(~np.isnan(cycles) & (cycles != 0.0))


def assert_not_dragged(run: Run, limit_mps: float = GOOD_MPS, from_s: float = 0.0) -> None:
    assert_honest(run, from_s)
    errors = after(run, SETTLED_S)[["d_vn_mps", "d_ve_mps", "d_vd_mps"]]
    assert errors.abs().to_numpy().max() < limit_mps


def statuses(run: Run, at_s: float, sv: tuple[str, ...] = ALL) -> list[str]:
    """Return the distinct statuses of the carriers of satellites at an epoch."""
    rows = run.measurements
    mine = (rows["kind"] == "carrier_difference") & ((rows["time_s"] - START_S - at_s).abs() < 1e-3)
    return sorted(set(rows.loc[mine & rows["sv"].isin(sv), "status"].astype(str)))


def test_flight_with_carriers_is_right_to_millimetres_per_second() -> None:
    run, bare = replayed(faulty()), insgnss.replay(flight(turns()))
    assert_not_dragged(run)
    names = ["vn_mps", "ve_mps", "vd_mps"]
    rms, rms_bare = (r.error_summary(from_s=START_S + SETTLED_S).loc[names, "rms"] for r in (run, bare))
    assert rms.max() < 0.004 and (rms_bare > 4.0 * rms).all()
    assert kinds(run) == ["start", "heading_single", "heading_known"]


def test_two_frequencies_are_used_and_are_no_worse() -> None:
    run = replayed(faulty(signals=("C1C", "C5Q")))
    assert_not_dragged(run, from_s=HEADING_FOUND_S)
    assert run.status_counts().loc["used", "carrier_difference"] > 2500


@pytest.mark.parametrize("cycles", [0.5, 1.0, -1.0, 5.0, 1000.0])
@pytest.mark.parametrize("sv", [ONE, THREE], ids=["one satellite", "three satellites"])
def test_slip_of_one_frequency_is_refused_where_it_happens(sv: tuple[str, ...], cycles: float) -> None:
    run = replayed(faulty(cycle_slip(sv, cycles, AT_S)))
    assert set(statuses(run, AT_S, sv)) <= {"gated", "slip_doppler"}
    assert statuses(run, AT_S, tuple(set(ALL) - set(sv))) == ["used"]
    assert statuses(run, AT_S + 1.0, tuple(set(ALL) - set(sv))) == ["used"]
    # a slip that the Doppler shows leaves its phase in doubt
    assert set(statuses(run, AT_S + 1.0, sv)) <= {"used", "phase_not_locked"}
    assert statuses(run, AT_S + 3.0) == ["used"]
    assert_not_dragged(run)


@pytest.mark.parametrize("cycles", [1.0, 5.0, 1000.0])
@pytest.mark.parametrize("sv", [MOST, ALL], ids=["six of eleven", "all"])
def test_same_slip_of_most_satellites_is_taken_for_the_clocks_at_worst(
    sv: tuple[str, ...], cycles: float
) -> None:
    """A slip that most share is the clock's step to all that an epoch can know; the velocity is right nevertheless."""
    assert_not_dragged(replayed(faulty(cycle_slip(sv, cycles, AT_S))))


@pytest.mark.parametrize("cycles", [1.0, 5.0, 1000.0])
def test_slip_that_the_receiver_indicates_is_refused_by_name(cycles: float) -> None:
    run = replayed(faulty(cycle_slip(THREE, cycles, AT_S, indicated=True)))
    assert statuses(run, AT_S, THREE) == ["slip_indicated"]
    assert_not_dragged(run)


@pytest.mark.parametrize("cycles", [1.0, 5.0])
def test_slip_of_one_carrier_of_two_shows_between_them(cycles: float) -> None:
    run = replayed(faulty(cycle_slip(ONE, cycles, AT_S, signal="C5Q"), signals=("C1C", "C5Q")))
    assert statuses(run, AT_S, ONE) == ["slip_geometry_free"]
    assert_not_dragged(run, from_s=HEADING_FOUND_S)


def test_tenth_of_all_carriers_slipping_all_the_time_does_no_harm() -> None:
    rng = np.random.default_rng(7)

    def slipping(gnss: GnssTable) -> GnssTable:
        cycles = np.array(gnss.carrier_cycles)
        for sv in range(len(gnss.sv_names)):
            own = np.flatnonzero(gnss.sv == sv)
            cycles[own] += np.cumsum((rng.random(len(own)) < 0.1) * rng.integers(-3, 4, len(own)))
        return dataclasses.replace(gnss, carrier_cycles=cycles)

    run = replayed(faulty(), slipping)
    assert_not_dragged(run)
    assert run.status_counts().loc["gated", "carrier_difference"] > 60


@pytest.mark.parametrize("size_m", [MILLISECOND_M, -MILLISECOND_M, 100.0, 5.0])
@pytest.mark.parametrize("follows", [True, False], ids=["phase steps too", "phase goes on"])
def test_step_of_the_receiver_clock_costs_the_carriers_an_epoch_at_most(size_m: float, follows: bool) -> None:
    clock = dataclasses.replace(turns().scenario.clock, jumps=((AT_S, size_m),))
    faults = () if follows else (carrier_without_clock_step(AT_S, size_m),)
    run = replayed(faulty(*faults, clock=clock))
    assert statuses(run, AT_S + 1.0) == ["used"]
    assert set(statuses(run, AT_S)) <= {"clock_stepped", "gated", "bad_value", "used"}
    assert_not_dragged(run)


def test_carriers_alone_that_step_by_a_millisecond_are_refused_for_an_epoch() -> None:
    run = replayed(faulty(carrier_without_clock_step(AT_S, -MILLISECOND_M)))
    assert set(statuses(run, AT_S)) <= {"gated", "bad_value"}
    assert statuses(run, AT_S + 1.0) == ["used"]
    assert_not_dragged(run)


@pytest.mark.parametrize("flagged", [True, False])
def test_half_cycle_is_used_within_and_refused_at_its_ends(flagged: bool) -> None:
    run = replayed(faulty(half_cycle(THREE, 50.0, 60.0, flagged=flagged)))
    for end in (50.0, 60.0):
        assert statuses(run, end, THREE) == ["half_cycle" if flagged else "gated"]
    assert statuses(run, 55.0, THREE) == ["used"]
    assert_not_dragged(run)


def without_window(from_s: float, to_s: float) -> Callable[[GnssTable], GnssTable]:
    """Return what takes the epochs of a window out of a table."""

    def change(gnss: GnssTable) -> GnssTable:
        t = (gnss.t_ns - START_NS) / 1e9
        return rows_where(gnss, ~((t > from_s - 0.01) & (t < to_s - 0.01)))

    return change


def test_missing_epoch_is_bridged_by_a_difference_over_two_seconds() -> None:
    run = replayed(faulty(), without_window(60.0, 61.0))
    assert statuses(run, 61.0) == ["used"]
    assert_not_dragged(run)


def test_carriers_wait_an_epoch_after_a_longer_gap() -> None:
    run = replayed(faulty(), without_window(60.0, 63.0))
    assert statuses(run, 63.0) == ["no_epoch_before"] and statuses(run, 64.0) == ["used"]
    assert_not_dragged(run)


def test_carrier_without_pseudorange_is_refused_because_nothing_tells_when_it_was_sent() -> None:
    """The epoch's median flight time would be 10 ms off, 8 m at the window's ends and 1 cm/s within."""
    run = replayed(faulty(carrier_alone(ONE, 50.0, 80.0)))
    assert statuses(run, 50.0, ONE) == statuses(run, 79.0, ONE) == ["no_range"]
    assert statuses(run, 80.0, ONE) == ["no_epoch_before"] and statuses(run, 81.0, ONE) == ["used"]
    assert_not_dragged(run)


def test_half_a_minute_of_carriers_alone_is_coasted_over() -> None:
    run = replayed(faulty(carrier_alone(ALL, 50.0, 80.0)))
    assert statuses(run, 60.0) == ["no_range"]
    assert_not_dragged(run, 0.2)
    assert {"no_measurements", "measurements_back"} <= set(kinds(run))


@pytest.mark.parametrize("size_m", [50.0, MILLISECOND_M])
def test_wrong_pseudorange_does_not_spoil_its_carrier(size_m: float) -> None:
    """A millisecond of wrong flight time is up to 0.8 m in the satellite's distance at both ends of the fault."""
    run = replayed(faulty(range_step("G13", size_m, 60.0, 70.0)))
    assert_not_dragged(run)


def scaled(factor: float) -> Callable[[GnssTable], GnssTable]:
    return lambda gnss: dataclasses.replace(gnss, carrier_cycles=gnss.carrier_cycles * factor)


@pytest.mark.parametrize("doppler", [True, False], ids=["with Doppler", "without"])
@pytest.mark.parametrize(
    "factor", [L5_OVER_L1, -1.0, C_MPS / L1_HZ], ids=["L5 under L1's name", "sign turned", "metres"]
)
def test_carriers_of_another_unit_are_all_refused(factor: float, doppler: bool) -> None:
    def change(gnss: GnssTable) -> GnssTable:
        wrong = scaled(factor)(gnss)
        nothing = np.full(len(gnss.t_ns), np.nan)
        return wrong if doppler else dataclasses.replace(wrong, doppler_hz=nothing)

    run = replayed(faulty(), change)
    counts = run.status_counts()["carrier_difference"]
    assert counts.get("used", 0) < 0.02 * counts.sum()
    assert_honest(run, 0.0)


def test_cells_that_are_no_phases_are_counted_and_refused() -> None:
    rng = np.random.default_rng(5)

    def change(gnss: GnssTable) -> GnssTable:
        absurd = rng.choice([np.inf, -np.inf, 1e300, -1e300, 0.0, np.nan], len(gnss.t_ns))
        spoilt = np.where(rng.random(len(gnss.t_ns)) < 0.3, absurd, gnss.carrier_cycles)
        return dataclasses.replace(gnss, carrier_cycles=spoilt)

    run = replayed(faulty(), change)
    counts = run.status_counts()["carrier_difference"]
    assert counts["bad_value"] > 150 and counts["used"] > 300
    assert_honest(run, 0.0)


@pytest.mark.parametrize("sigma_m", [0.005, 0.01])
def test_carriers_noisier_than_assumed_are_given_less_weight(sigma_m: float) -> None:
    rng = np.random.default_rng(9)

    def change(gnss: GnssTable) -> GnssTable:
        noise = rng.standard_normal(len(gnss.t_ns)) * sigma_m * L1_HZ / C_MPS
        return dataclasses.replace(gnss, carrier_cycles=gnss.carrier_cycles + noise)

    run = replayed(faulty(), change)
    assert run.status_counts().loc["used", "carrier_difference"] > 1000
    assert_honest(run, 0.0)


@pytest.mark.parametrize("seed", [31, 32])
@pytest.mark.parametrize("interval_s", [0.2, 1.0])
def test_phases_that_are_not_locked_and_not_flagged_do_no_harm(interval_s: float, seed: int) -> None:
    """Seven of eleven phases are numbers of a receiver that has lost them: off by 10 m/s from epoch to epoch."""
    unlocked = (*MOST, next(sv for sv in ALL if sv not in MOST))

    def lost(table: GnssTable) -> GnssTable:
        random = np.random.default_rng(seed)
        assert table.carrier_cycles is not None and table.lli is not None
        cycles = table.carrier_cycles.copy()
        for name in unlocked:
            rows = np.flatnonzero(table.sv == table.sv_names.index(name))
            cycles[rows] += np.cumsum(10.0 * interval_s * random.normal(size=len(rows))) * L1_HZ / C_MPS
        return dataclasses.replace(table, carrier_cycles=cycles, lli=np.zeros_like(table.lli))

    base = faulty().scenario
    receiver = dataclasses.replace(base.receiver, rate_hz=1.0 / interval_s)
    run = replayed(Simulator(dataclasses.replace(base, receiver=receiver, duration_s=80.0)), lost)
    assert_not_dragged(run, 5.0 * GOOD_MPS, HEADING_FOUND_S)  # by four carriers
    rows = run.measurements[run.measurements["kind"] == "carrier_difference"]
    is_lost, is_used = rows["sv"].isin(unlocked), rows["status"] == "used"
    assert is_used[is_lost].mean() < 0.01
    assert is_used[~is_lost].mean() > 0.7  # the median of an epoch may be that of a lost one
