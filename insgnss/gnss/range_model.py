"""Every correction of a pseudorange, in one list (``CORRECTIONS``), and the part of it that an epoch's air makes.

Equation: P = rho + b + o - c dt_s + I (f_L1 / f)^2 + T, rho between the antennas' phase centres with the Earth's turn,
b the receiver's clock, o its inter-system offset, dt_s the satellite's clock with relativity and without group delay.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, NamedTuple

import numpy as np

from insgnss.gnss.ionosphere import (
    DAY_ENDS,
    ionosphere_above,
    klobuchar_delay_of,
    klobuchar_towards,
    klobuchar_wave,
)
from insgnss.gnss.troposphere import (
    STANDARD_WEATHER,
    Weather,
    mapped,
    mapping_coefficients,
    standard_atmosphere,
    zenith_delays,
)
from insgnss.kernels.jit import kernel
from insgnss.kernels.records import Record, dtype_of
from insgnss.tables import Float64


class RangeCorrection(NamedTuple):
    """One term of a pseudorange: its name, how it enters the prediction, and its size."""

    name: str
    adds: str  # "+": lengthens the predicted pseudorange where positive, "-": shortens it, "in rho"
    symbol: str  # in the equation above
    size_m: tuple[float, float]  # usual size between a good and a bad case, absolute value [m]
    where: str  # module of the package that computes it
    source: str


CORRECTIONS: Final = (
    RangeCorrection(
        "light time", "in rho", "rho", (30.0, 80.0), "gnss.orbits.satellite_state", "IS-GPS-200N, 20.3.3.4.3"
    ),
    RangeCorrection(
        "Earth's turn", "in rho", "rho", (0.0, 45.0), "gnss.line_of_sight", "IS-GPS-200N, 20.3.3.4.3.4"
    ),
    RangeCorrection(
        "satellite antenna",
        "in rho",
        "rho",
        (0.3, 3.0),
        "gnss.phase_centre",
        "ANTEX 1.4; broadcast orbits hold it",
    ),
    RangeCorrection(
        "receiver clock", "+", "b", (1.0, 3e5), "filter.state", "Kaplan and Hegarty (2017), 11.2"
    ),
    RangeCorrection(
        "inter-system offset", "+", "o", (0.1, 1e3), "filter.state", "RINEX 4.01, 5.4; receiver's own"
    ),
    RangeCorrection(
        "satellite clock",
        "-",
        "c dt_s",
        (1.0, 3e5),
        "gnss.orbits.satellite_clock",
        "IS-GPS-200N, 20.3.3.3.3.1",
    ),
    RangeCorrection(
        "relativity of the eccentricity",
        "-",
        "c dt_s",
        (0.1, 15.0),
        "gnss.orbits.satellite_clock",
        "IS-GPS-200N, 20.3.3.3.3.1",
    ),
    RangeCorrection(
        "group delay",
        "+",
        "c dt_s",
        (0.1, 8.0),
        "gnss.signals",
        "IS-GPS-200N, 20.3.3.3.3.2; other ICDs there",
    ),
    RangeCorrection(
        "ionosphere", "+", "I", (1.5, 60.0), "gnss.ionosphere", "IS-GPS-200N, 20.3.3.5.2.5; ionosphere_rows"
    ),
    RangeCorrection(
        "hydrostatic troposphere",
        "+",
        "T",
        (2.0, 25.0),
        "gnss.troposphere",
        "Davis et al. 1985, Radio Sci. 20(6), A11",
    ),
    RangeCorrection(
        "wet troposphere", "+", "T", (0.02, 4.0), "gnss.troposphere", "Saastamoinen 1972; Niell 1996"
    ),
    RangeCorrection(
        "differential correction",
        "+",
        "P",
        (0.1, 30.0),
        "gnss.differential",
        "RTCM 10402.3, message 1: base minus model",
    ),
)


class EpochAtmosphere(Record):
    """The common inputs of an epoch's delays."""

    lat: float  # of the antenna [rad]
    lon: float
    week_s: float  # GPS seconds of the week
    above: float  # share of the ionosphere above the antenna
    dry: float  # zenith delays of the troposphere [m]
    wet: float
    mapping: Annotated[Float64, 9]  # ``mapping_coefficients``
    wet_factor: float  # of the last row: d delay / d (zenith delay left over), by ``slant_delay``
    dry_factor: float  # of the last row, by ``slant_changes``


AIR_DTYPE: Final = dtype_of(EpochAtmosphere)


class AirModel(NamedTuple):
    """Which corrections there are and what they start from (``filter.parameters`` has the same numbers)."""

    klobuchar: Float64  # (8,), zeros without
    ionosphere: Float64  # (n,) (f_L1 / f)^2 of each row's or satellite's carrier, zero for none
    troposphere: float  # 1.0 or 0.0
    weather: Weather


@kernel
def evaluate_atmosphere(
    air: EpochAtmosphere,
    lat: float,
    lon: float,
    h: float,
    week_s: float,
    troposphere_factor: float,
    weather: Weather,
) -> None:
    """Write the common inputs of all satellites' delays at an antenna.

    Parameters
    ----------
    air : output
    lat, lon, h : of the antenna [rad, rad, m]
    week_s : GPS seconds of the week
    troposphere_factor : one, or zero for no correction
    weather : at sea level
    """
    air.lat, air.lon, air.week_s = lat, lon, week_s
    air.above = ionosphere_above(h)
    pressure, temperature, vapour = standard_atmosphere(
        h, weather.pressure_hpa, weather.temperature_k, weather.humidity
    )
    dry, wet = zenith_delays(lat, h, pressure, temperature, vapour)
    air.dry, air.wet = troposphere_factor * dry, troposphere_factor * wet
    air.wet_factor = 0.0
    mapping_coefficients(lat, h, air.mapping)


@kernel
def slant_delay(
    air: EpochAtmosphere,
    klobuchar: Float64,
    u_n: Float64,
    ionosphere_factor: float,
    ionosphere_m: float = math.nan,
) -> float:
    """Return the delay of a pseudorange by the atmosphere [m]; the wet mapping factor stays in ``air.wet_factor``.

    The factor is the row's derivative by a residual zenith delay; it is zero where there is no troposphere.

    Parameters
    ----------
    air : of the epoch
    klobuchar : (8,) alpha 0..3, beta 0..3
    u_n : (3,) unit line of sight, north-east-down
    ionosphere_factor : (f_L1 / f)^2 of the signal, zero for no ionosphere
    ionosphere_m : the delay on L1 at this antenna where another model gave it (``ionosphere_rows``), NaN for
        Klobuchar's model with ``klobuchar``
    """
    delay = 0.0
    if ionosphere_factor > 0.0:
        if math.isnan(ionosphere_m):
            sine = min(max(-u_n[2], -1.0), 1.0)
            level = math.sqrt(max(1.0 - sine * sine, 1e-24))
            elevation = math.asin(sine)
            on_ground = klobuchar_towards(
                klobuchar, air.lat, air.lon, u_n[0] / level, u_n[1] / level, elevation, air.week_s
            )
            delay += ionosphere_factor * air.above * on_ground
        else:
            delay += ionosphere_factor * ionosphere_m
    air.wet_factor = 0.0
    if air.dry > 0.0:
        dry_factor, wet_factor = mapped(air.mapping, -u_n[2])
        delay += air.dry * dry_factor + air.wet * wet_factor
        air.wet_factor = wet_factor
    return delay


@kernel
def slant_changes(
    air: EpochAtmosphere,
    earlier: EpochAtmosphere,
    klobuchar: Float64,
    u_n: Float64,
    u_n_earlier: Float64,
    with_ionosphere: bool,
    ionosphere_m: float,
) -> tuple[float, float, float, float]:
    """Return a path's ionosphere on L1 and troposphere [m], and by how much each has grown since a little earlier [m].

    Both are the models' own differences, so a rate from them is the model's to second order in the time between. The
    factors of both airs are those of the path afterwards, as ``slant_delay`` leaves them.

    Parameters
    ----------
    air, earlier : where and when the antenna is, and was
    klobuchar : (8,) alpha 0..3, beta 0..3
    u_n, u_n_earlier : (3,) unit lines of sight then, each in the north-east-down of its own place
    with_ionosphere : whether there is one
    ionosphere_m : the delay on L1 where another model gave it (its growth is that model's), NaN for Klobuchar's
    """
    ionosphere = grown = 0.0
    if with_ionosphere:
        if math.isnan(ionosphere_m):
            ionosphere, before = klobuchar_pair(air, earlier, klobuchar, u_n, u_n_earlier)
            grown = ionosphere - before
        else:
            ionosphere = ionosphere_m
    air.wet_factor = air.dry_factor = earlier.wet_factor = earlier.dry_factor = 0.0
    if air.dry <= 0.0:
        return ionosphere, grown, 0.0, 0.0
    air.dry_factor, air.wet_factor = mapped(air.mapping, -u_n[2])
    earlier.dry_factor, earlier.wet_factor = mapped(earlier.mapping, -u_n_earlier[2])
    troposphere = air.dry * air.dry_factor + air.wet * air.wet_factor
    before = earlier.dry * earlier.dry_factor + earlier.wet * earlier.wet_factor
    return ionosphere, grown, troposphere, troposphere - before


@kernel(inline=True)
def klobuchar_pair(
    air: EpochAtmosphere, earlier: EpochAtmosphere, klobuchar: Float64, u_n: Float64, u_n_earlier: Float64
) -> tuple[float, float]:
    """Return Klobuchar's delays on L1 [m] of now and of a little earlier, both by the branch of now."""
    sine = min(max(-u_n[2], -1.0), 1.0)
    level = math.sqrt(max(1.0 - sine * sine, 1e-24))
    slant, amplitude, x = klobuchar_wave(
        klobuchar, air.lat, air.lon, u_n[0] / level, u_n[1] / level, math.asin(sine), air.week_s
    )
    day = abs(x) < DAY_ENDS
    now = air.above * klobuchar_delay_of(slant, amplitude, x, day)
    sine = min(max(-u_n_earlier[2], -1.0), 1.0)
    level = math.sqrt(max(1.0 - sine * sine, 1e-24))
    slant, amplitude, x = klobuchar_wave(
        klobuchar,
        earlier.lat,
        earlier.lon,
        u_n_earlier[0] / level,
        u_n_earlier[1] / level,
        math.asin(sine),
        earlier.week_s,
    )
    return now, earlier.above * klobuchar_delay_of(slant, amplitude, x, day)


@kernel
def path_delay(
    klobuchar: Float64,
    place: tuple[float, float, float],
    azimuth: float,
    elevation: float,
    week_s: float,
    ionosphere_factor: float,
    troposphere_factor: float,
) -> float:
    """Return the delay of one pseudorange by the atmosphere [m]: ``evaluate_atmosphere`` and ``slant_delay`` in one.

    Parameters
    ----------
    klobuchar : (8,) alpha 0..3, beta 0..3
    place : latitude, longitude and height of the antenna [rad, rad, m]
    azimuth, elevation : of the satellite [rad]
    week_s : GPS seconds of the week
    ionosphere_factor : (f_L1 / f)^2 of the signal, zero for no correction
    troposphere_factor : one, or zero for no correction
    """
    air = np.zeros(1, AIR_DTYPE)
    lat, lon, h = place
    evaluate_atmosphere(air[0], lat, lon, h, week_s, troposphere_factor, STANDARD_WEATHER)
    level = math.cos(elevation)
    u_n = np.array([level * math.cos(azimuth), level * math.sin(azimuth), -math.sin(elevation)])
    return slant_delay(air[0], klobuchar, u_n, ionosphere_factor)
