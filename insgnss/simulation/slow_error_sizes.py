"""The sizes of a simulated receiver's range errors that last, for its flight file (``[gnss.slow_errors]``)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.config.simulation import SimulatedGnss
from insgnss.config.slow_errors import NO_SLOW_ERRORS, SlowErrorSizes
from insgnss.tables import Float64

_SKY_POINTS: Final = 201
# share of an orbit's error along the line of sight, of radial, and of along and cross: GPS, averaged over the Earth
# [Montenbruck, Steigenberger & Hauschild 2015, Broadcast versus precise ephemerides, GPS Solutions 19(2)]
_RADIAL, _ACROSS2 = 0.98, 1.0 / 49.0
_MIRRORED_S: Final = 60.0  # a mirror's phase turns as the satellite rises: by a cycle in minutes


def slow_errors_of(gnss: SimulatedGnss) -> SlowErrorSizes:
    """Return the sizes of what lasts in a simulated log: errors of messages and air, and reflections.

    Reflections vary with elevation and the file has one size for them: the rms over an even sky above the mask. A
    satellite has one correlation time: that of the larger of its errors.
    """
    orbit, air = gnss.ephemeris_errors, gnss.air_errors
    across2 = orbit.along_m**2 + orbit.cross_m**2
    message2 = orbit.clock_m**2 + (_RADIAL * orbit.radial_m) ** 2 + _ACROSS2 * across2
    echo2, mirror2 = reflections_m(gnss) ** 2, mirrored_m(gnss) ** 2
    time_s = NO_SLOW_ERRORS.satellite_time_s
    if max(echo2, mirror2) > message2:
        time_s = gnss.multipath.correlation_time_s if gnss.multipath and echo2 > mirror2 else _MIRRORED_S
    return NO_SLOW_ERRORS.model_copy(
        update={
            "satellite_m": {"G": math.sqrt(message2 + echo2 + mirror2)},
            "satellite_time_s": time_s,
            "ionosphere_zenith_m": air.ionosphere_m,
            "no_ionosphere_zenith_m": air.ionosphere_m,
            "troposphere_zenith_m": air.troposphere_m,
            "air_time_s": air.correlation_time_s,
        }
    )


def reflections_m(gnss: SimulatedGnss) -> float:
    """Return the rms of the code's reflections without a geometry, over an even sky above the mask [m]."""
    echo = gnss.multipath
    if echo is None:
        return 0.0
    elevation_deg = np.degrees(np.arcsin(_sines(gnss)))
    sigma = echo.floor_m + echo.horizon_m * np.exp(-elevation_deg / echo.scale_deg)
    return float(np.sqrt(np.mean(sigma**2)))


def mirrored_m(gnss: SimulatedGnss) -> float:
    """Return the rms of what a mirror below the antenna adds to the code [m].

    Equation: a path longer by 2 h sin E, of relative amplitude a and any phase, moves the code by a 2 h sin E cos phi.
    """
    mirror = gnss.specular
    if mirror is None:
        return 0.0
    longer = 2.0 * mirror.height_m * _sines(gnss)
    return float(mirror.amplitude * np.sqrt(np.mean(longer**2) / 2.0))


def _sines(gnss: SimulatedGnss) -> Float64:
    return np.linspace(np.sin(np.radians(gnss.horizon_mask_deg)), 1.0, _SKY_POINTS)
