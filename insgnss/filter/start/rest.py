"""Detect standstill at the start: by two velocities and the inertial samples between them."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.filter import FilterConfig
from insgnss.config.imu import ImuGrade
from insgnss.constants import NS_PER_S
from insgnss.inertial.alignment import LARGEST_BIAS_RADPS, AlignmentWindow
from insgnss.tables import Float64

# What the sigma of a velocity may add to the limits of rest: with a poor velocity nothing says that the vehicle stands
_REST_ALLOWANCE_MPS: Final = 0.5


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

    They may read more than the grade says: gravity shows whether the vehicle tilts as they read.
    """
    start = config.start
    limit = math.radians(start.rest_rate_degps)
    steady = window.spread_w < limit and window.spread_f < start.rest_accel_mps2
    read = np.abs(window.w_ib_b).max()
    stands = read < LARGEST_BIAS_RADPS and np.linalg.norm(window.tilting_b) < limit
    return bool(steady and (read <= _largest_usual(config, grade) or stands))


def rate_in_doubt(window: AlignmentWindow, config: FilterConfig, grade: ImuGrade) -> Float64:
    """Return (3,) the rate about gravity that may be a bias or a turn [rad/s], zero if the grade has such biases."""
    up = -window.still_f_b / np.linalg.norm(window.still_f_b)
    about = float(window.w_ib_b @ up)
    return about * up if abs(about) > _largest_usual(config, grade) else np.zeros(3)


def _largest_usual(config: FilterConfig, grade: ImuGrade) -> float:
    """Return what a gyro of the grade may read at rest [rad/s]."""
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
