"""The error model of an inertial sensor: from a grade to the densities the filter's prediction needs."""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.config.flight import ImuGrade
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.tables import Float64
from insgnss.units import (
    SQRT_S_PER_SQRT_H,
    deg_per_h_to_radps,
    deg_per_sqrt_h_to_rad_per_sqrt_s,
    mg_to_mps2,
    mps_per_sqrt_h_to_mps_per_sqrt_s,
    ppm_to_ratio,
)

OVER_RANGE: Final = 2.0  # no sensor shows twice its declared range

# of what a sensor's errors may go with beside time: each name and unit are those of the grade
UNIT_OF_ERROR: Final = {
    "gyro_scale_factor": "ppm",
    "gyro_misalignment": "mrad",
    "gyro_g_sensitivity": "deg_per_h_per_g",
    "accel_scale_factor": "ppm",
    "accel_misalignment": "mrad",
}
_WALK_S: Final = 4.0 * 3600.0  # for which a random walk's variance is right: as long as logs and missions are


@dataclass(frozen=True)
class BiasModel:
    """A first-order Gauss-Markov bias: b' = -b / time_s + noise of two-sided density ``density`` [unit^2 / s]."""

    sigma: float  # when the sensor is switched on
    time_s: float
    density: float


def bias_model(constant: float, instability: float, time_s: float, walk: float = 0.0) -> BiasModel:
    """Return one Gauss-Markov process that represents a constant bias, an in-run instability and a random walk.

    Equation: sigma^2 = constant^2 + instability^2, density = 2 instability^2 / time_s + walk^2; the time is that for
    which the variance stays sigma^2 (time = 2 sigma^2 / density without a walk) or, with a walk, has become
    sigma^2 + walk^2 t after t = 4 h: sigma^2 exp(-2 t / time) + density time / 2 (1 - exp(-2 t / time)).
    The short-term wander is that of the parts; with no constant part and no walk it is the plain Gauss-Markov process,
    of a walk alone the variance grows for ever. Neglects: the constant part slowly forgets its value, over a time
    (sigma / instability)^2 longer than the correlation time; what a walk beside an instability does after 4 h, when the
    variance comes to rest.

    Parameters
    ----------
    walk : of the bias itself [unit / sqrt(s)]
    """
    variance = constant**2 + instability**2
    density = 2.0 * instability**2 / time_s + walk**2
    rate = _decay_rate(variance, density, variance + walk**2 * _WALK_S)
    return BiasModel(math.sqrt(variance), 2.0 / rate if rate > 0.0 else math.inf, density)


def _decay_rate(variance: float, density: float, wanted: float) -> float:
    """Return the rate r [1/s] at which the variance decays to become ``wanted`` after ``_WALK_S``."""

    def reached(rate: float) -> float:
        left = math.exp(-rate * _WALK_S)
        return variance * left + density * (1.0 - left) / rate

    if wanted >= variance + density * _WALK_S:  # nothing but a walk
        return 0.0
    low, high = 0.0, density / variance  # at which the variance stays what it is
    if wanted <= variance:
        return high
    for _ in range(100):  # halves, to rounding
        middle = 0.5 * (low + high)
        low, high = (middle, high) if reached(middle) > wanted else (low, middle)
    return 0.5 * (low + high)


@dataclass(frozen=True)
class SensorModel:
    """Densities and sigmas of a grade in SI units, per axis."""

    gyro_density: float  # angular random walk squared [rad^2/s]
    accel_density: float  # velocity random walk squared [m^2/s^3]
    gyro_bias: BiasModel  # [rad/s]
    accel_bias: BiasModel  # [m/s^2]
    gyro_scale: float  # one sigma [-]
    accel_scale: float  # one sigma [-]
    accel_scale_factor: float  # the same without the axes' misalignment [-]

    def accel_bias_variances(self, down_b: Float64) -> Float64:
        """Return the variances (3,) of the accelerometers' biases when switched on in an attitude [m^2/s^4].

        Equation: sigma_i^2 = sigma^2 + (scale g down_i)^2: at rest, or on a straight, an axis' scale factor reads a
        share of the gravity along it, which is a bias as long as the attitude is constant. Its change with
        attitude is noise of the manoeuvre. Of the axes' misalignments the bias has a share in every direction.

        Parameters
        ----------
        down_b : (3,) unit vector down, body axes
        """
        of_gravity = self.accel_scale_factor * STANDARD_GRAVITY_MPS2 * np.asarray(down_b)
        return np.asarray(self.accel_bias.sigma**2 + of_gravity**2)


def sensor_model(grade: ImuGrade, states: Container[str] = ()) -> SensorModel:
    """Return the SI densities of an IMU grade.

    What is constant in one attitude and changes with it, and has no state of its own, counts as constant bias: a gyro's
    sensitivity to the specific force of rest and an accelerometer's misalignment times gravity. Misalignments else
    count as scale factors, whose errors they resemble in a manoeuvre. Each adds in variance. What an accelerometer
    scale factor reads of gravity is in the direction of gravity alone: ``SensorModel.accel_bias_variances``.

    Parameters
    ----------
    states : names of errors (``UNIT_OF_ERROR``) that have states of their own and are left out
    """
    left_out = {f"{name}_{unit}": 0.0 for name, unit in UNIT_OF_ERROR.items() if name in states}
    grade = grade.model_copy(update=left_out)
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
            deg_per_h_to_radps(grade.gyro_rate_random_walk_deg_per_h_per_sqrt_h) / SQRT_S_PER_SQRT_H,
        ),
        accel_bias=bias_model(
            mg_to_mps2(accel_bias),
            mg_to_mps2(grade.accel_bias_instability_mg),
            grade.accel_correlation_time_s,
            mg_to_mps2(grade.accel_random_walk_mg_per_sqrt_h) / SQRT_S_PER_SQRT_H,
        ),
        gyro_scale=gyro_scale,
        accel_scale=accel_scale,
        accel_scale_factor=ppm_to_ratio(grade.accel_scale_factor_ppm),
    )
