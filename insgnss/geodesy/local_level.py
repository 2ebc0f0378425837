"""The local level frame n (north-east-down): its axes in ECEF, and geodetic positions of whole arrays."""

from __future__ import annotations

import math

import numpy as np
import pymap3d

from insgnss.constants import WGS84_A_M, WGS84_E2
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel
def up_direction(r_e: Float64) -> tuple[float, float, float]:
    """Return the unit vector up, against gravity, at an ECEF position (3,) [m]: that of the ellipsoid's normal.

    Equation: (x, y, z / (1 - e^2 a / |r|)), of length one; the normal itself has N / (N + h) in the place of a / |r|
    Neglects: 2e-5 rad by that, and the bend of the plumb line, 2e-6 rad at 10 km. The Earth's centre is up to 3e-3 rad
    off, by which a turn about it would tilt.
    """
    x, y, z = r_e[0], r_e[1], r_e[2]
    r = math.sqrt(x * x + y * y + z * z)
    z /= 1.0 - WGS84_E2 * WGS84_A_M / r
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@kernel
def ecef_to_ned_matrix(lat: float, lon: float, C_ne: Float64) -> None:
    """Write C_ne (3, 3), rows north, east, down in ECEF axes, at geodetic ``lat``, ``lon`` [rad].

    At a pole north points along the meridian of ``lon``: any longitude gives a valid frame.
    """
    sf, cf = math.sin(lat), math.cos(lat)
    sl, cl = math.sin(lon), math.cos(lon)
    C_ne[0, 0] = -sf * cl
    C_ne[0, 1] = -sf * sl
    C_ne[0, 2] = cf
    C_ne[1, 0] = -sl
    C_ne[1, 1] = cl
    C_ne[1, 2] = 0.0
    C_ne[2, 0] = -cf * cl
    C_ne[2, 1] = -cf * sl
    C_ne[2, 2] = -sf


def level_axes(r_e: Float64) -> Float64:
    """Return C_ne (3, 3), rows north, east, down in ECEF axes, at an ECEF position (3,) [m]."""
    lat, lon, _ = ecef_to_geodetic(r_e)
    C_ne = np.zeros((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)
    return C_ne


def geodetic(r_e: Float64) -> Float64:
    """Return latitude, longitude [rad] and height [m] (n, 3) of ECEF positions (n, 3) [m]; NaN stays NaN."""
    lat, lon, h = pymap3d.ecef2geodetic(r_e[:, 0], r_e[:, 1], r_e[:, 2], deg=False)
    # a single position comes back as scalars
    return np.column_stack([np.atleast_1d(lat), np.atleast_1d(lon), np.atleast_1d(h)])


def ned_axes(place: Float64) -> Float64:
    """Return C_ne (n, 3, 3), rows north, east, down in ECEF axes, at geodetic positions (n, 3)."""
    sf, cf = np.sin(place[:, 0]), np.cos(place[:, 0])
    sl, cl = np.sin(place[:, 1]), np.cos(place[:, 1])
    north = np.column_stack([-sf * cl, -sf * sl, cf])
    east = np.column_stack([-sl, cl, np.zeros_like(sl)])
    down = np.column_stack([-cf * cl, -cf * sl, -sf])
    return np.stack([north, east, down], axis=1)
