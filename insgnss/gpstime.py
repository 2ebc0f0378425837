"""GPS time as integer nanoseconds since 1980-01-06 00:00:00 GPS, and the other time scales seen from it.

Integer nanoseconds do not lose resolution at any date: a float64 of Unix seconds resolves only 0.24 us.
"""

from __future__ import annotations

import datetime as dt
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, NS_PER_WEEK

_Time = TypeVar("_Time", np.int64, np.float64)
GPS_EPOCH = dt.datetime(1980, 1, 6)
UNIX_TO_GPS_S = 315_964_800  # GPS epoch in Unix seconds
LATEST_WEEK = 10_000  # the year 2171: a receiver that states a later GPS week does not know the time
BDT_WEEK_OFFSET = 1356  # BeiDou week 0 began in GPS week 1356 (BDS-SIS-ICD B1I, 3.3)
BDT_MINUS_GPST_S = -14  # BeiDou time is 14 s behind GPS time
BDT_TO_GPS_NS = -BDT_MINUS_GPST_S * NS_PER_S
GST_WEEK_OFFSET = 1024  # Galileo week 0 began in GPS week 1024 (OS SIS ICD, 5.1.2)
GLONASS_EPOCH = dt.datetime(1996, 1, 1)  # in Moscow time (GLONASS ICD 5.1, A.3.1.3)
GLONASS_MINUS_UTC_H = 3  # GLONASS time is Moscow's, UTC + 3 h (GLONASS ICD 5.1, 3.3.3)
MOSCOW_MINUS_UTC_S = GLONASS_MINUS_UTC_H * 3600

# GPS minus UTC, from the dates at which each value came into force (IERS Bulletin C)
LEAP_SECONDS: tuple[tuple[str, int], ...] = (
    ("1980-01-06", 0),
    ("1981-07-01", 1),
    ("1982-07-01", 2),
    ("1983-07-01", 3),
    ("1985-07-01", 4),
    ("1988-01-01", 5),
    ("1990-01-01", 6),
    ("1991-01-01", 7),
    ("1992-07-01", 8),
    ("1993-07-01", 9),
    ("1994-07-01", 10),
    ("1996-01-01", 11),
    ("1997-07-01", 12),
    ("1999-01-01", 13),
    ("2006-01-01", 14),
    ("2009-01-01", 15),
    ("2012-07-01", 16),
    ("2015-07-01", 17),
    ("2017-01-01", 18),
)


def week_seconds_to_ns(week: int, seconds: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return GPS time in ns of ``seconds`` of GPS week ``week``; exact to 1 ns for any second of the week."""
    whole = np.rint(np.asarray(seconds, dtype=np.float64) * NS_PER_S).astype(np.int64)
    return np.asarray(whole + np.int64(week) * NS_PER_WEEK)


def ns_to_week_seconds(t_ns: npt.ArrayLike, week: int) -> npt.NDArray[np.float64]:
    """Return seconds counted from the start of GPS week ``week`` (beyond 604800 after a week crossover)."""
    return np.asarray((np.asarray(t_ns, dtype=np.int64) - np.int64(week) * NS_PER_WEEK) / NS_PER_S)


def nearest(times: npt.NDArray[_Time], wanted: npt.NDArray[_Time]) -> npt.NDArray[np.int64]:
    """Return for each wanted time the index of the nearest one in ``times``, the earlier of two that are as near.

    Parameters
    ----------
    times : (n,) in order, at least one
    """
    after = np.minimum(np.searchsorted(times, wanted), len(times) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(times[after] - wanted < wanted - times[before], after, before)


def leap_seconds(utc: dt.datetime) -> int:
    """Return GPS minus UTC [s] in force at the given UTC date."""
    value = 0
    for date, seconds in LEAP_SECONDS:
        if utc >= dt.datetime.fromisoformat(date):
            value = seconds
    return value


def utc_to_ns(utc: dt.datetime) -> int:
    """Return GPS time in ns of a UTC date; the leap seconds are those in force at it."""
    return datetime_to_ns(utc) + leap_seconds(utc) * NS_PER_S


def unix_to_gps_ns(unix_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return GPS times in ns of Unix times in ns, with the leap seconds in force at the first."""
    since = unix_ns - UNIX_TO_GPS_S * NS_PER_S
    leap_s = leap_seconds(ns_to_datetime(int(since[0]))) if len(since) else 0
    return since + leap_s * NS_PER_S


def utc_to_gps_ns(unix_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return GPS times in ns of UTC dates in ns since 1970, with the leap seconds in force at each."""
    since = unix_ns - UNIX_TO_GPS_S * NS_PER_S
    in_force = np.searchsorted(_LEAP_CHANGES_NS - _LEAP_VALUES * NS_PER_S, since, side="right")
    return np.asarray(since + np.append(0, _LEAP_VALUES)[in_force] * NS_PER_S)


def ns_to_utc(t_ns: npt.ArrayLike) -> npt.NDArray[np.datetime64]:
    """Return UTC dates (datetime64[ns]) of GPS times in ns, with the leap seconds in force at each.

    Such dates cannot express 23:59:60: an inserted second repeats the date of the second after it.
    """
    t = np.asarray(t_ns, dtype=np.int64)
    in_force = np.searchsorted(_LEAP_CHANGES_NS, t, side="right") - 1
    seconds = _LEAP_VALUES[np.maximum(in_force, 0)]
    return np.asarray(np.datetime64(GPS_EPOCH, "ns") + (t - seconds * NS_PER_S).astype("timedelta64[ns]"))


def glonass_to_ns(four_years: int, day: int, seconds: float) -> int:
    """Return GPS time in ns of a date as GLONASS sends it: Moscow time, which is UTC + 3 h and has its leap seconds.

    Equation: day 1 of interval 1 is 1996-01-01, an interval is four years of 1461 days [GLONASS ICD 5.1, A.3.1.3]

    Parameters
    ----------
    four_years : N_4, from 1
    day : N_T of the interval, from 1
    seconds : of the Moscow day; t_b is its multiple of 900
    """
    days = (four_years - 1) * 1461 + day - 1
    moscow = GLONASS_EPOCH + dt.timedelta(days=days, seconds=seconds)
    return utc_to_ns(moscow - dt.timedelta(hours=GLONASS_MINUS_UTC_H))


def datetime_to_ns(when: dt.datetime) -> int:
    """Return GPS time in ns of a calendar date given in GPS time (no leap seconds applied)."""
    delta = when - GPS_EPOCH
    return (delta.days * 86_400 + delta.seconds) * NS_PER_S + delta.microseconds * 1000


def ns_to_datetime(t_ns: int) -> dt.datetime:
    """Return the calendar date, in GPS time, of a GPS time in ns (to the microsecond)."""
    return GPS_EPOCH + dt.timedelta(microseconds=int(t_ns) // 1000)


_LEAP_VALUES = np.array([value for _, value in LEAP_SECONDS], np.int64)
# GPS time in ns from which on each of them is in force
_LEAP_CHANGES_NS = np.array([utc_to_ns(dt.datetime.fromisoformat(date)) for date, _ in LEAP_SECONDS])
