"""Interpolation between a run's rows: position by Hermite cubic, velocity linear, attitude by the shortest rotation.

Between the rows at t_0 and t_1, T apart, with u = (t - t_0) / T and axes of ECEF:

    r = r_0 + u (r_1 - r_0) + u (1 - u) ((1 - u) (T v_0 - r_1 + r_0) + u (r_1 - r_0 - T v_1))
    v = v_0 + u (v_1 - v_0)
    C = exp(u log(C_1 C_0^T)) C_0

Motion between rows that the rows do not show is lost. With w and a the mean angular rate and acceleration of a step,
the largest loss within the step (one sigma) is assumed to be

    of attitude |dw| T / 8,    of velocity |da| T / 8,    of position |da| T^2 / 64

where d is the difference between the next and the previous step. A steadily growing rate loses half of this in the
middle of a step, a rate that steps there twice this. The loss is added to the sigmas of the rows; a loss beyond the
limits is an error. An oscillation that the rows do not resolve stays unseen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd

from insgnss.errors import ResultError
from insgnss.filter.output.further_columns import QUATERNION
from insgnss.filter.smoothing.body_points import attitudes_of, local_levels_of, places_of
from insgnss.results.nav_columns import ATTITUDE, PLACE, POSITION, VELOCITY
from insgnss.runs.datum import GPS_WEEK
from insgnss.runs.wanted_times import WANTED, about, week_seconds
from insgnss.tables import Bool, Float64, Int64

_GAP: Final = 1.5  # times the usual step of the rows: farther apart, and by more than a second, is a gap
_LONGEST_S: Final = 5.0  # of any step: a vehicle does what it likes in it
_SHARE: Final = 0.125
_SHARE_POSITION: Final = 1.0 / 64.0
_NAMED: Final = 3  # of the refused times
_TOLERANCE_S: Final = 1e-6
_ADVICE: Final = (
    "replay with output=times, which propagates the filter to each time, or with rows at a higher rate"
)
_NO_FILTER: Final = (
    "the inertial samples have a gap there, or the filter restarted: only a smoothed replay has rows before the next"
    " fix; no run has rows where samples are missing"
)


class RefusedTimes(NamedTuple):
    """The times that are refused for one reason."""

    are: Bool  # (m,), which they are
    why: str
    advice: str


class InterpolationLimits(NamedTuple):
    """The permitted loss between rows, one sigma."""

    attitude_deg: float
    position_m: float
    velocity_mps: float


def rows_at(
    nav: pd.DataFrame,
    times_s: Any,
    limits: InterpolationLimits,
    *,
    no_filter_s: Sequence[float] | Float64 = (),
    refuse: bool = True,
) -> pd.DataFrame:
    """Return navigation rows at times in any order, each between two rows of ``nav`` or at one.

    Parameters
    ----------
    nav : the rows, in their order
    times_s : seconds of the GPS week or dates with a zone, see ``week_seconds``
    limits : how much may be lost between rows
    no_filter_s : times at which a gap of the inertial samples began or the filter restarted [s of the week]
    refuse : whether a time without a row is an error; else its row holds NaN, and its counts are floating point

    Raises
    ------
    ResultError : a value is not a time; with ``refuse`` a time is outside the rows or in a gap of them, or they are too
        far apart for the motion there
    """
    times = week_seconds(times_s, nav.attrs.get(GPS_WEEK), _not_times)
    t = nav["time_s"].to_numpy()
    if not len(t):
        raise ResultError("the run has no navigation row", advice="replay the flight again")
    within = np.clip(times, t[0], t[-1])
    before = np.clip(np.searchsorted(t, within, side="right") - 1, 0, max(len(t) - 2, 0))
    after = np.minimum(before + 1, len(t) - 1)
    at_row = (times == t[before]) | (times == t[after])
    span = np.where(after > before, t[after] - t[before], 1.0)
    u = np.where(after > before, (within - t[before]) / span, 0.0)[:, None]
    numbers = nav.to_numpy(np.float64)
    table = pd.DataFrame((1.0 - u) * numbers[before] + u * numbers[after], columns=nav.columns)
    table["time_s"] = times
    lost = _filled_in(table, nav, before, after, u, span)
    lost[at_row] = 0.0
    steps = np.stack([t[before], t[after]], axis=1)
    stopped = np.asarray(no_filter_s, np.float64)
    reasons = (
        _outside(t, times),
        _in_gaps(t, times, np.where(at_row[:, None], 0.0, steps), stopped),
        _beyond_limits(times, steps, lost, limits, stopped),
    )
    refused = np.any([one.are for one in reasons], axis=0)
    if refuse and refused.any():
        raise _refusal(times, refused, reasons)
    exact = np.where(times == t[before], before, after)[at_row]
    table.loc[at_row] = numbers[exact]
    for name, most in (("n_used", False), ("n_hypotheses", True)):
        values = nav[name].to_numpy()
        one = np.where(times == t[after], values[after], values[before])
        both = np.maximum(values[before], values[after])
        table[name] = np.where(at_row, one, both if most else one)
    if refused.any():
        table = table.astype(np.float64)
        table.loc[refused, [name for name in table.columns if name != "time_s"]] = np.nan
    return table


def _filled_in(
    table: pd.DataFrame, nav: pd.DataFrame, before: Int64, after: Int64, u: Float64, span: Float64
) -> Float64:
    """Write the nonlinear part between rows, and the sigmas; return the loss (m, 3) by ``InterpolationLimits``."""
    from scipy.spatial.transform import Rotation  # late: 0.4 s and 40 MB that a replay can use

    t = nav["time_s"].to_numpy()
    lost = np.zeros((len(table), 3))
    for point in ("", "point_"):
        names = [f"{point}{name}" for name in (*PLACE, *VELOCITY)]
        if names[0] not in nav:
            continue
        r_e, C_ne = places_of(nav[names[:3]].to_numpy())
        v_e = np.einsum("kji,kj->ki", C_ne, nav[names[3:]].to_numpy())
        T, way = span[:, None], r_e[after] - r_e[before]
        bend = (1.0 - u) * (T * v_e[before] - way) + u * (way - T * v_e[after])
        geodetic, C_now = local_levels_of(r_e[before] + u * way + u * (1.0 - u) * bend)
        table[names[:3]] = geodetic
        v = v_e[before] + u * (v_e[after] - v_e[before])
        table[names[3:]] = np.einsum("kij,kj->ki", C_now, v)
        change = _changes(t, np.diff(v_e, axis=0))[before]
        lost[:, 1] = np.maximum(lost[:, 1], _SHARE_POSITION * change * span**2)
        lost[:, 2] = np.maximum(lost[:, 2], _SHARE * change * span)
        _widen(table, [f"sd_{point}{name}" for name in POSITION], u, _SHARE_POSITION * change * span**2)
        _widen(table, [f"sd_{point}{name}" for name in VELOCITY], u, _SHARE * change * span)
    C_en = places_of(nav[list(PLACE)].to_numpy())[1].transpose(0, 2, 1)
    C_eb = Rotation.from_matrix(C_en @ attitudes_of(nav[list(ATTITUDE)].to_numpy()))
    turn = (C_eb[after] * C_eb[before].inv()).as_rotvec()
    C_now = places_of(table[list(PLACE)].to_numpy())[1]
    C_nb = Rotation.from_matrix(C_now) * Rotation.from_rotvec(u * turn) * C_eb[before]
    table[list(ATTITUDE)] = C_nb.as_euler("ZYX", degrees=True)[:, ::-1]
    if QUATERNION[0] in nav:
        table[list(QUATERNION)] = C_nb.as_quat(canonical=True)[:, [3, 0, 1, 2]]
    steps = (C_eb[1:] * C_eb[:-1].inv()).as_rotvec(degrees=True) if len(nav) > 1 else np.zeros((0, 3))
    lost[:, 0] = _SHARE * _changes(t, steps)[before] * span
    _widen(table, [f"sd_{name}" for name in ATTITUDE], u, lost[:, 0])
    return lost


def _changes(t: Float64, steps: Float64) -> Float64:
    """Return, for each step of rows, by how much the rate differs between the steps around it (n,).

    ``steps`` (n - 1, 3) is what each step makes; the last row, which begins none, has the change of the last step.
    """
    if not len(steps):
        return np.zeros(len(t))
    rates = steps / np.diff(t)[:, None]
    if len(rates) == 1:
        change = np.linalg.norm(rates, axis=1)  # its change is unknown
    else:
        change = np.empty(len(rates))
        change[1:-1] = np.linalg.norm(rates[2:] - rates[:-2], axis=1)
        change[[0, -1]] = 2.0 * np.linalg.norm(rates[[1, -1]] - rates[[0, -2]], axis=1)
    return np.append(change, change[-1])


def _widen(table: pd.DataFrame, names: list[str], u: Float64, lost: Float64) -> None:
    """Add the loss to sigmas: nothing at a row, all of it in the middle."""
    part = (4.0 * u[:, 0] * (1.0 - u[:, 0]) * lost)[:, None]
    table[names] = np.sqrt(table[names].to_numpy() ** 2 + part**2)


def _not_times(what: str) -> ResultError:
    return ResultError(about("the times", what), advice=WANTED)


def _outside(t: Float64, times: Float64) -> RefusedTimes:
    wrong = ~((times >= t[0]) & (times <= t[-1]))
    why = f"{times[wrong][0]:.9g} s is outside the run" if wrong.any() else ""
    return RefusedTimes(wrong, why, f"its rows reach from {t[0]:.9g} to {t[-1]:.9g} s of the GPS week")


def _in_gaps(t: Float64, times: Float64, steps: Float64, stopped: Float64) -> RefusedTimes:
    """Return the times in a gap of the rows; ``steps`` (m, 2) are the times of the rows around each."""
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    longest = min(max(_GAP * usual, 1.0), _LONGEST_S)
    wrong = np.diff(steps, axis=1)[:, 0] > longest + _TOLERANCE_S
    if not wrong.any():
        return RefusedTimes(wrong, "", "")
    i = int(np.argmax(wrong))
    why = f"no row between {steps[i, 0]:.9g} and {steps[i, 1]:.9g} s, where {times[i]:.9g} s lies"
    return RefusedTimes(wrong, why, _advice(steps[i], stopped))


def _beyond_limits(
    times: Float64, steps: Float64, lost: Float64, limits: InterpolationLimits, stopped: Float64
) -> RefusedTimes:
    """Return the times at which too much may be lost."""
    share = (lost / np.array(limits)).max(axis=1)
    wrong = share > 1.0
    if not wrong.any():
        return RefusedTimes(wrong, "", "")
    i = int(np.argmax(share))
    angle, metres, speed = lost[i]
    why = (
        f"rows {steps[i, 1] - steps[i, 0]:.3g} s apart are too far for the motion at {times[i]:.9g} s: between them the"
        f" attitude may be {angle:.2g} deg off, the position {metres:.2g} m, the velocity {speed:.2g} m/s"
    )
    return RefusedTimes(wrong, why, _advice(steps[i], stopped))


def _advice(step: Float64, stopped: Float64) -> str:
    """Return what gives a row between two rows, if anything does."""
    is_stopped = (stopped >= step[0] - _TOLERANCE_S) & (stopped <= step[1] + _TOLERANCE_S)
    return _NO_FILTER if is_stopped.any() else _ADVICE


def _refusal(times: Float64, refused: Bool, reasons: Sequence[RefusedTimes]) -> ResultError:
    """Return the error of times of which some are refused."""
    first = next(one for one in reasons if one.are.any())
    named = ", ".join(f"{time_s:.9g}" for time_s in times[refused][:_NAMED])
    count = int(refused.sum())
    more = ", ..." if count > _NAMED else ""
    return ResultError(
        f"{first.why}; {count} of {len(times)} times are refused: {named}{more} s",
        advice=f"{first.advice}; with refuse=False the rows of such times hold NaN",
    )
