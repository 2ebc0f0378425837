"""The sizes of a simulated receiver's range errors that last, for its flight file (``[gnss.slow_errors]``)."""

from __future__ import annotations

import math
from operator import itemgetter
from typing import Final

import numpy as np

from insgnss.config.simulation import SimulatedGnss
from insgnss.config.slow_errors import NO_SLOW_ERRORS, SlowErrorSizes
from insgnss.constants import C_MPS
from insgnss.gnss.signals import L1_HZ
from insgnss.tables import Float64

_SKY_POINTS: Final = 201
# share of an orbit's error along the line of sight, of radial, and of along and cross: GPS, averaged over the Earth
# [Montenbruck, Steigenberger & Hauschild 2015, Broadcast versus precise ephemerides, GPS Solutions 19(2)]
_RADIAL, _ACROSS2 = 0.98, 1.0 / 49.0
_SINE_RATE: Final = (
    8e-5  # rate of sin E [1/s], rms of the GPS satellites above 5 deg at latitudes of 45 to 60 deg
)


def slow_errors_of(gnss: SimulatedGnss) -> SlowErrorSizes:
    """Return the sizes of what lasts in a simulated log: errors of messages and air, and reflections.

    Reflections vary with elevation and the file has one size for them: the rms over an even sky above the mask. A
    satellite has one correlation time: that of the larger of its errors.
    """
    orbit, air = gnss.ephemeris_errors, gnss.air_errors
    across2 = orbit.along_m**2 + orbit.cross_m**2
    message2 = orbit.clock_m**2 + (_RADIAL * orbit.radial_m) ** 2 + _ACROSS2 * across2
    lasting = [(message2, NO_SLOW_ERRORS.satellite_time_s)]
    if gnss.multipath is not None:
        lasting.append((reflections_m(gnss) ** 2, gnss.multipath.correlation_time_s))
    if gnss.specular is not None:
        lasting.append((mirrored_m(gnss) ** 2, mirrored_s(gnss.specular.height_m)))
    variance = sum(variance for variance, _ in lasting)
    _, time_s = max(lasting, key=itemgetter(0))
    return NO_SLOW_ERRORS.model_copy(
        update={
            "satellite_m": {"G": math.sqrt(variance)},
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


def mirrored_s(height_m: float) -> float:
    """Return the correlation time [s] of the error of a mirror below the antenna by ``height_m``.

    Equation: the phase phi = 2 pi 2 h sin E / lambda turns at w = 4 pi h (sin E)' / lambda as the satellite rises. Over
    times longer than 1 / w the sine averages out, and faster than a Gauss-Markov error of that correlation time.
    """
    return C_MPS / L1_HZ / (4.0 * math.pi * height_m * _SINE_RATE)


def _sines(gnss: SimulatedGnss) -> Float64:
    return np.linspace(np.sin(np.radians(gnss.horizon_mask_deg)), 1.0, _SKY_POINTS)
