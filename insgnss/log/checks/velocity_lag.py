"""How far velocities are behind the position fixes beside them.

Receivers give velocities that are means over the last epoch, or the output of a filter: of two public logs with four
fixes a second both are 0.13 s late. The way between two fixes is the integral of the velocity. With velocities whose
tags need a correction d,

    r(t + T) - r(t) = V(t + T - d) - V(t - d),    V the integral of the logged velocity over its tags,

level components, T about a second: the longer, the less the noise of the fixes counts, and the shorter, the more a turn
shows. d is where the mean square of the difference is least. Its sigma is that of a fit in which the ways of each T
count once.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.geodesy.local_level import level_axes
from insgnss.tables import Float64, Int64

_SPAN_S: Final = 1.0
_MOST_S: Final = 0.5
_STEP_S: Final = 0.01
_LEAST_WAYS: Final = 20
_SURE_SIGMAS: Final = 5.0
_SURE_LIKELIHOOD: Final = 10.0
_LEAST_S: Final = 0.02  # at 2 m/s^2 less than the noise of a velocity
LONGEST_GAP_S: Final = 1.1  # between readings that a curve goes through


class VelocityLag(NamedTuple):
    """The correction of the velocities' tags, negative for late velocities."""

    offset_s: float
    sigma_s: float
    log_likelihood: float  # above that of no correction

    @property
    def is_sure(self) -> bool:
        """Whether the velocities contradict the fixes without the correction."""
        far = abs(self.offset_s) > max(_SURE_SIGMAS * self.sigma_s, _LEAST_S)
        return far and self.log_likelihood > _SURE_LIKELIHOOD


def velocity_lag(t_s: Float64, r_e: Float64, v_s: Float64, v_n: Float64) -> VelocityLag | None:
    """Return the correction of the velocities' tags that fits the position fixes best; None where nothing shows it.

    Parameters
    ----------
    t_s, r_e : (n,) and (n, 3) times and places of the fixes [m]
    v_s, v_n : (m,) and (m, 2) times of the velocities since the same moment, and they north and east [m/s]
    """
    if len(t_s) < _LEAST_WAYS or len(v_s) < _LEAST_WAYS:
        return None
    from scipy.interpolate import CubicSpline  # 30 MB that a replay does not need

    begin, end = _ways(t_s, v_s)
    if len(begin) < _LEAST_WAYS:
        return None
    place = (r_e - r_e[0]) @ level_axes(r_e[0])[:2].T
    measured, way = place[end] - place[begin], CubicSpline(v_s, v_n).antiderivative()
    shifts = np.arange(-_MOST_S, _MOST_S + _STEP_S / 2.0, _STEP_S)
    apart = np.array([measured - (way(t_s[end] - d) - way(t_s[begin] - d)) for d in shifts])
    mean_square = np.mean(apart**2, axis=(1, 2))
    best = int(np.argmin(mean_square))
    if best in (0, len(shifts) - 1):
        return None
    # the parabola through the least and its neighbours
    before, least, after = mean_square[best - 1 : best + 2]
    bend = before - 2.0 * least + after
    steps = np.diff(t_s)
    count = 2.0 * max(float(steps[steps < 2.0 * _SPAN_S].sum()) / _SPAN_S, 1.0)  # of two components
    return VelocityLag(
        offset_s=float(shifts[best] + 0.5 * (before - after) / bend * _STEP_S),
        sigma_s=float(_STEP_S * np.sqrt(2.0 * least / (bend * count))),
        log_likelihood=float(0.5 * count * np.log(mean_square[len(shifts) // 2] / least)),
    )


def _ways(t_s: Float64, v_s: Float64) -> tuple[Int64, Int64]:
    """Return the first and the last fix of each way over which the velocities have no pause, shifted or not."""
    late = np.searchsorted(t_s, t_s + _SPAN_S - 1e-3)
    begin = np.flatnonzero(late < len(t_s))
    end = late[begin]
    inside = (t_s[begin] > v_s[0] + _MOST_S) & (t_s[end] < v_s[-1] - _MOST_S)
    inside &= t_s[end] - t_s[begin] < 2.0 * _SPAN_S
    begin, end = begin[inside], end[inside]
    pauses = np.concatenate([[0], np.cumsum(np.diff(v_s) > LONGEST_GAP_S)])  # before each velocity
    first = np.searchsorted(v_s, t_s[begin] - _MOST_S, "right") - 1
    last = np.searchsorted(v_s, t_s[end] + _MOST_S)
    whole = pauses[first] == pauses[last]
    return begin[whole], end[whole]
