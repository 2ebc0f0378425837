"""The Doppler profile of a planned trajectory as a source of aiding, with its own error density.

A launch or a flight whose trajectory is planned knows its range rates beforehand. The profile takes the inertial
system's place in the aided loop: same interface, known ahead, its error a random walk of the rate.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import interpolate

from insgnss.constants import C_MPS
from insgnss.errors import InputError
from insgnss.tracking.admissible import require_positive
from insgnss.tracking.aiding_source import AidingSource

_LEAST_POINTS: Final = 4  # of a cubic spline without assumptions at its ends


def planned_source(
    t_s: npt.ArrayLike,
    range_m: npt.ArrayLike,
    carrier_hz: float,
    error_density: float,
    step_s: float = 1e-3,
    late_s: float = 0.0,
) -> AidingSource:
    """Return the aiding of a planned range over time to one satellite.

    Equation: rate = -2 pi f0 / c dR/dt, R a cubic spline through the plan

    Parameters
    ----------
    t_s, range_m : the plan, (n,)
    carrier_hz : f0
    error_density : one-sided, of the derivative of the rate's error [rad^2/s^3]
    step_s : between the samples of the source
    late_s : by how much the flight is behind the plan

    Raises
    ------
    InputError : too few points, times that do not grow, ranges that are not numbers
    """
    require_positive(carrier_hz=carrier_hz, step_s=step_s)
    t, distance = np.asarray(t_s, float), np.asarray(range_m, float)
    if t.ndim != 1 or t.shape != distance.shape or len(t) < _LEAST_POINTS or np.any(np.diff(t) <= 0.0):
        advice = f"give at least {_LEAST_POINTS} ranges at strictly increasing times"
        raise InputError("the plan is not a valid profile", key="t_s", advice=advice)
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(distance))):
        raise InputError("the plan has a value that is not finite", key="range_m", advice="leave it out")
    fine = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / step_s) + 1))
    rate = interpolate.CubicSpline(t, distance)(fine, 1)
    return AidingSource(
        fine + late_s, -2.0 * math.pi * carrier_hz / C_MPS * rate, None, 0.0, error_density, known_ahead=True
    )
