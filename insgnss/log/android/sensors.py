"""The phone's own sensors: accelerometer and gyroscope as one inertial table, pressure and magnetic field as they are.

All are stamped with the time since the phone started; the measurements' ``ChipsetElapsedRealtimeNanos`` ties it to GPS
time: a straight line through all epochs. A log without it, or without measurements, has the fixes of the phone's
receiver, which state both times (on two phones within 1 and 5 ms of the epochs); one without such fixes leaves the
phone's own UTC (on the same phones 541 and 472 ms off).

[Android developer reference, SensorEvent, Location]
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.constants import NS_PER_MS, NS_PER_S, SIGMA_PER_MEDIAN
from insgnss.inertial.alignment import LARGEST_BIAS_RADPS
from insgnss.log.android.clock import ReceiverClock
from insgnss.log.android.fixes import TIMES
from insgnss.log.android.lines import AndroidCells, AndroidLines, cells, refused_lines
from insgnss.log.events import counted
from insgnss.log.further_samples import BAROMETER, MAGNETOMETER, FurtherKind, FurtherSamples, further_samples
from insgnss.log.sensor_pairs import paired
from insgnss.tables import Bool, Event, Float64, ImuTable, Int64


def _axes(name: str, unit: str = "") -> tuple[str, ...]:
    """Return the columns of three axes ("AccelXMps2", ...)."""
    return tuple(f"{name}{axis}{unit}" for axis in "XYZ")


# Kinds of line in the order of preference, with the columns of the three axes
_ACCELERATION: Final = tuple((kind, _axes(kind, "Mps2")) for kind in ("UncalAccel", "Accel"))
_ANGULAR_RATE: Final = tuple((kind, _axes(kind, "RadPerSec")) for kind in ("UncalGyro", "Gyro"))
# what the phone itself takes for the drift of its raw gyros; it changes in steps, which the raw rates do not have
_DRIFT: Final = _axes("Drift", "RadPerSec")
# In tables that hold all sensors in the same columns, a cell for each axis
_COMMON, _COMMON_DRIFT = _axes("Measurement"), _axes("Bias")
INERTIAL_KINDS: Final = frozenset(kind for kind, _ in _ACCELERATION + _ANGULAR_RATE)
# The calibrated field steps where the phone changes its own estimate of the hard iron; the raw one does not
_FIELD: Final = tuple((kind, _axes(kind, "MicroT")) for kind in ("UncalMag", "Mag"))
# below, the scatter of single epochs (ms) would give a worse rate than zero
_DRIFT_FITTED_FROM_S: Final = 60.0


class PhoneClock:
    """The phone's time since its start, tied to GPS time by its receiver.

    Parameters
    ----------
    raw, receiver : the measurements and their clock
    fixes : the "Fix" lines

    Attributes
    ----------
    doubt : what is uncertain about the samples' times, None where the measurements state them
    """

    def __init__(self, raw: AndroidCells, receiver: ReceiverClock, fixes: AndroidCells) -> None:
        elapsed, given = raw.integers("ChipsetElapsedRealtimeNanos")
        self._line = _elapsed_to_gps(elapsed, receiver.t_ns, given & receiver.known)
        self.doubt: Event | None = None
        if self._line is not None:
            return
        without = "no measurement with ChipsetElapsedRealtimeNanos"
        of_fix, t_ns, usable = _times_of_fixes(fixes)
        self._line = _elapsed_to_gps(of_fix, t_ns, usable)
        if self._line is None:
            detail = (
                f"{without}: inertial samples carry the phone's own UTC, which may be wrong by half a second"
            )
            self.doubt = Event(None, "imu_time_uncertain", detail)
        else:
            detail = f"{without}: {int(usable.sum())} fixes date the inertial samples, to some milliseconds"
            self.doubt = Event(None, "imu_time_estimated", detail)

    def times(self, table: AndroidCells) -> tuple[Int64, Bool]:
        """Return the GPS time of each sample [ns] and where it is known."""
        elapsed, ticks = table.integers("elapsedRealtimeNanos")
        if self._line is not None:
            elapsed_0, gps_0, rate = self._line
            since = elapsed - elapsed_0
            return gps_0 + since + np.rint(since * rate).astype(np.int64), ticks
        utc_ns, given = table.gps_times("utcTimeMillis")
        ticks &= elapsed > 0
        if not (given & ticks).any():
            return utc_ns, given
        # UTC in whole milliseconds would let samples share a time: the phone's counter is aligned with it on average
        return elapsed + int(np.median((utc_ns - elapsed)[given & ticks])), ticks


def inertial(kinds: dict[str, AndroidLines], clock: PhoneClock) -> tuple[ImuTable | None, list[Event]]:
    """Return a row for each gyro sample, the specific force interpolated to it, in the phone's axes.

    If the phone states the drift of its raw rates (several deg/s in some), the median drift is subtracted.
    """
    if not any(kinds.get(kind, AndroidLines()).texts for kind in INERTIAL_KINDS):
        return None, []
    events = [] if clock.doubt is None else [clock.doubt]
    samples = []
    for choices in (_ANGULAR_RATE, _ACCELERATION):
        kind, axes = next((c for c in choices if c[0] in kinds and kinds[c[0]].texts), choices[0])
        table = cells(kinds.get(kind, AndroidLines()))
        events += refused_lines(kind, table)
        t_ns, timed = clock.times(table)
        values = _vectors(table, axes, _COMMON)
        if kind == "UncalGyro":
            values, drift_events = _without_drift(table, values)
            events += drift_events
        events += counted("imu_time_unknown", ~timed, "sample(s) without a time left out", kind)
        samples.append((t_ns[timed], values[timed]))
    imu, more_events = paired(*samples[0], *samples[1], "phone")
    return imu, events + more_events


def _without_drift(table: AndroidCells, rates: Float64) -> tuple[Float64, list[Event]]:
    """Return the rates (n, 3) without the phone's own estimate of their drift [rad/s], and an event of it."""
    stated = _vectors(table, _DRIFT, _COMMON_DRIFT)
    stated = stated[np.isfinite(stated).all(axis=1)]
    drift = np.median(stated, axis=0) if len(stated) else np.zeros(3)
    if not 0.0 < np.abs(drift).max() < LARGEST_BIAS_RADPS:
        return rates, []
    shown = " ".join(f"{each:+.3f}" for each in np.rad2deg(drift))
    detail = f"UncalGyro: the phone's own estimate of the gyro drift is subtracted, median {shown} deg/s"
    return rates - drift, [Event(None, "imu_drift_taken_off", detail)]


def further(kinds: dict[str, AndroidLines], clock: PhoneClock) -> tuple[list[FurtherSamples], list[Event]]:
    """Return the pressure [hPa] and the magnetic field [uT]; the kinds of line are their sources."""
    field = next((choice for choice in _FIELD if _has(kinds, *choice)), None)
    chosen: list[tuple[FurtherKind, str, tuple[str, ...]]] = []
    if field is not None:
        chosen.append((MAGNETOMETER, *field))
    for kind, lines in kinds.items():
        pressure = next((name for name in lines.columns if name.lower().startswith("pressure")), None)
        if kind.lower().startswith(("press", "baro")) and pressure is not None and lines.texts:
            chosen.append((BAROMETER, kind, (pressure,)))
            break
    tables: list[FurtherSamples] = []
    events: list[Event] = []
    for of, kind, columns in chosen:
        table = cells(kinds[kind])
        events += refused_lines(kind, table)
        t_ns, timed = clock.times(table)
        samples, more_events = further_samples(of, kind, t_ns, _vectors(table, columns, _COMMON), timed)
        tables += samples
        events += more_events
    return tables, events


def _has(kinds: dict[str, AndroidLines], kind: str, columns: tuple[str, ...]) -> bool:
    lines = kinds.get(kind, AndroidLines())
    named = set(map(str.lower, lines.columns))
    return bool(lines.texts) and any(set(map(str.lower, names)) <= named for names in (columns, _COMMON))


def _vectors(table: AndroidCells, columns: tuple[str, ...], common: tuple[str, ...]) -> Float64:
    """Return (n, k) numbers of the kind's own columns, else of the common ones; no row where there are no lines."""
    if not table.n:
        return np.zeros((0, len(columns)))
    own = len(columns) != len(common) or any(map(table.has, columns)) or not all(map(table.has, common))
    return np.stack([table.decimals(name) for name in (columns if own else common)], axis=1)


def _times_of_fixes(fixes: AndroidCells) -> tuple[Int64, Int64, Bool]:
    """Return the time since the phone's start and the GPS time of each fix [ns], and which fixes may be used.

    The receiver's own alone: those of the network and fused ones carry the phone's own UTC.
    """
    elapsed, given = fixes.integers("elapsedRealtimeNanos")
    t_ns, dated = fixes.gps_times(*TIMES)
    of_receiver = np.array([text.strip().lower() == "gps" for text in fixes.texts("Provider")], np.bool_)
    return elapsed, t_ns, given & dated & of_receiver


def _elapsed_to_gps(elapsed: Int64, gps: Int64, usable: Bool) -> tuple[int, int, float] | None:
    """Return (elapsed_0, gps_0, rate) with gps = gps_0 + (elapsed - elapsed_0) (1 + rate), None when not known."""
    rows = np.flatnonzero(usable & (elapsed > 0))
    if not len(rows):
        return None
    elapsed, gps = elapsed[rows], gps[rows]
    offset = (gps - elapsed) - (gps[0] - elapsed[0])
    since_s = (elapsed - elapsed[0]) / NS_PER_S
    away = np.abs(offset - np.median(offset))
    good = away <= 5 * SIGMA_PER_MEDIAN * np.median(away) + NS_PER_MS  # five robust sigmas, and a millisecond
    rate, constant = 0.0, float(np.median(offset[good]))
    if np.ptp(since_s[good]) > _DRIFT_FITTED_FROM_S:
        slope, constant = np.polyfit(since_s[good], offset[good].astype(np.float64), 1)
        rate = float(slope) / NS_PER_S
    return int(elapsed[0]), int(gps[0]) + round(constant), rate
