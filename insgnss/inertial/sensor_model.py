"""The error model of an inertial sensor: from a grade to the densities the filter's prediction needs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from insgnss.config.flight import ImuGrade
from insgnss.units import (
    deg_per_h_to_radps,
    deg_per_sqrt_h_to_rad_per_sqrt_s,
    mg_to_mps2,
    mps_per_sqrt_h_to_mps_per_sqrt_s,
    ppm_to_ratio,
)


@dataclass(frozen=True)
class BiasModel:
    """A first-order Gauss-Markov bias: b' = -b / time_s + noise of two-sided density ``density`` [unit^2 / s]."""

    sigma: float
    time_s: float
    density: float


def bias_model(constant: float, instability: float, time_s: float) -> BiasModel:
    """Return one Gauss-Markov process that stands for a constant bias plus an in-run instability.

    Equation: sigma^2 = constant^2 + instability^2, density = 2 instability^2 / time_s, time = 2 sigma^2 / density
    The short-term wander is that of the instability alone and the variance stays that of both together; with no
    constant part it is the plain Gauss-Markov process. Neglects: the constant part slowly forgets its value, over a
    time (sigma / instability)^2 longer than the correlation time.
    """
    variance = constant**2 + instability**2
    density = 2.0 * instability**2 / time_s
    return BiasModel(math.sqrt(variance), 2.0 * variance / density if density > 0.0 else math.inf, density)


@dataclass(frozen=True)
class SensorModel:
    """Densities and sigmas of a grade in SI units, per axis."""

    gyro_density: float  # angular random walk squared [rad^2/s]
    accel_density: float  # velocity random walk squared [m^2/s^3]
    gyro_bias: BiasModel  # [rad/s]
    accel_bias: BiasModel  # [m/s^2]
    gyro_scale: float  # one sigma [-]
    accel_scale: float  # one sigma [-]


def sensor_model(grade: ImuGrade) -> SensorModel:
    """Return the SI densities of an IMU grade.

    What is constant in one attitude and changes with it is not a state of its own: a gyro's sensitivity to the specific
    force of rest and an accelerometer's misalignment times gravity count as constant bias, misalignments else as scale
    factors, whose errors they resemble in a manoeuvre. Each adds in variance.
    """
    gyro_scale = math.hypot(ppm_to_ratio(grade.gyro_scale_factor_ppm), 1e-3 * grade.gyro_misalignment_mrad)
    accel_scale = math.hypot(ppm_to_ratio(grade.accel_scale_factor_ppm), 1e-3 * grade.accel_misalignment_mrad)
    gyro_bias = math.hypot(grade.gyro_bias_deg_per_h, grade.gyro_g_sensitivity_deg_per_h_per_g)
    accel_bias = math.hypot(grade.accel_bias_mg, grade.accel_misalignment_mrad)  # a milliradian of g is a mg
    return SensorModel(
        gyro_density=deg_per_sqrt_h_to_rad_per_sqrt_s(grade.gyro_arw_deg_per_sqrt_h) ** 2,
        accel_density=mps_per_sqrt_h_to_mps_per_sqrt_s(grade.accel_vrw_mps_per_sqrt_h) ** 2,
        gyro_bias=bias_model(
            deg_per_h_to_radps(gyro_bias),
            deg_per_h_to_radps(grade.gyro_bias_instability_deg_per_h),
            grade.gyro_correlation_time_s,
        ),
        accel_bias=bias_model(
            mg_to_mps2(accel_bias),
            mg_to_mps2(grade.accel_bias_instability_mg),
            grade.accel_correlation_time_s,
        ),
        gyro_scale=gyro_scale,
        accel_scale=accel_scale,
    )
