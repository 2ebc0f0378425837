"""Reflections, wrong messages, air, loops and tracking: each has the size and the signs it should have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insgnss.antenna.pattern_file import read_pattern
from insgnss.config.flight import MountedAntenna
from insgnss.config.library import antenna_file
from insgnss.constants import C_MPS
from insgnss.gnss.signals import L1_HZ, L5_HZ
from insgnss.gpstime import week_seconds_to_ns
from insgnss.simulation import sample_trajectories
from insgnss.simulation.faults import carrier_false_lock
from insgnss.simulation.observations import (
    NoiseTerms,
    SignalObservations,
    SimulatedReceiver,
    antenna_motion,
    observe,
    signal_paths,
)
from insgnss.simulation.oscillator import ClockTruth
from insgnss.simulation.reception import (
    CA_CHIP_M,
    HIDDEN_DBIC,
    CarrierLoopNoise,
    CodeLoopNoise,
    FrequencyLoopNoise,
    ReceivingAntenna,
    Reception,
    TrackingRules,
)
from insgnss.simulation.signal_errors import (
    AirResiduals,
    Disturbance,
    MarkovMultipath,
    MessageErrors,
    SpecularReflection,
    smooth_markov,
)
from insgnss.simulation.sky import PAPER_SKY, constellation_over
from insgnss.simulation.trajectory import Trajectory
from tests.statistics_bounds import assert_mean_chi_square

START_NS = int(week_seconds_to_ns(2385, 293_700.0))
EPH = constellation_over(
    sample_trajectories.AIRFIELD, PAPER_SKY, START_NS, 1200.0, int(week_seconds_to_ns(2385, 295_200.0))
).ephemerides
N = len(EPH.sv_names)
TAGS = np.arange(1.0, 119.0)
CLOCK = ClockTruth(TAGS, np.zeros_like(TAGS), np.zeros_like(TAGS))
QUIET = SimulatedReceiver(
    signals=("C1C", "C5Q"),
    cn0_sigma_db=0.0,
    pseudorange_noise=NoiseTerms(0.0),
    range_rate_noise=NoiseTerms(0.0),
    carrier_noise=NoiseTerms(0.0),
    horizon_mask_deg=-90.0,
)
WAVELENGTH = np.repeat([C_MPS / L1_HZ, C_MPS / L5_HZ], N)


@pytest.fixture(scope="module")
def flight() -> Trajectory:
    return sample_trajectories.airborne_turns(120.0)


def observed(flight: Trajectory, receiver: SimulatedReceiver, seed: int = 1) -> SignalObservations:
    return observe(flight, EPH, START_NS, CLOCK, receiver, np.random.default_rng(seed))


def added(
    flight: Trajectory, *sources: Disturbance, seed: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what disturbances add to code and carrier [m] and to the range rate [m/s]; ambiguities are the same."""
    clean, spoilt = (observed(flight, replace(QUIET, disturbances=s), seed) for s in ((), sources))
    assert clean.carrier_cycles is not None and spoilt.carrier_cycles is not None
    carrier = (spoilt.carrier_cycles - clean.carrier_cycles) * WAVELENGTH
    return (
        spoilt.pseudorange_m - clean.pseudorange_m,
        carrier,
        spoilt.range_rate_mps - clean.range_rate_mps,
    )


def elevations(flight: Trajectory) -> np.ndarray:
    return signal_paths(antenna_motion(flight, TAGS, (0.0, 0.0, 0.0)), EPH, START_NS, TAGS).elevation


def test_rate_of_a_disturbance_is_the_slope_of_its_carrier(flight: Trajectory) -> None:
    _, carrier, rate = added(flight, AirResiduals(2.0, 0.1, 100.0))
    slope = (carrier[2:] - carrier[:-2]) / 2.0
    assert rate[1:-1] == pytest.approx(slope, abs=1e-6)
    assert np.abs(rate).max() > 5e-3


def test_multipath_is_larger_for_low_satellites_and_other_on_each_signal(flight: Trajectory) -> None:
    source = MarkovMultipath(0.2, 2.0, np.radians(10.0), 5.0, 0.01)
    runs = [added(flight, source, seed=seed)[:2] for seed in range(30)]
    sigma = 0.2 + 2.0 * np.exp(-np.tile(elevations(flight), 2) / np.radians(10.0))
    # epochs 20 s apart, four correlation times: independent to 2 %
    for size, values in ((1.0, [code for code, _ in runs]), (0.01, [carrier for _, carrier in runs])):
        assert_mean_chi_square((np.array(values)[:, ::20] / (size * sigma[::20])) ** 2, 1)
    code = runs[0][0]
    assert np.corrcoef(code[:-1, 0], code[1:, 0])[0, 1] > 0.5
    assert abs(np.corrcoef(code[:, 0], code[:, N])[0, 1]) < 0.6


def test_mirror_gives_the_envelope_of_its_amplitude_and_beats_with_the_elevation(flight: Trajectory) -> None:
    code, carrier, _ = added(flight, SpecularReflection(3.0, 0.5))
    longer = np.tile(6.0 * np.sin(elevations(flight)), 2)
    # in phase a / (1 + a) = 1/3 of the detour, in antiphase a / (1 - a) = 1 of it, the other way
    assert np.all(code <= longer / 3.0 + 1e-6) and np.all(code >= -longer - 1e-6)
    assert np.abs(carrier).max() <= np.arcsin(0.5) / (2.0 * np.pi) * WAVELENGTH.max() + 1e-6
    phase = 2.0 * np.pi * longer / WAVELENGTH
    in_phase = np.cos(phase) > 0.999
    assert code[in_phase] == pytest.approx(longer[in_phase] / 3.0, rel=2e-3)


def test_wrong_messages_shift_code_and_carrier_alike_and_slowly(flight: Trajectory) -> None:
    code, carrier, _ = added(flight, MessageErrors(0.0, 0.0, 0.0, 3.0))
    assert code == pytest.approx(carrier, abs=1e-6) and np.ptp(code, axis=0).max() < 1e-6
    assert np.array_equal(np.round(code[:, :N], 6), np.round(code[:, N:], 6))
    radial = np.abs(added(flight, MessageErrors(2.0, 0.0, 0.0, 0.0))[0])
    along = np.abs(added(flight, MessageErrors(0.0, 2.0, 0.0, 0.0))[0])
    # seen from the ground a satellite's radial direction lies within 14 deg of the line of sight
    assert np.median(radial) > 4.0 * np.median(along)


def test_ionosphere_left_over_turns_its_sign_on_the_carrier_and_grows_with_the_wavelength(
    flight: Trajectory,
) -> None:
    code, carrier, _ = added(flight, AirResiduals(2.0, 0.0, 600.0))
    assert carrier == pytest.approx(-code, abs=1e-6)
    assert code[:, N:] == pytest.approx(code[:, :N] * (L1_HZ / L5_HZ) ** 2, abs=1e-6)
    code, carrier, _ = added(flight, AirResiduals(0.0, 0.1, 600.0))
    assert carrier == pytest.approx(code, abs=1e-6)
    assert code[:, :N] * np.sin(elevations(flight)) == pytest.approx(
        np.tile((code[:, :1] * np.sin(elevations(flight)[:, :1])), N), abs=1e-6
    )


def test_residual_air_is_smooth_and_stationary(rng: np.random.Generator) -> None:
    t = np.arange(400) * 0.1
    runs = smooth_markov(t, 500, 2.0, rng)
    for row in (0, 200, -1):
        assert_mean_chi_square(runs[row] ** 2, 1)
    # (1 + h / T) exp(-h / T) at h = T = 20 steps; its derivative has the variance 1 / T^2, whatever the step
    assert np.mean(runs[0] * runs[20]) == pytest.approx(2.0 / np.e, abs=0.12)
    slopes = (runs[1] - runs[0]) / 0.1
    assert np.mean(slopes**2) == pytest.approx(0.25, rel=0.25)


def test_loops_have_the_textbooks_noise() -> None:
    cn0 = np.array([45.0, 30.0])
    el = np.ones(2)
    # Kaplan and Hegarty: 0.5 Hz, 0.5 chips, 20 ms: sqrt(0.125 / 31623 (1 + 2 / (1.5 0.02 31623))) chips at 45 dBHz
    code = CodeLoopNoise(0.5, 0.5, 0.02, CA_CHIP_M).sigma(el, cn0)
    assert code == pytest.approx([0.58323, 3.3837], rel=1e-3)
    # 15 Hz, 20 ms: 1.249 deg at 45 dBHz, 7.07 deg at 30 dBHz, of 19.03 cm
    phase = CarrierLoopNoise(15.0, 0.02, 0.19029).sigma(el, cn0)
    assert np.degrees(phase * 2.0 * np.pi / 0.19029) == pytest.approx([1.249, 7.105], rel=1e-3)
    rate = FrequencyLoopNoise(4.0, 0.02, 0.19029).sigma(el, cn0)
    assert rate == pytest.approx([0.03409, 0.19628], rel=1e-3)


def test_cn0_is_the_patterns_gain_at_the_true_attitude(flight: Trajectory) -> None:
    antenna = ReceivingAntenna.mounted(MountedAntenna(pattern="cardioid"), Path())
    seen = observed(flight, replace(QUIET, reception=Reception((antenna,), 45.0)))
    paths = signal_paths(antenna_motion(flight, TAGS, (0.0, 0.0, 0.0)), EPH, START_NS, TAGS)
    table, _ = read_pattern(antenna_file("cardioid"))
    gain = np.interp(np.degrees(paths.antenna_elevation), table.elevation_deg, table.gain_dbic[:, 0])
    assert seen.cn0_dbhz[:, :N] == pytest.approx(45.0 + gain, abs=1e-6)
    assert np.ptp(gain) > 8.0


def test_antenna_turned_upside_down_sees_what_was_below_and_the_airframe_hides(tmp_path: Path) -> None:
    up, down = np.array([[0.0, 0.0, -1.0]]), np.array([[0.0, 0.0, 1.0]])
    plain = ReceivingAntenna.mounted(MountedAntenna(pattern="cardioid"), Path())
    turned = ReceivingAntenna.mounted(
        MountedAntenna(pattern="cardioid", mounting_rpy_deg=(180.0, 0.0, 0.0)), Path()
    )
    assert turned.gain_dbic(down) == pytest.approx(plain.gain_dbic(up))
    assert plain.gain_dbic(up)[0] > plain.gain_dbic(down)[0] + 20.0
    (tmp_path / "fin.toml").write_text(
        'frame = "body_forward_right_down"\nsource = "test"\n'
        "[[sector]]\nazimuth_deg = [170, 190]\nelevation_deg = [0, 40]\n"
    )
    hidden = ReceivingAntenna.mounted(
        MountedAntenna(pattern="isotropic", obstruction=Path("fin.toml")), tmp_path
    )
    behind = np.array([[-np.cos(0.3), 0.0, -np.sin(0.3)]])
    assert hidden.gain_dbic(behind)[0] == HIDDEN_DBIC and hidden.gain_dbic(-behind * [1, 1, -1])[0] > -10.0


def steady(strength: np.ndarray, rules: TrackingRules, seed: int = 1) -> SignalObservations:
    """Return what the rules make of carriers at zero with the given C/N0 (m, n), one epoch a second."""
    shape = strength.shape
    seen = SignalObservations(
        sv_names=("G01",) * shape[1],
        signals=("C1C",) * shape[1],
        tag_s=np.arange(float(shape[0])),
        pseudorange_m=np.zeros(shape),
        range_rate_mps=np.zeros(shape),
        cn0_dbhz=strength,
        tracked=np.ones(shape, np.bool_),
        carrier_cycles=np.zeros(shape),
        lli=np.zeros(shape, np.int8),
    )
    return rules.apply(seen, strength, np.random.default_rng(seed))


def test_signal_that_returns_is_tracked_after_its_time_with_a_new_ambiguity() -> None:
    strength = np.full((20, 1), 45.0)
    strength[5:8] = 20.0
    seen = steady(strength, TrackingRules(28.0, reacquire_s=3.0))
    assert np.flatnonzero(~seen.tracked[:, 0]).tolist() == [5, 6, 7, 8, 9, 10]
    assert seen.carrier_cycles is not None and seen.lli is not None
    assert np.all(seen.carrier_cycles[:5] == 0.0) and np.all(
        seen.carrier_cycles[11:] == seen.carrier_cycles[11]
    )
    assert abs(seen.carrier_cycles[11, 0]) > 1.0
    assert np.flatnonzero(seen.lli).tolist() == [11]


def test_slips_are_as_many_as_stated_and_as_often_told() -> None:
    seen = steady(
        np.full((4000, 10), 45.0), TrackingRules(28.0, 0.0, slips_per_hour=36.0, slips_indicated=0.75)
    )
    assert seen.carrier_cycles is not None and seen.lli is not None
    slipped = np.diff(seen.carrier_cycles, axis=0) != 0.0
    assert slipped.sum() == pytest.approx(400, abs=4 * 20)
    assert np.mean(seen.lli[1:][slipped]) == pytest.approx(0.75, abs=4 * 0.022)
    assert np.all(seen.lli[1:][~slipped] == 0)


def test_false_lock_shifts_doppler_and_lets_the_carrier_run_but_not_the_code(flight: Trajectory) -> None:
    plain = observed(flight, QUIET)
    locked = carrier_false_lock("G04", 25.0, 40.0, 50.0)(plain)
    column = EPH.sv_names.index("G04")
    inside = (TAGS >= 40.0) & (TAGS < 50.0)
    off = locked.range_rate_mps - plain.range_rate_mps
    assert off[:, column] == pytest.approx(np.where(inside, -25.0 * WAVELENGTH[0], 0.0))
    assert np.array_equal(locked.pseudorange_m, plain.pseudorange_m)
    assert locked.carrier_cycles is not None and plain.carrier_cycles is not None
    run = (locked.carrier_cycles - plain.carrier_cycles)[:, column]
    assert np.round(run[[10, 44, 60, -1]], 6) == pytest.approx([0.0, -125.0, -250.0, -250.0])
    assert (plain.cn0_dbhz - locked.cn0_dbhz)[inside][:, column] == pytest.approx(6.0)
    assert np.count_nonzero(off[:, 2 * N - 1]) == 0


def test_a_disturbance_draws_alike_for_the_same_seed(flight: Trajectory) -> None:
    source = MarkovMultipath(0.2, 2.0, 0.2, 5.0, 0.01)
    assert np.array_equal(added(flight, source, seed=4)[0], added(flight, source, seed=4)[0])
