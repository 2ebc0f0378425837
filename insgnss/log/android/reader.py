"""Android GnssLogger files become tables: raw measurements, accelerometer and gyroscope, the phone's own fixes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_MS, NS_PER_S
from insgnss.errors import InputError
from insgnss.log.android.clock import ReceiverClock
from insgnss.log.android.fixes import fixes
from insgnss.log.android.lines import AndroidCells, AndroidLines, cells, lines_by_kind
from insgnss.log.android.measurements import measurements
from insgnss.log.files import file_text
from insgnss.log.imu.sensor_pairs import paired
from insgnss.log.receiver import ReceiverLog
from insgnss.tables import Bool, Event, Float64, ImuTable, Int64

READ_KINDS: Final = frozenset({"Raw", "UncalAccel", "UncalGyro", "Accel", "Gyro", "Fix"})
# Kinds of line in the order of preference, with the columns of the three axes
_ACCELERATION: Final = (
    ("UncalAccel", ("UncalAccelXMps2", "UncalAccelYMps2", "UncalAccelZMps2")),
    ("Accel", ("AccelXMps2", "AccelYMps2", "AccelZMps2")),
)
_ANGULAR_RATE: Final = (
    ("UncalGyro", ("UncalGyroXRadPerSec", "UncalGyroYRadPerSec", "UncalGyroZRadPerSec")),
    ("Gyro", ("GyroXRadPerSec", "GyroYRadPerSec", "GyroZRadPerSec")),
)
# Forward, right, down of a phone that lies flat, its top ahead: its axes are x right, y to the top, z out of the screen
_FLAT: Final = ("+y", "+x", "-z")
# below, the scatter of single epochs (ms) would give a worse rate than zero
_DRIFT_FITTED_FROM_S: Final = 60.0


def read_android(path: Path) -> ReceiverLog:
    """Read an Android GnssLogger file (plain or gzipped).

    The inertial table has a row for each gyro sample, the specific force interpolated to it, in the phone's axes (x
    right, y to the top, z out of the screen). Both sensors are stamped with the time since the phone started; the
    measurements' ``ChipsetElapsedRealtimeNanos`` ties it to GPS time: a straight line through all epochs. A log without
    it leaves the phone's own UTC, good to some tens of milliseconds at best; an event says so. Lines of other kinds
    (magnetometer, orientation, pressure, gain control, navigation messages, status) are counted in an event.

    Raises
    ------
    InputError : no "Raw" line with its header, or no measurement that can be used
    """
    kinds = lines_by_kind(file_text(path))
    if "Raw" not in kinds or "timenanos" not in map(str.lower, kinds["Raw"].columns):
        raise InputError(
            "no raw measurements: the line '# Raw,...,TimeNanos,...' is missing",
            file=path,
            advice="log with 'Raw measurements' switched on, and keep the comment lines",
        )
    raw = cells(kinds["Raw"])
    gnss, receiver, events = measurements(raw)
    events += _refused("Raw", raw)
    if not len(gnss.t_ns):
        why = "; ".join(event.detail for event in events)
        raise InputError(f"no measurement that can be used{': ' + why if why else ''}", file=path)
    imu, told = _inertial(kinds, raw, receiver)
    other = {
        kind: len(lines.texts) for kind, lines in kinds.items() if kind not in READ_KINDS and lines.texts
    }
    if other:
        listed = ", ".join(f"{count} {kind}" for kind, count in sorted(other.items())[:10])
        told.append(Event(None, "android_lines_not_read", f"lines of other kinds: {listed}"))
    found = cells(kinds.get("Fix", AndroidLines()))
    told += _refused("Fix", found)
    named = [Event(e.t_ns, e.kind, f"{path}: {e.detail}") for e in events + told]
    return ReceiverLog(gnss, None, imu, named, fixes(found), imu_axes=_FLAT)


def _refused(kind: str, found: AndroidCells) -> list[Event]:
    if not found.refused:
        return []
    return [Event(None, "bad_row", f"{found.refused} {kind} line(s) with a wrong number of cells refused")]


def _inertial(
    kinds: dict[str, AndroidLines], raw: AndroidCells, receiver: ReceiverClock
) -> tuple[ImuTable | None, list[Event]]:
    if not any(kinds.get(kind, AndroidLines()).texts for kind, _ in _ANGULAR_RATE + _ACCELERATION):
        return None, []
    clock, events = _elapsed_to_gps(raw, receiver)
    samples = []
    for choices in (_ANGULAR_RATE, _ACCELERATION):
        kind, axes = next((c for c in choices if c[0] in kinds and kinds[c[0]].texts), choices[0])
        found = cells(kinds.get(kind, AndroidLines()))
        events += _refused(kind, found)
        t_ns, timed = _sample_times(found, clock)
        values = np.stack([found.decimals(name) for name in axes], axis=1) if found.n else np.zeros((0, 3))
        if not timed.all():
            detail = f"{kind}: {int((~timed).sum())} sample(s) without a time left out"
            events.append(Event(None, "imu_time_unknown", detail))
        samples.append((t_ns[timed], values[timed]))
    imu, told = paired(*samples[0], *samples[1], "phone")
    return imu, events + told


def _elapsed_to_gps(
    raw: AndroidCells, receiver: ReceiverClock
) -> tuple[tuple[int, int, float] | None, list[Event]]:
    """Return (elapsed_0, gps_0, rate) with gps = gps_0 + (elapsed - elapsed_0) (1 + rate), None when not known."""
    elapsed, given = raw.integers("ChipsetElapsedRealtimeNanos")
    rows = np.flatnonzero(given & receiver.known & (elapsed > 0))
    if not len(rows):
        detail = "no ChipsetElapsedRealtimeNanos: inertial samples carry the phone's own UTC, some 10 ms wrong or more"
        return None, [Event(None, "imu_time_uncertain", detail)]
    elapsed, gps = elapsed[rows], receiver.t_ns[rows]
    offset = (gps - elapsed) - (gps[0] - elapsed[0])
    since_s = (elapsed - elapsed[0]) / NS_PER_S
    good = _without_outliers(offset.astype(np.float64))
    rate, constant = 0.0, float(np.median(offset[good]))
    if np.ptp(since_s[good]) > _DRIFT_FITTED_FROM_S:
        slope, constant = np.polyfit(since_s[good], offset[good].astype(np.float64), 1)
        rate = float(slope) / NS_PER_S
    return (int(elapsed[0]), int(gps[0]) + round(constant), rate), []


def _without_outliers(values: Float64) -> Bool:
    """Return which values lie within five robust sigmas of the median, and a millisecond."""
    deviation = np.abs(values - np.median(values))
    return np.asarray(deviation <= 5 * 1.4826 * np.median(deviation) + NS_PER_MS)


def _sample_times(found: AndroidCells, clock: tuple[int, int, float] | None) -> tuple[Int64, Bool]:
    """Return the GPS time of each sample and where it is known."""
    if clock is not None:
        elapsed, given = found.integers("elapsedRealtimeNanos")
        since = elapsed - clock[0]
        return clock[1] + since + np.rint(since * clock[2]).astype(np.int64), given
    utc_ns, given = found.gps_times("utcTimeMillis")
    elapsed, ticks = found.integers("elapsedRealtimeNanos")
    ticks &= elapsed > 0
    if not (given & ticks).any():
        return utc_ns, given
    # UTC in whole milliseconds would let samples share a time: the phone's counter is aligned with it on average
    return elapsed + int(np.median((utc_ns - elapsed)[given & ticks])), ticks
