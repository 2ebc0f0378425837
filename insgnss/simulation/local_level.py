"""Geodetic places and north-east-down axes of whole arrays of positions."""

from __future__ import annotations

import numpy as np
import pymap3d

from insgnss.tables import Float64


def geodetic(r_e: Float64) -> Float64:
    """Return latitude, longitude [rad] and height [m] (n, 3) of ECEF positions (n, 3) [m]."""
    lat, lon, h = pymap3d.ecef2geodetic(r_e[:, 0], r_e[:, 1], r_e[:, 2], deg=False)
    # a single position comes back as scalars
    return np.column_stack([np.atleast_1d(lat), np.atleast_1d(lon), np.atleast_1d(h)])


def ned_axes(place: Float64) -> Float64:
    """Return C_ne (n, 3, 3), rows north, east, down in ECEF axes, at geodetic places (n, 3)."""
    sf, cf = np.sin(place[:, 0]), np.cos(place[:, 0])
    sl, cl = np.sin(place[:, 1]), np.cos(place[:, 1])
    north = np.column_stack([-sf * cl, -sf * sl, cf])
    east = np.column_stack([-sl, cl, np.zeros_like(sl)])
    down = np.column_stack([-cf * cl, -cf * sl, -sf])
    return np.stack([north, east, down], axis=1)
