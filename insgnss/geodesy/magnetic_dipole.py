"""The Earth's magnetic field: its size, and whether it points down or up by the dipole that fits it best."""

from __future__ import annotations

import math
from typing import Final

from insgnss.units import RAD_PER_DEG

EARTH_FIELD_UT: Final = (18.0, 80.0)  # at the ground, 22 to 67; a fifth for iron on board
_POLE_LAT: Final = 80.8 * RAD_PER_DEG  # of the dipole, IGRF-14, 2025
_POLE_LON: Final = -72.8 * RAD_PER_DEG
_UNKNOWN: Final = math.sin(20.0 * RAD_PER_DEG)  # the dip equator strays from the dipole's by up to 15 deg


def down_sign(lat: float, lon: float) -> int:
    """Return 1 where the field points down, -1 where it points up, 0 within 20 deg of the dipole's equator.

    Equation: sin(magnetic latitude) = sin(lat) sin(lat_p) + cos(lat) cos(lat_p) cos(lon - lon_p), p the pole

    Parameters
    ----------
    lat, lon : geodetic [rad]
    """
    sine = math.sin(lat) * math.sin(_POLE_LAT)
    sine += math.cos(lat) * math.cos(_POLE_LAT) * math.cos(lon - _POLE_LON)
    return 0 if abs(sine) < _UNKNOWN else int(math.copysign(1.0, sine))
