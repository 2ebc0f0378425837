"""Conversions at the edges: what a data sheet, a log or a user writes, in SI units and radians, and back.

Each function takes a float or an array and returns the same kind. Inside the package there is nothing to convert.

Random-walk figures per square root of an hour become densities per square root of a second, which is the same as
per square root of a hertz: ``1 deg/sqrt(h) = 1/60 deg/sqrt(s) = 1/60 (deg/s)/sqrt(Hz)``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt

from insgnss.constants import STANDARD_GRAVITY_MPS2

Value = TypeVar("Value", float, npt.NDArray[np.float64])

RAD_PER_DEG: Final = math.pi / 180.0
S_PER_H: Final = 3600.0
SQRT_S_PER_SQRT_H: Final = 60.0
MPS2_PER_MG: Final = 1e-3 * STANDARD_GRAVITY_MPS2

# What one of the unit, as a flight file may declare it, is in SI units and radians
SI_PER_UNIT: Final[Mapping[str, float]] = MappingProxyType(
    {
        "rad": 1.0,
        "deg": RAD_PER_DEG,
        "rad/s": 1.0,
        "deg/s": RAD_PER_DEG,
        "deg/h": RAD_PER_DEG / S_PER_H,
        "m/s^2": 1.0,
        "g": STANDARD_GRAVITY_MPS2,
        "mg": MPS2_PER_MG,
        "cm/s^2": 1e-2,
        "m/s": 1.0,
        "km/h": 1.0 / 3.6,
        "mph": 0.44704,
        "kn": 1852.0 / 3600.0,
        "g*s": STANDARD_GRAVITY_MPS2,
        "m": 1.0,
        "ft": 0.3048,
        "s": 1.0,
        "ms": 1e-3,
        "us": 1e-6,
        "ns": 1e-9,
    }
)


def deg_to_rad(angle_deg: Value) -> Value:
    """Return radians of an angle [deg], or rad/s of a rate [deg/s]."""
    return angle_deg * RAD_PER_DEG


def rad_to_deg(angle_rad: Value) -> Value:
    """Return degrees of an angle [rad], or deg/s of a rate [rad/s]."""
    return angle_rad / RAD_PER_DEG


def deg_per_h_to_radps(rate_deg_per_h: Value) -> Value:
    """Return a gyro bias or drift in rad/s."""
    return rate_deg_per_h * (RAD_PER_DEG / S_PER_H)


def radps_to_deg_per_h(rate_radps: Value) -> Value:
    """Return a gyro bias or drift in deg/h."""
    return rate_radps / (RAD_PER_DEG / S_PER_H)


def deg_per_sqrt_h_to_rad_per_sqrt_s(walk_deg_per_sqrt_h: Value) -> Value:
    """Return an angle random walk (ARW) as a density in rad/sqrt(s) = (rad/s)/sqrt(Hz)."""
    return walk_deg_per_sqrt_h * (RAD_PER_DEG / SQRT_S_PER_SQRT_H)


def mps_per_sqrt_h_to_mps_per_sqrt_s(walk_mps_per_sqrt_h: Value) -> Value:
    """Return a velocity random walk (VRW) as a density in (m/s)/sqrt(s) = (m/s^2)/sqrt(Hz)."""
    return walk_mps_per_sqrt_h / SQRT_S_PER_SQRT_H


def mps_per_sqrt_s_to_mps_per_sqrt_h(walk_mps_per_sqrt_s: Value) -> Value:
    """Return a velocity random walk (VRW) in m/s/sqrt(h)."""
    return walk_mps_per_sqrt_s * SQRT_S_PER_SQRT_H


def rad_per_sqrt_s_to_deg_per_sqrt_h(walk_rad_per_sqrt_s: Value) -> Value:
    """Return an angle random walk (ARW) in deg/sqrt(h)."""
    return walk_rad_per_sqrt_s / (RAD_PER_DEG / SQRT_S_PER_SQRT_H)


def mg_to_mps2(acceleration_mg: Value) -> Value:
    """Return an accelerometer bias [mg] in m/s^2."""
    return acceleration_mg * MPS2_PER_MG


def mps2_to_mg(acceleration_mps2: Value) -> Value:
    """Return an accelerometer bias [m/s^2] in mg."""
    return acceleration_mps2 / MPS2_PER_MG


def ppm_to_ratio(scale_ppm: Value) -> Value:
    """Return a scale factor error [ppm] as a ratio."""
    return scale_ppm * 1e-6
