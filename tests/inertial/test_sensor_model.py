"""From a data sheet to densities: units by hand, and the one Gauss-Markov process that stands for two."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.config.flight import ImuGrade
from insgnss.inertial.sensor_model import bias_model, sensor_model
from insgnss.simulation.imu import gauss_markov

GRADE = ImuGrade(
    gyro_bias_deg_per_h=80.0,
    gyro_bias_instability_deg_per_h=6.0,
    gyro_correlation_time_s=600.0,
    gyro_arw_deg_per_sqrt_h=0.3,
    gyro_scale_factor_ppm=1000.0,
    accel_bias_mg=6.0,
    accel_bias_instability_mg=0.5,
    accel_correlation_time_s=300.0,
    accel_vrw_mps_per_sqrt_h=0.12,
    accel_scale_factor_ppm=250.0,
)


def test_densities_and_sigmas_are_the_data_sheets_in_si_units() -> None:
    model = sensor_model(GRADE)

    # 0.3 deg/sqrt(h) = 0.005 deg/sqrt(s) = 8.726646e-5 rad/sqrt(s); 0.12 m/s/sqrt(h) = 0.002 m/s/sqrt(s)
    assert math.sqrt(model.gyro_density) == pytest.approx(8.726646e-5, rel=1e-6, abs=0.0)
    assert math.sqrt(model.accel_density) == pytest.approx(0.002, rel=1e-12)
    # 1 deg/h = 4.848137e-6 rad/s, 1 mg = 9.80665e-3 m/s^2
    assert model.gyro_bias.sigma == pytest.approx(math.hypot(80.0, 6.0) * 4.848137e-6, rel=1e-6, abs=0.0)
    assert model.accel_bias.sigma == pytest.approx(math.hypot(6.0, 0.5) * 9.80665e-3, rel=1e-12)
    assert model.gyro_bias.density == pytest.approx(2.0 * (6.0 * 4.848137e-6) ** 2 / 600.0, rel=1e-6, abs=0.0)
    assert model.accel_bias.density == pytest.approx(
        2.0 * (0.5 * 9.80665e-3) ** 2 / 300.0, rel=1e-12, abs=0.0
    )
    assert (model.gyro_scale, model.accel_scale) == (pytest.approx(1e-3), pytest.approx(2.5e-4))


def test_bias_without_constant_part_is_the_plain_gauss_markov_process() -> None:
    model = bias_model(0.0, 2e-3, 500.0)

    assert (model.sigma, model.time_s) == (2e-3, pytest.approx(500.0))
    assert model.density == 2.0 * 2e-3**2 / 500.0


def test_bias_without_instability_stays_what_it_is() -> None:
    model = bias_model(0.01, 0.0, 500.0)

    assert (model.sigma, model.time_s, model.density) == (0.01, math.inf, 0.0)


def test_bias_of_both_parts_keeps_their_variance_and_the_wander_of_the_instability() -> None:
    constant, instability, time_s = 8e-3, 1e-3, 400.0
    model = bias_model(constant, instability, time_s)

    # stationary variance of b' = -b / T + noise is density T / 2
    assert 0.5 * model.density * model.time_s == pytest.approx(constant**2 + instability**2)
    # growth of (b(t) - b(0))^2: over 0.01 T twice the density's share, with and without the constant part
    t = 0.01 * time_s
    wander = 2.0 * model.sigma**2 * -math.expm1(-t / model.time_s)
    assert wander == pytest.approx(2.0 * instability**2 * -math.expm1(-t / time_s), rel=6e-3, abs=0.0)


def test_drawn_bias_has_the_density_of_its_model(rng: np.random.Generator) -> None:
    model, step_s = bias_model(0.0, 2e-3, 50.0), 0.5
    drawn = gauss_markov(200_000, step_s, model.sigma, 50.0, rng)

    # increments over one step: density * step, to 1 % of decay inside it, and 600 000 draws (0.2 %)
    assert np.var(np.diff(drawn, axis=0)) == pytest.approx(model.density * step_s, rel=0.02, abs=0.0)


def test_misalignment_counts_as_scale_factor_and_as_bias_under_gravity() -> None:
    """A milliradian of misalignment is 1000 ppm across the axes, and a mg where gravity stands across."""
    bare = GRADE.model_copy(
        update={
            "gyro_scale_factor_ppm": 300.0,
            "accel_bias_mg": 3.0,
            "gyro_bias_deg_per_h": 5.0,
            "gyro_bias_instability_deg_per_h": 0.0,
            "accel_bias_instability_mg": 0.0,
        }
    )
    crossed = bare.model_copy(
        update={
            "gyro_misalignment_mrad": 0.4,
            "accel_misalignment_mrad": 4.0,
            "gyro_g_sensitivity_deg_per_h_per_g": 12.0,
        }
    )

    without, with_them = sensor_model(bare), sensor_model(crossed)

    assert (without.gyro_scale, with_them.gyro_scale) == pytest.approx((300e-6, 500e-6))
    assert with_them.accel_bias.sigma / without.accel_bias.sigma == pytest.approx(5.0 / 3.0)
    assert with_them.gyro_bias.sigma / without.gyro_bias.sigma == pytest.approx(13.0 / 5.0)


def test_random_walks_that_an_allan_deviation_finds_move_the_biases() -> None:
    walking = GRADE.model_copy(
        update={"gyro_rate_random_walk_deg_per_h_per_sqrt_h": 30.0, "accel_random_walk_mg_per_sqrt_h": 1.2}
    )
    plain, model = sensor_model(GRADE), sensor_model(walking)

    # 1 deg/h/sqrt(h) = 4.848137e-6 rad/s / 60 sqrt(s); 1.2 mg/sqrt(h) = 0.02 mg/sqrt(s)
    assert model.gyro_bias.density - plain.gyro_bias.density == pytest.approx(
        (0.5 * 4.848137e-6) ** 2, rel=1e-6, abs=0.0
    )
    assert model.accel_bias.density - plain.accel_bias.density == pytest.approx(
        (0.02 * 9.80665e-3) ** 2, rel=1e-9, abs=0.0
    )
    assert (model.gyro_bias.sigma, model.accel_bias.sigma) == (plain.gyro_bias.sigma, plain.accel_bias.sigma)


@pytest.mark.parametrize(("constant", "instability"), [(8e-3, 1e-3), (0.0, 1e-3), (1e-3, 0.0), (0.0, 0.0)])
def test_bias_that_walks_has_grown_by_its_walk_after_hours(constant: float, instability: float) -> None:
    walk, hours = 2e-5, 4.0
    model = bias_model(constant, instability, 400.0, walk)
    t_s = 3600.0 * hours

    # d var / dt = -2 var / time + density, integrated exactly
    left = math.exp(-2.0 * t_s / model.time_s)
    fed = model.density * (t_s if math.isinf(model.time_s) else 0.5 * model.time_s * (1.0 - left))
    assert model.sigma**2 * left + fed == pytest.approx(
        constant**2 + instability**2 + walk**2 * t_s, rel=1e-9, abs=0.0
    )
    assert model.density == pytest.approx(2.0 * instability**2 / 400.0 + walk**2, rel=1e-12, abs=0.0)


def test_walk_too_small_to_matter_changes_nothing() -> None:
    plain, model = bias_model(8e-3, 1e-3, 400.0), bias_model(8e-3, 1e-3, 400.0, 1e-12)

    assert model.time_s == pytest.approx(plain.time_s, rel=1e-6)
