"""The atmosphere's delay of a signal: nothing, or the broadcast model. Any function of the same form will do."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from insgnss.gnss.range_model import path_delay
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


class Atmosphere(Protocol):
    """An atmosphere, asked for the delay of all paths at once."""

    def __call__(
        self,
        geodetic: Float64,
        azimuth: Float64,
        elevation: Float64,
        week_s: Float64,
        ionosphere: float = 1.0,
    ) -> Float64:
        """Return the delay (m, n) [m].

        Parameters
        ----------
        geodetic : (m, 3) latitude, longitude [rad] and height [m] of the antenna
        azimuth, elevation : (m, n) of the satellites [rad]
        week_s : (m,) seconds of the week
        ionosphere : delay over that of the code on L1, (f_L1 / f)^2; negative for a carrier, which is advanced
        """


def vacuum(
    geodetic: Float64, azimuth: Float64, elevation: Float64, week_s: Float64, ionosphere: float = 1.0
) -> Float64:
    """Return no delay at all."""
    return np.zeros_like(elevation)


@kernel
def delays_along(
    klobuchar: Float64,
    geodetic: Float64,
    azimuth: Float64,
    elevation: Float64,
    week_s: Float64,
    ionosphere_factor: float,
    delay: Float64,
) -> None:
    """Write the delay [m] of each of (m, k) lines of sight from the places ``geodetic`` (m, 3) into ``delay``."""
    for k in range(azimuth.shape[0]):
        place = geodetic[k, 0], geodetic[k, 1], geodetic[k, 2]
        for j in range(azimuth.shape[1]):
            delay[k, j] = path_delay(
                klobuchar, place, azimuth[k, j], elevation[k, j], week_s[k], ionosphere_factor, 1.0
            )


def broadcast_atmosphere(klobuchar: Float64 | None) -> Atmosphere:
    """Return the delay by Klobuchar's ionosphere (none without coefficients) and Saastamoinen's troposphere.

    These are the models that the engine corrects with: what remains of them is simulated as noise. The residuals of a
    real atmosphere need a function of one's own.
    """
    factor = 0.0 if klobuchar is None else 1.0
    coefficients = np.zeros(8) if klobuchar is None else klobuchar

    def delay(
        geodetic: Float64, azimuth: Float64, elevation: Float64, week_s: Float64, ionosphere: float = 1.0
    ) -> Float64:
        result = np.empty_like(elevation)
        delays_along(coefficients, geodetic, azimuth, elevation, week_s, factor * abs(ionosphere), result)
        if ionosphere < 0.0:
            troposphere = np.empty_like(elevation)
            delays_along(coefficients, geodetic, azimuth, elevation, week_s, 0.0, troposphere)
            return 2.0 * troposphere - result
        return result

    return delay
