"""Extrapolation of a carrier phase over one integration, from a navigation filter's state of user and satellite.

A replica that the filter steers gets its phase from velocities, never from ranges: a range of 2e7 m read twice would
add its rounding, and a correction of the position would step the phase. The sum of the steps must follow the range for
hours. The unit is metres of range; the carrier phase falls while the range grows (``phase_of_range``).

Over T from k-1 to k, u the unit vector from user to satellite, V' the drift of the receiver's clock:

    step = T/2 [u_(k-1) . (v_sat,(k-1) - v_(k-1)) + u_k . (v_sat,k - v_(k-1) - a_(k-1) T)] + V'_(k-1) T
                [Shatilov 2007, chapter 2, which subtracts the clock's drift; here it adds to the range as everywhere]

The trapezoid rule with the user's velocity led on by its acceleration. One step errs by T^3 / 12 (f'' + 3 u . j), f the
range rate and j the user's jerk; the sum stays bounded where the jerk averages out. The rectangle rule takes the range
rate at the beginning of the step and errs by -T / 2 times the change of the range rate since the start: it drifts.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64
from insgnss.tracking.admissible import require_known, require_positive

TRAPEZOID, RECTANGLE, RECTANGLE_ACCELERATED = 0, 1, 2
RULES: Final = ("trapezoid", "rectangle", "rectangle_accelerated")


@kernel
def relative_speed(u: Float64, satellite_v: Float64, v: Float64, a: Float64, ahead_s: float) -> float:
    """Return the range rate along u (3,) with the user's velocity v (3,) led on by a (3,) over ``ahead_s`` [m/s]."""
    rate = 0.0
    for i in range(3):
        rate += u[i] * (satellite_v[i] - v[i] - a[i] * ahead_s)
    return rate


@kernel
def extrapolate_ranges(
    rule: int,
    before: tuple[Float64, Float64],
    after: tuple[Float64, Float64],
    user: tuple[Float64, Float64, float],
    step_s: float,
    steps: Float64,
) -> None:
    """Write what the ranges of m channels change by over one step [m].

    Equation: the one above; rectangle u_(k-1) . (v_sat,(k-1) - v_(k-1)) T, accelerated with a_(k-1) T / 2 in it

    Parameters
    ----------
    rule : ``TRAPEZOID``, or one of the rectangles, which are for comparison
    before, after : directions (m, 3) and velocities (m, 3) of the satellites at the ends of the step, any axes that do
        not turn; the end's direction is that from the predicted position
    user : velocity (3,), acceleration (3,) and clock drift [m/s] at the beginning of the step
    steps : (m,), out
    """
    v, a, drift = user
    for c in range(steps.shape[0]):
        rate = relative_speed(
            before[0][c], before[1][c], v, a, 0.5 * step_s if rule == RECTANGLE_ACCELERATED else 0.0
        )
        if rule == TRAPEZOID:
            rate = 0.5 * (rate + relative_speed(after[0][c], after[1][c], v, a, step_s))
        steps[c] = step_s * (rate + drift)


@kernel
def accumulate_ranges(
    rule: int,
    satellites: tuple[Float64, Float64],
    user: tuple[Float64, Float64, Float64],
    step_s: float,
    ranges: Float64,
) -> None:
    """Write the sums of the steps after the first of n + 1 instants [m].

    Parameters
    ----------
    satellites : directions and velocities, (n + 1, m, 3) each
    user : velocities and accelerations (n + 1, 3), clock drifts (n + 1,) [m/s]
    ranges : (n + 1, m); the first row holds the start, the others are written
    """
    u, satellite_v = satellites
    for k in range(1, len(ranges)):
        known = (user[0][k - 1], user[1][k - 1], user[2][k - 1])
        before, after = (u[k - 1], satellite_v[k - 1]), (u[k], satellite_v[k])
        extrapolate_ranges(rule, before, after, known, step_s, ranges[k])
        for c in range(ranges.shape[1]):
            ranges[k, c] += ranges[k - 1, c]


def accumulated_ranges(
    directions: Float64,
    satellite_velocities: Float64,
    velocities: Float64,
    accelerations: Float64,
    step_s: float,
    clock_drift_mps: npt.ArrayLike = 0.0,
    rule: str = "trapezoid",
) -> Float64:
    """Return the changes of the ranges since the first instant by extrapolation step after step, (n + 1, m) [m].

    Parameters
    ----------
    directions : (n + 1, m, 3) unit vectors from user to satellites, in axes that do not turn
    satellite_velocities : (n + 1, m, 3) [m/s]
    velocities, accelerations : of the user, (n + 1, 3)
    step_s : T
    clock_drift_mps : of the receiver, (n + 1,) or one for all
    rule : "trapezoid"; "rectangle" and "rectangle_accelerated" are for comparison

    Raises
    ------
    ConfigError : shapes that do not fit, numbers that are not finite, no such rule
    """
    require_known(rule, RULES, "rule", "rule of extrapolation")
    require_positive("give the integration time in seconds", step_s=step_s)
    u = _finite("directions", directions)
    if u.ndim != 3 or u.shape[2] != 3 or u.shape[0] < 2:
        advice = "give (n + 1, m, 3): instants, channels, components"
        raise ConfigError(f"directions of shape {u.shape}", key="directions", advice=advice)
    count = len(u)
    satellite_v = _finite("satellite_velocities", satellite_velocities, u.shape)
    v = _finite("velocities", velocities, (count, 3))
    a = _finite("accelerations", accelerations, (count, 3))
    drift_mps = np.asarray(clock_drift_mps, float)
    drift = _finite(
        "clock_drift_mps", np.full(count, drift_mps) if drift_mps.ndim == 0 else drift_mps, (count,)
    )
    ranges = np.zeros(u.shape[:2])
    accumulate_ranges(RULES.index(rule), (u, satellite_v), (v, a, drift), step_s, ranges)
    return ranges


def _finite(key: str, value: npt.ArrayLike, shape: tuple[int, ...] | None = None) -> Float64:
    """Return a contiguous array of finite numbers and of a shape."""
    numbers = np.ascontiguousarray(value, np.float64)
    if shape is not None and numbers.shape != shape:
        advice = "give one row for each instant of the directions"
        raise ConfigError(f"shape {numbers.shape} is not {shape}", key=key, advice=advice)
    if not np.isfinite(numbers).all():
        raise ConfigError("a value is not finite", key=key, advice="drop channels that have no satellite")
    return numbers
