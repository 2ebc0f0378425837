"""Damaged inertial axes: one that stands still while the others move, and values pinned at the end of the range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.log.events import shortened
from insgnss.tables import Event, Float64, Int64, stretches_of
from insgnss.units import RAD_PER_DEG

# Equal to the last digit for this long, with the other axes moving: no sensor at rest does that
STUCK_S: Final = 1.0
PINNED_SAMPLES: Final = 3  # in a row at the largest magnitude of the log
PINNED_TOTAL: Final = 5
PINNED_SHARE_OF_RANGE: Final = 0.999  # of the declared range, or of the largest magnitude
# A pinned value lies this many resolution steps out: coarse numbers at rest repeat themselves too
LEVELS: Final = 100.0
# Smaller magnitudes are not the end of any sensor's range
MIN_PINNED: Final = {"gyro": 100.0 * RAD_PER_DEG, "accel": 1.5 * STANDARD_GRAVITY_MPS2}


@dataclass(frozen=True)
class SensorTriad:
    """Three sensor axes of one kind as logged, and the size of one unit."""

    kind: str  # "gyro" or "accel"
    columns: list[Float64]  # three (n,)
    names: tuple[str, str, str]
    si_per_unit: float  # rate or acceleration [rad/s or m/s^2] of one unit of the column, for a nominal step
    range_si: float | None  # measuring range [rad/s or m/s^2], None when not known


def fault_events(t_ns: Int64, axes: SensorTriad, file: str) -> list[Event]:
    """Return an event for each stretch in which an axis is stuck, and one for each axis that saturates."""
    events: list[Event] = []
    for axis in range(3):
        events += _stuck(t_ns, axes, axis, file)
        events += _saturated(t_ns, axes, axis, file)
    return events


def _stuck(t_ns: Int64, axes: SensorTriad, axis: int, file: str) -> list[Event]:
    column = axes.columns[axis]
    first, last = stretches_of(column[1:] == column[:-1]).T
    long = np.flatnonzero(t_ns[last] - t_ns[first] > STUCK_S * NS_PER_S)
    events = []
    for run in long:
        a, b = int(first[run]), int(last[run])
        others = [axes.columns[other][a : b + 1] for other in range(3) if other != axis]
        if not any(other.min() < other.max() for other in others):
            continue
        seconds = (t_ns[b] - t_ns[a]) / NS_PER_S
        detail = f"{file}: column '{axes.names[axis]}' holds {column[a]:g} for {seconds:.3g} s"
        events.append(Event(int(t_ns[a]), "imu_stuck_axis", detail))
    return shortened(events, file)


def _saturated(t_ns: Int64, axes: SensorTriad, axis: int, file: str) -> list[Event]:
    """Return an event when values lie at the declared range, or are pinned at the largest magnitude of the log."""
    column = axes.columns[axis]
    top = float(max(column.max(), -column.min()))
    known = None if axes.range_si is None else axes.range_si / axes.si_per_unit
    if known is not None and top >= PINNED_SHARE_OF_RANGE * known:
        at = np.flatnonzero(np.abs(column) >= PINNED_SHARE_OF_RANGE * known)
        why = "at or above the sensor's range"
    elif top * axes.si_per_unit >= MIN_PINNED[axes.kind]:
        at = np.flatnonzero(np.abs(column) >= PINNED_SHARE_OF_RANGE * top)
        if len(at) < PINNED_TOTAL or not _pinned(column, at):
            return []
        why = "pinned at the largest value of the log"
    else:
        return []
    detail = f"{file}: column '{axes.names[axis]}': {len(at)} sample(s) {why}, {top * axes.si_per_unit:.4g} in SI units"
    return [Event(int(t_ns[at[0]]), "imu_saturated", detail)]


def _pinned(column: Float64, at: Int64) -> bool:
    """Return whether the samples ``at`` hold runs of equal values that lie many resolution steps out."""
    in_row = (np.diff(at) == 1) & (column[at[1:]] == column[at[:-1]])
    if len(in_row) < PINNED_SAMPLES - 1 or not (in_row[:-1] & in_row[1:]).any():
        return False
    change = np.abs(np.diff(column))
    moving = change[change > 0.0]
    return len(moving) > 0 and float(np.abs(column[at[0]])) > LEVELS * float(moving.min())
