"""Carrier phases and a second frequency: the pseudorange's path with the ionosphere turned round, and whole cycles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insgnss.config.flight import Gnss
from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.gnss.signals import L1_HZ, L5_HZ
from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.gnss_csv import read_gnss
from insgnss.simulation import sample_trajectories
from insgnss.simulation.atmosphere import broadcast_atmosphere
from insgnss.simulation.faults import carrier_alone, carrier_without_clock_step, cycle_slip, half_cycle
from insgnss.simulation.log_files import write_gnss
from insgnss.simulation.observations import (
    Fault,
    NoiseTerms,
    SignalObservations,
    SimulatedReceiver,
    antenna_motion,
    observe,
    signal_paths,
    to_table,
)
from insgnss.simulation.oscillator import ClockTruth
from insgnss.simulation.sky import PAPER_SKY, constellation_over
from insgnss.simulation.trajectory import Trajectory
from tests.statistics_bounds import assert_mean_chi_square

WEEK = 2385
START_NS = int(week_seconds_to_ns(WEEK, 293_700.0))
NAVIGATION = constellation_over(
    sample_trajectories.AIRFIELD, PAPER_SKY, START_NS, 1200.0, int(week_seconds_to_ns(WEEK, 295_200.0))
)
EPH = NAVIGATION.ephemerides
N = len(EPH.sv_names)
TAGS = np.arange(1.0, 119.0, 2.0)
CLOCK = ClockTruth(TAGS, 9.0e4 + 50.0 * TAGS, np.full_like(TAGS, 50.0))
BOTH = ("C1C", "C5Q")
WAVELENGTH_M = np.repeat([C_MPS / L1_HZ, C_MPS / L5_HZ], N)
NOISE = NoiseTerms(0.0015, 0.0007, 0.0015)
WITH_CARRIER = SimulatedReceiver(signals=BOTH, carrier_noise=NOISE)


@pytest.fixture(scope="module")
def flight() -> Trajectory:
    return sample_trajectories.airborne_turns(120.0)


def observed(
    flight: Trajectory, receiver: SimulatedReceiver = WITH_CARRIER, *faults: Fault, seed: int | None = None
) -> SignalObservations:
    rng = None if seed is None else np.random.default_rng(seed)
    return observe(flight, EPH, START_NS, CLOCK, receiver, rng, faults)


def phase_m(seen: SignalObservations) -> np.ndarray:
    assert seen.carrier_cycles is not None
    return np.asarray(seen.carrier_cycles * WAVELENGTH_M)


def test_carrier_without_noise_is_the_pseudorange_less_a_constant_for_each_satellite(
    flight: Trajectory,
) -> None:
    seen = observed(flight)
    apart = phase_m(seen) - seen.pseudorange_m
    # in vacuum only the group delay lies between them; 1e8 cycles are rounded to 3 nm
    assert np.ptp(apart, axis=0).max() < 1e-6
    assert apart[0, :N] == pytest.approx(-C_MPS * EPH.group_delay_s[:, 0], abs=1e-6)


def test_ionosphere_delays_the_code_and_advances_the_carrier_by_the_square_of_the_wavelength(
    flight: Trajectory,
) -> None:
    with_sky = replace(WITH_CARRIER, atmosphere=broadcast_atmosphere(NAVIGATION.klobuchar))
    dry = replace(WITH_CARRIER, atmosphere=broadcast_atmosphere(None))
    a, b = observed(flight, with_sky), observed(flight, dry)
    code, carrier = a.pseudorange_m - b.pseudorange_m, phase_m(a) - phase_m(b)
    assert code[:, :N].min() > 1.0
    assert carrier == pytest.approx(-code, abs=1e-6)
    assert code[:, N:] == pytest.approx(code[:, :N] * (L1_HZ / L5_HZ) ** 2, abs=1e-6)


def test_carriers_noise_has_the_stated_sigma_and_its_ambiguities_are_whole(flight: Trajectory) -> None:
    clean, noisy = observed(flight), observed(flight, seed=3)
    assert clean.carrier_cycles is not None and noisy.carrier_cycles is not None
    added = noisy.carrier_cycles - clean.carrier_cycles
    ambiguity = np.rint(added.mean(axis=0))
    assert len(np.unique(ambiguity)) == 2 * N
    paths = signal_paths(antenna_motion(flight, CLOCK.true_s, (0.0, 0.0, 0.0)), EPH, START_NS, CLOCK.true_s)
    sigma = NOISE.sigma(np.tile(paths.elevation, 2), noisy.cn0_dbhz)
    assert_mean_chi_square(((added - ambiguity) * WAVELENGTH_M / sigma) ** 2, 1)


def test_carrier_does_not_change_a_bit_of_the_other_observations(flight: Trajectory) -> None:
    """So what was simulated before carriers were is still what is simulated without them."""
    with_carrier = observed(flight, replace(WITH_CARRIER, signals=("C1C",)), seed=5)
    without = observed(flight, SimulatedReceiver(), seed=5)
    assert without.carrier_cycles is None and to_table(without, START_NS).carrier_cycles is None
    for name in ("pseudorange_m", "range_rate_mps", "cn0_dbhz"):
        assert np.array_equal(getattr(with_carrier, name), getattr(without, name))


def test_table_of_two_signals_names_each_row(flight: Trajectory) -> None:
    seen = observed(flight, seed=1)
    table = to_table(seen, START_NS)
    assert table.sv_names == EPH.sv_names and table.signal_names == BOTH
    assert len(table.t_ns) == 2 * N * len(TAGS)
    assert table.carrier_cycles is not None and table.lli is not None
    of_l5 = table.signal == 1
    wavelength = np.where(of_l5, C_MPS / L5_HZ, C_MPS / L1_HZ)
    at = np.searchsorted(TAGS, (table.t_ns - START_NS) / 1e9 - 1e-6), table.sv + N * table.signal
    assert np.array_equal(table.carrier_cycles, seen.carrier_cycles[at])
    assert -table.doppler_hz * wavelength == pytest.approx(seen.range_rate_mps[at], abs=1e-9)


def added_cycles(flight: Trajectory, *faults: Fault) -> tuple[np.ndarray, np.ndarray]:
    """Return what faults add to the carriers [cycles] and the indicators, both (m, 2 n)."""
    clean, faulty = observed(flight), observed(flight, WITH_CARRIER, *faults)
    assert faulty.carrier_cycles is not None and clean.carrier_cycles is not None and faulty.lli is not None
    return np.round(faulty.carrier_cycles - clean.carrier_cycles, 6), faulty.lli


def test_cycle_slip_stays_from_its_tag_on_and_is_indicated_once(flight: Trajectory) -> None:
    added, lli = added_cycles(flight, cycle_slip(["G04"], 5.0, 40.0, signal="C5Q", indicated=True))
    column = N + EPH.sv_names.index("G04")
    assert np.array_equal(added[:, column], np.where(TAGS >= 40.0, 5.0, 0.0))
    assert np.count_nonzero(added) == np.count_nonzero(TAGS >= 40.0)
    assert np.argwhere(lli).tolist() == [[int(np.searchsorted(TAGS, 40.0)), column]]
    assert not added_cycles(flight, cycle_slip(["G04"], 5.0, 40.0))[1].any()


def test_half_cycle_is_flagged_for_as_long_as_it_lasts(flight: Trajectory) -> None:
    added, lli = added_cycles(flight, half_cycle(["G10"], 20.0, 30.0))
    inside = np.outer((TAGS >= 20.0) & (TAGS < 30.0), np.isin(EPH.sv_names * 2, ["G10"]))
    assert np.array_equal(added, 0.5 * inside) and np.array_equal(lli, 2 * inside)


def test_carrier_that_does_not_follow_the_clocks_step_goes_straight_on(flight: Trajectory) -> None:
    added, _ = added_cycles(flight, carrier_without_clock_step(60.0, 300.0))
    assert added * WAVELENGTH_M == pytest.approx(np.where(TAGS >= 60.0, -300.0, 0.0)[:, None] + 0.0 * added)


def test_carrier_alone_leaves_the_other_cells_of_its_row_empty(flight: Trajectory) -> None:
    seen = observed(flight, WITH_CARRIER, carrier_alone(["G13"], 10.0, 20.0))
    table = to_table(seen, START_NS)
    bare = np.isnan(table.pseudorange_m)
    assert np.count_nonzero(bare) == 2 * np.count_nonzero((TAGS >= 10.0) & (TAGS < 20.0))
    assert np.array_equal(bare, np.isnan(table.doppler_hz))
    assert table.carrier_cycles is not None and np.isfinite(table.carrier_cycles).all()


def test_fault_of_the_carrier_without_a_carrier_is_told(flight: Trajectory) -> None:
    with pytest.raises(ConfigError, match="logs it"):
        observed(flight, SimulatedReceiver(), cycle_slip(["G04"], 1.0, 40.0))


def test_carriers_are_read_back_from_the_file(flight: Trajectory, tmp_path: Path) -> None:
    table = to_table(observed(flight, WITH_CARRIER, half_cycle(["G10"], 20.0, 30.0), seed=2), START_NS)
    write_gnss(tmp_path / "gnss.csv", table, WEEK)
    read = read_gnss(Gnss(files=(tmp_path / "gnss.csv",)), WEEK)[0]
    assert read.carrier_cycles is not None and table.carrier_cycles is not None
    assert read.carrier_cycles == pytest.approx(table.carrier_cycles, abs=5.1e-4)
    assert np.array_equal(read.lli, table.lli)


def test_range_rate_is_the_carriers_own_derivative_with_the_airs(flight: Trajectory) -> None:
    """Ionosphere with the phase's sign and troposphere: millimetres per second even at 20 deg of elevation."""
    tags = np.arange(10.0, 110.0, 5.0)
    air = broadcast_atmosphere(np.array([1.1e-8, 1.5e-8, -6e-8, -1.2e-7, 9e4, 1.3e5, -6.5e4, -5.2e5]))
    receiver = replace(WITH_CARRIER, atmosphere=air)
    path_m = []
    for step in (-0.01, 0.01):
        clock = ClockTruth(tags + step, 9.0e4 + 50.0 * (tags + step), np.full_like(tags, 50.0))
        seen = observe(flight, EPH, START_NS, clock, receiver, None)
        assert seen.carrier_cycles is not None
        path_m.append(seen.carrier_cycles * WAVELENGTH_M)
    clock = ClockTruth(tags, 9.0e4 + 50.0 * tags, np.full_like(tags, 50.0))
    rate = observe(flight, EPH, START_NS, clock, receiver, None).range_rate_mps
    empty = observe(flight, EPH, START_NS, clock, WITH_CARRIER, None).range_rate_mps

    slope = (path_m[1] - path_m[0]) / 0.02
    # the flight's jerk over 0.01 s, the product of clock drift and range rate, and the rounding of 2e7 m
    assert np.max(np.abs(rate - slope)) < 2e-4
    assert np.max(np.abs(rate - empty)) > 2e-3
