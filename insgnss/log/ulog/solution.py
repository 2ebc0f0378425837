"""A simulator's truth, PX4's own solution (quality 2, no truth) or its receiver's fixes (the same) as a reference.

The solution is vehicle_global_position with the velocity of vehicle_local_position and the attitude of vehicle_attitude
(a quaternion from body to north-east-down) that are nearest in time. Where it states its heights above the geoid alone,
the difference of the receiver's two heights is added. A simulator writes its truth into topics of the same columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from insgnss.constants import NS_PER_US
from insgnss.gpstime import nearest, unix_to_gps_ns
from insgnss.log.boot_time import BootClock, dated
from insgnss.log.own_solution import (
    FIX_3D,
    distinct_rows,
    not_independent,
    on_earth,
    own_reference,
    stated_sigmas,
)
from insgnss.log.receiver import SolutionFrom
from insgnss.tables import Event, Float64, Int64, ReferenceTable

FIXES: Final = ("vehicle_gps_position", "sensor_gps")
GLOBAL: Final = "vehicle_global_position"
SOLUTION: Final = (GLOBAL, "vehicle_local_position", "vehicle_attitude")
# written by simulators
TRUTH: Final = tuple(f"{name}_groundtruth" for name in SOLUTION)
_TRUE: Final = 1.0  # quality
_LONGEST_GAP_NS: Final = 200_000_000  # between a position and the velocity or attitude paired with it
Data = Mapping[tuple[str, int], Any]


@dataclass(frozen=True)
class UlogSolution:
    """The reference of a log, and its receiver's fixes where the reference is another's."""

    table: ReferenceTable | None = None
    source: SolutionFrom = "satellites"
    fixes: ReferenceTable | None = None
    events: list[Event] = field(default_factory=list)


def solution(data: Data, clock: BootClock, wanted: str | None) -> UlogSolution:
    """Return the best solution of the log, and beside another's the receiver's fixes.

    Parameters
    ----------
    data : columns of each topic and instance
    wanted : the topic to take, None for the best
    """
    name = None if wanted is None else wanted.partition(":")[0]
    fixes = max(
        (key for key in data if key[0] in FIXES and (name not in FIXES or name == key[0])),
        key=lambda key: len(data[key]["timestamp"]),
        default=None,
    )
    fixed, more_events = (None, []) if fixes is None else _fixes(data[fixes], fixes[0])
    for topics in (TRUTH, SOLUTION):
        if (topics[0], 0) in data and name in (None, topics[0]):
            table, events = _filtered(data, clock, topics)
            if table is not None or wanted is not None:
                return UlogSolution(table, "truth" if topics is TRUTH else "filter", fixed, events)
    return UlogSolution(fixed, events=more_events) if name in (None, *FIXES) else UlogSolution(fixes=fixed)


def _filtered(
    data: Data, clock: BootClock, topics: tuple[str, ...]
) -> tuple[ReferenceTable | None, list[Event]]:
    """Return the rows of the topics of position, velocity and attitude."""
    places, velocities, attitudes = topics
    rows = data[places, 0]
    if not {"lat", "lon", "alt", "timestamp"} <= set(rows):
        return None, [Event(None, "ulog_damaged", f"{places} without its columns")]
    t_ns = clock.gps_ns(sampled_us(rows))
    place = np.column_stack([np.asarray(rows[name], np.float64) for name in ("lat", "lon", "alt")])
    place[:, 2] += _above_ellipsoid(data, rows)
    chosen = distinct_rows(t_ns, on_earth(place))
    if len(chosen) < 2:
        return None, []
    velocity = _beside(data.get((velocities, 0)), ("vx", "vy", "vz"), clock, t_ns[chosen])
    attitude = _beside(data.get((attitudes, 0)), tuple(f"q[{k}]" for k in range(4)), clock, t_ns[chosen])
    table = own_reference(
        *(t_ns[chosen], place[chosen], _stated(rows, chosen, eph=(0, 1), epv=(2,))),
        velocity=velocity,
        attitude=_euler_deg(attitude),
    )
    listed = ", ".join(topics)
    if topics is TRUTH:
        detail = f"the reference is the simulator's truth ({listed})"
        return replace(table, quality=np.full(len(chosen), _TRUE)), [Event(None, "reference_truth", detail)]
    return table, [not_independent(f"PX4's own solution ({listed})")]


def _stated(rows: Any, chosen: Int64, **columns: tuple[int, ...]) -> Float64:
    """Return the sigmas (n, 9) of chosen rows, those of the named columns at these places; NaN where none is stated."""
    sigma = np.full((len(chosen), 9), np.nan)
    for name, places in columns.items():
        if name in rows:
            sigma[:, places] = stated_sigmas(np.asarray(rows[name], np.float64))[chosen, None]
    return sigma


def _fixes(rows: Any, name: str) -> tuple[ReferenceTable | None, list[Event]]:
    """Return the receiver's fixes at their own UTC."""
    degrees = "latitude_deg" in rows
    names = (
        ("latitude_deg", "longitude_deg", "altitude_ellipsoid_m")
        if degrees
        else ("lat", "lon", "alt_ellipsoid")
    )
    if not {*names, "time_utc_usec", "fix_type"} <= set(rows):
        return None, [Event(None, "ulog_damaged", f"{name} without its columns")]
    scale = np.array([1.0, 1.0, 1.0] if degrees else [1e-7, 1e-7, 1e-3])
    place = np.column_stack([np.asarray(rows[key], np.float64) for key in names]) * scale
    good = dated(rows) & (np.asarray(rows["fix_type"]) >= FIX_3D) & on_earth(place)
    utc_us = np.asarray(rows["time_utc_usec"]).astype(np.int64)
    t_ns = np.zeros(len(utc_us), np.int64)
    t_ns[good] = unix_to_gps_ns(utc_us[good] * NS_PER_US)
    chosen = distinct_rows(t_ns, good)
    if len(chosen) < 2:
        return None, [Event(None, "ulog_no_fix", f"{name}: no two fixes with a date")]
    speeds = ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
    velocity = (
        np.column_stack([np.asarray(rows[key], np.float64) for key in speeds])[chosen]
        if set(speeds) <= set(rows)
        else None
    )
    sigma = _stated(rows, chosen, eph=(0, 1), epv=(2,), s_variance_m_s=(3, 4, 5))
    table = own_reference(t_ns[chosen], place[chosen], sigma, velocity=velocity)
    return table, [not_independent(f"{name}, the receiver's fixes")]


def sampled_us(rows: Any) -> Int64:
    """Return when each row was sampled [us of the autopilot's clock]."""
    name = (
        "timestamp_sample" if "timestamp_sample" in rows and np.any(rows["timestamp_sample"]) else "timestamp"
    )
    return np.asarray(rows[name]).astype(np.int64)


def _above_ellipsoid(data: Data, rows: Any) -> Float64 | float:
    """Return the correction of the solution's heights to the ellipsoid."""
    # a simulator may leave it zero
    if "alt_ellipsoid" in rows and np.any(rows["alt_ellipsoid"]):
        difference: Float64 = np.asarray(rows["alt_ellipsoid"], np.float64) - np.asarray(
            rows["alt"], np.float64
        )
        return difference
    for name in FIXES:
        fixes = data.get((name, 0), {})
        for above, sea, scale in (
            ("altitude_ellipsoid_m", "altitude_msl_m", 1.0),
            ("alt_ellipsoid", "alt", 1e-3),
        ):
            if above in fixes and sea in fixes and len(fixes[sea]):
                off = (np.asarray(fixes[above], np.float64) - np.asarray(fixes[sea], np.float64)) * scale
                return float(np.median(off))
    return 0.0


def _beside(rows: Any | None, names: tuple[str, ...], clock: BootClock, at_ns: Int64) -> Float64:
    """Return another topic's columns at the positions' times, those nearest in time, NaN where none is near."""
    if rows is None or not set(names) <= set(rows) or not len(rows["timestamp"]):
        return np.full((len(at_ns), len(names)), np.nan)
    t_ns = clock.gps_ns(sampled_us(rows))
    order = np.argsort(t_ns, kind="stable")
    t_ns = t_ns[order]
    chosen = nearest(t_ns, at_ns)
    values = np.column_stack([np.asarray(rows[name], np.float64) for name in names])[order[chosen]]
    far = np.abs(t_ns[chosen] - at_ns) > _LONGEST_GAP_NS
    return np.asarray(np.where(far[:, None] | ~np.isfinite(values), np.nan, values))


def _euler_deg(q: Float64) -> Float64:
    """Return roll, pitch, yaw [deg] of quaternions (w, x, y, z) from body to navigation axes."""
    w, x, y, z = (q / np.linalg.norm(np.where(np.isfinite(q), q, 1.0), axis=1, keepdims=True)).T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.asarray(np.degrees(np.column_stack([roll, pitch, yaw])))
