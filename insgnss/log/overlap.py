"""Checks that inertial log, GNSS log and navigation messages overlap in time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.config.flight import FlightConfig
from insgnss.constants import NS_PER_S, NS_PER_WEEK, S_PER_DAY
from insgnss.errors import NavigationDataError, TimeError
from insgnss.gpstime import leap_seconds, nearest, ns_to_datetime, ns_to_week_seconds
from insgnss.log.imu.csv_log import inertial
from insgnss.tables import Event, Int64, NavigationData, SensorTable

# a first tag below it: counted from the recorder's own start rather than in a week
FROM_ZERO_S: Final = 3600.0
MOST_HOURS: Final = 14  # between local time and UTC
# Two recorders never stop at the same moment: one epoch before or after the inertial log is worth no word
USUAL_EPOCHS_OUTSIDE: Final = 1
_WEEK_S: Final = NS_PER_WEEK / NS_PER_S


def check_overlap(imu_ns: Int64, gnss_ns: Int64, config: FlightConfig) -> None:
    """Hold the spans of the two logs against each other.

    Raises
    ------
    TimeError : they have no time in common; both spans are named, and which usual reasons fit the numbers
    """
    if imu_ns[0] <= gnss_ns[-1] and gnss_ns[0] <= imu_ns[-1]:
        return
    week = config.gps_week
    raise TimeError(
        f"the logs do not overlap: IMU {_span(imu_ns, week)}, GNSS {_span(gnss_ns, week)}",
        file=inertial(config).files[0],
        advice=_advice(imu_ns, gnss_ns, week),
    )


def epochs_outside(imu_ns: Int64, gnss_ns: Int64) -> tuple[int, int]:
    """Return how many epochs of a GNSS log (rows in time order) lie before the first and after the last sample."""
    before = np.searchsorted(gnss_ns, imu_ns[0], side="left")
    after = np.searchsorted(gnss_ns, imu_ns[-1], side="right")
    return len(np.unique(gnss_ns[:before])), len(np.unique(gnss_ns[after:]))


def outside_events(imu_ns: Int64, gnss_ns: Int64) -> list[Event]:
    """Return an event for each end of the inertial log that the GNSS log passes by more than one epoch."""
    before, after = epochs_outside(imu_ns, gnss_ns)
    return [
        Event(int(t_ns), "epochs_without_imu", f"{count} GNSS epoch(s) {where}: not used")
        for t_ns, count, where in (
            (gnss_ns[0], before, "before the inertial log begins"),
            (imu_ns[-1], after, "after the inertial log ends"),
        )
        if count > USUAL_EPOCHS_OUTSIDE
    ]


def sensor_outside(imu_ns: Int64, sensor: SensorTable, week: int) -> list[Event]:
    """Return an event for a further sensor's log that has no time in common with the inertial one."""
    if sensor.t_ns[0] <= imu_ns[-1] and imu_ns[0] <= sensor.t_ns[-1]:
        return []
    detail = (
        f"sensor '{sensor.name}' has no time in common with the IMU log: {_span(sensor.t_ns, week)}, IMU"
        f" {_span(imu_ns, week)}; none of its readings is used: check its time.unit, time.origin and time.offset_s"
    )
    return [Event(None, "sensor_no_overlap", detail)]


def _span(t_ns: Int64, week: int) -> str:
    first, last = ns_to_week_seconds(t_ns[[0, -1]], week)
    return (
        f"{first:.3f} to {last:.3f} s of week {week} ({ns_to_datetime(int(t_ns[0])):%Y-%m-%d %H:%M:%S} GPS)"
    )


def _advice(imu_ns: Int64, gnss_ns: Int64, week: int) -> str:
    """Say which of the usual mistakes would bring the logs together, and nothing that does not fit the numbers."""
    least = (int(gnss_ns[0]) - int(imu_ns[-1])) / NS_PER_S
    most = (int(gnss_ns[-1]) - int(imu_ns[0])) / NS_PER_S
    fits = [*_from_zero(imu_ns, gnss_ns, week), *_by_calendar(least, most, int(gnss_ns[0]))]
    if fits:
        return "; or ".join(fits)
    return (
        f"they are {min(abs(least), abs(most)):.1f} s apart, which no whole weeks, hours or leap seconds explain:"
        " check that both logs are of one flight, then time.unit, time.origin and time.offset_s"
    )


def _from_zero(imu_ns: Int64, gnss_ns: Int64, week: int) -> list[str]:
    """Return what to do when the inertial log counts from its own start; a receiver knows its time."""
    imu_s, gnss_s = (float(ns_to_week_seconds(t_ns[:1], week)[0]) for t_ns in (imu_ns, gnss_ns))
    if abs(imu_s) > FROM_ZERO_S or abs(gnss_s) <= FROM_ZERO_S:
        return []
    return [
        "the IMU log seems to count from its own start, not from the week's: give imu.time.offset_s,"
        f" about {gnss_s - imu_s:.0f} if both logs begin together"
    ]


def _by_calendar(least_s: float, most_s: float, when_ns: int) -> list[str]:
    """Return the shifts by the calendar, added to the IMU tags, that would make the logs overlap."""
    leap_s = leap_seconds(ns_to_datetime(when_ns))
    fits = []
    weeks = _multiple_inside(_WEEK_S, least_s, most_s)
    if weeks:
        fits.append(f"they are {abs(weeks)} week(s) apart: check gps_week and time.origin of both logs")
    if any(sign * leap_s > least_s and sign * leap_s < most_s for sign in (-1, 1)):
        fits.append(f"they may be the {leap_s} leap seconds apart: check time.scale of both logs, UTC or GPS")
    hours = _multiple_inside(3600.0, least_s, most_s)
    if hours and abs(hours) <= MOST_HOURS:
        fits.append(f"they are {abs(hours)} hour(s) apart: local time? give time.offset_s")
    return fits


def _multiple_inside(unit_s: float, least_s: float, most_s: float) -> int:
    """Return the smallest multiple of a unit between two shifts of equal sign, 0 when there is none."""
    if least_s > 0.0:
        count = math.ceil(least_s / unit_s)
    else:
        count = math.floor(most_s / unit_s)
    return count if least_s <= count * unit_s <= most_s else 0


# No message is of use further than this from the log: the longest validity is 4 h, a fit interval up to 26 h
WRONG_DAY_S = 1.5 * S_PER_DAY
# A part of the log this far from every message has no ephemeris of GPS (2 h) nor of most others
UNCOVERED_S = 7200.0


def check_navigation_time(navigation: NavigationData, gnss_ns: Int64, paths: tuple[Path, ...]) -> list[Event]:
    """Return an event where the messages cover a part of the log alone.

    Parameters
    ----------
    navigation : the messages as read
    gnss_ns : time tags of the GNSS log, in time order
    paths : the navigation files, for the message

    Raises
    ------
    NavigationDataError : the messages are of another day or week than the log
    """
    of_states = np.zeros(0, np.int64) if navigation.state_vectors is None else navigation.state_vectors.t_ns
    times = np.sort(np.concatenate([navigation.ephemerides.toe_ns, of_states]))
    if not len(times) or not len(gnss_ns):
        return []
    epochs = np.unique(gnss_ns)
    gap_s = np.abs(times[nearest(times, epochs)] - epochs) / NS_PER_S
    if gap_s.min() > WRONG_DAY_S:
        raise NavigationDataError(
            f"the navigation data are of {_days(times)}, the GNSS log of {_days(epochs)}",
            file=", ".join(map(str, paths)),
            advice="give the broadcast navigation file of the flight's day, and check the flight's gps_week",
        )
    uncovered = int(np.count_nonzero(gap_s > UNCOVERED_S))
    if not uncovered:
        return []
    detail = f"{uncovered} of {len(epochs)} epochs are more than 2 h from every message: add the files of those hours"
    return [Event(int(epochs[np.argmax(gap_s > UNCOVERED_S)]), "navigation_gap", detail)]


def _days(times: Int64) -> str:
    """Return the first and the last time in words, with the GPS week."""
    first, last = (f"{ns_to_datetime(int(t)):%Y-%m-%d %H:%M}" for t in (times[0], times[-1]))
    return f"{first} to {last} (GPS week {int(times[0]) // NS_PER_WEEK})"
