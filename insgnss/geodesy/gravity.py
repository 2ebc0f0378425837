"""Normal gravity of WGS-84: Somigliana on the ellipsoid, and the same field at any height in ECEF.

The compiled field is the normal field's even zonal series: on the ellipsoid it is Somigliana's formula to 2e-9 m/s^2,
and unlike the usual second-order height term (wrong by 0.9 m/s^2 at 2000 km) it stays right at any height.
"""

from __future__ import annotations

import math

from insgnss.constants import (
    WGS84_A_M,
    WGS84_E2,
    WGS84_GM_M3PS2,
    WGS84_J2,
    WGS84_OMEGA_RADPS,
)
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

# zonals of the normal field: J_2n = (-1)^(n+1) 3 e^2n / ((2n+1)(2n+3)) (1 - n + 5 n J2 / e^2)
# [Heiskanen & Moritz 1967, 2-92]
_J4 = -3.0 * WGS84_E2**2 / 35.0 * (-1.0 + 10.0 * WGS84_J2 / WGS84_E2)
_J6 = 3.0 * WGS84_E2**3 / 63.0 * (-2.0 + 15.0 * WGS84_J2 / WGS84_E2)


@kernel
def normal_gravity_ecef(r_e: Float64, g_e: Float64) -> None:
    """Write normal gravity (gravitation and centrifugal acceleration) at ``r_e`` (3,) [m] into ``g_e`` (3,) [m/s^2].

    Equation: g = -GM r/r^3 (1 - sum J_n (a/r)^n [(n+1) P_n + s P_n' - (P_n'/s) z-row]) + w^2 (x, y, 0), s = z/r
    Neglects: J8 and above, 1e-9 m/s^2.
    """
    x = r_e[0]
    y = r_e[1]
    z = r_e[2]
    inv_r2 = 1.0 / (x * x + y * y + z * z)
    s2 = z * z * inv_r2
    s4 = s2 * s2
    s6 = s4 * s2
    q = WGS84_A_M * WGS84_A_M * inv_r2
    j2 = WGS84_J2 * q * 1.5
    j4 = _J4 * q * q * 0.125
    j6 = _J6 * q * q * q * 0.0625
    central = -WGS84_GM_M3PS2 * inv_r2 * math.sqrt(inv_r2)
    horizontal = (
        j2 * (1.0 - 5.0 * s2)
        - j4 * (315.0 * s4 - 210.0 * s2 + 15.0)
        - j6 * (3003.0 * s6 - 3465.0 * s4 + 945.0 * s2 - 35.0)
    )
    axial = (
        j2 * (3.0 - 5.0 * s2)
        - j4 * (315.0 * s4 - 350.0 * s2 + 75.0)
        - j6 * (3003.0 * s6 - 4851.0 * s4 + 2205.0 * s2 - 245.0)
    )
    across = central * (1.0 + horizontal) + WGS84_OMEGA_RADPS * WGS84_OMEGA_RADPS
    g_e[0] = across * x
    g_e[1] = across * y
    g_e[2] = central * (1.0 + axial) * z
