"""Errors beyond bias and white noise, each alone: misalignment, g-sensitivity, bandwidth, vibration, tags, losses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from insgnss.config.flight import ImuGrade
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError
from insgnss.simulation.imu import (
    RISE_S,
    ImuRecord,
    TriadErrorModel,
    VibrationSpectrum,
    accelerometer_model,
    gyro_model,
    low_pass,
    measure,
    vibration,
)
from insgnss.tables import ImuTable
from tests.statistics_bounds import assert_mean_chi_square

STEP_S = 0.01
PERFECT = TriadErrorModel(0.0, 0.0, 100.0, 0.0, 0.0, None)
NOTHING = ImuGrade(
    gyro_bias_deg_per_h=0.0,
    gyro_bias_instability_deg_per_h=0.0,
    gyro_correlation_time_s=1.0,
    gyro_arw_deg_per_sqrt_h=0.0,
    accel_bias_mg=0.0,
    accel_bias_instability_mg=0.0,
    accel_correlation_time_s=1.0,
    accel_vrw_mps_per_sqrt_h=0.0,
)


def test_grade_of_nothing_is_a_perfect_sensor(rng: np.random.Generator) -> None:
    true = rng.standard_normal((50, 3))
    for model in (gyro_model(NOTHING), accelerometer_model(NOTHING)):
        assert np.array_equal(measure(true, STEP_S, model, rng, force=true).value, true)


def test_new_keys_of_a_grade_are_converted_to_si() -> None:
    grade = NOTHING.model_copy(
        update={
            "gyro_rate_random_walk_deg_per_h_per_sqrt_h": 6.0,
            "gyro_misalignment_mrad": 2.0,
            "gyro_g_sensitivity_deg_per_h_per_g": 3.6,
            "gyro_quantisation_deg": 1e-3,
            "accel_random_walk_mg_per_sqrt_h": 6.0,
            "accel_quantisation_mps": 2e-4,
            "accel_bandwidth_hz": 40.0,
        }
    )
    gyro, accel = gyro_model(grade), accelerometer_model(grade)
    assert gyro.bias_random_walk == pytest.approx(np.radians(6.0 / 3600.0) / 60.0)
    assert gyro.misalignment == 2e-3
    assert gyro.g_sensitivity == pytest.approx(np.radians(1e-3) / STANDARD_GRAVITY_MPS2)
    assert gyro.resolution == pytest.approx(np.radians(1e-3))
    assert accel.bias_random_walk == pytest.approx(6e-3 * STANDARD_GRAVITY_MPS2 / 60.0)
    assert accel.resolution == 2e-4 and accel.bandwidth_hz == 40.0


def test_misalignment_leaks_between_axes_and_not_into_its_own(rng: np.random.Generator) -> None:
    model = replace(PERFECT, misalignment=1e-3)
    leaks = []
    for _ in range(400):
        out = measure(np.array([[1.0, 0.0, 0.0]]), STEP_S, model, rng).value[0]
        assert out[0] == 1.0
        leaks.append(out[1:])
    assert_mean_chi_square((np.array(leaks) / 1e-3) ** 2, 1)


def test_gyro_feels_specific_force_by_its_sensitivity(rng: np.random.Generator) -> None:
    model, force = replace(PERFECT, g_sensitivity=1e-6), np.array([[0.0, 0.0, -10.0]])
    runs = np.array([measure(np.zeros((1, 3)), STEP_S, model, rng, force=force).value[0] for _ in range(400)])
    assert_mean_chi_square((runs / 1e-5) ** 2, 1)
    assert np.all(measure(np.zeros((1, 3)), STEP_S, model, rng).value == 0.0)


def test_bias_random_walk_grows_with_the_root_of_time(rng: np.random.Generator) -> None:
    model = replace(PERFECT, bias_random_walk=1e-4)
    ends = np.concatenate(
        [measure(np.zeros((400, 3)), STEP_S, model, rng).bias[[99, 399]] for _ in range(300)], 1
    )
    assert_mean_chi_square((ends / (1e-4 * np.sqrt([[1.0], [4.0]]))) ** 2, 1)


def test_bandwidth_halves_the_power_at_its_frequency_and_leaves_slow_motion() -> None:
    t = np.arange(4000) * STEP_S
    for frequency, gain in ((0.5, 1.0), (10.0, np.sqrt(0.5)), (40.0, 0.0)):
        wave = np.column_stack([np.sin(2.0 * np.pi * frequency * t)] * 3)
        out = low_pass(wave, STEP_S, 10.0)[1000:]
        assert np.sqrt(2.0) * out.std() == pytest.approx(gain, abs=0.02)
    constant = np.full((20, 3), 9.81)
    assert low_pass(constant, STEP_S, 10.0) == pytest.approx(constant, rel=1e-12)
    assert low_pass(wave, STEP_S, 60.0) is wave


def test_vibration_has_the_density_of_its_spectrum(rng: np.random.Generator) -> None:
    spectrum = VibrationSpectrum((5.0, 20.0, 45.0), (1e-3, 4e-3, 4e-3))
    shaken = vibration(400_000, STEP_S, spectrum, rng)
    f, density = welch(shaken, fs=100.0, nperseg=2000, axis=0)
    inside = (f > 8.0) & (f < 15.0)
    # up to half the sampling rate nothing is folded: only the mean over the interval, sinc^2, lowers the lines
    expected = spectrum.at(f) * np.sinc(f * STEP_S) ** 2
    assert density[inside].mean() == pytest.approx(expected[inside].mean(), rel=0.02)
    assert density[(f < 4.0) | (f > 47.0)].max() < 0.02 * expected.max()


def test_vibration_above_half_the_rate_is_folded_and_lowered_by_the_mean(rng: np.random.Generator) -> None:
    line = VibrationSpectrum(lines=((95.0, 2.0),))
    shaken = vibration(20_000, STEP_S, line, rng)
    f, density = welch(shaken[:, 0], fs=100.0, nperseg=4000)
    assert f[np.argmax(density)] == pytest.approx(5.0, abs=0.05)
    assert np.sqrt(2.0) * shaken.std() == pytest.approx(2.0 * abs(np.sinc(0.95)), rel=0.01)
    broad = vibration(20_000, STEP_S, VibrationSpectrum((120.0, 130.0), (1.0, 1.0)), rng)
    f, density = welch(broad[:, 0], fs=100.0, nperseg=1000)
    assert 19.0 < f[np.argmax(density)] < 31.0


def test_vibration_of_a_motor_lasts_as_long_as_the_motor_and_changes_no_other_number() -> None:
    lasting = VibrationSpectrum((5.0, 45.0), (1.0, 1.0), ((20.0, 3.0),))
    always, burning = (
        vibration(1000, STEP_S, spectrum, np.random.default_rng(4))
        for spectrum in (lasting, replace(lasting, from_s=3.0, end_s=6.0))
    )
    middle = (np.arange(1000) + 0.5) * STEP_S
    assert np.all(burning[(middle < 3.0) | (middle > 6.0)] == 0.0)
    whole = (middle > 3.0 + RISE_S) & (middle < 6.0 - RISE_S)
    assert np.array_equal(burning[whole], always[whole])
    assert np.all(np.abs(burning) <= np.abs(always))


def test_vibration_of_a_spinning_body_walks_where_means_fold_it_onto_the_spin(
    rng: np.random.Generator,
) -> None:
    """The lines a spin beside the multiples of the sampling rate: sum of S sinc^2(f step) / 2, turned into a walk."""
    step_s, spin_hz, seconds, density = 0.005, 2.0, 400, 0.077
    flat = VibrationSpectrum((20.0, 2000.0), (density, density))
    y, z = vibration(200 * seconds, step_s, flat, rng)[:, 1:].T
    middle = (np.arange(200 * seconds) + 0.5) * step_s
    turned = ((y + 1j * z) * np.exp(2j * np.pi * spin_hz * middle)).reshape(seconds // 20, -1)
    walked = np.mean(np.abs(turned.sum(axis=1) * step_s) ** 2) / 2.0 / 20.0
    beside = np.array([200.0 * k + side * spin_hz for k in range(1, 10) for side in (-1, 1)])
    expected = np.sum(density * np.sinc(beside * step_s) ** 2) / 2.0
    assert walked == pytest.approx(expected, rel=0.6)


def test_vibration_too_long_for_memory_is_told(rng: np.random.Generator) -> None:
    with pytest.raises(ConfigError, match="too long"):
        vibration(1_000_000, STEP_S, VibrationSpectrum((10.0, 20_000.0), (1.0, 1.0)), rng)


def log_of(count: int) -> ImuTable:
    values = np.arange(3.0 * count).reshape(count, 3)
    return ImuTable(10_000_000 * np.arange(1, count + 1), values, values)


def test_tags_jitter_with_the_stated_sigma_and_keep_their_order(rng: np.random.Generator) -> None:
    imu = log_of(20_000)
    logged, kept = ImuRecord(tag_jitter_s=1e-3).log(imu, rng)
    assert kept.all()
    assert_mean_chi_square(((logged.t_ns - imu.t_ns) / 1e6) ** 2, 1)
    assert np.all(np.diff(ImuRecord(tag_jitter_s=0.05).log(imu, rng)[0].t_ns) > 0)


def test_lost_samples_are_as_many_as_stated_and_go_together(rng: np.random.Generator) -> None:
    imu = log_of(100_000)
    logged, kept = ImuRecord(lost_share=0.03, lost_at_once=3).log(imu, rng)
    assert np.mean(~kept) == pytest.approx(0.03, rel=0.1)
    gaps = np.diff(np.flatnonzero(kept)) - 1
    assert gaps[gaps > 0].min() == 3
    assert kept[[0, -1]].all() and np.array_equal(logged.f_b, imu.f_b[kept])
