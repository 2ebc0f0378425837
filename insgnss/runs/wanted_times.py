"""Times that a user gives, as numbers, dates or text, become seconds of a GPS week."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa

from insgnss.errors import InsGnssError
from insgnss.gpstime import ns_to_week_seconds, utc_to_gps_ns
from insgnss.log.csv.calendar import Calendar, has_zone
from insgnss.tables import Float64, Int64

WANTED: Final = (
    "give seconds of the run's GPS week, as run.nav['time_s'] has them, or dates with a zone: 2025-09-24T09:36:22.25Z,"
    " the index of run.nav_with(utc=True)"
)
_UTC: Final = Calendar(("time",), "ymd", "utc", None)
_NO_ZONE: Final = "has no zone: write 'Z' after UTC, or localise it, as in index.tz_localize('UTC')"
Refuse = Callable[[str], InsGnssError]


def week_seconds(times: Any, week: int | None, refuse: Refuse) -> Float64:
    """Return times as seconds of a GPS week, beyond 604800 after its end; dates become GPS time with leap seconds.

    Parameters
    ----------
    times : numbers, which are seconds of the week already; dates with a zone, as pandas and ``datetime`` have them;
        text in ISO 8601 with a zone
    week : the GPS week; None: unknown, numbers only
    refuse : makes the error of a reason

    Raises
    ------
    the error of ``refuse`` : a value is neither, is not finite, or is a date without a zone
    """
    if isinstance(times, pd.Index | pd.Series) and isinstance(times.dtype, pd.DatetimeTZDtype):
        return _of_dates(pd.DatetimeIndex(times), week, refuse)
    if isinstance(times, str | dt.datetime):
        times = [times]
    if isinstance(times, list | tuple):
        seconds = _of_each(list(times), week, refuse)
    else:
        seconds = _of_array(np.atleast_1d(np.asarray(times)), week, refuse)
    wrong = np.flatnonzero(~np.isfinite(seconds))
    if len(wrong):
        raise refuse(f"value {wrong[0] + 1} of {len(seconds)}, {seconds[wrong[0]]}, is not a finite number")
    return seconds


def about(times: str, what: str) -> str:
    """Return what is wrong with some times as a sentence: of one value after a colon, of all of them without."""
    return f"{times}: {what}" if what.startswith("value") else f"{times} {what}"


def dated_text_ns(texts: list[str]) -> list[int | str]:
    """Return GPS time [ns] of each text that is a date and time with a zone, or what is wrong with it."""
    cells = pa.array(texts, pa.string())
    t_ns, readable = _UTC.to_gps([cells])
    zoned = has_zone(cells)
    return [
        "is not a time" if not good else int(t) if zone else _NO_ZONE
        for t, good, zone in zip(t_ns.tolist(), readable.tolist(), zoned, strict=True)
    ]


def _of_array(values: npt.NDArray[Any], week: int | None, refuse: Refuse) -> Float64:
    """Return the same of an array, whose values are of one kind or objects."""
    if values.dtype.kind in "OUT":
        return _of_each(list(values), week, refuse)
    if values.dtype.kind == "M":
        raise refuse(f"value 1, {values[0]}, {_NO_ZONE}" if len(values) else "are dates without a zone")
    if values.dtype.kind not in "iuf":
        raise refuse("are neither numbers nor dates")
    return np.asarray(values, np.float64)


def _of_each(values: list[Any], week: int | None, refuse: Refuse) -> Float64:
    """Return the same of values that need not be of one kind."""
    seconds = np.zeros(len(values))
    texts: dict[int, str] = {}
    for k, value in enumerate(values):
        if isinstance(value, dt.datetime | np.datetime64):  # of which pandas' Timestamp is one
            if pd.isna(value):  # NaT is a datetime
                raise refuse(f"value {k + 1} of {len(values)}, NaT, is not a time")
            date = pd.Timestamp(value)
            if date.tzinfo is None:
                raise refuse(f"value {k + 1} of {len(values)}, {value}, {_NO_ZONE}")
            seconds[k] = _of_dates(pd.DatetimeIndex([date]), week, refuse)[0]
            continue
        try:
            seconds[k] = float(value)
        except (TypeError, ValueError):
            if not isinstance(value, str):
                raise refuse(f"value {k + 1} of {len(values)}, {value!r}, is not a time") from None
            texts[k] = value
    for k, result in zip(texts, dated_text_ns(list(texts.values())), strict=True):
        if isinstance(result, str):
            raise refuse(f"value {k + 1} of {len(values)}, '{texts[k]}', {result}")
        seconds[k] = _in_week(np.array([result]), week, refuse)[0]
    return seconds


def _of_dates(dates: pd.DatetimeIndex, week: int | None, refuse: Refuse) -> Float64:
    wrong = np.flatnonzero(dates.isna())
    if len(wrong):
        raise refuse(f"value {wrong[0] + 1} of {len(dates)}, NaT, is not a time")
    unix_ns = dates.tz_convert("UTC").as_unit("ns").asi8
    return _in_week(utc_to_gps_ns(unix_ns), week, refuse)


def _in_week(t_ns: Int64, week: int | None, refuse: Refuse) -> Float64:
    if week is None:
        raise refuse("are dates, and the run does not say of which GPS week its seconds are")
    return ns_to_week_seconds(t_ns, week)
