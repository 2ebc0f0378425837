"""NAV-PVT, the receiver's own solution, as a reference with its sigmas, quality 2: no truth.

u-blox M8 and F9 interface descriptions, "UBX-NAV-PVT": longitude, latitude, height above the ellipsoid, velocity north,
east, down, and accuracies of the place across, of its height and of the speed. They are not said to be radii: each
component gets them whole. The time of the week is GPS time, the date UTC.
"""

from __future__ import annotations

import datetime as dt
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_MS, NS_PER_S, NS_PER_WEEK
from insgnss.gpstime import datetime_to_ns
from insgnss.log.files import records
from insgnss.log.own_solution import FIX_3D, distinct_rows, not_independent, own_reference, stated_sigmas
from insgnss.log.receiver import SolutionFrom
from insgnss.log.ubx.frames import UbxFrames
from insgnss.tables import Event, Int64, ReferenceTable

PVT: Final = 0x0107
_LAYOUT: Final = np.dtype(
    [
        *(("tow_ms", "<u4"), ("year", "<u2"), ("month", "u1"), ("day", "u1"), ("", "V3"), ("valid", "u1")),
        *(("", "V8"), ("fix", "u1"), ("flags", "u1"), ("", "V2"), ("lon", "<i4"), ("lat", "<i4")),
        *(("height", "<i4"), ("", "V4"), ("sigma_level", "<u4"), ("sigma_height", "<u4")),
        *(("velocity", "<i4", (3,)), ("", "V8"), ("sigma_speed", "<u4")),
    ]
)
DATE_AND_TIME_VALID: Final = 3
_FIX_OK: Final = 1  # bit of the flags
_FIX_WITH_INERTIAL: Final = 4
_M: Final = 1e-3  # the unit of lengths and speeds
_DEG: Final = 1e-7


def solution_times(frames: UbxFrames) -> tuple[Int64, Int64]:
    """Return the positions (n,) in a file of the solutions whose date and time are valid, and their GPS times."""
    offsets, _, t_ns = _dated(frames)
    return offsets, t_ns


def solution(files: list[UbxFrames]) -> tuple[ReferenceTable | None, SolutionFrom, list[Event]]:
    """Return the fixes in three dimensions of all files, None with less than two.

    They are those of a filter where the receiver says of any that its own inertial sensor has a share.
    """
    parts = [_dated(frames) for frames in files]
    rows = np.concatenate([found for _, found, _ in parts])
    t_ns = np.concatenate([found for _, _, found in parts])
    usable = (rows["flags"] & _FIX_OK > 0) & np.isin(rows["fix"], (FIX_3D, _FIX_WITH_INERTIAL))
    kept = distinct_rows(t_ns, usable)
    if len(kept) < 2:
        return None, "satellites", []
    rows = rows[kept]
    place = np.column_stack([rows["lat"] * _DEG, rows["lon"] * _DEG, rows["height"] * _M])
    names = ("sigma_level", "sigma_level", "sigma_height", *["sigma_speed"] * 3)
    stated = stated_sigmas(np.column_stack([rows[name] * _M for name in names]))
    sigma = np.column_stack([stated, np.full((len(rows), 3), np.nan)])
    table = own_reference(t_ns[kept], place, sigma, velocity=rows["velocity"] * _M)
    source: SolutionFrom = "filter" if (rows["fix"] == _FIX_WITH_INERTIAL).any() else "satellites"
    what = "solution with its inertial sensor" if source == "filter" else "fixes"
    return table, source, [not_independent(f"NAV-PVT, the receiver's {what}")]


def _dated(frames: UbxFrames) -> tuple[Int64, npt.NDArray[np.void], Int64]:
    """Return positions, content and GPS times of the solutions of a file whose date and time are valid."""
    offsets = [offset for offset, length in frames.of(PVT) if length >= _LAYOUT.itemsize]
    rows = records(frames.data, offsets, _LAYOUT)
    midday = np.array([_midday_ns(row) for row in rows], np.int64)
    tow = rows["tow_ms"].astype(np.int64) * NS_PER_MS
    half = NS_PER_WEEK // 2
    # the date gives the week, the milliseconds of the week the time in it
    t_ns = midday + (tow - midday + half) % NS_PER_WEEK - half
    good = midday > 0
    return np.array(offsets, np.int64)[good], rows[good], t_ns[good]


def _midday_ns(row: np.void) -> int:
    """Return the middle of a solution's day, 0 when it has no valid date."""
    if row["valid"] & DATE_AND_TIME_VALID != DATE_AND_TIME_VALID or not 1980 < row["year"] < 2171:
        return 0
    try:
        day = dt.datetime(int(row["year"]), int(row["month"]), int(row["day"]))
    except ValueError:
        return 0  # no date of the calendar
    return datetime_to_ns(day) + NS_PER_S * 43_200
