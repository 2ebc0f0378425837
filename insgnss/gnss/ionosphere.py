"""The ionosphere: Klobuchar's single-layer model with the eight broadcast coefficients (IS-GPS-200N, 20.3.3.5.2.5).

It removes about half of the delay (rms). All arguments in radians and seconds; the model's own semicircles stay inside.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.constants import C_MPS, S_PER_DAY
from insgnss.jit import kernel
from insgnss.tables import Float64

_NIGHT_DELAY_S: Final = 5.0e-9
_SHORTEST_PERIOD_S: Final = 72_000.0
_PEAK_LOCAL_TIME_S: Final = 50_400.0
_NORTHERNMOST_SC: Final = 0.416  # of the pierce point's latitude, either way
_POLE_LATITUDE_SC: Final = 0.064  # tilt of the geomagnetic pole
_POLE_LONGITUDE_SC: Final = 1.617

_PEAK_HEIGHT_M: Final = 350_000.0  # the model's layer; IS-GPS-200N, 20.3.3.5.2.5
_SCALE_HEIGHT_M: Final = 80_000.0  # of the ionised gas above the peak, about 70 to 100 km (Chapman layer)


@kernel
def klobuchar_delay(
    coefficients: Float64, lat: float, lon: float, azimuth: float, elevation: float, week_s: float
) -> float:
    """Return the ionospheric delay of a code on L1 [m] towards an azimuth [rad]; see ``klobuchar_towards``."""
    return klobuchar_towards(coefficients, lat, lon, math.cos(azimuth), math.sin(azimuth), elevation, week_s)


@kernel
def klobuchar_towards(
    coefficients: Float64,
    lat: float,
    lon: float,
    cos_azimuth: float,
    sin_azimuth: float,
    elevation: float,
    week_s: float,
) -> float:
    """Return the ionospheric delay of a code on L1 [m]; on another carrier times (f_L1 / f)^2.

    Equation: F [5 ns + A (1 - x^2/2 + x^4/24)], x = 2 pi (t - 50400 s) / P    [IS-GPS-200N, figure 20-4]
    A satellite below the horizon gets the delay at elevation zero (the obliquity has a pole at -20 deg). For a
    receiver on the ground; higher up multiply by ``ionosphere_above``.

    Parameters
    ----------
    coefficients : (8,) alpha 0..3 [s, s/semicircle, ...], beta 0..3 [s, s/semicircle, ...]
    lat, lon : geodetic, of the antenna [rad]
    cos_azimuth, sin_azimuth : of the satellite's azimuth
    elevation : of the satellite [rad]
    week_s : GPS time, seconds of the week (or of the day) [s]
    """
    elevation_sc = max(elevation, 0.0) / math.pi
    # earth-centred angle to the pierce point, its latitude and longitude, its geomagnetic latitude [semicircles]
    psi = 0.0137 / (elevation_sc + 0.11) - 0.022
    phi = lat / math.pi + psi * cos_azimuth
    phi = min(max(phi, -_NORTHERNMOST_SC), _NORTHERNMOST_SC)
    lam = lon / math.pi + psi * sin_azimuth / math.cos(phi * math.pi)
    phi_m = phi + _POLE_LATITUDE_SC * math.cos((lam - _POLE_LONGITUDE_SC) * math.pi)
    local_s = (43_200.0 * lam + week_s) % S_PER_DAY
    a, b = coefficients[0:4], coefficients[4:8]
    amplitude = max(a[0] + phi_m * (a[1] + phi_m * (a[2] + phi_m * a[3])), 0.0)
    period = max(b[0] + phi_m * (b[1] + phi_m * (b[2] + phi_m * b[3])), _SHORTEST_PERIOD_S)
    x = 2.0 * math.pi * (local_s - _PEAK_LOCAL_TIME_S) / period
    # slant factor F = 1 + 16 (0.53 - E)^3
    low = 0.53 - elevation_sc
    slant = 1.0 + 16.0 * low * low * low
    vertical = _NIGHT_DELAY_S
    if abs(x) < 1.57:
        vertical += amplitude * (1.0 - 0.5 * x * x * (1.0 - x * x / 12.0))
    return C_MPS * slant * vertical


@kernel
def ionosphere_above(h: float) -> float:
    """Return the share of the vertical electron content that lies above height ``h`` [m]; 1 on the ground.

    Equation: erf(exp(-z / 2) / sqrt 2), z = (h - 350 km) / 80 km, the integral of a Chapman layer
    exp((1 - z - exp(-z)) / 2) from ``h`` upwards. 1 - 1e-9 at 80 km, 0.68 at the peak, 0 far above.
    """
    if h > _PEAK_HEIGHT_M + 100.0 * _SCALE_HEIGHT_M:
        return 0.0
    if h < 0.0:
        return 1.0
    return math.erf(math.exp(0.5 * (_PEAK_HEIGHT_M - h) / _SCALE_HEIGHT_M) / math.sqrt(2.0))
