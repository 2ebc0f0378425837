"""The WGS-84 ellipsoid: radii of curvature and the way between ECEF and geodetic coordinates, compiled.

No singularity at the poles; heights from -500 km to beyond the navigation satellites.
"""

from __future__ import annotations

import math

from insgnss.constants import WGS84_A_M, WGS84_B_M, WGS84_E2
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_SECOND_E2 = WGS84_E2 / (1.0 - WGS84_E2)
_BOWRING_STEPS = 3  # one step is good to 1e-9 rad at 10 km, three to rounding at 20 000 km


@kernel
def radii(lat: float) -> tuple[float, float]:
    """Return the radii of curvature of meridian and prime vertical (M, N) [m] at geodetic latitude ``lat`` [rad]."""
    w2 = 1.0 - WGS84_E2 * math.sin(lat) ** 2
    n = WGS84_A_M / math.sqrt(w2)
    return n * (1.0 - WGS84_E2) / w2, n


@kernel
def geodetic_to_ecef(lat: float, lon: float, h: float, r_e: Float64) -> None:
    """Write the ECEF position [m] of geodetic ``lat``, ``lon`` [rad] and ``h`` [m] into ``r_e`` (3,)."""
    n = radii(lat)[1]
    p = (n + h) * math.cos(lat)
    r_e[0] = p * math.cos(lon)
    r_e[1] = p * math.sin(lon)
    r_e[2] = (n * (1.0 - WGS84_E2) + h) * math.sin(lat)


@kernel
def ecef_to_geodetic(r_e: Float64) -> tuple[float, float, float]:
    """Return geodetic latitude, longitude [rad] and height [m] of the ECEF position ``r_e`` (3,) [m].

    Equation: tan lat = (z + e'^2 b sin^3 beta) / (p - e^2 a cos^3 beta), beta reduced latitude   [Bowring 1976]
    Neglects: nothing above 1e-9 m between -500 km and 30 000 km; inside 50 km of the centre it has no meaning.
    """
    p = math.hypot(r_e[0], r_e[1])
    z = r_e[2]
    sin_lat = z * WGS84_A_M
    cos_lat = p * WGS84_B_M
    for _ in range(_BOWRING_STEPS):
        # reduced latitude: tan beta = (1 - f) tan lat; the first pass takes tan beta = z a / (p b)
        norm = math.hypot(sin_lat, cos_lat)
        sin_b = sin_lat / norm
        cos_b = cos_lat / norm
        sin_geo = z + _SECOND_E2 * WGS84_B_M * sin_b**3
        cos_geo = p - WGS84_E2 * WGS84_A_M * cos_b**3
        sin_lat = sin_geo * WGS84_B_M
        cos_lat = cos_geo * WGS84_A_M
    norm = math.hypot(sin_geo, cos_geo)
    s = sin_geo / norm
    h = p * cos_geo / norm + z * s - WGS84_A_M * math.sqrt(1.0 - WGS84_E2 * s * s)
    return math.atan2(sin_geo, cos_geo), math.atan2(r_e[1], r_e[0]), h
