"""NAV-PVT, the receiver's own solution (of older receivers NAV-SOL), as a reference with its sigmas, quality 2.

u-blox M8 and F9 interface descriptions, "UBX-NAV-PVT": longitude, latitude, height above the ellipsoid, velocity north,
east, down, and accuracies of the place across, of its height and of the speed. They are not said to be radii: each
component gets them whole. The time of the week is GPS time, the date UTC. NAV-PVAT of receivers with an inertial sensor
states the same, and the vehicle's attitude with its accuracies: where it is logged, NAV-PVT is not read. NAV-HPPOSLLH
of the same time adds the digits that both round to 1e-7 deg (11 mm), and its finer accuracies. NAV-SOL, in a file
without them, states the week and earth-fixed position and velocity in cm with an accuracy each, in three dimensions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_DAY, NS_PER_MS, NS_PER_WEEK
from insgnss.gpstime import GPS_EPOCH, LATEST_WEEK
from insgnss.log.files import records
from insgnss.log.own_solution import (
    FIX_3D,
    distinct_rows,
    from_earth_axes,
    not_independent,
    on_earth,
    own_reference,
    stated_sigmas,
)
from insgnss.log.receiver import SolutionFrom
from insgnss.log.ubx.frames import UbxFrames
from insgnss.tables import Bool, Event, Float64, Int64, ReferenceTable

PVT: Final = 0x0107
PVAT: Final = 0x0117
SOL: Final = 0x0106
HPPOSLLH: Final = 0x0114
_DATE: Final = (("year", "<u2"), ("month", "u1"), ("day", "u1"))
_FIX: Final = (("fix", "u1"), ("flags", "u1"), ("", "V2"), ("lon", "<i4"), ("lat", "<i4"))
_MOTION: Final = (
    *(("height", "<i4"), ("", "V4"), ("sigma_level", "<u4"), ("sigma_height", "<u4")),
    ("velocity", "<i4", (3,)),
)
_LAYOUTS: Final = {
    PVAT: np.dtype(
        [
            *(("tow_ms", "<u4"), ("", "V1"), ("valid", "u1"), *_DATE, ("", "V14"), *_FIX, *_MOTION),
            *(("", "V4"), ("sigma_speed", "<u4"), ("attitude", "<i4", (3,)), ("", "V4")),
            ("sigma_attitude", "<u2", (3,)),
        ]
    ),
    PVT: np.dtype(
        [
            *(("tow_ms", "<u4"), *_DATE, ("", "V3"), ("valid", "u1"), ("", "V8"), *_FIX, *_MOTION),
            *(("", "V8"), ("sigma_speed", "<u4")),
        ]
    ),
}
_SOL_LAYOUT: Final = np.dtype(
    [
        *(("tow_ms", "<u4"), ("", "V4"), ("week", "<i2"), ("fix", "u1"), ("flags", "u1"), ("r", "<i4", (3,))),
        *(("sigma", "<u4"), ("v", "<i4", (3,)), ("sigma_speed", "<u4")),
    ]
)
_HP_LAYOUT: Final = np.dtype(
    [
        *(("", "V3"), ("flags", "u1"), ("tow_ms", "<u4"), ("llh", "<i4", (3,)), ("", "V4")),
        *(("llh_hp", "i1", (3,)), ("", "V1"), ("sigma", "<u4", (2,))),
    ]
)
_HP_INVALID: Final = 1
_WEEK_AND_TIME_SET: Final = 12
DATE_AND_TIME_VALID: Final = 3
_FIX_OK: Final = 1  # bit of the flags
_FIX_WITH_INERTIAL: Final = 4
_M: Final = 1e-3  # the unit of lengths and speeds
_CM: Final = 1e-2
_DEG: Final = 1e-7
_ATTITUDE_DEG: Final = 1e-5  # of NAV-PVAT; of its accuracies:
_ACCURACY_DEG: Final = 1e-2
_ROLL_VALID: Final = 3  # the bit of the flags; those of pitch and heading follow


class SolvedEpochs(NamedTuple):
    """The solutions of a file whose date and time are valid."""

    offsets: Int64  # (n,) where they lie in the file
    t_ns: Int64  # (n,)
    place: Float64  # (n, 3) deg, deg, m
    velocity: Float64  # (n, 3) m/s, north, east, down
    sigma: Float64  # (n, 6) m, m/s
    fix: Bool  # (n,) in three dimensions
    inertial: Bool  # (n,) the receiver's own inertial sensor has a share
    name: str  # of the message
    attitude: Float64 | None = (
        None  # (n, 6) roll, pitch, yaw and their sigmas [deg], where the message states them
    )

    @property
    def angles(self) -> Float64:
        """Roll, pitch, yaw and their sigmas (n, 6) [deg], NaN where they are not stated."""
        return np.full((len(self.t_ns), 6), np.nan) if self.attitude is None else self.attitude


def solved_epochs(frames: UbxFrames) -> SolvedEpochs:
    """Return the solutions of a file: of NAV-PVAT, without any of NAV-PVT, without any of NAV-SOL."""
    kind = next((kind for kind in _LAYOUTS if frames.of(kind)), None)
    return _sol_epochs(frames) if kind is None else _pvt_epochs(frames, kind)


def _pvt_epochs(frames: UbxFrames, kind: int) -> SolvedEpochs:
    """Return the solutions of NAV-PVT or NAV-PVAT. The date gives the week, the milliseconds the time in it."""
    layout = _LAYOUTS[kind]
    offsets = [offset for offset, length in frames.of(kind) if length >= layout.itemsize]
    rows = records(frames.data, offsets, layout)
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
    rows = rows[good]
    place = np.column_stack([rows["lat"] * _DEG, rows["lon"] * _DEG, rows["height"] * _M])
    names = ("sigma_level", "sigma_level", "sigma_height", *["sigma_speed"] * 3)
    sigma = np.column_stack([rows[name] * _M for name in names])
    place, sigma[:, :3] = _finer(frames, rows["tow_ms"], place, sigma[:, :3])
    fix = (rows["flags"] & _FIX_OK > 0) & np.isin(rows["fix"], (FIX_3D, _FIX_WITH_INERTIAL))
    inertial = rows["fix"] == _FIX_WITH_INERTIAL
    velocity = rows["velocity"] * _M
    attitude = _attitude(rows) if kind == PVAT else None
    name = "NAV-PVAT" if kind == PVAT else "NAV-PVT"
    return SolvedEpochs(
        np.array(offsets, np.int64)[good], t_ns[good], place, velocity, sigma, fix, inertial, name, attitude
    )


def _attitude(rows: Any) -> Float64:
    """Return roll, pitch, heading of the vehicle and their sigmas (n, 6) [deg], NaN where they are not valid."""
    valid = rows["flags"][:, None] >> np.arange(3) + _ROLL_VALID & 1 > 0
    values = np.where(valid, rows["attitude"] * _ATTITUDE_DEG, np.nan)
    sigma = np.where(valid, stated_sigmas(rows["sigma_attitude"] * _ACCURACY_DEG), np.nan)
    return np.column_stack([values, sigma])


def _finer(
    frames: UbxFrames, tow_ms: npt.NDArray[np.uint32], place: Float64, sigma: Float64
) -> tuple[Float64, Float64]:
    """Return places and their sigmas (n, 3), those of NAV-HPPOSLLH where it states the same place at the same time."""
    offsets = [offset for offset, length in frames.of(HPPOSLLH) if length >= _HP_LAYOUT.itemsize]
    rows = records(frames.data, offsets, _HP_LAYOUT)
    rows = rows[rows["flags"] & _HP_INVALID == 0]
    order = np.argsort(rows["tow_ms"], kind="stable")
    rows = rows[order]
    if not len(rows):
        return place, sigma
    row = np.minimum(np.searchsorted(rows["tow_ms"], tow_ms), len(rows) - 1)
    units = np.array([_DEG, _DEG, _M])
    fine = rows["llh"][:, [1, 0, 2]] * units + rows["llh_hp"][:, [1, 0, 2]] * (units * [1e-2, 1e-2, 0.1])
    finer = fine[row]
    # a week later, or damaged: another place
    same = (rows["tow_ms"][row] == tow_ms) & (np.abs(finer - place) <= 1.5 * units).all(axis=1)
    stated = rows["sigma"][row][:, [0, 0, 1]] * (0.1 * _M)
    return np.where(same[:, None], finer, place), np.where(same[:, None], stated, sigma)


def _sol_epochs(frames: UbxFrames) -> SolvedEpochs:
    """Return the solutions of NAV-SOL."""
    offsets = [offset for offset, length in frames.of(SOL) if length >= _SOL_LAYOUT.itemsize]
    rows = records(frames.data, offsets, _SOL_LAYOUT)
    good = (rows["flags"] & _WEEK_AND_TIME_SET == _WEEK_AND_TIME_SET) & (rows["week"] > 0)
    good &= rows["week"] <= LATEST_WEEK
    rows = rows[good]
    t_ns = rows["week"].astype(np.int64) * NS_PER_WEEK + rows["tow_ms"].astype(np.int64) * NS_PER_MS
    place, velocity = from_earth_axes(rows["r"] * _CM, rows["v"] * _CM)
    fix = (rows["flags"] & _FIX_OK > 0) & np.isin(rows["fix"], (FIX_3D, _FIX_WITH_INERTIAL))
    sigma = np.column_stack([rows[name] * _CM for name in (*["sigma"] * 3, *["sigma_speed"] * 3)])
    inertial = rows["fix"] == _FIX_WITH_INERTIAL
    return SolvedEpochs(
        np.array(offsets, np.int64)[good], t_ns, place, velocity, sigma, fix, inertial, "NAV-SOL"
    )


def solution(
    parts: Sequence[SolvedEpochs], file: str
) -> tuple[ReferenceTable | None, SolutionFrom, list[Event]]:
    """Return the 3D fixes of all files, None with less than two.

    If the receiver's own inertial sensor has a share in any of them, they are those of a filter.
    """
    t_ns, place, velocity, sigma, fix, inertial, angles = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("t_ns", "place", "velocity", "sigma", "fix", "inertial", "angles")
    )
    rows = distinct_rows(t_ns, fix & on_earth(place))
    if len(rows) < 2:
        return None, "satellites", []
    stated = np.column_stack([stated_sigmas(sigma[rows]), angles[rows, 3:]])
    table = own_reference(t_ns[rows], place[rows], stated, velocity=velocity[rows], attitude=angles[rows, :3])
    source: SolutionFrom = "filter" if inertial[rows].any() else "satellites"
    what = "solution with its inertial sensor" if source == "filter" else "fixes"
    names = " and ".join(sorted({part.name for part in parts if len(part.t_ns)}))
    return table, source, [not_independent(f"{names} of {file}, the receiver's {what}")]
