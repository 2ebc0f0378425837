"""The phone's own solution ("Fix" lines) becomes a reference trajectory with sigmas, quality 2: not truth.

Android states latitude, longitude, height above the ellipsoid, speed over ground with its direction, and accuracies as
radii or half-widths that hold 68 %: sigma = radius / 1.51 of a round horizontal distribution.
[Android developer reference, android.location.Location]
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.log.android.lines import AndroidCells
from insgnss.log.own_solution import distinct_rows, on_earth, own_reference
from insgnss.tables import Event, Float64, Int64, ReferenceTable

# the receiver alone before what networks helped with
_PROVIDERS: Final = ("gps", "flp", "fused", "nlp", "network")
TIMES: Final = ("UnixTimeMillis", "(UTC)TimeInMs", "UtcTimeInMs")  # names of the column, newest version first
_RADIUS_68: Final = 1.51  # of a round normal distribution, in sigmas of one axis


def fixes(lines: AndroidCells) -> ReferenceTable | None:
    """Return the solution of the log's best provider, in time order, None when no line has a place and a time.

    Velocity is level: the log has no vertical one.
    """
    t_ns, timed = lines.gps_times(*TIMES)
    names = (
        ("LatitudeDegrees", "Latitude"),
        ("LongitudeDegrees", "Longitude"),
        ("AltitudeMeters", "Altitude"),
    )
    place = np.column_stack([_first(lines, *pair) for pair in names])
    usable = timed & on_earth(place)
    provider = np.array([text.strip().lower() for text in lines.texts("Provider")], "U10")
    chosen = next((name for name in _PROVIDERS if (usable & (provider == name)).any()), None)
    usable &= provider == (chosen or "")
    if chosen is None or usable.sum() < 2:
        return None
    rows = distinct_rows(t_ns, usable)
    speed = _first(lines, "SpeedMps", "Speed")[rows]
    course = np.radians(lines.decimals("BearingDegrees")[rows])
    level = np.where(speed > 0.0, course, 0.0)  # a phone at rest states no direction
    v_n = np.column_stack([speed * np.cos(level), speed * np.sin(level), np.full(len(rows), np.nan)])
    return own_reference(t_ns[rows], place[rows], _sigmas(lines, rows), velocity=v_n)


def _first(lines: AndroidCells, *names: str) -> Float64:
    """Return the column that the file has of several names; versions of the application differ."""
    return lines.decimals(next((name for name in names if lines.has(name)), names[0]))


def _sigmas(lines: AndroidCells, rows: Int64) -> Float64:
    level = _first(lines, "AccuracyMeters", "Accuracy")[rows] / _RADIUS_68
    speed = lines.decimals("SpeedAccuracyMps")[rows]
    unknown = np.full(len(rows), np.nan)
    upright = lines.decimals("VerticalAccuracyMeters")[rows]
    return np.column_stack([level, level, upright, speed, speed, *[unknown] * 4])


def unused_fixes(lines: AndroidCells, solution: ReferenceTable | None) -> list[Event]:
    """Return an event of a log's "Fix" lines if they give no solution, none where there are none."""
    if solution is not None or not lines.n:
        return []
    needs = f"two with a place, a time ({', '.join(TIMES)}) and a provider ({', '.join(_PROVIDERS)})"
    return [
        Event(None, "android_fixes_not_used", f"{lines.n} Fix line(s) give no reference, which needs {needs}")
    ]
