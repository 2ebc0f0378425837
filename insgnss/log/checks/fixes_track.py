"""The track of a vehicle without raw GNSS data: position fixes, velocities, and how late the velocities are.

Receivers give velocities that are means over the last epoch, or the output of a filter: of two public logs with four
fixes a second both are 0.13 s late. The way between two fixes is the integral of the velocity. With velocities whose
tags need a correction d,

    r(t + T) - r(t) = V(t + T - d) - V(t - d),    V the integral of the logged velocity over its tags,

level components, T about a second: the longer, the less the noise of the fixes counts, and the shorter, the more a turn
shows. d is where the mean square of the difference is least. Its sigma is that of a fit in which the ways of each T
count once.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.quantities import LeverArm
from insgnss.config.sensors import PositionSensor, VelocitySensor
from insgnss.constants import NS_PER_S
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import level_axes
from insgnss.log.checks.report import Finding
from insgnss.log.checks.sensor_findings import SensorLogRead
from insgnss.log.checks.track import VELOCITY_FLOOR_MPS, GnssTrack, velocities_by_positions
from insgnss.tables import Float64, Int64, SensorTable

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


_SLOW_S: Final = 2.0  # before and after a fix
_KNOWN_S: Final = 0.1  # a larger sigma hides the lag of a usual receiver
_UNSTATED_MPS: Final = 0.1  # sigma of a velocity where neither log nor flight file has one


class FixesTrack(NamedTuple):
    """The track of a vehicle by its fixes."""

    track: GnssTrack
    lever_b: LeverArm  # of the point whose way it is
    findings: list[Finding]  # on the velocities


def fixes_track(logs: Iterable[SensorLogRead]) -> FixesTrack | None:
    """Return the track of the first log of position fixes; None without one.

    Velocities that are late against the fixes are taken at their right times.
    """
    read = [(log.config, log.table) for log in logs if log.table is not None]
    positions = next(((config, table) for config, table in read if isinstance(config, PositionSensor)), None)
    if positions is None:
        return None
    config, table = positions
    finite = np.isfinite(table.values).all(axis=1)
    t_ns, n = table.t_ns[finite], int(finite.sum())
    if n < 3:
        return None
    r_e = np.zeros((n, 3))
    for at, (lat, lon, h) in zip(r_e, table.values[finite], strict=True):
        geodetic_to_ecef(lat, lon, h, at)
    t_s = (t_ns - t_ns[0]) / NS_PER_S
    velocities = next(((config, table) for config, table in read if isinstance(config, VelocitySensor)), None)
    v_e, sd = velocities_by_positions(t_s, r_e, np.ones(n, np.bool_))
    sd_time_s, findings = 0.0, []
    if velocities is not None:
        read_e, stated, lag = _velocities(*velocities, t_ns, r_e)
        if np.isfinite(read_e).all(axis=1).any():
            v_e, sd = read_e, stated
            sd_time_s = _time_sigma_s(velocities[1], lag)
            findings = _lag_findings(velocities[0].label, lag)
    used = np.isfinite(v_e).all(axis=1)
    sd = np.maximum(sd[used], VELOCITY_FLOOR_MPS)
    clock_m, drift_mps = np.zeros(len(sd)), np.full(len(sd), np.nan)
    track = GnssTrack(
        *(t_s[used], r_e[used], v_e[used], sd, clock_m, drift_mps, int(t_ns[0]), n, n, n), sd_time_s=sd_time_s
    )
    return FixesTrack(track, config.lever_arm_m, findings)


def _velocities(
    config: VelocitySensor, table: SensorTable, t_ns: Int64, r_e: Float64
) -> tuple[Float64, Float64, VelocityLag | None]:
    """Return the velocities (m, 3) at the fixes' times, NaN where there is none, their sigmas (m,), and their lag.

    A component that the log lacks is that of the way over some seconds, in which heights of a receiver are good enough.
    """
    lacking = np.array(config.lacking)
    good = np.isfinite(table.values[:, ~lacking]).all(axis=1)
    t_s, v_s = ((each - t_ns[0]) / NS_PER_S for each in (t_ns, table.t_ns[good]))
    v_n, C_ne = np.full(r_e.shape, np.nan), np.array([level_axes(place) for place in r_e])
    lag = None if lacking[:2].any() else velocity_lag(t_s, r_e, v_s, table.values[good, :2])
    if len(v_s) > 1:
        late_s = 0.0 if lag is None or not lag.is_sure else -lag.offset_s
        v_n[:, ~lacking] = _between(v_s, table.values[good][:, ~lacking], t_s + late_s)
    if lacking.any():
        early, late = np.searchsorted(t_s, t_s - _SLOW_S), np.searchsorted(t_s, t_s + _SLOW_S, "right") - 1
        slow_e = (r_e[late] - r_e[early]) / np.maximum(t_s[late] - t_s[early], _SLOW_S)[:, None]
        v_n = np.where(lacking, np.einsum("kij,kj->ki", C_ne, slow_e), v_n)
    v_e = np.einsum("kji,kj->ki", C_ne, v_n)
    given = float(np.max(config.sigma_mps)) if config.sigma_mps else _UNSTATED_MPS
    stated = table.sigma[np.clip(np.searchsorted(table.t_ns, t_ns), 0, len(table.t_ns) - 1)]
    sd = np.where(lacking, -np.inf, stated).max(axis=1)
    return v_e, np.where(np.isfinite(sd), sd, given), lag


def _between(v_s: Float64, values: Float64, at_s: Float64) -> Float64:
    """Return the curve through readings at given times, NaN beyond them and in their pauses."""
    from scipy.interpolate import CubicSpline

    after = np.clip(np.searchsorted(v_s, at_s), 1, len(v_s) - 1)
    between = (at_s >= v_s[0]) & (at_s <= v_s[-1]) & (v_s[after] - v_s[after - 1] <= LONGEST_GAP_S)
    near = between | np.isin(at_s, v_s)  # a reading itself borders on a pause
    return np.where(near[:, None], CubicSpline(v_s, values)(at_s), np.nan)


def _time_sigma_s(velocities: SensorTable, lag: VelocityLag | None) -> float:
    """Return how well the times of velocities are known: without evidence half of their interval, as of a mean."""
    half_s = 0.5 * float(np.median(np.diff(velocities.t_ns))) / NS_PER_S
    return half_s if lag is None else min(lag.sigma_s, half_s)


def _lag_findings(label: str, lag: VelocityLag | None) -> list[Finding]:
    """Return the finding on the velocities' tags against those of the fixes."""
    if lag is None:
        return []
    sigma_text = f"sigma {lag.sigma_s:.3f} s"
    if not lag.is_sure:
        fit = f"its tags fit the position fixes: offset {lag.offset_s:+.3f} s"
        unknown = "the position fixes do not show whether the velocities are late"
        return [Finding("ok", label, f"{fit if lag.sigma_s <= _KNOWN_S else unknown}, {sigma_text}")]
    side = "late" if lag.offset_s < 0.0 else "early"
    text = f"the velocities are {abs(lag.offset_s):.3f} s {side} relative to the position fixes"
    advice = (
        f"add {lag.offset_s:+.3f} s to its time.offset_s: a receiver's velocities may be means over an epoch"
    )
    sure = f"sure: {sigma_text}, log likelihood {lag.log_likelihood:.0f} above no offset"
    return [Finding("warning", label, text, advice, sure)]
