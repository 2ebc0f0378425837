"""An autopilot's clock, which counts from its start, tied to GPS time by the messages of its receiver.

A message states the UTC of its fix and the autopilot's time when it came in: some 50 to 200 ms after the fix. A
straight line is laid through all messages (least squares, outliers left out), so that the rate of the autopilot's clock
comes out. Its level is late by the mean delay: inertial times are too early by as much against the fixes. An event says
so; a time offset among the settings takes it away once it is known (PX4 itself assumes EKF2_GPS_DELAY, 110 ms unless
set).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_US
from insgnss.gpstime import unix_to_gps_ns
from insgnss.tables import Bool, Event, Int64

_EARLIEST_US: Final = 1_100_000_000_000_000  # November 2004; a receiver without a date states earlier ones
_LATEST_US: Final = 6_300_000_000_000_000  # the year 2169
_FITTED_FROM_S: Final = 60.0  # below, the scatter of the delays would give a worse rate than none
_WORST_RATE: Final = 1e-3
FURTHEST_US: Final = 10 * 86_400 * 1_000_000  # from the first GPS message; times beyond are damaged


@dataclass(frozen=True)
class BootClock:
    """gps = gps_0 + (boot - boot_0) (1 + rate)."""

    boot_0_us: int
    gps_0_ns: int
    rate: float
    scatter_s: float

    def is_near(self, boot_us: Int64) -> Bool:
        """Return which times of the autopilot can be those of this log."""
        return np.asarray((boot_us > self.boot_0_us - FURTHEST_US) & (boot_us < self.boot_0_us + FURTHEST_US))

    def gps_ns(self, boot_us: Int64) -> Int64:
        """Return the GPS time of times of the autopilot [us]."""
        since = np.clip(boot_us - self.boot_0_us, -FURTHEST_US, FURTHEST_US)
        return np.asarray(
            self.gps_0_ns + since * NS_PER_US + np.rint(since * (NS_PER_US * self.rate)).astype(np.int64)
        )


def dated(rows: Any) -> Bool:
    """Return which GPS messages state a date."""
    utc_us = np.asarray(rows["time_utc_usec"]).astype(np.float64)
    return np.asarray((utc_us > _EARLIEST_US) & (utc_us < _LATEST_US))


def boot_clock(fixes: Any | None) -> tuple[BootClock | None, list[Event]]:
    """Return the relation of the two clocks, None when no message states a date.

    Parameters
    ----------
    fixes : columns ``timestamp`` and ``time_utc_usec``, and ``timestamp_time_relative`` where there is one [us]
    """
    if fixes is None or not (good := dated(fixes)).any():
        return None, []
    relative = np.asarray(fixes.get("timestamp_time_relative", np.zeros(len(good)))).astype(np.int64)
    boot_us = (np.asarray(fixes["timestamp"]).astype(np.int64) + relative)[good]
    gps_ns = unix_to_gps_ns(np.asarray(fixes["time_utc_usec"]).astype(np.int64)[good] * NS_PER_US)
    since_s = (boot_us - boot_us[0]) / 1e6
    offset_s = ((gps_ns - gps_ns[0]) - (boot_us - boot_us[0]) * NS_PER_US) / NS_PER_S
    kept = np.abs(offset_s - np.median(offset_s)) < 1.0  # a date that jumped
    rate, level = 0.0, float(np.median(offset_s))
    for _ in range(3):
        if not kept.any():
            return None, []
        if np.ptp(since_s[kept]) > _FITTED_FROM_S:
            slope, level = (float(v) for v in np.polyfit(since_s[kept], offset_s[kept], 1))
            rate = slope if abs(slope) < _WORST_RATE else 0.0
            level = level if rate else float(np.median(offset_s[kept]))
        else:
            rate, level = 0.0, float(np.median(offset_s[kept]))
        residual = offset_s - level - rate * since_s
        kept = np.abs(residual) <= max(4.0 * float(np.median(np.abs(residual[kept]))), 1e-3)
    scatter_s = float(np.sqrt(np.mean(residual[kept] ** 2)))
    clock = BootClock(int(boot_us[0]), int(gps_ns[0]) + round(level * NS_PER_S), rate, scatter_s)
    detail = (
        f"the autopilot's clock aligned with GPS time by {int(kept.sum())} GPS messages, scatter {scatter_s:.3f} s;"
        " inertial times may be too early by the receiver's delay, 0.05 to 0.2 s"
    )
    return clock, [Event(int(gps_ns[0]), "imu_time_estimated", detail)]
