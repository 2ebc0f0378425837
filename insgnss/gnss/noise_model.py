"""How good one measurement is: its variance from elevation and C/N0, with a floor, compiled."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

REFERENCE_CN0_DBHZ: Final = 45.0
LOWEST_SINE: Final = 0.05  # below 3 deg of elevation the 1/sin law has no meaning any more


def thermal_factor(cn0_dbhz: Float64 | float) -> Float64:
    """Return the thermal variance relative to that at 45 dBHz: 10^((45 - C/N0) / 10), NaN where C/N0 is NaN."""
    return np.asarray(10.0 ** (0.1 * (REFERENCE_CN0_DBHZ - np.asarray(cn0_dbhz, dtype=np.float64))))


@kernel
def measurement_variance(
    sine: float, thermal: float, floor2: float, elevation2: float, cn02: float, missing_thermal: float
) -> float:
    """Return the variance of a pseudorange [m^2] or range rate [m^2/s^2].

    Equation: sigma^2 = floor^2 + elevation^2 / sin^2(el) + cn0^2 10^((45 - C/N0) / 10)
    The last term is the loop's thermal noise, the middle one multipath and the residual atmosphere after mapping.

    Parameters
    ----------
    sine : of the satellite's elevation
    thermal : ``thermal_factor`` of its C/N0, NaN where the log gives none; then ``missing_thermal`` replaces it
    floor2, elevation2, cn02 : squares of the three sigmas
    """
    s = max(sine, LOWEST_SINE)
    factor = missing_thermal if math.isnan(thermal) else thermal
    return floor2 + elevation2 / (s * s) + cn02 * factor


@kernel
def stated_variance(sigma: float, floor2: float) -> float:
    """Return the variance of a sigma that the log states itself, never below the floor."""
    return max(sigma * sigma, floor2)
