"""NAV-PVT, the receiver's own solution, as a reference with its sigmas, quality 2: no truth.

u-blox M8 and F9 interface descriptions, "UBX-NAV-PVT": longitude, latitude, height above the ellipsoid, velocity north,
east, down, and accuracies of the place across, of its height and of the speed. They are not said to be radii: each
component gets them whole. The time of the week is GPS time, the date UTC.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_DAY, NS_PER_MS, NS_PER_WEEK
from insgnss.gpstime import GPS_EPOCH
from insgnss.log.files import records
from insgnss.log.own_solution import (
    FIX_3D,
    distinct_rows,
    not_independent,
    on_earth,
    own_reference,
    stated_sigmas,
)
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


class PvtRows(NamedTuple):
    """The solutions of a file whose date and time are valid."""

    offsets: Int64  # (n,) where they lie in the file
    t_ns: Int64  # (n,)
    rows: npt.NDArray[np.void]  # (n,)


def pvt_rows(frames: UbxFrames) -> PvtRows:
    """Return the solutions of a file. The date gives the week, the milliseconds of the week the time in it."""
    offsets = [offset for offset, length in frames.of(PVT) if length >= _LAYOUT.itemsize]
    rows = records(frames.data, offsets, _LAYOUT)
    month = (rows["year"].astype(np.int64) - 1970) * 12 + rows["month"] - 1
    begin = month.astype("datetime64[M]")
    day = begin.astype("datetime64[D]") + (rows["day"].astype(np.int64) - 1)
    good = (rows["valid"] & DATE_AND_TIME_VALID == DATE_AND_TIME_VALID) & (
        day.astype("datetime64[M]") == begin
    )
    good &= (rows["year"] > 1980) & (rows["year"] < 2171) & (rows["month"] >= 1) & (rows["month"] <= 12)
    midday = (day - np.datetime64(GPS_EPOCH, "D")).astype(np.int64) * NS_PER_DAY + NS_PER_DAY // 2
    half = NS_PER_WEEK // 2
    t_ns = midday + (rows["tow_ms"].astype(np.int64) * NS_PER_MS - midday + half) % NS_PER_WEEK - half
    return PvtRows(np.array(offsets, np.int64)[good], t_ns[good], rows[good])


def solution(parts: Sequence[PvtRows], file: str) -> tuple[ReferenceTable | None, SolutionFrom, list[Event]]:
    """Return the 3D fixes of all files, None with less than two.

    If the receiver's own inertial sensor has a share in any of them, they are those of a filter.
    """
    rows = np.concatenate([part.rows for part in parts])
    t_ns = np.concatenate([part.t_ns for part in parts])
    place = np.column_stack([rows["lat"] * _DEG, rows["lon"] * _DEG, rows["height"] * _M])
    usable = (rows["flags"] & _FIX_OK > 0) & np.isin(rows["fix"], (FIX_3D, _FIX_WITH_INERTIAL))
    kept = distinct_rows(t_ns, usable & on_earth(place))
    if len(kept) < 2:
        return None, "satellites", []
    rows = rows[kept]
    names = ("sigma_level", "sigma_level", "sigma_height", *["sigma_speed"] * 3)
    stated = stated_sigmas(np.column_stack([rows[name] * _M for name in names]))
    sigma = np.column_stack([stated, np.full((len(rows), 3), np.nan)])
    table = own_reference(t_ns[kept], place[kept], sigma, velocity=rows["velocity"] * _M)
    source: SolutionFrom = "filter" if (rows["fix"] == _FIX_WITH_INERTIAL).any() else "satellites"
    what = "solution with its inertial sensor" if source == "filter" else "fixes"
    return table, source, [not_independent(f"NAV-PVT of {file}, the receiver's {what}")]
