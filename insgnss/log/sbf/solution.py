"""SBF's INSNavGeod, the receiver's own solution of satellites and inertial sensor, as a reference with sigmas.

AsteRx SBi reference guide, "INSNavGeod": a fixed part, then position sigmas, attitude, its sigmas, velocity and its
sigmas, of which ``SBList`` names those that follow. Angles of the attitude in degrees, heading clockwise from north.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.log.files import records
from insgnss.log.own_solution import distinct_rows, on_earth
from insgnss.log.sbf.blocks import (
    FLOAT_MISSING,
    HEADER_LENGTH,
    INS_NAV,
    LAYOUTS,
    Blocks,
    block_length,
    block_records,
    block_times_ns,
    time_known,
)
from insgnss.tables import Bool, Event, Float64, Int64, ReferenceTable
from insgnss.units import RAD_PER_DEG

_TRIPLE: Final = np.dtype([("value", "<f4", (3,))])
# Sub-blocks in the order of their bits in SBList
_POSITION_SD, _ATTITUDE, _ATTITUDE_SD, _VELOCITY, _VELOCITY_SD = range(5)
_N_PARTS: Final = 5


def solution(data: bytes, blocks: Blocks) -> tuple[ReferenceTable | None, list[Event]]:
    """Return the receiver's solution, None when the file has none; rows in error or without a place are counted."""
    heads = block_records(data, blocks, INS_NAV)
    if not len(heads):
        return None, []
    place, rows, events = solved_rows(heads, True, "INSNavGeod block(s) without a solution")
    if len(rows) < 2:
        return None, events
    parts = _parts(data, np.array(blocks.starts[INS_NAV], np.int64)[rows], heads[rows])
    # the receiver's order: latitude, longitude, height; east, north, up; heading, pitch, roll
    velocity = parts[_VELOCITY][:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    attitude = parts[_ATTITUDE][:, ::-1]
    sigma = np.column_stack(
        [parts[_POSITION_SD], parts[_VELOCITY_SD][:, [1, 0, 2]], parts[_ATTITUDE_SD][:, ::-1]]
    )
    lat_deg, lon_deg, h_m = place[rows].T
    table = ReferenceTable(
        block_times_ns(heads[rows]),
        lat_deg,
        lon_deg,
        h_m,
        velocity,
        attitude,
        np.ones(len(rows)),
        sigma,
    )
    return table, events


def solved_rows(
    rows: npt.NDArray[np.void], usable: Bool | bool, lost: str
) -> tuple[Float64, Int64, list[Event]]:
    """Return places (n, 3) of a receiver's solutions [deg, deg, m], the rows to take, and an event for the others.

    Parameters
    ----------
    usable : which may be taken, if they have a time, no error and a place
    lost : what the others are
    """
    place = np.column_stack([rows["lat_rad"] / RAD_PER_DEG, rows["lon_rad"] / RAD_PER_DEG, rows["h_m"]])
    good = time_known(rows) & (rows["error"] == 0) & on_earth(place) & usable
    events = []
    if not good.all():
        events.append(Event(None, "sbf_no_solution", f"{int((~good).sum())} {lost} left out"))
    return place, distinct_rows(block_times_ns(rows), good), events


def _parts(data: bytes, starts: Int64, heads: npt.NDArray[np.void]) -> list[Float64]:
    """Return the five sub-blocks (n, 3) of each block, NaN where it has not sent one."""
    listed = heads["parts"].astype(np.int64)
    size = _TRIPLE.itemsize
    at = starts + HEADER_LENGTH + LAYOUTS[INS_NAV].itemsize
    ends = starts + np.array([block_length(data, start) for start in starts.tolist()], np.int64)
    parts = []
    for part in range(_N_PARTS):
        present = (listed >> part & 1 != 0) & (at + size <= ends)
        values = np.full((len(starts), 3), np.nan)
        values[present] = _values(records(data, at[present].tolist(), _TRIPLE))
        parts.append(values)
        at = at + size * (listed >> part & 1)
    return parts


def _values(rows: Any) -> Float64:
    values = rows["value"].astype(np.float64)
    return np.where(values > FLOAT_MISSING, values, np.nan)
