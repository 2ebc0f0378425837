"""The times of a run as dates: UTC, with the leap seconds in force."""

from __future__ import annotations

import datetime as dt

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.errors import ResultError
from insgnss.gpstime import GPS_EPOCH, leap_seconds, ns_to_datetime, week_seconds_to_ns
from insgnss.run import Run
from insgnss.tables import Float64


def gps_week(run: Run) -> int:
    """Return the GPS week that ``time_s`` of the run counts from.

    Raises
    ------
    ResultError : the run's settings do not say
    """
    week = dict(run.settings.get("flight") or {}).get("gps_week")
    if not isinstance(week, int):
        raise ResultError(
            "the run does not say which GPS week its times are of",
            key='settings["flight"]["gps_week"]',
            advice="replay the flight again: every run that is made by replay says it",
        )
    return week


def utc(time_s: float, week: int) -> dt.datetime:
    """Return the UTC date of a time of the week, to the microsecond."""
    gps = ns_to_datetime(int(week_seconds_to_ns(week, time_s)))
    return gps - dt.timedelta(seconds=_behind(gps))


def utc_texts(time_s: Float64, week: int) -> list[str]:
    """Return times of the week as UTC in ISO 8601 to the millisecond: '2025-09-24T09:34:44.000Z'."""
    if len(time_s) == 0:
        return []
    first, last = (ns_to_datetime(int(week_seconds_to_ns(week, t))) for t in (time_s.min(), time_s.max()))
    if _behind(first) != _behind(last):  # a leap second within the run
        return [utc(t, week).isoformat(timespec="milliseconds") + "Z" for t in time_s.tolist()]
    # rounded, not cut: 0.9999999 s of a float is the next whole second
    ms = np.rint((week_seconds_to_ns(week, time_s) - _behind(first) * NS_PER_S) / 1e6).astype(np.int64)
    dates = np.datetime64(GPS_EPOCH, "ms") + ms.astype("timedelta64[ms]")
    return [f"{text}Z" for text in np.datetime_as_string(dates, unit="ms").tolist()]


def _behind(gps: dt.datetime) -> int:
    """Return GPS minus UTC [s] at a date given in GPS time."""
    # in the seconds after a change the GPS date is already past it, UTC is not
    seconds = leap_seconds(gps)
    return leap_seconds(max(gps - dt.timedelta(seconds=seconds), GPS_EPOCH))
