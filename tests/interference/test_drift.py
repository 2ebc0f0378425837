"""Drift densities: the paper's examples, simulated records, oscillators and sensors with a known answer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from insgnss.config.flight import Oscillator
from insgnss.config.library import imu_grade
from insgnss.constants import C_MPS
from insgnss.errors import ConfigError
from insgnss.gnss.signals import L1_HZ
from insgnss.interference.drift import (
    density_of_allan,
    density_of_grade,
    density_of_record,
    density_of_walk,
    greatest_rule_bias,
    ins_density,
    oscillator_density,
    oscillator_of_allan,
    per_mps,
    phase_walk_of,
    total_density,
)
from insgnss.simulation.oscillator import simulate_clock


def wiener(rng: np.random.Generator, S: float, n: int, runs: int, T: float = 1.0) -> np.ndarray:
    """Return records (runs, n + 1) [rad/s] of drift of the one-sided density S."""
    steps = rng.normal(scale=math.sqrt(0.5 * S * T), size=(runs, n))
    return np.concatenate([np.zeros((runs, 1)), np.cumsum(steps, axis=1)], axis=1)


def test_paper_examples_are_reproduced() -> None:
    oscillator = float(oscillator_density(19.0, 1.0))
    assert oscillator == pytest.approx(3167.05, abs=0.005)
    assert float(ins_density(0.5, 30.0, 1575.42e6)) == pytest.approx(2.019, abs=5e-4)
    assert float(ins_density(0.5, 30.0, 1600e6)) == pytest.approx(2.082, abs=5e-4)
    assert float(total_density(oscillator, 2.0)) == pytest.approx(3169.05, abs=0.005)


@pytest.mark.parametrize(("n", "bias"), [(10, 0.42), (100, 0.86), (300, 1.08), (1000, 1.32)])
def test_greatest_rule_has_the_bias_of_its_record_length(
    n: int, bias: float, rng: np.random.Generator
) -> None:
    assert greatest_rule_bias(n) == pytest.approx(bias, abs=0.006)
    found = [
        density_of_record(x, 1.0, per_unit=1.0, rule="greatest").density for x in wiener(rng, 50.0, n, 2000)
    ]
    # 2000 records, each spread by less than 0.5 of its mean: four sigmas are 0.05
    assert np.mean(found) / 50.0 == pytest.approx(bias, rel=0.05)


def test_variance_rule_has_no_bias_and_its_interval_covers(rng: np.random.Generator) -> None:
    found = [density_of_record(x, 0.5, per_unit=1.0) for x in wiener(rng, 50.0, 40, 2000, 0.5)]
    inside = np.mean([f.low <= 50.0 <= f.high for f in found])

    # sqrt(2 / 40 / 2000) = 0.5 % of one sigma; binomial bounds of 99.9 % around 0.95
    assert np.mean([f.density for f in found]) == pytest.approx(50.0, rel=0.02)
    low, high = stats.binom.ppf([0.0005, 0.9995], 2000, 0.95) / 2000
    assert low <= inside <= high


def test_averaged_samples_lose_a_third_that_is_given_back(rng: np.random.Generator) -> None:
    fine = wiener(rng, 50.0, 64 * 401, 60, 1.0 / 64)[:, :-1]
    means = fine.reshape(60, 401, 64).mean(axis=2)
    plain = [density_of_record(x, 1.0, per_unit=1.0).density for x in means]
    right = [density_of_record(x, 1.0, per_unit=1.0, averaged=True) for x in means]

    # 24000 increments, neighbours correlated: 1 % of one sigma
    assert np.mean(plain) == pytest.approx(50.0 * 2.0 / 3.0, rel=0.04)
    assert np.mean([f.density for f in right]) == pytest.approx(50.0, rel=0.04)


def test_measurement_noise_counts_as_drift_unless_it_is_told(rng: np.random.Generator) -> None:
    x = wiener(rng, 50.0, 4000, 1)[0]
    noisy = x + rng.normal(scale=4.0, size=x.shape)

    # 2 (25 + 2 * 16) against 50; 4000 increments: 2.2 % of one sigma, more with the noise taken out
    assert density_of_record(noisy, 1.0, per_unit=1.0).density == pytest.approx(114.0, rel=0.1)
    assert density_of_record(noisy, 1.0, per_unit=1.0, noise_sd=4.0).density == pytest.approx(50.0, rel=0.2)


def test_records_in_hertz_and_metres_per_second_are_scaled() -> None:
    x = np.array([0.0, 1.0, 0.0, -1.0, 0.0])
    assert density_of_record(x, 2.0).density == pytest.approx(4.0 * math.pi**2)
    assert density_of_record(x, 2.0, per_unit=per_mps(L1_HZ)).density == pytest.approx(
        (2.0 * math.pi * L1_HZ / C_MPS) ** 2
    )


def test_h_parameters_give_the_drift_of_a_simulated_clock(rng: np.random.Generator) -> None:
    oscillator = Oscillator(h0_s=0.0, h_minus2_per_s=2e-20)
    clock = simulate_clock(oscillator, np.arange(0.0, 20_001.0), rng)
    frequency = 2.0 * math.pi * L1_HZ / C_MPS * clock.drift_mps
    found = density_of_record(frequency, 1.0, per_unit=1.0, confidence=0.999)

    assert found.low < float(density_of_walk(2e-20, L1_HZ)) < found.high


def test_allan_deviation_of_a_simulated_clock_gives_the_same_drift(rng: np.random.Generator) -> None:
    oscillator = Oscillator(h0_s=0.0, h_minus2_per_s=2e-20)
    bias_s = simulate_clock(oscillator, np.arange(0.0, 40_001.0), rng).bias_m / C_MPS
    y = np.diff(bias_s)
    allan = math.sqrt(0.5 * np.mean(np.diff(y) ** 2))

    # 40000 differences, correlated: 1.5 % of the variance is more than two sigmas
    assert float(density_of_allan(allan, 1.0, L1_HZ)) == pytest.approx(
        float(density_of_walk(2e-20, L1_HZ)), rel=0.03
    )


def test_allan_curve_is_parted_into_white_noise_and_walk() -> None:
    tau = np.array([0.1, 1.0, 10.0, 100.0])
    variance = 2e-19 / (2.0 * tau) + 2.0 * math.pi**2 / 3.0 * 2e-20 * tau
    found = oscillator_of_allan(tau.tolist(), np.sqrt(variance).tolist())

    assert found.h0_s == pytest.approx(2e-19, rel=1e-9)
    assert found.h_minus2_per_s == pytest.approx(2e-20, rel=1e-9)
    assert oscillator_of_allan([1.0, 4.0], [1e-9, 0.5e-9]).h_minus2_per_s == pytest.approx(0.0, abs=1e-30)


def test_phase_walk_is_what_white_frequency_noise_does_to_the_clock(rng: np.random.Generator) -> None:
    clock = simulate_clock(Oscillator(h0_s=2e-19, h_minus2_per_s=0.0), np.arange(0.0, 20_001.0), rng)
    phase = 2.0 * math.pi * L1_HZ / C_MPS * clock.bias_m
    # two-sided density of frequency is the growth of phase variance in a second; 1 % of one sigma
    assert float(phase_walk_of(2e-19, L1_HZ)) == pytest.approx(2.0 * np.mean(np.diff(phase) ** 2), rel=0.04)


def test_grade_gives_the_variance_of_simulated_velocity_errors(rng: np.random.Generator) -> None:
    grade = imu_grade("tactical")
    T, runs, dt = 20.0, 4000, 0.1
    n = round(T / dt)
    arw = math.radians(0.1) / 60.0
    tilt = np.cumsum(rng.normal(scale=arw * math.sqrt(dt), size=(runs, n)), axis=1)
    tilt += math.radians(0.3 / 3600.0) * rng.normal(size=(runs, 1)) * dt * np.arange(1, n + 1)
    tilt += 1e-3 * rng.normal(size=(runs, 1))
    accel = 0.1e-3 * 9.80665 * rng.normal(size=(runs, 1)) + 9.80665 * tilt
    dv = np.sum(accel, axis=1) * dt + rng.normal(scale=0.06 / 60.0 * math.sqrt(T), size=runs)
    simulated = 2.0 * (2.0 * math.pi * L1_HZ / C_MPS) ** 2 * np.mean(dv**2) / T

    found = density_of_grade(grade, L1_HZ, interval_s=T, tilt_rad=1e-3)

    # 4000 runs: 2.2 % of one sigma
    assert found.total == pytest.approx(simulated, rel=0.09)
    assert min(found) > 0.0


def test_uncalibrated_biases_count_in_full() -> None:
    grade = imu_grade("tactical")
    known, unknown = (density_of_grade(grade, L1_HZ, calibrated=c).accel_bias for c in (True, False))
    # a mg of bias, half a milliradian of misalignment under gravity, and what is calibrated
    assert unknown / known == pytest.approx((1.0**2 + 0.5**2 + 0.1**2) / 0.1**2)


@pytest.mark.parametrize(
    ("samples", "interval", "key"),
    [
        ([1.0, 2.0], 1.0, "samples"),
        ([1.0, math.nan, 2.0, 3.0], 1.0, "samples"),
        ([0.0] * 9, 0.0, "interval_s"),
    ],
)
def test_records_that_tell_nothing_are_refused(samples: list[float], interval: float, key: str) -> None:
    with pytest.raises(ConfigError) as caught:
        density_of_record(samples, interval)
    assert caught.value.key == key and caught.value.advice


def test_negative_drifts_and_single_deviations_are_refused() -> None:
    with pytest.raises(ConfigError, match="greatest_hz"):
        oscillator_density(-19.0, 1.0)
    with pytest.raises(ConfigError, match="two values"):
        oscillator_of_allan([1.0], [1e-9])
    with pytest.raises(ConfigError, match="carrier_hz"):
        per_mps(0.0)
