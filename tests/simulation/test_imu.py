"""Simulated sensor errors have the statistics of their grade."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insgnss.config.flight import ImuGrade
from insgnss.simulation.imu import (
    TriadErrorModel,
    accelerometer_model,
    gauss_markov,
    gyro_model,
    measure,
    quantise,
)
from tests.statistics_bounds import assert_mean_chi_square

STEP_S = 0.01
GRADE = ImuGrade(
    gyro_bias_deg_per_h=10.0,
    gyro_bias_instability_deg_per_h=3.0,
    gyro_correlation_time_s=200.0,
    gyro_arw_deg_per_sqrt_h=0.3,
    gyro_scale_factor_ppm=500.0,
    accel_bias_mg=3.0,
    accel_bias_instability_mg=1.0,
    accel_correlation_time_s=100.0,
    accel_vrw_mps_per_sqrt_h=0.12,
    accel_scale_factor_ppm=400.0,
    gyro_range_deg_per_s=300.0,
    accel_range_g=10.0,
)
PERFECT = TriadErrorModel(0.0, 0.0, 100.0, 0.0, 0.0, None)


def test_a_grade_is_converted_to_si() -> None:
    gyro, accel = gyro_model(GRADE), accelerometer_model(GRADE)
    assert gyro.turn_on_bias == pytest.approx(4.848136811e-5, rel=1e-9)
    assert gyro.random_walk == pytest.approx(8.726646260e-5, rel=1e-9)
    assert gyro.full_scale == pytest.approx(5.235987756, rel=1e-9)
    assert accel.turn_on_bias == pytest.approx(3e-3 * 9.80665)
    assert accel.random_walk == pytest.approx(0.002)
    assert accel.full_scale == pytest.approx(98.0665)


@pytest.mark.parametrize("make", [gyro_model, accelerometer_model])
def test_allan_deviation_at_one_second_is_the_random_walk(make: type, rng: np.random.Generator) -> None:
    model = replace(make(GRADE), turn_on_bias=0.0, slow_bias=0.0, scale_factor=0.0)
    out = measure(np.zeros((400_000, 3)), STEP_S, model, rng)
    second = out.value.reshape(-1, 100, 3).mean(axis=1)
    # disjoint pairs of neighbouring means: independent, (y2 - y1)^2 / 2 has the Allan variance as its mean
    pairs = (second[1::2] - second[0::2]) / np.sqrt(2.0)
    assert_mean_chi_square((pairs / model.random_walk) ** 2, 1)
    # white from sample to sample: the same walk at every averaging time
    assert_mean_chi_square((out.value / (model.random_walk / np.sqrt(STEP_S))) ** 2, 1)


def test_turn_on_bias_and_scale_factor_vary_from_run_to_run_as_the_grade_says(
    rng: np.random.Generator,
) -> None:
    model = replace(gyro_model(GRADE), slow_bias=0.0, random_walk=0.0)
    runs = [measure(np.ones((2, 3)), STEP_S, model, rng) for _ in range(1000)]
    bias, scale = np.array([r.bias[0] for r in runs]), np.array([r.scale_factor for r in runs])
    assert_mean_chi_square((bias / model.turn_on_bias) ** 2, 1)
    assert_mean_chi_square((scale / model.scale_factor) ** 2, 1)
    assert runs[0].value == pytest.approx(np.tile(1.0 + scale[0] + bias[0], (2, 1)), abs=1e-15)


def test_slow_bias_is_a_stationary_gauss_markov_process(rng: np.random.Generator) -> None:
    sigma, tau, count = 2.0, 5.0, 501
    runs = np.concatenate([gauss_markov(count, STEP_S, sigma, tau, rng) for _ in range(1000)], axis=1)
    assert_mean_chi_square((runs[0] / sigma) ** 2, 1)
    assert_mean_chi_square((runs[-1] / sigma) ** 2, 1)
    kept = np.exp(-(count - 1) * STEP_S / tau)  # exp(-1)
    assert_mean_chi_square((runs[-1] - kept * runs[0]) ** 2 / (sigma**2 * (1.0 - kept**2)), 1)


def test_reported_bias_is_the_bias_in_the_readings(rng: np.random.Generator) -> None:
    model = replace(gyro_model(GRADE), random_walk=0.0, scale_factor=0.0)
    true = rng.standard_normal((1000, 3))
    out = measure(true, STEP_S, model, rng)
    assert out.value - true == pytest.approx(out.bias, abs=1e-15)
    assert np.std(out.bias, axis=0).min() > 0.0


def test_readings_stop_at_full_scale(rng: np.random.Generator) -> None:
    true = np.array([[20.0, -20.0, 1.0]])
    out = measure(true, STEP_S, replace(PERFECT, full_scale=5.0), rng)
    assert out.value == pytest.approx(np.array([[5.0, -5.0, 1.0]]))


def test_quantised_increments_lose_nothing_in_the_long_run(rng: np.random.Generator) -> None:
    resolution = 1e-4
    true = 0.3 + 0.1 * rng.standard_normal((1000, 3))
    rough = quantise(true, STEP_S, resolution)
    counts = rough * STEP_S / resolution
    assert counts == pytest.approx(np.rint(counts), abs=1e-6)
    drift = np.cumsum((rough - true) * STEP_S, axis=0)
    assert np.max(np.abs(drift)) <= 0.5 * resolution * (1.0 + 1e-9)
    assert measure(true, STEP_S, replace(PERFECT, resolution=resolution), rng).value == pytest.approx(rough)


def test_a_perfect_sensor_reports_the_truth(rng: np.random.Generator) -> None:
    true = rng.standard_normal((100, 3))
    assert np.array_equal(measure(true, STEP_S, PERFECT, rng).value, true)
