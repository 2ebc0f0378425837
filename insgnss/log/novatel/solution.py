"""INSPVAX, INSPVA, BESTPOS or BESTXYZ, the receiver's own solution, as a reference with sigmas; HEADING2 or HEADING.

OEM7 commands and logs reference manual: roll about the forward, pitch about the right axis, azimuth clockwise from
north, degrees; velocities north, east, up. INSPVAX and BESTPOS state the height above the geoid and the undulation. The
sigmas of INSPVA come in another message (INSSTDEV) and are not taken. Those of BESTXYZ are along the axes of the Earth,
without their correlations: not taken either.

HEADING2 and HEADING state the azimuth of the baseline between two antennas and its sigma in degrees. They begin alike;
HEADING has one station's name where HEADING2 has two.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK, S_PER_WEEK
from insgnss.gpstime import LATEST_WEEK
from insgnss.log.events import counted
from insgnss.log.files import records
from insgnss.log.further_samples import HEADING, FurtherSamples, further_samples
from insgnss.log.novatel.frames import NovatelFrames
from insgnss.log.own_solution import distinct_rows, from_earth_axes, on_earth, own_reference, stated_sigmas
from insgnss.tables import Bool, Event, Float64, Int64, ReferenceTable

INSPVAX: Final = 1465
INSPVA: Final = (507, 508)  # with the long and the short header
BESTPOS, BESTVEL = 42, 99
BESTXYZ: Final = 241
_POSITION: Final = (("lat", "<f8"), ("lon", "<f8"), ("height", "<f8"))
_MOTION: Final = tuple((name, "<f8") for name in ("vn", "ve", "vu", "roll", "pitch", "azimuth"))
_INSPVAX: Final = np.dtype(
    [("status", "<u4"), ("kind", "<u4"), *_POSITION, ("undulation", "<f4"), *_MOTION, ("sigma", "<f4", (9,))]
)
_INSPVA: Final = np.dtype([("week", "<u4"), ("sow", "<f8"), *_POSITION, *_MOTION, ("status", "<u4")])
_STATUS: Final = (("status", "<u4"), ("kind", "<u4"))
_BESTPOS: Final = np.dtype([*_STATUS, *_POSITION, ("undulation", "<f4"), ("", "<u4"), ("sigma", "<f4", (3,))])
_BESTVEL: Final = np.dtype(
    [*_STATUS, ("latency_s", "<f4"), ("", "<f4"), *((name, "<f8") for name in ("speed", "track", "vu"))]
)
_ALONG_EARTH_AXES: Final = np.dtype([*_STATUS, ("xyz", "<f8", (3,)), ("sigma", "<f4", (3,))])
_BESTXYZ: Final = np.dtype([("position", _ALONG_EARTH_AXES), ("velocity", _ALONG_EARTH_AXES)])
_GOOD: Final = (3,)  # INS_SOLUTION_GOOD
_USABLE: Final = (2, 6, 7)  # high variance, free of satellites, alignment complete: quality 2
_COMPUTED: Final = 0


def solution(files: list[NovatelFrames]) -> tuple[ReferenceTable | None, bool, list[Event]]:
    """Return the fullest solution of the files, whether it is that of the inertial sensor, and the events."""
    for read, is_inertial in ((_inspvax, True), (_inspva, True), (_bestpos, False), (_bestxyz, False)):
        table, left_out = read(files)
        if table is not None:
            what = "row(s) of the receiver marked as no solution left out"
            return table, is_inertial, counted("novatel_no_solution", left_out, what, files[0].path)
    return None, False, []


def _read(files: list[NovatelFrames], layout: np.dtype[np.void], *kinds: int) -> tuple[Any, Int64]:
    """Return the messages' contents and the GPS times of their headers."""
    rows, times = [], []
    for frames in files:
        chosen = [f for f in frames.of(*kinds) if f.length >= layout.itemsize]
        rows.append(records(frames.data, [f.offset for f in chosen], layout))
        times += [f.t_ns for f in chosen]
    return np.concatenate(rows), np.array(times, np.int64)


def _inspvax(files: list[NovatelFrames]) -> tuple[ReferenceTable | None, int]:
    rows, t_ns = _read(files, _INSPVAX, INSPVAX)
    sigma = rows["sigma"].astype(np.float64)
    height = rows["height"] + rows["undulation"]
    return _table(rows, t_ns, height, _ins_quality(rows), _motion(rows), sigma)


def _inspva(files: list[NovatelFrames]) -> tuple[ReferenceTable | None, int]:
    rows, _ = _read(files, _INSPVA, *INSPVA)
    timed = (
        (rows["week"] > 0) & (rows["week"] <= LATEST_WEEK) & (rows["sow"] >= 0) & (rows["sow"] <= S_PER_WEEK)
    )
    sow = np.where(timed, rows["sow"], 0.0)
    t_ns = rows["week"].astype(np.int64) * NS_PER_WEEK + np.rint(sow * NS_PER_S).astype(np.int64)
    return _table(rows, np.where(timed, t_ns, -1), rows["height"], _ins_quality(rows), _motion(rows), None)


def _bestpos(files: list[NovatelFrames]) -> tuple[ReferenceTable | None, int]:
    """Return positions, with the velocities of BESTVEL that carry the same time."""
    rows, t_ns = _read(files, _BESTPOS, BESTPOS)
    speeds, speed_ns = _read(files, _BESTVEL, BESTVEL)
    motion = np.full((len(rows), 6), np.nan)
    usable = np.flatnonzero(
        (speeds["status"] == _COMPUTED) & np.isfinite(speeds["track"]) & np.isfinite(speeds["speed"])
    )
    _, here, there = np.intersect1d(t_ns, speed_ns[usable], return_indices=True)
    chosen = speeds[usable[there]]
    track = np.radians(chosen["track"])
    motion[here, :3] = np.column_stack(
        [chosen["speed"] * np.cos(track), chosen["speed"] * np.sin(track), -chosen["vu"]]
    )
    quality = np.where(_is_computed(rows), 1.0, np.nan)
    sigma = np.column_stack([rows["sigma"].astype(np.float64), np.full((len(rows), 6), np.nan)])
    return _table(rows, t_ns, rows["height"] + rows["undulation"], quality, motion, sigma)


def _bestxyz(files: list[NovatelFrames]) -> tuple[ReferenceTable | None, int]:
    """Return positions and velocities along the axes of the Earth."""
    rows, t_ns = _read(files, _BESTXYZ, BESTXYZ)
    position, velocity = rows["position"], rows["velocity"]
    place, v_n = from_earth_axes(position["xyz"], velocity["xyz"])
    motion = np.full((len(rows), 6), np.nan)
    motion[:, :3] = np.where(_is_computed(velocity)[:, None], v_n, np.nan)
    quality = np.where(_is_computed(position), 1.0, np.nan)
    named = {"lat": place[:, 0], "lon": place[:, 1]}
    return _table(named, t_ns, place[:, 2], quality, motion, None)


def _is_computed(rows: Any) -> Bool:
    return np.asarray((rows["status"] == _COMPUTED) & (rows["kind"] > 0))


def _ins_quality(rows: Any) -> Float64:
    """Return 1 for a good solution, 2 for a usable one, NaN for none."""
    return np.where(
        np.isin(rows["status"], _GOOD), 1.0, np.where(np.isin(rows["status"], _USABLE), 2.0, np.nan)
    )


def _motion(rows: Any) -> Float64:
    """Return velocity north, east, down [m/s] and roll, pitch, yaw [deg]."""
    return np.column_stack(
        [rows["vn"], rows["ve"], -rows["vu"], rows["roll"], rows["pitch"], rows["azimuth"]]
    )


def _table(
    rows: Any, t_ns: Int64, height: Float64, quality: Float64, motion: Float64, sigma: Float64 | None
) -> tuple[ReferenceTable | None, int]:
    """Return the usable rows in the order of time, and how many others there were."""
    place = np.column_stack([rows["lat"], rows["lon"], height])
    usable = (t_ns >= 0) & np.isfinite(quality) & on_earth(place)
    chosen = distinct_rows(t_ns, usable)
    if len(chosen) < 2:
        return None, len(t_ns)
    motion = np.where(np.isfinite(motion) & (np.abs(motion) < 1e6), motion, np.nan)[chosen]
    if sigma is not None:
        sigma = stated_sigmas(sigma)[chosen]
    v_n, rpy_deg = motion[:, :3], motion[:, 3:]
    table = own_reference(
        t_ns[chosen], place[chosen], sigma, velocity=v_n, attitude=rpy_deg, quality=quality[chosen]
    )
    return table, int((~usable).sum())


HEADING2: Final = 1335
HEADING_OF_OLD: Final = 971
_HEADING: Final = np.dtype(
    [
        *(("status", "<u4"), ("kind", "<u4"), ("length_m", "<f4"), ("heading", "<f4"), ("pitch", "<f4")),
        *(("", "<f4"), ("sigma", "<f4"), ("sigma_pitch", "<f4")),
    ]
)
_FIXED: Final = (48, 49, 50)  # position types with integer ambiguities: L1_INT, WIDE_INT, NARROW_INT


def headings(files: list[NovatelFrames]) -> tuple[list[FurtherSamples], list[Event]]:
    """Return the headings with fixed ambiguities and their sigmas, and an event that counts the others.

    The list is empty if there is none. Where a receiver logs both messages, those of HEADING2 count.
    """
    kind = HEADING2 if any(frames.of(HEADING2) for frames in files) else HEADING_OF_OLD
    name = "HEADING2" if kind == HEADING2 else "HEADING"
    rows, t_ns = _read(files, _HEADING, kind)
    if not len(rows):
        return [], []
    usable = (t_ns >= 0) & (rows["status"] == 0) & np.isin(rows["kind"], _FIXED)
    usable &= np.abs(rows["heading"]) <= 360.0
    what = f"{name} message(s) without a heading by fixed ambiguities left out"
    events = counted("novatel_no_heading", ~usable, what, files[0].path)
    values = np.column_stack(
        [rows["heading"].astype(np.float64), stated_sigmas(rows["sigma"].astype(np.float64))]
    )
    samples, left_out = further_samples(HEADING, name, t_ns[usable], values[usable])
    return samples, events + left_out
