"""The troposphere: Saastamoinen's zenith delays in the standard atmosphere, Niell's mapping to the elevation.

The zenith delay is good to about 5 cm (the weather of the day is unknown), the mapping to 1 cm above 5 deg. A measured
pressure makes the hydrostatic part good to 2 mm for each hPa of its error; the wet part stays within 3 to 5 cm, because
the humidity at the ground says little of that above.

Weather is kept as three numbers at sea level (pressure, temperature, relative humidity), to which
``weather_at_sea_level`` brings a measurement made at any height; the standard atmosphere is the default of all three.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.errors import ConfigError
from insgnss.geodesy.standard_atmosphere import LAPSE_K_PER_M, P0_HPA, T0_K, TROPOPAUSE_M
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

# Standard atmosphere (ICAO doc 7488; ISO 2533)
_PRESSURE_EXPONENT: Final = 5.25588  # g0 M / (R L)
_T_TROPOPAUSE_K: Final = T0_K - LAPSE_K_PER_M * TROPOPAUSE_M
# R T / (g0 M) at the tropopause, kept above it (below 2 cm of delay above 30 km)
_SCALE_HEIGHT_M: Final = 6341.62
# relative, at sea level: 0.12 m of wet delay at the zenith, near the mean over the Earth
_HUMIDITY: Final = 0.7

# What weather at sea level can be: records of pressure 870 and 1085 hPa, of temperature -90 and +57 degC, with a margin
_POSSIBLE_WEATHER: Final = ((850.0, 1100.0), (180.0, 335.0), (0.0, 1.0))

_LOWEST_H_M: Final = -1000.0  # no antenna is lower; a wrong height must not make a wild delay
_HIGHEST_GRAVITY_H_M: Final = 100_000.0  # above, nothing is left to weigh
_HIGHEST_MAPPING_H_M: Final = 15_000.0  # Niell fitted his height correction to radiosondes
# Niell is valid to 3 deg and finite to 2 deg; lower is as 2 deg
_LOWEST_SINE: Final = math.sin(math.radians(2.0))

# Niell (1996), J. Geophys. Res. 101(B2), tables 3 and 4, at latitudes 15, 30, 45, 60, 75 deg
_HYDROSTATIC: Final = np.array(
    [
        [1.2769934e-3, 1.2683230e-3, 1.2465397e-3, 1.2196049e-3, 1.2045996e-3],
        [2.9153695e-3, 2.9152299e-3, 2.9288445e-3, 2.9022565e-3, 2.9024912e-3],
        [62.610505e-3, 62.837393e-3, 63.721774e-3, 63.824265e-3, 64.258455e-3],
    ]
)
_WET: Final = np.array(
    [
        [5.8021897e-4, 5.6794847e-4, 5.8118019e-4, 5.9727542e-4, 6.1641693e-4],
        [1.4275268e-3, 1.5138625e-3, 1.4572752e-3, 1.5007428e-3, 1.7599082e-3],
        [4.3472961e-2, 4.6729510e-2, 4.3908931e-2, 4.4626982e-2, 5.4736038e-2],
    ]
)
_HEIGHT: Final = (2.53e-5, 5.49e-3, 1.14e-3)
_HEIGHT_AT_ZENITH: Final = 1.0 + _HEIGHT[0] / (1.0 + _HEIGHT[1] / (1.0 + _HEIGHT[2]))


class Weather(NamedTuple):
    """The state of the air, brought to sea level."""

    pressure_hpa: float = P0_HPA
    temperature_k: float = T0_K
    humidity: float = _HUMIDITY  # relative, 0 to 1, taken as the same at all heights


STANDARD_WEATHER: Final = Weather()


def weather_at_sea_level(
    pressure_hpa: float | None = None,
    temperature_k: float | None = None,
    humidity: float | None = None,
    h: float = 0.0,
) -> Weather:
    """Return the weather at sea level that gives the measured values at height ``h``; None is as in the standard.

    Equation: T0 = T + L h, p0 = p (T0 / T)^5.256, the inverse of ``standard_atmosphere``.

    Parameters
    ----------
    pressure_hpa : air pressure at the station, not reduced to sea level [hPa]
    temperature_k : [K]
    humidity : relative, 0 to 1
    h : height of the instruments above the ellipsoid, below the tropopause [m]

    Raises
    ------
    ConfigError : a value that no weather on Earth has
    """
    low = min(max(h, _LOWEST_H_M), TROPOPAUSE_M)
    cooling = LAPSE_K_PER_M * low
    temperature = T0_K - cooling if temperature_k is None else temperature_k
    sea_level_k = temperature + cooling
    reduced = P0_HPA
    if pressure_hpa is not None:
        # a temperature that is none is refused below
        reduced = pressure_hpa * (sea_level_k / max(temperature, 1.0)) ** _PRESSURE_EXPONENT
    weather = Weather(reduced, sea_level_k, _HUMIDITY if humidity is None else humidity)
    for key, value, (least, most) in zip(Weather._fields, weather, _POSSIBLE_WEATHER, strict=True):
        if not least <= value <= most:
            raise ConfigError(
                f"{value:g} at sea level is not possible weather",
                key=key,
                advice=f"give the values measured at the stated height; at sea level {least:g} to {most:g}",
            )
    return weather


@kernel
def standard_atmosphere(
    h: float, pressure_0: float = P0_HPA, temperature_0: float = T0_K, humidity: float = _HUMIDITY
) -> tuple[float, float, float]:
    """Return pressure [hPa], temperature [K] and water vapour pressure [hPa] at height ``h`` [m].

    Equation: p = p0 (1 - L h / T0)^5.256, T = T0 - L h up to 11 km; above, T stays and both pressures fall as
    exp(-(h - 11 km) / H), H = 6.34 km T(11 km) / 216.65 K, to nothing.
    e = humidity * 6.108 exp((17.15 T - 4684) / (T - 38.45)).

    Parameters
    ----------
    h : height [m]
    pressure_0, temperature_0, humidity : ``Weather`` at sea level; the standard atmosphere when not given
    """
    low = min(max(h, _LOWEST_H_M), TROPOPAUSE_M)
    temperature = temperature_0 - LAPSE_K_PER_M * low
    scale = _SCALE_HEIGHT_M * ((temperature_0 - LAPSE_K_PER_M * TROPOPAUSE_M) / _T_TROPOPAUSE_K)
    thinning = math.exp(-max(h - TROPOPAUSE_M, 0.0) / scale)
    pressure = pressure_0 * math.pow(temperature / temperature_0, _PRESSURE_EXPONENT) * thinning
    saturation = 6.108 * math.exp((17.15 * temperature - 4684.0) / (temperature - 38.45))
    return pressure, temperature, humidity * saturation * thinning


@kernel
def zenith_delays(
    lat: float, h: float, pressure: float, temperature: float, vapour: float
) -> tuple[float, float]:
    """Return the hydrostatic and the wet delay at the zenith [m].

    Equation: 0.0022768 p / (1 - 0.00266 cos 2 lat - 0.00028 h/km) and 0.0022768 (1255 / T + 0.05) e
    [Saastamoinen 1972; Davis et al. 1985, Radio Sci. 20(6), eq. A11]

    Parameters
    ----------
    lat, h : of the antenna [rad, m]
    pressure, temperature, vapour : there [hPa, K, hPa]
    """
    gravity = 1.0 - 0.00266 * math.cos(2.0 * lat) - 2.8e-7 * min(h, _HIGHEST_GRAVITY_H_M)
    return 0.0022768 * pressure / gravity, 0.0022768 * (1255.0 / temperature + 0.05) * vapour


@kernel
def _at_zenith(a: float, b: float, c: float) -> float:
    """Return the numerator of Herring's continued fraction, which makes it one at the zenith."""
    return 1.0 + a / (1.0 + b / (1.0 + c))


@kernel
def mapping_coefficients(lat: float, h: float, m: Float64) -> None:
    """Write what the mapping needs of a place into ``m`` (9,): a, b, c hydrostatic, a, b, c wet, both numerators, km.

    Equation: Niell (1996), eq. 5, at the mean of the year, linear in latitude between the table's columns.
    A latitude that is not a number gives coefficients that are NaN.
    """
    place = min(max(abs(lat) * (12.0 / math.pi) - 1.0, 0.0), 4.0)  # 15 deg steps
    i = int(place) if 0.0 <= place < 3.0 else 3  # NaN too: an index is never made of it
    w = place - i
    for k in range(3):
        m[k] = _HYDROSTATIC[k, i] + w * (_HYDROSTATIC[k, i + 1] - _HYDROSTATIC[k, i])
        m[3 + k] = _WET[k, i] + w * (_WET[k, i + 1] - _WET[k, i])
    m[6] = _at_zenith(m[0], m[1], m[2])
    m[7] = _at_zenith(m[3], m[4], m[5])
    m[8] = 1e-3 * min(max(h, _LOWEST_H_M), _HIGHEST_MAPPING_H_M)


@kernel
def mapped(m: Float64, sine: float) -> tuple[float, float]:
    """Return slant delay over zenith delay, hydrostatic and wet, at the sine of an elevation; ``m`` of the place.

    Equation: Herring's continued fraction (1 + a/(1 + b/(1 + c))) / (s + a/(s + b/(s + c))), and Niell's height term
    h (1/s - f_height(s)), eq. 6; at the mean of the year.
    Neglects: the season (1e-3 of the slant delay at 10 deg, 5 cm of delay at 5 deg, 60 deg latitude). Below 2 deg
    of elevation the factors stay what they are at 2 deg.
    """
    s = max(sine, _LOWEST_SINE)
    hydrostatic = m[6] / (s + m[0] / (s + m[1] / (s + m[2])))
    wet = m[7] / (s + m[3] / (s + m[4] / (s + m[5])))
    height = _HEIGHT_AT_ZENITH / (s + _HEIGHT[0] / (s + _HEIGHT[1] / (s + _HEIGHT[2])))
    return hydrostatic + m[8] * (1.0 / s - height), wet
