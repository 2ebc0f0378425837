"""The ionosphere: single-layer models with eight broadcast coefficients, GPS's (Klobuchar) and BeiDou's.

GPS: IS-GPS-200N, 20.3.3.5.2.5; QZSS and NavIC broadcast coefficients of the same form. BeiDou: BDS-SIS-ICD B1I 3.0,
5.2.4.7. They remove about half of the delay (rms). All arguments in radians and seconds; the models' own semicircles
stay inside.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.constants import C_MPS, S_PER_DAY, WGS84_A_M
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_NIGHT_DELAY_S: Final = 5.0e-9
_SHORTEST_PERIOD_S: Final = 72_000.0
_PEAK_LOCAL_TIME_S: Final = 50_400.0
DAY_ENDS: Final = 1.57  # phase [rad] from which the night's constant stands alone
_NORTHERNMOST_SC: Final = 0.416  # of the pierce point's latitude, either way
_POLE_LATITUDE_SC: Final = 0.064  # tilt of the geomagnetic pole
_POLE_LONGITUDE_SC: Final = 1.617

# BDS-SIS-ICD B1I 3.0, 5.2.4.7
_BEIDOU_RADIUS_M: Final = 6_378_000.0
_BEIDOU_LAYER_M: Final = 375_000.0
_BEIDOU_LONGEST_PERIOD_S: Final = 172_800.0

_PEAK_HEIGHT_M: Final = 350_000.0  # the model's layer; IS-GPS-200N, 20.3.3.5.2.5
AT_SHELL: Final = WGS84_A_M / (WGS84_A_M + _PEAK_HEIGHT_M)  # the Earth's radius over the layer's
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
    slant, amplitude, x = klobuchar_wave(coefficients, lat, lon, cos_azimuth, sin_azimuth, elevation, week_s)
    return klobuchar_delay_of(slant, amplitude, x, abs(x) < DAY_ENDS)


@kernel(inline=True)
def klobuchar_wave(
    coefficients: Float64,
    lat: float,
    lon: float,
    cos_azimuth: float,
    sin_azimuth: float,
    elevation: float,
    week_s: float,
) -> tuple[float, float, float]:
    """Return slant factor F, amplitude A [s] and phase x [rad] of the day's wave; see ``klobuchar_towards``."""
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
    return 1.0 + 16.0 * low * low * low, amplitude, x


@kernel(inline=True)
def klobuchar_delay_of(slant: float, amplitude: float, x: float, day: bool) -> float:
    """Return the delay [m] of a ``klobuchar_wave``, by day or by night.

    The model jumps where the day ends, by 2 % of A: a difference of two delays takes ``day`` of one of them for both.
    """
    vertical = _NIGHT_DELAY_S
    if day:
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


def beidou_delay(
    coefficients: Float64, lat: Float64, lon: Float64, azimuth: Float64, elevation: Float64, week_s: Float64
) -> Float64:
    """Return the ionospheric delay of codes on B1I [m] by BeiDou's model; on another carrier times (f_B1I / f)^2.

    Equation: I = [5 ns + A2 cos(2 pi (t - 50400 s) / A4)] / sqrt(1 - (R / (R + h) cos E)^2), the cosine for
    |t - 50400 s| < A4 / 4, A2 and A4 cubic in the pierce point's geographic latitude    [BDS-SIS-ICD B1I 3.0, 5.2.4.7]
    A satellite below the horizon gets the delay at elevation zero. For a receiver on the ground.

    Parameters
    ----------
    coefficients : (8,) alpha 0..3 [s, s/semicircle, ...], beta 0..3 [s, s/semicircle, ...]
    lat, lon : (n,) geodetic, of the antenna [rad]
    azimuth, elevation : (n,) of the satellite [rad]
    week_s : (n,) BeiDou time, seconds of the week (or of the day) [s]
    """
    cos_at_layer = (
        _BEIDOU_RADIUS_M / (_BEIDOU_RADIUS_M + _BEIDOU_LAYER_M) * np.cos(np.maximum(elevation, 0.0))
    )
    psi = 0.5 * math.pi - np.maximum(elevation, 0.0) - np.arcsin(cos_at_layer)
    sin_phi = np.sin(lat) * np.cos(psi) + np.cos(lat) * np.sin(psi) * np.cos(azimuth)
    phi = np.arcsin(np.clip(sin_phi, -1.0, 1.0))
    # beyond a pole the arcsine would fold the longitude: the same point by the angle's two sides
    lam = lon + np.arctan2(
        np.sin(psi) * np.sin(azimuth) * np.cos(lat), np.cos(psi) - np.sin(lat) * np.sin(phi)
    )
    local_s = (week_s + lam * (S_PER_DAY / (2.0 * math.pi))) % S_PER_DAY
    latitude_sc = np.abs(phi) / math.pi
    a, b = coefficients[0:4], coefficients[4:8]
    amplitude = np.maximum(a[0] + latitude_sc * (a[1] + latitude_sc * (a[2] + latitude_sc * a[3])), 0.0)
    period = b[0] + latitude_sc * (b[1] + latitude_sc * (b[2] + latitude_sc * b[3]))
    period = np.clip(period, _SHORTEST_PERIOD_S, _BEIDOU_LONGEST_PERIOD_S)
    after_peak = local_s - _PEAK_LOCAL_TIME_S
    day = np.abs(after_peak) < 0.25 * period
    vertical = _NIGHT_DELAY_S + np.where(day, amplitude * np.cos(2.0 * math.pi * after_peak / period), 0.0)
    return np.asarray(C_MPS * vertical / np.sqrt(1.0 - cos_at_layer**2))


@kernel(inline=True)
def shell_mapping(sine: float) -> float:
    """Return slant over zenith delay of a thin shell 350 km high: 1 / sqrt(1 - (R / (R + h) cos E)^2)."""
    return 1.0 / math.sqrt(1.0 - AT_SHELL * AT_SHELL * (1.0 - sine * sine))
