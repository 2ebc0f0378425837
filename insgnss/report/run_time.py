"""The times of a run as dates: UTC, with the leap seconds in force."""

from __future__ import annotations

import datetime as dt

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.errors import ResultError
from insgnss.gpstime import ns_to_utc, week_seconds_to_ns
from insgnss.runs.result import Run
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


def utc_dates(time_s: Float64, week: int) -> npt.NDArray[np.datetime64]:
    """Return times of the week as UTC (datetime64[ns])."""
    return ns_to_utc(week_seconds_to_ns(week, time_s))


def utc(time_s: float, week: int) -> dt.datetime:
    """Return the UTC date of a time of the week, to the microsecond."""
    date: dt.datetime = utc_dates(np.array([time_s]), week).astype("datetime64[us]")[0].item()
    return date


def utc_origin_ms(run: Run) -> int | None:
    """Return the Unix time of second 0 of the run's GPS week [ms], by its leap seconds; None if unknown."""
    week, first = dict(run.settings.get("flight") or {}).get("gps_week"), float(run.nav["time_s"].iloc[0])
    if not isinstance(week, int):
        return None
    unix_ns = int(utc_dates(np.array([first]), week).astype(np.int64)[0])
    return round(unix_ns / 1e6 - 1e3 * first)


def utc_texts(time_s: Float64, week: int, decimals: int = 3) -> list[str]:
    """Return times of the week as UTC in ISO 8601, by default to the millisecond: '2025-09-24T09:34:44.000Z'."""
    # rounded, not cut: 0.9999999 s of a float is the next whole second
    half = np.timedelta64(NS_PER_S // 10**decimals // 2, "ns")
    dates = np.datetime_as_string(utc_dates(time_s, week) + half, unit="ns").tolist()
    return [f"{text[: decimals - 9]}Z" for text in dates]
