"""The local level frame n (north-east-down): its axes in ECEF, and directions seen in it."""

from __future__ import annotations

import math

from insgnss.jit import borrowing
from insgnss.tables import Float64


@borrowing
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
