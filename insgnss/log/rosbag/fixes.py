"""The fixes of a bag, sensor_msgs/NavSatFix or gps_msgs/GPSFix, as a reference of quality 2.

NavSatFix states a place with its covariance. GPSFix states speed, track and climb besides, and errors that hold 95 %:
sigma = error / 1.96, of a place's horizontal error / 2.45. A driver that does not measure velocity leaves zeros.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from insgnss.gpstime import nearest
from insgnss.log.own_solution import distinct_rows, not_independent, on_earth, own_reference, stated_sigmas
from insgnss.log.rosbag.mcap_file import Decoded, Topic, stamps
from insgnss.tables import Event, Float64, Int64, ReferenceTable

NAVSATFIX: Final = "sensor_msgs/msg/NavSatFix"
GPSFIX: Final = "gps_msgs/msg/GPSFix"
_NO_FIX: Final = -1
_FASTEST_MPS: Final = 1e4
_HALF_WIDTH_95: Final = 1.96  # of a normal distribution, in sigmas
_RADIUS_95: Final = math.sqrt(-2.0 * math.log(0.05))  # of a round normal distribution, in sigmas of one axis
_FIXES: Final = "the receiver's fixes"
_FILTERED: Final = "the solution of a receiver's filter with inertial data"
_SAME_FIX_NS: Final = 5_000_000  # a driver stamps the messages of one fix one after the other
_INERTIAL: Final = 32 | 64  # bits of a source: gyroscopes, accelerometers


def fixes(topic: Topic, beside: Topic | None, events: list[Event]) -> tuple[ReferenceTable | None, bool]:
    """Return the fixes of a topic, None with less than two, and whether they are a filter's with inertial data.

    Parameters
    ----------
    beside : a topic of GPSFix, whose velocities are those of the fixes with nearly the same stamps
    """
    messages = [m for m in topic.decoded(events) if m[1].status.status > _NO_FIX]
    if not messages:
        return None, False
    t_ns = stamps(topic, messages, events)
    place = np.array([(m.latitude, m.longitude, m.altitude) for _, m in messages], np.float64)
    rows = distinct_rows(t_ns, (t_ns >= 0) & on_earth(place))
    if len(rows) < 2:
        return None, False
    own = topic.kind == GPSFIX
    sigma = np.full((len(messages), 9), np.nan)
    covariance = np.array([list(m.position_covariance) for _, m in messages], np.float64)
    known = np.array([m.position_covariance_type > 0 for _, m in messages])
    variance = covariance[:, [4, 0, 8]]  # east, north, up on the diagonal
    sigma[:, :3] = stated_sigmas(np.sqrt(np.where(known[:, None] & (variance > 0.0), variance, np.nan)))
    velocity, inertial = np.full(place.shape, np.nan), False
    if own:
        across, upright = (
            _column(messages, "err_horz") / _RADIUS_95,
            _column(messages, "err_vert") / _HALF_WIDTH_95,
        )
        errors = stated_sigmas(np.column_stack([across, across, upright]))
        sigma[:, :3] = np.where(np.isnan(sigma[:, :3]), errors, sigma[:, :3])
        velocity, sigma[:, 3:6] = _velocities(messages)
        inertial = _is_inertial(messages)
    elif beside is not None:
        velocity, sigma[:, 3:6], inertial = _velocities_at(t_ns, beside, events)
    source = f"{topic.name}, {_FILTERED if inertial else _FIXES}"
    if own:
        detail = "heights are taken as above the ellipsoid; some drivers state those above sea level"
        events.append(Event(int(t_ns[rows[0]]), "mcap_heights_assumed", f"{topic.name} (GPSFix): {detail}"))
    elif beside is not None and np.isfinite(velocity[rows]).any():
        source += f" with the velocities of {beside.name}"
    events.append(not_independent(source))
    return own_reference(t_ns[rows], place[rows], sigma[rows], velocity=velocity[rows]), inertial


def _velocities(messages: Decoded) -> tuple[Float64, Float64]:
    """Return the velocities (n, 3), north, east, down, of messages of GPSFix, and their sigmas (n, 3), NaN if unknown.

    The sigma across the track is that of the track times the speed; never below that of the speed, which knows no
    direction.
    """
    track = _column(messages, "track")
    speed, climb = (  # a column of zeros is not measured
        values if np.any(np.abs(values) > 0.0) else np.full(len(values), np.nan)
        for values in (_column(messages, "speed"), _column(messages, "climb"))
    )
    course = np.radians(np.where(speed > 0.0, track, 0.0))  # a receiver at rest states no direction
    north, east = np.cos(course), np.sin(course)
    velocity = np.column_stack([speed * north, speed * east, -climb])
    velocity[~(np.abs(velocity) < _FASTEST_MPS)] = np.nan
    velocity[np.isnan(velocity[:, :2]).any(axis=1), :2] = np.nan
    along, upright = (_column(messages, name) / _HALF_WIDTH_95 for name in ("err_speed", "err_climb"))
    across = np.fmax(np.radians(_column(messages, "err_track") / _HALF_WIDTH_95) * speed, along)
    level = np.hypot(along * north, across * east), np.hypot(along * east, across * north)
    return velocity, stated_sigmas(np.column_stack([*level, upright]))


def _velocities_at(t_ns: Int64, topic: Topic, events: list[Event]) -> tuple[Float64, Float64, bool]:
    """Return the velocities (n, 3) at given times, their sigmas, NaN where unknown, and whether they are a filter's."""
    velocity, sigma = np.full((len(t_ns), 3), np.nan), np.full((len(t_ns), 3), np.nan)
    messages = [m for m in topic.decoded(events) if m[1].status.status > _NO_FIX]
    if not messages:
        return velocity, sigma, False
    stated, stated_sigma = _velocities(messages)
    own_ns = stamps(topic, messages, events)
    rows = distinct_rows(own_ns, own_ns >= 0)
    if not len(rows):
        return velocity, sigma, False
    chosen = rows[nearest(own_ns[rows], t_ns)]
    same = np.abs(own_ns[chosen] - t_ns) <= _SAME_FIX_NS
    velocity[same], sigma[same] = stated[chosen[same]], stated_sigma[chosen[same]]
    return velocity, sigma, _is_inertial(messages)


def _is_inertial(messages: Decoded) -> bool:
    """Return whether any message names gyroscopes or accelerometers as a source of its place or motion."""
    sources = ((m.status.position_source | m.status.motion_source) & _INERTIAL for _, m in messages)
    return any(sources)


def _column(messages: Decoded, name: str) -> Float64:
    values: Any = [getattr(m, name) for _, m in messages]
    return np.array(values, np.float64)
