"""Time columns become GPS time in integer nanoseconds: unit, origin, time scale, week crossover, offset."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.config.log_table import NO_COLUMN, LogTable, TimeScale
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import TimeError
from insgnss.gpstime import UNIX_TO_GPS_S, leap_seconds, ns_to_datetime
from insgnss.log.csv.calendar import Calendar
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import CsvTable
from insgnss.log.first_events import first_events
from insgnss.tables import Bool, Event, Int64

NS_PER_UNIT: Final = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_DIGITS: Final = {"s": 9, "ms": 6, "us": 3, "ns": 0}
CROSSOVER_TOLERANCE_NS: Final = 3600 * NS_PER_S  # a log may pause that long over the week's end
LATEST_NS: Final = 9_999 * NS_PER_WEEK  # later values are not dates of a log
MAX_WEEK_SECONDS_NS: Final = 10 * NS_PER_WEEK  # seconds may be counted on over some week ends
# from the middle of the log: no log lasts a year, an unset clock is years off
STRAY_NS: Final = 183 * 86_400 * NS_PER_S


def is_exact(scale: TimeScale) -> bool:
    """Return whether the column must be read digit by digit.

    Seconds of the week fit a float64 to 0.1 ns; seconds since 1970 or 1980 only to 0.2 us.
    """
    return scale.origin != "gps_week"


def wanted_with_time(log: LogTable, wanted: ColumnSelection) -> ColumnSelection:
    """Return ``wanted`` with the columns of time added in the way their scale needs, and the decimal mark."""
    names, scale = log.columns, log.time
    wanted = replace(wanted, decimal=log.decimal)
    if scale.origin == "calendar":
        columns = (names.time,) if names.date == NO_COLUMN else (names.date, names.time)
        declared = scale.model_fields_set
        calendar = Calendar(
            columns,
            scale.date_order,
            scale.scale,
            scale.leap_seconds,
            is_order_declared="date_order" in declared,
            has_day_seconds="unit" in declared and len(columns) == 2,
        )
        return replace(wanted, calendar=calendar)
    if is_exact(scale):
        return replace(wanted, exact={names.time: _DIGITS[scale.unit]})
    week = () if names.week == NO_COLUMN else (names.week,)
    return replace(wanted, numeric=(*week, names.time, *wanted.numeric))


def gps_times(
    table: CsvTable, log: LogTable, week: int
) -> tuple[Int64, npt.NDArray[np.intp] | None, list[Event]]:
    """Return GPS time [ns] of the rows of a table that was read with ``wanted_with_time``.

    Returns
    -------
    The times, the rows they belong to (None: all; a tag that is not a date refuses its row), and what was noticed.

    Raises
    ------
    TimeError : most times lie outside any GPS date: wrong unit or origin
    """
    names, scale = log.columns, log.time
    column = names.time if names.week == NO_COLUMN else f"{names.week}' and '{names.time}"
    if is_exact(scale):
        t_ns = table.exact[names.time]
        if scale.origin == "unix_epoch":
            t_ns = t_ns - UNIX_TO_GPS_S * NS_PER_S
        possible = (t_ns >= 0) & (t_ns <= LATEST_NS)
    else:
        with np.errstate(over="ignore"):  # 1e308 s: infinite, and refused as such
            ns = table.columns[names.time] * NS_PER_UNIT[scale.unit]
        possible = np.abs(ns) <= MAX_WEEK_SECONDS_NS
        if names.week != NO_COLUMN:
            weeks = table.columns[names.week]
            possible &= (weeks == np.rint(weeks)) & (weeks >= 0) & (weeks <= LATEST_NS // NS_PER_WEEK)
        t_ns = np.rint(np.where(possible, ns, 0.0) if not possible.all() else ns).astype(np.int64)
        if names.week != NO_COLUMN:
            t_ns += np.where(possible, weeks, 0.0).astype(np.int64) * NS_PER_WEEK
    rows, events = _possible_rows(table, column, scale, possible)
    has_date = is_exact(scale) or names.week != NO_COLUMN
    if has_date:
        rows, found = _rows_of_one_log(table, column, t_ns, rows)
        events += found
    t_ns = t_ns if rows is None else t_ns[rows]
    if not has_date:
        events += _unwrap_week(t_ns, str(table.path), week)
        t_ns += week * NS_PER_WEEK
    return _to_gps(t_ns, scale, str(table.path), events), rows, events


def _possible_rows(
    table: CsvTable, column: str, scale: TimeScale, possible: Bool
) -> tuple[npt.NDArray[np.intp] | None, list[Event]]:
    if possible.all():
        return None, []
    rows = np.flatnonzero(possible)
    bad = np.flatnonzero(~possible)
    if len(bad) > len(rows):
        meant = f"times since the {scale.origin} in {scale.unit}"
        if scale.origin == "gps_week":
            meant = f"seconds of a GPS week in {scale.unit}"
        if scale.origin == "calendar":
            meant = "dates after 1980"
        raise TimeError(
            f"the time tags are not {meant}",
            file=table.path,
            line=int(table.line[bad[0]]),
            column=column,
            advice="check time.unit and time.origin ('gps_week', 'gps_epoch', 'unix_epoch', 'calendar') in the flight"
            " file",
        )
    return rows, _refusals(table, column, bad, ["not a date"] * len(bad))


def _rows_of_one_log(
    table: CsvTable, column: str, t_ns: Int64, rows: npt.NDArray[np.intp] | None
) -> tuple[npt.NDArray[np.intp] | None, list[Event]]:
    """Refuse rows whose date is half a year and more from the middle one: a recorder's clock was not yet set."""
    told = t_ns if rows is None else t_ns[rows]
    if int(told.max()) - int(told.min()) <= STRAY_NS:
        return rows, []
    kept = np.arange(len(t_ns)) if rows is None else rows
    away = told - middle_ns(told)
    stray = np.abs(away) > STRAY_NS
    if not stray.any():
        return rows, []
    years = away[stray] / (365.25 * 86_400 * NS_PER_S)
    reasons = [f"{abs(y):.1f} years {'before' if y < 0 else 'after'} the middle of the log" for y in years]
    return kept[~stray], _refusals(table, column, kept[stray], reasons)


def middle_ns(t_ns: Int64) -> int:
    """Return the median tag [ns], one of the log's own: it stays where it is when some tags are wrong."""
    half = len(t_ns) // 2
    return int(np.partition(t_ns, half)[half])


def _refusals(table: CsvTable, column: str, bad: npt.NDArray[np.intp], reasons: Sequence[str]) -> list[Event]:
    def event(k: int) -> Event:
        place = f"{table.path}:{table.line[bad[k]]}, column '{column}'"
        return Event(None, "bad_row", f"{place}: {reasons[k]}; row refused")

    return first_events(range(len(bad)), event, table.path, "row refused")


def _unwrap_week(t_ns: Int64, file: str, week: int) -> list[Event]:
    """Add a week, in place, to all tags after each fall of the seconds of the week by about 604800."""
    step = np.diff(t_ns)
    falls = np.flatnonzero(np.abs(step + NS_PER_WEEK) < CROSSOVER_TOLERANCE_NS)
    if not len(falls):
        return []
    rises = np.flatnonzero(np.abs(step - NS_PER_WEEK) < CROSSOVER_TOLERANCE_NS)  # rows out of order around it
    weeks = np.zeros(len(t_ns), np.int64)
    np.add.at(weeks, falls + 1, 1)
    np.add.at(weeks, rises + 1, -1)
    t_ns += np.cumsum(weeks) * NS_PER_WEEK
    when = int(t_ns[falls[0] + 1]) + week * NS_PER_WEEK
    detail = (
        f"{file}: the seconds of the week start again at row {falls[0] + 2}; counted on into week {week + 1}"
    )
    return [Event(when, "week_crossover", detail)]


def _to_gps(t_ns: Int64, scale: TimeScale, file: str, events: list[Event]) -> Int64:
    """Return the times with leap seconds and the declared offset added."""
    shift = round(scale.offset_s * NS_PER_S)
    if scale.scale == "utc":
        leap = scale.leap_seconds
        if leap is None:
            utc = ns_to_datetime(middle_ns(t_ns))
            leap = leap_seconds(dt.datetime(utc.year, utc.month, utc.day))
            events.append(
                Event(
                    None, "leap_seconds_by_date", f"{file}: UTC; {leap} s added by its date, {utc:%Y-%m-%d}"
                )
            )
        if scale.origin != "calendar":  # each date has its own already
            shift += leap * NS_PER_S
    return t_ns + shift if shift else t_ns


def continued_week(t_ns: Int64, previous_ns: int | None, file: str) -> tuple[Int64, list[Event]]:
    """Return the times of a file, a week later when it goes on where the file before it crossed the week's end."""
    if previous_ns is None or abs(int(t_ns[0]) + NS_PER_WEEK - previous_ns) > CROSSOVER_TOLERANCE_NS:
        return t_ns, []
    return t_ns + NS_PER_WEEK, [
        Event(int(t_ns[0]) + NS_PER_WEEK, "week_crossover", f"{file}: goes on in the next week")
    ]
