"""Normal gravity by Somigliana's formula, as published with WGS-84: what the field of the package must equal."""

from __future__ import annotations

import math
from typing import Final

from insgnss.constants import WGS84_A_M, WGS84_E2, WGS84_F

# NGA.STND.0036 (2014), tables 3.4 and 3.5
WGS84_GAMMA_E_MPS2: Final = 9.7803253359  # normal gravity at the equator
WGS84_GAMMA_P_MPS2: Final = 9.8321849379  # normal gravity at the pole
WGS84_SOMIGLIANA_K: Final = 1.931852652458e-3  # Somigliana's constant k = b gp / (a ge) - 1
WGS84_M: Final = 3.449786506841e-3  # omega^2 a^2 b / GM


def somigliana(lat: float, h: float) -> float:
    """Return normal gravity [m/s^2] at geodetic latitude ``lat`` [rad] and height ``h`` [m].

    Equation: gamma = ge (1 + k s^2) / sqrt(1 - e^2 s^2),  s = sin lat          [NGA.STND.0036, 4-1]
              gamma(h) = gamma (1 - 2/a (1 + f + m - 2 f s^2) h + 3 h^2 / a^2)  [NGA.STND.0036, 4-3]
    Neglects: the flattening squared in the gradient, 1e-10 m/s^2 per metre, and third order in h/a: 7e-7 m/s^2 at
    10 km, 0.9 m/s^2 at 2000 km.
    """
    s2 = math.sin(lat) ** 2
    on_ellipsoid = WGS84_GAMMA_E_MPS2 * (1.0 + WGS84_SOMIGLIANA_K * s2) / math.sqrt(1.0 - WGS84_E2 * s2)
    x = h / WGS84_A_M
    return on_ellipsoid * (1.0 - 2.0 * (1.0 + WGS84_F + WGS84_M - 2.0 * WGS84_F * s2) * x + 3.0 * x * x)
