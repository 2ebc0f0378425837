"""What the atmosphere adds to a pseudorange: none, or the broadcast model. Any function of the same form will do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from insgnss.gnss.range_model import path_delay
from insgnss.jit import kernel
from insgnss.tables import Float64

# geodetic (m, 3) latitude, longitude [rad] and height [m]; azimuth (m, n) and elevation (m, n) [rad]; seconds of the
# week (m,); it returns the delay (m, n) [m]
Atmosphere = Callable[[Float64, Float64, Float64, Float64], Float64]


def vacuum(geodetic: Float64, azimuth: Float64, elevation: Float64, week_s: Float64) -> Float64:
    """Return no delay at all."""
    return np.zeros_like(elevation)


@kernel
def _delays(
    klobuchar: Float64,
    geodetic: Float64,
    azimuth: Float64,
    elevation: Float64,
    week_s: Float64,
    ionosphere_factor: float,
    delay: Float64,
) -> None:
    for k in range(azimuth.shape[0]):
        lat, lon, h = geodetic[k]
        for j in range(azimuth.shape[1]):
            delay[k, j] = path_delay(
                klobuchar, lat, lon, h, azimuth[k, j], elevation[k, j], week_s[k], ionosphere_factor, 1.0
            )


def broadcast_atmosphere(klobuchar: Float64 | None) -> Atmosphere:
    """Return the delay on L1 by Klobuchar's ionosphere (none without coefficients) and Saastamoinen's troposphere.

    These are the models that the engine corrects with: what remains of them is simulated as noise. The residuals of a
    real atmosphere need a function of one's own.
    """
    factor = 0.0 if klobuchar is None else 1.0
    coefficients = np.zeros(8) if klobuchar is None else klobuchar

    def delay(geodetic: Float64, azimuth: Float64, elevation: Float64, week_s: Float64) -> Float64:
        result = np.empty_like(elevation)
        _delays(coefficients, geodetic, azimuth, elevation, week_s, factor, result)
        return result

    return delay
