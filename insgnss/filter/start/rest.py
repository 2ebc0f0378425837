"""Detect standstill at the start: by two velocities and the inertial samples between them.

A boat, a crane or a hovering aircraft moves slowly enough for both. Its gyros read the sway, which must not pass for
their bias. Where they read more than the grade's biases and the noise explain, the accelerometers decide: gravity turns
against the body as the gyros say, or it stays. A turn about gravity, or one too slow for them, stays in doubt.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.filter import FilterConfig
from insgnss.config.imu import ImuGrade
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.inertial.alignment import LARGEST_BIAS_RADPS, AlignmentWindow
from insgnss.inertial.sensor_model import SensorModel, sensor_model
from insgnss.tables import Float64

# What the sigma of a velocity may add to the limits of rest: with a poor velocity nothing says that the vehicle stands
_REST_ALLOWANCE_MPS: Final = 0.5
_SIGMAS: Final = 5.0
_LEAST_FORCE_MPS2: Final = 0.5 * STANDARD_GRAVITY_MPS2


class MeasuredVelocity(NamedTuple):
    """A velocity that something else than the filter has measured, along axes that do not turn with the vehicle."""

    t_ns: int
    v: Float64  # (3,) [m/s]
    P: Float64  # (3, 3) [m^2/s^2]


def velocities_show_rest(
    now: MeasuredVelocity, earlier: MeasuredVelocity | None, config: FilterConfig
) -> bool:
    """Return whether a vehicle is slow, and does not brake since an ``earlier`` velocity where there is one."""
    start = config.start
    slow = float(np.linalg.norm(now.v)) < start.rest_speed_mps + _allowance(now.P)
    if earlier is None:
        return slow
    change = float(np.linalg.norm(now.v - earlier.v))
    most = start.rest_acceleration_mps2 * (now.t_ns - earlier.t_ns) / NS_PER_S
    return slow and change < most + _allowance(now.P + earlier.P)


def samples_show_rest(window: AlignmentWindow, config: FilterConfig, grade: ImuGrade) -> bool:
    """Return whether gyros and accelerometers hold still, and the gyros read no more than their biases may be.

    They may exceed the grade if gravity does not turn with them. Accelerometers that do not feel gravity do not
    measure, or the vehicle falls.
    """
    start = config.start
    if float(np.linalg.norm(window.still_f_b)) < _LEAST_FORCE_MPS2:
        return False
    limit = math.radians(start.rest_rate_degps)
    steady = window.spread_w < limit and window.spread_f < start.rest_accel_mps2
    read = np.abs(window.w_ib_b).max()
    stands = read < LARGEST_BIAS_RADPS and np.linalg.norm(window.tilting_b) < limit
    return bool(steady and (read <= _largest_usual(config, grade) or stands) and not _tilts(window, grade))


def reading_sigma(window: AlignmentWindow, sensor: SensorModel) -> float:
    """Return the sigma of the gyros' mean reading as one of their errors [rad/s].

    White noise averages down; a third of the spread represents swaying during the window.
    """
    return math.hypot(math.sqrt(sensor.gyro_density / window.length_s), window.spread_w / 3.0)


def rate_in_doubt(window: AlignmentWindow, grade: ImuGrade) -> tuple[Float64, Float64]:
    """Return what of the gyros' reading may be a turn rather than a bias: mean (3,) [rad/s] and covariance (3, 3).

    A rate that may be bias or turn is taken as half bias, with a sigma of that half. About gravity the accelerometers
    see no turn; which way gravity is they know as well as their biases. Across gravity a reading is a bias beyond the
    grade if the accelerometers would see a quarter of it, and see nothing.
    """
    sensor = sensor_model(grade)
    about, across = _parts(window)
    level = sensor.accel_bias.sigma / STANDARD_GRAVITY_MPS2 * float(np.linalg.norm(about))
    most, size = _explained(window, sensor), float(np.linalg.norm(across))
    sees_nothing = np.linalg.norm(window.tilting_b) <= 3.0 * window.sd_tilting < 0.75 * size
    mean, covariance = np.zeros(3), np.zeros((3, 3))
    if np.linalg.norm(about) > most:
        up = about / np.linalg.norm(about)
        mean += 0.5 * about
        covariance += np.outer(0.5 * about, 0.5 * about) + level**2 * (np.eye(3) - np.outer(up, up))
    if size > most + _SIGMAS * level and not sees_nothing:
        mean += 0.5 * across
        covariance += np.outer(0.5 * across, 0.5 * across)
    return mean, covariance


def _tilts(window: AlignmentWindow, grade: ImuGrade) -> bool:
    """Return whether gravity turns as the gyros read, by more than the grade's errors."""
    _, across = _parts(window)
    size = float(np.linalg.norm(across))
    if size <= _explained(window, sensor_model(grade)):
        return False
    seen = np.linalg.norm(window.tilting_b) > _SIGMAS * window.sd_tilting
    return bool(seen and np.linalg.norm(across - window.tilting_b) < 0.5 * size)


def _parts(window: AlignmentWindow) -> tuple[Float64, Float64]:
    """Return the parts of the gyros' mean reading about gravity and across it, (3,) each [rad/s]."""
    up = window.still_f_b / np.linalg.norm(window.still_f_b)
    about = float(window.w_ib_b @ up) * up
    return about, window.w_ib_b - about


def _explained(window: AlignmentWindow, sensor: SensorModel) -> float:
    """Return what the gyros of a vehicle that stands may read [rad/s]."""
    return WGS84_OMEGA_RADPS + _SIGMAS * math.hypot(sensor.gyro_bias.sigma, reading_sigma(window, sensor))


def _largest_usual(config: FilterConfig, grade: ImuGrade) -> float:
    """Return the reading up to which a vehicle may stand even if vibration hides what gravity does [rad/s]."""
    return math.radians(config.start.rest_rate_degps + 3.0 * grade.gyro_bias_deg_per_h / 3600.0)


def slight_acceleration(now: MeasuredVelocity, earlier: MeasuredVelocity) -> float:
    """Return the acceleration that two velocities of a vehicle at rest leave possible [m/s^2].

    Equation: a^2 = (|v - v'|^2 - tr(P + P')) / T^2, the mean square beyond their own sigmas. A car counts as at rest in
    the last moment of its brake, whose 0.5 m/s^2 are 3 deg of the level.
    """
    change = now.v - earlier.v
    beyond = float(change @ change) - float(np.trace(now.P + earlier.P))
    return math.sqrt(max(beyond, 0.0)) * NS_PER_S / (now.t_ns - earlier.t_ns)


def _allowance(P: Float64) -> float:
    """Return three sigmas of a velocity, at most what rest allows [m/s]."""
    return min(3.0 * math.sqrt(float(np.trace(P))), _REST_ALLOWANCE_MPS)
