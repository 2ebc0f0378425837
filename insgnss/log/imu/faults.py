"""Damaged inertial axes: one that stands still while the others move, and values pinned at the end of the range.

And frozen sensors: three gyros or three accelerometers, or all six, that hold their values while time advances.
A coarse sensor at rest also repeats its values. A fault is reported only if the log's resolution is fine, if the
values resume with a jump of many resolution steps, or if the other sensor shows motion meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.log.events import shortened
from insgnss.tables import Bool, Event, Float64, Int64, stretches_of
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


FROZEN: Final = "imu_frozen_sensor"
DEAD: Final = "imu_dead_sensor"
FROZEN_S: Final = 1.0
FROZEN_SAMPLES: Final = 50
FINE_STEPS: Final = 100.0  # changes are usually so many resolution steps: no noise hides below one
LEAP_STEPS: Final = 10.0  # a sensor at rest goes on by a step or two
# Runs of so many equal samples that are not long enough are those of a coarse sensor, where they fill such a share;
# shorter ones come of a logger that is faster than its sensor
COARSE_SAMPLES: Final = 10
COARSE_SHARE: Final = 0.02
RESOLUTION_QUANTILE: Final = 0.001  # of the changes that are none: the least of a long log may be an accident
# Means over half a second that differ by so much are motion which the frozen sensor would have felt
MEAN_S: Final = 0.5
LONG_S: Final = 5.0
MOVES: Final = {"gyro": 10.0 * RAD_PER_DEG, "accel": 0.5}
NAMES: Final = {"gyro": "gyros", "accel": "accelerometers"}


def frozen_events(t_ns: Int64, sensors: tuple[SensorTriad, SensorTriad], file: str) -> list[Event]:
    """Return an event for each stretch in which a sensor is frozen, kind ``FROZEN``.

    A sensor that is frozen for more than half of the log is reported once, as ``DEAD``.

    Parameters
    ----------
    t_ns : (n,) tags
    sensors : the log's two, in either order
    file : named in the events
    """
    same = [_repeats(sensor) for sensor in sensors]
    if not any(one.any() for one in same):
        return []
    both = same[0] & same[1]
    events = _told(t_ns, list(sensors), None, both, "all six inertial columns", file)
    for own, other in ((0, 1), (1, 0)):
        alone = same[own] & ~_long(t_ns, both)
        events += _told(
            t_ns, [sensors[own]], sensors[other], alone, f"the three {NAMES[sensors[own].kind]}", file
        )
    return events


def _repeats(sensor: SensorTriad) -> Bool:
    """Return (n - 1,) which samples are equal to the one before in all three columns."""
    same: Bool = sensor.columns[0][1:] == sensor.columns[0][:-1]
    for column in sensor.columns[1:]:
        if same.any():
            same &= column[1:] == column[:-1]
    return same


def _runs(t_ns: Int64, same: Bool) -> list[tuple[int, int]]:
    """Return first and last sample of the runs that are long enough."""
    first, last = stretches_of(same).T
    long = (t_ns[last] - t_ns[first] >= FROZEN_S * NS_PER_S) & (last - first + 1 >= FROZEN_SAMPLES)
    return list(zip(first[long].tolist(), last[long].tolist(), strict=True))


def _long(t_ns: Int64, same: Bool) -> Bool:
    inside = np.zeros(len(same), np.bool_)
    for a, b in _runs(t_ns, same):
        inside[a:b] = True
    return inside


def _told(
    t_ns: Int64, own: list[SensorTriad], other: SensorTriad | None, same: Bool, name: str, file: str
) -> list[Event]:
    runs = _runs(t_ns, same)
    if not runs:
        return []
    outside = ~_long(t_ns, same)
    steps = [_change_steps(sensor, outside) for sensor in own]
    first, last = stretches_of(same & outside).T
    length = last - first + 1
    coarse = length[length >= COARSE_SAMPLES].sum() > COARSE_SHARE * max(int(outside.sum()), 1)
    frozen = [
        (a, b)
        for a, b in runs
        if any(fine for _, fine in steps)
        or (not coarse and any(_leaps(s, q, b) for s, (q, _) in zip(own, steps, strict=True)))
        or (not coarse and other is not None and _moves(t_ns, other, a, b))
        or (other is None and not outside.any())
    ]
    text = f"{file}: {name} hold their values for"
    total_s = sum(int(t_ns[b] - t_ns[a]) for a, b in frozen) / NS_PER_S
    share = total_s * NS_PER_S / max(float(t_ns[-1] - t_ns[0]), 1.0)
    if share > 0.5:
        detail = f"{text} {total_s:.3g} s, {100.0 * share:.0f} % of the log"
        return [Event(int(t_ns[frozen[0][0]]), DEAD, detail)]
    events = [
        Event(int(t_ns[a]), FROZEN, f"{text} {(t_ns[b] - t_ns[a]) / NS_PER_S:.3g} s") for a, b in frozen
    ]
    return shortened(events, file)


def _change_steps(sensor: SensorTriad, outside: Bool) -> tuple[Float64, bool]:
    """Return (3,) resolution steps as the changes outside the runs show them, and whether all are fine."""
    steps, fine = np.full(3, np.inf), True
    for axis, column in enumerate(sensor.columns):
        change = np.abs(np.diff(column)[outside])
        change = change[change > 0.0]
        if not len(change):
            fine = False
            continue
        steps[axis] = np.quantile(change, RESOLUTION_QUANTILE)
        fine = fine and float(np.median(change)) > FINE_STEPS * steps[axis]
    return steps, fine


def _leaps(sensor: SensorTriad, steps: Float64, last: int) -> bool:
    """Return whether a column goes on after a run with a leap of many resolution steps."""
    if last + 1 >= len(sensor.columns[0]):
        return False
    leap = np.array([abs(column[last + 1] - column[last]) for column in sensor.columns])
    return bool((leap > LEAP_STEPS * steps).any())


def _moves(t_ns: Int64, other: SensorTriad, first: int, last: int) -> bool:
    """Return whether the other sensor shows motion during a long run."""
    if t_ns[last] - t_ns[first] < LONG_S * NS_PER_S:
        return False
    part = ((t_ns[first : last + 1] - t_ns[first]) // int(MEAN_S * NS_PER_S)).astype(np.int64)
    count = np.bincount(part)
    full = count > 0.5 * np.median(count[count > 0])
    for column in other.columns:
        mean = np.bincount(part, column[first : last + 1])[full] / count[full]
        if float(mean.max() - mean.min()) * other.si_per_unit > MOVES[other.kind]:
            return True
    return False
