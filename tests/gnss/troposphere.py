"""The troposphere's delay from place and elevation alone, by the package's parts."""

from __future__ import annotations

import math

import numpy as np

from insgnss.gnss.troposphere import mapped, mapping_coefficients, standard_atmosphere, zenith_delays


def mapping_factors(lat: float, h: float, elevation: float) -> tuple[float, float]:
    """Return slant delay over zenith delay, hydrostatic and wet."""
    m = np.empty(9)
    mapping_coefficients(lat, h, m)
    return mapped(m, math.sin(elevation))


def tropospheric_delay(lat: float, h: float, elevation: float) -> float:
    """Return the delay through the standard atmosphere [m]."""
    dry, wet = zenith_delays(lat, h, *standard_atmosphere(h))
    dry_factor, wet_factor = mapping_factors(lat, h, elevation)
    return dry * dry_factor + wet * wet_factor
