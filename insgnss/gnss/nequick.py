"""Galileo's ionosphere: NeQuick-G, three-dimensional and of the whole Earth, through the library ``sidereon``.

The library agrees with the verification tables of the model's description (Galileo ionospheric correction algorithm
1.2, annex A) to 0.03 TECU, 5 mm on L1. A delay takes 1 to 3 ms, too long for every row of a log: ``ionosphere_rows``
takes one for each satellite every few minutes and interpolates.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.gnss.signals import L1_HZ
from insgnss.tables import Float64

# When all three coefficients are zero the message does not state them (model's description 1.2, 3.1)
_DEFAULT_COEFFICIENTS: Final = (63.7, 0.0, 0.0)


def nequick_delay(
    coefficients: Float64, month: int, utc_h: float, antenna: Float64, satellite: Float64
) -> float:
    """Return the ionospheric delay of a code on L1 [m], NaN where the ray cannot be followed.

    Equation: 40.3e16 / f^2 times the electron content of the ray in TECU.

    Parameters
    ----------
    coefficients : (3,) a_i0, a_i1, a_i2 of the navigation message; all zero for the model's default
    month : 1 to 12
    utc_h : time of the day, UTC [h]
    antenna, satellite : (3,) geodetic latitude, longitude [rad], height [m]
    """
    a0, a1, a2 = map(float, coefficients) if np.any(coefficients) else _DEFAULT_COEFFICIENTS
    try:
        delay = sidereon.nequick_g_delay_m(
            a0,
            a1,
            a2,
            month,
            utc_h % 24.0,
            math.degrees(antenna[1]),
            math.degrees(antenna[0]),
            float(antenna[2]),
            math.degrees(satellite[1]),
            math.degrees(satellite[0]),
            float(satellite[2]),
            L1_HZ,
        )
    except (ValueError, sidereon.SidereonError):
        return math.nan
    return float(delay)
