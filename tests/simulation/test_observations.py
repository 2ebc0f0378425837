"""Observations are the geometry, the clocks and the delays, to the millimetre, and nothing else."""

from __future__ import annotations

import datetime as dt
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sidereon

from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.gpstime import GPS_EPOCH, week_seconds_to_ns
from insgnss.simulation import sample_trajectories
from insgnss.simulation.atmosphere import broadcast_atmosphere
from insgnss.simulation.faults import outage, range_ramp, range_step, reversed_range_rate
from insgnss.simulation.observations import (
    WAVELENGTH_M,
    NoiseTerms,
    SignalObservations,
    SimulatedReceiver,
    antenna_motion,
    observe,
    signal_paths,
    to_table,
)
from insgnss.simulation.oscillator import ClockTruth
from insgnss.simulation.rinex_nav import write_rinex_navigation
from insgnss.simulation.sky import PAPER_SKY, constellation_over
from insgnss.simulation.trajectory import Trajectory
from insgnss.tables import NavigationData
from tests.statistics_bounds import assert_mean_chi_square

START_NS = int(week_seconds_to_ns(2385, 293_700.0))
NAVIGATION = constellation_over(
    sample_trajectories.AIRFIELD, PAPER_SKY, START_NS, 1200.0, int(week_seconds_to_ns(2385, 295_200.0))
)
EPH = NAVIGATION.ephemerides
TAGS = np.arange(1.0, 119.0, 3.0)
LEVER = (0.8, 0.3, -1.1)


@pytest.fixture(scope="module")
def flight() -> Trajectory:
    return sample_trajectories.airborne_turns(120.0)


def straight_clock(tags: np.ndarray, bias_m: float = 9.0e4, drift_mps: float = 50.0) -> ClockTruth:
    return ClockTruth(tags, bias_m + drift_mps * tags, np.full_like(tags, drift_mps))


def observed(trajectory: Trajectory, clock: ClockTruth, **receiver: object) -> SignalObservations:
    return observe(trajectory, EPH, START_NS, clock, SimulatedReceiver(**receiver), None)  # type: ignore[arg-type]


def independent_pseudorange(
    navigation: NavigationData, trajectory: Trajectory, clock: ClockTruth, file: Path
) -> np.ndarray:
    """Return pseudoranges (m, n) by another road: the file's satellites, turned with the Earth during flight."""
    write_rinex_navigation(file, navigation, dt.datetime(2025, 9, 24))
    broadcast = sidereon.load_rinex_nav(file)
    epoch_s = (
        START_NS - int((dt.datetime(2000, 1, 1, 12) - GPS_EPOCH).total_seconds()) * NS_PER_S
    ) / NS_PER_S
    result = np.empty((len(clock.tag_s), len(EPH.sv_names)))
    for k, (tag, bias) in enumerate(zip(clock.tag_s, clock.bias_m, strict=True)):
        t = tag - bias / C_MPS
        motion = trajectory.motion(np.array([t]))
        antenna = motion.r_e[0] + motion.C_eb[0] @ np.array(LEVER)
        for j, name in enumerate(EPH.sv_names):
            distance = 2.2e7
            for _ in range(6):
                state = sidereon.observable_states_at_j2000_s(
                    broadcast, [name], np.array([epoch_s + t - distance / C_MPS])
                )
                angle = WGS84_OMEGA_RADPS * distance / C_MPS
                c, s = np.cos(angle), np.sin(angle)
                turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ state.positions_ecef_m[0]
                distance = float(np.linalg.norm(turned - antenna))
            group_delay = broadcast.records[j].group_delay_s
            result[k, j] = distance + bias - C_MPS * (state.clocks_s[0] - group_delay)
    return result


def test_pseudorange_without_noise_is_range_and_clocks(flight: Trajectory, tmp_path: Path) -> None:
    clock = straight_clock(TAGS[::8])
    expected = independent_pseudorange(NAVIGATION, flight, clock, tmp_path / "nav.rnx")
    seen = observed(flight, clock, lever_arm_b=LEVER)
    # the other implementation takes seconds since 2000 as one float: 0.1 us, 0.4 mm of satellite motion
    assert seen.pseudorange_m == pytest.approx(expected, abs=2e-3)


def test_range_rate_is_the_derivative_of_the_pseudorange_by_the_tag(flight: Trajectory) -> None:
    h = 0.01
    at, before, after = (observed(flight, straight_clock(TAGS + d), lever_arm_b=LEVER) for d in (0.0, -h, h))
    slope = (after.pseudorange_m - before.pseudorange_m) / (2.0 * h)
    assert (
        np.max(np.abs(slope - at.range_rate_mps)) < 1e-4
    )  # rolling at 0.3 rad/s^2: h^2/6 of the third derivative


def test_doppler_is_positive_when_the_distance_shrinks(flight: Trajectory) -> None:
    seen = observed(flight, straight_clock(TAGS, 0.0, 0.0))
    table = to_table(seen, START_NS)
    assert np.array_equal(table.doppler_hz, -seen.range_rate_mps[seen.tracked] / WAVELENGTH_M)
    shrinking = np.diff(seen.pseudorange_m[:, 0]) < 0.0
    assert np.mean(shrinking == (seen.range_rate_mps[:-1, 0] < 0.0)) > 0.9
    assert np.all(np.isnan(table.range_rate_mps))


def test_the_earths_turn_during_flight_matters(flight: Trajectory) -> None:
    t = TAGS
    antenna = antenna_motion(flight, t, (0.0, 0.0, 0.0))
    paths = signal_paths(antenna, EPH, START_NS, t)
    straight = np.linalg.norm(antenna.r_e[:, None] - paths.satellite.r_e, axis=-1)
    turned = paths.range_m - straight
    r, s = antenna.r_e[:, None], paths.satellite.r_e
    sagnac = WGS84_OMEGA_RADPS / C_MPS * (s[..., 0] * r[..., 1] - s[..., 1] * r[..., 0])
    assert np.max(np.abs(turned)) > 10.0
    assert turned == pytest.approx(sagnac, abs=1e-3)


def test_the_lever_arm_moves_range_and_range_rate_and_zero_is_the_imu(flight: Trajectory) -> None:
    clock = straight_clock(TAGS, 0.0, 0.0)
    bare, with_arm = observed(flight, clock), observed(flight, clock, lever_arm_b=LEVER)
    motion = flight.motion(TAGS)
    paths = signal_paths(antenna_motion(flight, TAGS, (0.0, 0.0, 0.0)), EPH, START_NS, TAGS)
    towards = paths.satellite.r_e - motion.r_e[:, None]
    towards /= np.linalg.norm(towards, axis=-1)[..., None]
    moved = -np.einsum("mnj,mj->mn", towards, motion.C_eb @ np.array(LEVER))
    assert with_arm.pseudorange_m - bare.pseudorange_m == pytest.approx(moved, abs=1e-4)
    assert np.max(np.abs(with_arm.range_rate_mps - bare.range_rate_mps)) > 0.05  # while rolling and turning
    assert observed(flight, clock, lever_arm_b=(0.0, 0.0, 0.0)).pseudorange_m == pytest.approx(
        bare.pseudorange_m
    )


def test_receiver_clock_adds_its_bias_and_moves_the_time_of_reception(flight: Trajectory) -> None:
    none, ahead = (observed(flight, straight_clock(TAGS, bias, 0.0)) for bias in (0.0, 3.0e5))
    earlier = -none.range_rate_mps * 3.0e5 / C_MPS  # received 1 ms before the tag
    difference = ahead.pseudorange_m - none.pseudorange_m - 3.0e5
    assert difference == pytest.approx(earlier, abs=1e-4)
    assert np.max(np.abs(difference)) > 0.3


def test_satellites_below_the_horizon_or_the_antennas_plane_are_not_tracked(flight: Trajectory) -> None:
    clock = straight_clock(TAGS, 0.0, 0.0)
    antenna = antenna_motion(flight, TAGS, LEVER)
    paths = signal_paths(antenna, EPH, START_NS, TAGS)
    everything = observed(flight, clock, horizon_mask_deg=-90.0)
    assert np.all(everything.tracked)
    high = observed(flight, clock, lever_arm_b=LEVER, horizon_mask_deg=20.0)
    assert np.array_equal(high.tracked, paths.elevation >= np.deg2rad(20.0))
    masked = observed(flight, clock, lever_arm_b=LEVER, antenna_mask_deg=5.0)
    up_e = -antenna.C_eb[:, :, 2]
    towards = paths.satellite.r_e - antenna.r_e[:, None]
    towards /= np.linalg.norm(towards, axis=-1)[..., None]
    angle = np.arcsin(np.einsum("mnj,mj->mn", towards, up_e))
    # the Earth's turn during flight shifts the direction by 1e-5 rad
    clear = np.abs(angle - np.deg2rad(5.0)) > 1e-4
    assert np.array_equal(masked.tracked[clear], (angle >= np.deg2rad(5.0))[clear])
    assert masked.tracked.sum(axis=1).min() <= 7 and masked.tracked.sum(axis=1).max() == 11


def test_level_flight_masks_by_elevation_alone() -> None:
    level = sample_trajectories.static(60.0, *sample_trajectories.AIRFIELD)
    clock = straight_clock(np.arange(1.0, 60.0, 10.0), 0.0, 0.0)
    by_horizon, by_antenna = (
        observed(level, clock, horizon_mask_deg=20.0),
        observed(level, clock, horizon_mask_deg=-90.0, antenna_mask_deg=20.0),
    )
    assert np.array_equal(by_horizon.tracked, by_antenna.tracked)
    assert by_horizon.cn0_dbhz[0, 7] == pytest.approx(48.0, abs=0.1)  # G23 stands near the zenith


def test_atmosphere_is_added_to_the_pseudorange_and_its_growth_to_the_rate(flight: Trajectory) -> None:
    clock = straight_clock(TAGS)
    bare = observed(flight, clock)
    delayed = observed(flight, clock, atmosphere=broadcast_atmosphere(NAVIGATION.klobuchar))
    dry = observed(flight, clock, atmosphere=broadcast_atmosphere(None))
    both, troposphere = delayed.pseudorange_m - bare.pseudorange_m, dry.pseudorange_m - bare.pseudorange_m
    added = np.abs(delayed.range_rate_mps - bare.range_rate_mps)
    assert 1e-3 < added.max() < 2e-2  # that it is the carrier's derivative: test_carrier_observations
    assert (
        1.5 < troposphere.min() < 2.3 and 5.0 < troposphere.max() < 12.0
    )  # at 1500 m, from zenith to 13 deg
    assert 1.5 < (both - troposphere).min() and (both - troposphere).max() < 30.0


def test_noise_has_the_stated_sigma(flight: Trajectory, rng: np.random.Generator) -> None:
    terms, rates = NoiseTerms(0.5, 0.6, 0.7), NoiseTerms(0.03, 0.02, 0.03)
    clock = straight_clock(np.arange(1.0, 119.0, 0.5))
    receiver = SimulatedReceiver(pseudorange_noise=terms, range_rate_noise=rates)
    clean = observe(flight, EPH, START_NS, clock, receiver, None)
    noisy = observe(flight, EPH, START_NS, clock, receiver, rng)
    elevation = signal_paths(
        antenna_motion(flight, clock.true_s, (0.0, 0.0, 0.0)), EPH, START_NS, clock.true_s
    ).elevation
    variance = 0.25 + 0.36 / np.sin(elevation) ** 2 + 0.49 * 10.0 ** (0.1 * (45.0 - noisy.cn0_dbhz))
    assert_mean_chi_square((noisy.pseudorange_m - clean.pseudorange_m) ** 2 / variance, 1)
    sigma = rates.sigma(elevation, noisy.cn0_dbhz)
    assert_mean_chi_square(((noisy.range_rate_mps - clean.range_rate_mps) / sigma) ** 2, 1)
    assert_mean_chi_square(((noisy.cn0_dbhz - clean.cn0_dbhz) / 0.5) ** 2, 1)


def test_faults_touch_their_satellite_and_window_only(flight: Trajectory) -> None:
    clock = straight_clock(TAGS)
    clean = observed(flight, clock)
    faults = [range_step("G04", 50.0, 40.0), range_ramp("G10", 1.0, 10.0, 60.0), outage(["G13"], 30.0, 50.0)]
    seen = observe(flight, EPH, START_NS, clock, SimulatedReceiver(), None, faults)
    added = seen.pseudorange_m - clean.pseudorange_m
    column = {name: k for k, name in enumerate(EPH.sv_names)}
    assert np.array_equal(np.rint(added[:, column["G04"]]), np.where(TAGS >= 40.0, 50.0, 0.0))
    inside = (TAGS >= 10.0) & (TAGS < 60.0)
    assert added[:, column["G10"]] == pytest.approx(np.where(inside, TAGS - 10.0, 0.0), abs=1e-6)
    assert np.array_equal(~seen.tracked[:, column["G13"]], (TAGS >= 30.0) & (TAGS < 50.0))
    untouched = [k for name, k in column.items() if name not in ("G04", "G10")]
    assert np.all(added[:, untouched] == 0.0)
    nothing = observe(flight, EPH, START_NS, clock, SimulatedReceiver(), None, [outage(None, 0.0, 60.0)])
    assert not nothing.tracked[TAGS < 60.0].any() and nothing.tracked[TAGS >= 60.0].all()
    reversed_ = observe(flight, EPH, START_NS, clock, SimulatedReceiver(), None, [reversed_range_rate()])
    assert np.array_equal(reversed_.range_rate_mps, -clean.range_rate_mps)


def test_the_table_holds_the_tracked_rows_by_epoch(flight: Trajectory) -> None:
    seen = observed(flight, straight_clock(TAGS), antenna_mask_deg=5.0)
    seen = replace(seen, tracked=seen.tracked & (TAGS[:, None] != 7.0))
    table = to_table(seen, START_NS)
    assert len(table.t_ns) == np.count_nonzero(seen.tracked)
    assert np.all(np.diff(table.t_ns) >= 0)
    assert START_NS + 7 * NS_PER_S not in table.t_ns
    assert np.array_equal(np.unique((table.t_ns - START_NS) / NS_PER_S), TAGS[TAGS != 7.0])
    assert table.sv_names == EPH.sv_names
