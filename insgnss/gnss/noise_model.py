"""How good one measurement is: its variance from elevation and C/N0, with a floor, compiled."""

from __future__ import annotations

import math

from insgnss.jit import kernel

_REFERENCE_CN0_DBHZ = 45.0
_LOWEST_SINE = 0.05  # below 3 deg of elevation the 1/sin law has no meaning any more


@kernel
def measurement_variance(
    elevation: float, cn0_dbhz: float, floor2: float, elevation2: float, cn02: float, missing_cn0_dbhz: float
) -> float:
    """Return the variance of a pseudorange [m^2] or range rate [m^2/s^2].

    Equation: sigma^2 = floor^2 + elevation^2 / sin^2(el) + cn0^2 10^((45 - C/N0) / 10)
    The last term is the loop's thermal noise, the middle one multipath and what the mapping leaves of the atmosphere.

    Parameters
    ----------
    elevation : of the satellite [rad]
    cn0_dbhz : NaN where the log gives none; then ``missing_cn0_dbhz`` stands for it
    floor2, elevation2, cn02 : squares of the three sigmas
    """
    cn0 = missing_cn0_dbhz if math.isnan(cn0_dbhz) else cn0_dbhz
    sine = max(math.sin(elevation), _LOWEST_SINE)
    thermal: float = 10.0 ** (0.1 * (_REFERENCE_CN0_DBHZ - cn0))
    return floor2 + elevation2 / (sine * sine) + cn02 * thermal


@kernel
def stated_variance(sigma: float, floor2: float) -> float:
    """Return the variance of a sigma that the log states itself, never below the floor."""
    return max(sigma * sigma, floor2)
