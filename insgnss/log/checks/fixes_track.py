"""The way of a vehicle without raw GNSS data: position fixes, and the velocities that come with them."""

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
from insgnss.log.checks.velocity_lag import LONGEST_GAP_S, VelocityLag, velocity_lag
from insgnss.tables import Float64, Int64, SensorTable

_SLOW_S: Final = 2.0  # before and after a fix
_KNOWN_S: Final = 0.1  # a larger sigma hides the lag of a usual receiver
_UNSTATED_MPS: Final = 0.1  # sigma of a velocity where neither log nor flight file has one


class FixesTrack(NamedTuple):
    """The way of a vehicle by its fixes."""

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
    text = f"the velocities are {abs(lag.offset_s):.3f} s {side} against the position fixes"
    advice = (
        f"add {lag.offset_s:+.3f} s by its time.offset_s: a receiver's velocities may be means over an epoch"
    )
    sure = f"sure: {sigma_text}, log likelihood {lag.log_likelihood:.0f} above no offset"
    return [Finding("warning", label, text, advice, sure)]
