"""The phone's own solution ("Fix" lines) becomes a reference trajectory with sigmas, quality 2: no truth.

Android states latitude, longitude, height above the ellipsoid, speed over ground with its direction, and accuracies as
radii or half-widths that hold 68 %: sigma = radius / 1.51 of a round horizontal distribution.
[Android developer reference, android.location.Location]
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.gpstime import UNIX_TO_GPS_S, leap_seconds, ns_to_datetime
from insgnss.log.android.lines import AndroidCells
from insgnss.tables import Float64, Int64, ReferenceTable

OWN_SOLUTION: Final = 2.0  # its quality: do not score tightly
# the receiver alone before what networks helped with
_PROVIDERS: Final = ("gps", "flp", "fused", "nlp", "network")
_RADIUS_68: Final = 1.51  # of a round normal distribution, in sigmas of one axis
_NS_PER_MS: Final = NS_PER_S // 1000


def fixes(lines: AndroidCells) -> ReferenceTable | None:
    """Return the solution of the log's best provider, in time order, None when no line has a place and a time.

    Velocity is level: the log has no vertical one.
    """
    t_ns, timed = _times(lines)
    names = (
        ("LatitudeDegrees", "Latitude"),
        ("LongitudeDegrees", "Longitude"),
        ("AltitudeMeters", "Altitude"),
    )
    place = np.column_stack([_first(lines, *pair) for pair in names])
    usable = timed & np.isfinite(place).all(axis=1)
    provider = np.array([text.strip().lower() for text in lines.texts("Provider")], "U10")
    chosen = next((name for name in _PROVIDERS if (usable & (provider == name)).any()), None)
    rows = np.flatnonzero(usable & (provider == chosen))
    if chosen is None or len(rows) < 2:
        return None
    t_ns, first = np.unique(t_ns[rows], return_index=True)
    rows = rows[first]
    speed = _first(lines, "SpeedMps", "Speed")[rows]
    course = np.radians(lines.decimals("BearingDegrees")[rows])
    level = np.where(speed > 0.0, course, 0.0)  # a phone at rest states no direction
    v_n = np.column_stack([speed * np.cos(level), speed * np.sin(level), np.full(len(rows), np.nan)])
    lat_deg, lon_deg, h_m = place[rows].T
    return ReferenceTable(
        t_ns,
        lat_deg,
        lon_deg,
        h_m,
        v_n,
        np.full((len(rows), 3), np.nan),
        np.full(len(rows), OWN_SOLUTION),
        _sigmas(lines, rows),
    )


def _first(lines: AndroidCells, *names: str) -> Float64:
    """Return the column that the file has of several names; versions of the application differ."""
    return lines.decimals(next((name for name in names if lines.has(name)), names[0]))


def _times(lines: AndroidCells) -> tuple[Int64, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    name = next((name for name in ("UnixTimeMillis", "(UTC)TimeInMs") if lines.has(name)), "UnixTimeMillis")
    unix_ms, given = lines.integers(name)
    given &= (unix_ms > UNIX_TO_GPS_S * 1000) & (unix_ms < 10 * UNIX_TO_GPS_S * 1000)
    if not given.any():
        return unix_ms, given
    utc_ns = (unix_ms - UNIX_TO_GPS_S * 1000) * _NS_PER_MS
    leap_ns = leap_seconds(ns_to_datetime(int(utc_ns[given][0]))) * NS_PER_S
    return np.where(given, utc_ns + leap_ns, 0), given


def _sigmas(lines: AndroidCells, rows: Int64) -> Float64:
    level = _first(lines, "AccuracyMeters", "Accuracy")[rows] / _RADIUS_68
    speed = lines.decimals("SpeedAccuracyMps")[rows]
    unknown = np.full(len(rows), np.nan)
    upright = lines.decimals("VerticalAccuracyMeters")[rows]
    return np.column_stack([level, level, upright, speed, speed, *[unknown] * 4])
