"""Every correction of a pseudorange, in one list: what is added to the geometric range, its sign, its size.

| term                     | sign | size               | where |
|--------------------------|------|--------------------|-------|
| Earth's turn (Sagnac)    | in the geometric range    | up to 40 m | ``line_of_sight`` |
| receiver clock           | +    | metres to 300 km   | filter state |
| inter-system offset      | +    | up to 1 km         | filter state, further constellations only |
| satellite clock          | -    | up to 300 km       | ``satellite_clock``, relativity and group delay in it |
| ionosphere               | +    | 2 to 50 m          | ``ionosphere``, scaled by (f_L1 / f)^2 |
| troposphere              | +    | 2.4 to 25 m        | ``troposphere`` |
"""

from __future__ import annotations

import math
from typing import Any, Final, TypeAlias

import numpy as np

from insgnss.gnss.ionosphere import ionosphere_above, klobuchar_towards
from insgnss.gnss.troposphere import mapped, mapping_coefficients, standard_atmosphere, zenith_delays
from insgnss.jit import kernel
from insgnss.tables import Float64

AIR_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("lat", np.float64),  # of the antenna [rad]
            ("lon", np.float64),
            ("week_s", np.float64),  # GPS seconds of the week
            ("above", np.float64),  # share of the ionosphere above the antenna
            ("dry", np.float64),  # zenith delays of the troposphere [m]
            ("wet", np.float64),
            ("mapping", np.float64, (9,)),  # ``mapping_coefficients``
        ],
    )
)
Air: TypeAlias = Any  # one element of AIR_DTYPE: what all delays of an epoch share


@kernel
def place_air(air: Air, lat: float, lon: float, h: float, week_s: float, troposphere_factor: float) -> None:
    """Write what the delays of all satellites share at an antenna; ``troposphere_factor`` is one, or zero for none."""
    air.lat, air.lon, air.week_s = lat, lon, week_s
    air.above = ionosphere_above(h)
    pressure, temperature, vapour = standard_atmosphere(h)
    dry, wet = zenith_delays(lat, h, pressure, temperature, vapour)
    air.dry, air.wet = troposphere_factor * dry, troposphere_factor * wet
    mapping_coefficients(lat, h, air.mapping)


@kernel
def slant_delay(air: Air, klobuchar: Float64, u_n: Float64, ionosphere_factor: float) -> float:
    """Return the delay of a pseudorange by the atmosphere [m].

    Parameters
    ----------
    air : of the epoch
    klobuchar : (8,) alpha 0..3, beta 0..3
    u_n : (3,) unit line of sight, north-east-down
    ionosphere_factor : (f_L1 / f)^2 of the signal, zero for no ionosphere
    """
    delay = 0.0
    if ionosphere_factor > 0.0:
        sine = min(max(-u_n[2], -1.0), 1.0)
        level = math.sqrt(max(1.0 - sine * sine, 1e-24))
        elevation = math.asin(sine)
        on_ground = klobuchar_towards(
            klobuchar, air.lat, air.lon, u_n[0] / level, u_n[1] / level, elevation, air.week_s
        )
        delay += ionosphere_factor * air.above * on_ground
    if air.dry > 0.0:
        dry_factor, wet_factor = mapped(air.mapping, -u_n[2])
        delay += air.dry * dry_factor + air.wet * wet_factor
    return delay


@kernel
def path_delay(
    klobuchar: Float64,
    lat: float,
    lon: float,
    h: float,
    azimuth: float,
    elevation: float,
    week_s: float,
    ionosphere_factor: float,
    troposphere_factor: float,
) -> float:
    """Return the delay of one pseudorange by the atmosphere [m]: ``place_air`` and ``slant_delay`` in one.

    Parameters
    ----------
    klobuchar : (8,) alpha 0..3, beta 0..3
    lat, lon, h : of the antenna [rad, rad, m]
    azimuth, elevation : of the satellite [rad]
    week_s : GPS seconds of the week
    ionosphere_factor : (f_L1 / f)^2 of the signal, zero for no correction
    troposphere_factor : one, or zero for no correction
    """
    air = np.zeros(1, AIR_DTYPE)
    place_air(air[0], lat, lon, h, week_s, troposphere_factor)
    level = math.cos(elevation)
    u_n = np.array([level * math.cos(azimuth), level * math.sin(azimuth), -math.sin(elevation)])
    return slant_delay(air[0], klobuchar, u_n, ionosphere_factor)
