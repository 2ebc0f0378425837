"""Pressure and altitude in the standard atmosphere of ICAO Doc 7488: the scale of a barometer."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.tables import Float64

# ICAO Doc 7488/3: sea level, gas constant of air, lapse of the troposphere, its upper end, the Earth's nominal radius
P0_HPA: Final = 1013.25
T0_K: Final = 288.15
_R_J_PER_KG_K: Final = 287.05287
LAPSE_K_PER_M: Final = 0.0065
TROPOPAUSE_M: Final = 11_000.0
_RADIUS_M: Final = 6_356_766.0

_POWER: Final = STANDARD_GRAVITY_MPS2 / (_R_J_PER_KG_K * LAPSE_K_PER_M)
_T11_K: Final = T0_K - LAPSE_K_PER_M * TROPOPAUSE_M
_P11_HPA: Final = P0_HPA * (_T11_K / T0_K) ** _POWER
_SCALE_M: Final = _R_J_PER_KG_K * _T11_K / STANDARD_GRAVITY_MPS2


def pressure_altitude(pressure_hpa: npt.ArrayLike) -> Float64:
    """Return the geometric altitude [m] at which the standard atmosphere has a pressure [hPa]; NaN stays.

    Neglects: what lies above 20 km, where the temperature rises again; 60 m at 22 km.
    """
    p = np.asarray(pressure_hpa, np.float64)
    low = T0_K / LAPSE_K_PER_M * (1.0 - (p / P0_HPA) ** (1.0 / _POWER))
    high = TROPOPAUSE_M - _SCALE_M * np.log(p / _P11_HPA)
    H = np.where(p >= _P11_HPA, low, high)
    return np.asarray(np.where(np.isnan(p), np.nan, _RADIUS_M * H / (_RADIUS_M - H)))


def standard_pressure(altitude_m: npt.ArrayLike) -> Float64:
    """Return the pressure [hPa] of the standard atmosphere at a geometric altitude [m]."""
    z = np.asarray(altitude_m, np.float64)
    H = _RADIUS_M * z / (_RADIUS_M + z)
    low = P0_HPA * np.maximum(1.0 - LAPSE_K_PER_M * H / T0_K, 0.0) ** _POWER
    return np.where(H <= TROPOPAUSE_M, low, _P11_HPA * np.exp(-(H - TROPOPAUSE_M) / _SCALE_M))
