"""Time columns become GPS time in integer nanoseconds: unit, origin, time scale, week crossover, offset."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.config.log_table import NO_COLUMN, LogTable, TimeScale
from insgnss.constants import NS_PER_DAY, NS_PER_S, NS_PER_WEEK
from insgnss.errors import TimeError
from insgnss.gpstime import UNIX_TO_GPS_S, leap_seconds, ns_to_datetime
from insgnss.log.csv.calendar import Calendar
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import CsvTable, read_csv_table
from insgnss.log.events import first_events
from insgnss.tables import Bool, Event, Int64

NS_PER_UNIT: Final = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_DIGITS: Final = {"s": 9, "ms": 6, "us": 3, "ns": 0}
CROSSOVER_TOLERANCE_NS: Final = 3600 * NS_PER_S  # a log may pause that long over the week's end
LATEST_NS: Final = 9_999 * NS_PER_WEEK  # later values are not dates of a log
ROLLOVER_WEEKS: Final = 1024  # the week of GPS messages has ten bits
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
    needed = (*wanted.numeric, *wanted.text)
    measured = (*needed, *wanted.optional, *wanted.optional_text) if needed else ()
    wanted = replace(wanted, decimal=log.decimal, measured=measured)
    if scale.origin == "calendar":
        declared = scale.model_fields_set
        calendar = Calendar(
            names.time_names,
            "ymd" if scale.date_order == "yd" else scale.date_order,
            scale.scale,
            scale.leap_seconds,
            is_order_declared="date_order" in declared,
            date_columns=names.date_names,
            date=scale.date,
            day_digits=_DIGITS[scale.unit] if "unit" in declared else None,
        )
        return replace(wanted, calendar=calendar)
    if names.nanoseconds != NO_COLUMN:
        wanted = replace(wanted, exact={names.nanoseconds: 0})
    if is_exact(scale):
        return replace(wanted, exact={_time(log): _DIGITS[scale.unit], **wanted.exact})
    week = () if names.week == NO_COLUMN else (names.week,)
    return replace(wanted, numeric=(*week, _time(log), *wanted.numeric))


def _time(log: LogTable) -> str:
    """Return the name under which a table has its times."""
    return log.columns.time_names[-1]


def read_timed_table(path: Path, log: LogTable, wanted: ColumnSelection, week: int) -> tuple[Int64, CsvTable]:
    """Read the wanted columns of a log's file, and GPS time [ns] of each row; rows without a possible one are refused.

    Raises
    ------
    InputError or a subclass : as ``read_csv_table``
    TimeError : most times lie outside any GPS date: wrong unit or origin
    """
    table = read_csv_table(path, wanted_with_time(log, wanted))
    names, scale = log.columns, log.time
    if is_exact(scale):
        t_ns = table.exact[_time(log)]
        if scale.origin == "unix_epoch":
            t_ns = t_ns - UNIX_TO_GPS_S * NS_PER_S
        possible = (t_ns >= 0) & (t_ns <= LATEST_NS)
    else:
        t_ns, possible = _of_weeks(table, log)
    if names.nanoseconds != NO_COLUMN:
        fraction_ns = table.exact[names.nanoseconds]
        possible &= (fraction_ns >= 0) & (fraction_ns < NS_PER_S)
        t_ns = t_ns + np.where(possible, fraction_ns, 0)
    if not possible.all():
        _require_some(table, log, possible)
        t_ns, table = _without(t_ns, table, log, ~possible, repeat("not a date"))
    has_date = is_exact(scale) or names.week != NO_COLUMN
    if names.week != NO_COLUMN:
        _require_whole_weeks(table, log, t_ns)
    if has_date:
        t_ns, table = _rows_of_one_log(t_ns, table, log)
    if names.date_names or scale.date is not None:
        table.events += _unwrap_days(t_ns, scale, str(path))
    if not has_date:
        table.events += _unwrap_week(t_ns, str(path), week)
        t_ns += week * NS_PER_WEEK
    return _to_gps(t_ns, scale, str(path), table.events), table


def _of_weeks(table: CsvTable, log: LogTable) -> tuple[Int64, Bool]:
    """Return seconds of the week in ns, with the week where a column has it, and which rows hold possible ones."""
    names = log.columns
    with np.errstate(over="ignore"):  # 1e308 s: infinite, and refused as such
        ns = table.columns[_time(log)] * NS_PER_UNIT[log.time.unit]
    possible = np.abs(ns) <= MAX_WEEK_SECONDS_NS
    if names.week != NO_COLUMN:
        weeks = table.columns[names.week]
        possible &= (weeks == np.rint(weeks)) & (weeks >= 0) & (weeks <= LATEST_NS // NS_PER_WEEK)
    t_ns = np.rint(np.where(possible, ns, 0.0) if not possible.all() else ns).astype(np.int64)
    if names.week != NO_COLUMN:
        t_ns += np.where(possible, weeks, 0.0).astype(np.int64) * NS_PER_WEEK
    return t_ns, possible


def _require_whole_weeks(table: CsvTable, log: LogTable, t_ns: Int64) -> None:
    """Refuse weeks that a receiver counts modulo 1024, unless ``offset_s`` mends them."""
    week = middle_ns(t_ns) // NS_PER_WEEK
    if week + log.time.offset_s * NS_PER_S / NS_PER_WEEK >= ROLLOVER_WEEKS:
        return
    offset_s = 2 * ROLLOVER_WEEKS * NS_PER_WEEK // NS_PER_S
    raise TimeError(
        f"GPS week {week} is in {ns_to_datetime(week * NS_PER_WEEK):%Y}: the receiver counts weeks modulo"
        f" {ROLLOVER_WEEKS}",
        file=table.path,
        column=log.columns.week,
        advice=f"add {2 * ROLLOVER_WEEKS} weeks in the file, or write time.offset_s = {offset_s} in the flight file"
        " (half of that for logs before April 2019); if the log is that old, declare gps_week in place of columns.week",
    )


def _require_some(table: CsvTable, log: LogTable, possible: Bool) -> None:
    """Refuse a file of which most times are impossible."""
    bad, scale = np.flatnonzero(~possible), log.time
    if 2 * len(bad) <= table.n:
        return
    meant = f"times since the {scale.origin} in {scale.unit}"
    if scale.origin == "gps_week":
        meant = f"seconds of a GPS week in {scale.unit}"
    if scale.origin == "calendar":
        meant = "dates after 1980"
    raise TimeError(
        f"the time tags are not {meant}",
        file=table.path,
        line=int(table.line[bad[0]]),
        column="' and '".join(log.columns.of_time),
        advice="check time.unit and time.origin ('gps_week', 'gps_epoch', 'unix_epoch', 'calendar') in the flight file",
    )


def _rows_of_one_log(t_ns: Int64, table: CsvTable, log: LogTable) -> tuple[Int64, CsvTable]:
    """Refuse rows whose date is half a year and more from the middle one: a recorder's clock was not yet set."""
    if int(t_ns.max()) - int(t_ns.min()) <= STRAY_NS:
        return t_ns, table
    away = t_ns - middle_ns(t_ns)
    stray = np.abs(away) > STRAY_NS
    years = away[stray] / (365.25 * 86_400 * NS_PER_S)
    reasons = [f"{abs(y):.1f} years {'before' if y < 0 else 'after'} the middle of the log" for y in years]
    return _without(t_ns, table, log, stray, reasons)


def _without(
    t_ns: Int64, table: CsvTable, log: LogTable, bad: Bool, reasons: Iterable[str]
) -> tuple[Int64, CsvTable]:
    """Return the rows that are not bad; each of the others is refused for its reason."""
    column = "' and '".join(log.columns.of_time)

    refused = (
        f"{table.path}:{line}, column '{column}': {reason}; row refused"
        for line, reason in zip(table.line[bad].tolist(), reasons, strict=False)
    )
    table.events += first_events("bad_row", refused, table.path, "row refused")
    return t_ns[~bad], table.take(np.flatnonzero(~bad))


def middle_ns(t_ns: Int64) -> int:
    """Return the median tag [ns], one of the log's own: it stays where it is when some tags are wrong."""
    half = len(t_ns) // 2
    return int(np.partition(t_ns, half)[half])


def _turns(t_ns: Int64, period_ns: int) -> tuple[npt.NDArray[np.intp], Int64]:
    """Return the rows before which the tags step by about whole periods, and by how many: -1 where a count restarts.

    A step of +1 is of a row out of order around the restart.
    """
    step = np.diff(t_ns)
    far = np.flatnonzero(np.abs(step) > period_ns - CROSSOVER_TOLERANCE_NS)
    n = np.rint(step[far] / period_ns).astype(np.int64)
    whole = np.abs(step[far] - n * period_ns) < CROSSOVER_TOLERANCE_NS
    return far[whole] + 1, n[whole]


def _unwrap_week(t_ns: Int64, file: str, week: int) -> list[Event]:
    """Add a week, in place, to all tags after each fall of the seconds of the week by about 604800."""
    turns, n = _turns(t_ns, NS_PER_WEEK)
    if not (n == -1).any():
        return []
    weeks = np.zeros(len(t_ns), np.int64)
    weeks[turns] = -n * (np.abs(n) == 1)
    t_ns += np.cumsum(weeks) * NS_PER_WEEK
    first = int(turns[n == -1][0])
    when = int(t_ns[first]) + week * NS_PER_WEEK
    detail = (
        f"{file}: the seconds of the week start again at row {first + 1}; counted on into week {week + 1}"
    )
    return [Event(when, "week_crossover", detail)]


def _unwrap_days(t_ns: Int64, scale: TimeScale, file: str) -> list[Event]:
    """Add a day, in place, to all tags after each fall of the time of day by about 86400 s while the date stays.

    Where the date goes on later, the tags fit again from there. Rows that are not in the order of time stay.
    """
    turns, n = _turns(t_ns, NS_PER_DAY)
    leap_ns = _leap_seconds_of(scale, int(t_ns[0])) * NS_PER_S if scale.scale == "utc" else 0
    day = (np.stack((t_ns[turns - 1], t_ns[turns])) - leap_ns) // NS_PER_DAY
    same_date = day[0] == day[1]
    days = np.zeros(len(t_ns), np.int64)
    ahead = 0  # days that the tags were counted on before the row
    midnights = []
    for row, step, same in zip(turns.tolist(), n.tolist(), same_date.tolist(), strict=True):
        if step == -1 and (same or ahead):
            midnights.append(row)
        elif not 0 < step <= ahead:
            continue
        days[row] = -step
        ahead -= step
    if not midnights:
        return []
    unwrapped = t_ns + np.cumsum(days) * NS_PER_DAY
    if not _is_in_order(unwrapped, len(midnights)):
        return []
    t_ns[:] = unwrapped
    detail = f"{file}: the time of day starts again at row {midnights[0] + 1} with the same date; counted on"
    return [Event(int(t_ns[midnights[0]]), "midnight_crossover", f"{detail} into the next day")]


def _is_in_order(t_ns: Int64, n_midnights: int) -> bool:
    """Return whether tags with midnights counted on are a log's: not a day's rows sorted by satellite, say.

    Such a file falls back by hours at many satellites, and by a whole day at some.
    """
    few = len(t_ns) // 100
    ordered = np.partition(t_ns, (few, len(t_ns) - 1 - few))
    if int(ordered[len(t_ns) - 1 - few]) - int(ordered[few]) < NS_PER_DAY:
        return True
    return int(np.count_nonzero(np.diff(t_ns) < -CROSSOVER_TOLERANCE_NS)) <= n_midnights


def _to_gps(t_ns: Int64, scale: TimeScale, file: str, events: list[Event]) -> Int64:
    """Return the times with leap seconds and the declared offset added."""
    shift = round(scale.offset_s * NS_PER_S)
    if scale.scale == "utc":
        middle = middle_ns(t_ns)
        leap = _leap_seconds_of(scale, middle)
        if scale.leap_seconds is None:
            detail = f"{file}: UTC; {leap} s added by its date, {ns_to_datetime(middle):%Y-%m-%d}"
            events.append(Event(None, "leap_seconds_by_date", detail))
        if scale.origin != "calendar":  # each date has its own already
            shift += leap * NS_PER_S
    return t_ns + shift if shift else t_ns


def _leap_seconds_of(scale: TimeScale, t_ns: int) -> int:
    """Return the declared leap seconds, else those of the date of a tag [s]."""
    if scale.leap_seconds is not None:
        return scale.leap_seconds
    utc = ns_to_datetime(t_ns)
    return leap_seconds(dt.datetime(utc.year, utc.month, utc.day))


def continued_times(
    t_ns: Int64, previous_ns: int | None, log: LogTable, file: str
) -> tuple[Int64, list[Event]]:
    """Return the times of a file, weeks later when it goes on where the file before it crossed the week's end.

    Where the flight file states the date of a log without dates, days later.
    """
    if previous_ns is None:
        return t_ns, []
    has_days = log.time.date is not None
    period_ns = NS_PER_DAY if has_days else NS_PER_WEEK
    n = round((previous_ns - int(t_ns[0])) / period_ns)
    if n < 1 or abs(int(t_ns[0]) + n * period_ns - previous_ns) > CROSSOVER_TOLERANCE_NS:
        return t_ns, []
    t_ns = t_ns + n * period_ns
    kind, goes_on = ("midnight_crossover", "day") if has_days else ("week_crossover", "week")
    return t_ns, [Event(int(t_ns[0]), kind, f"{file}: goes on in the next {goes_on}")]


def each_time_once(t_ns: Int64, source: Path, kind: str) -> tuple[Int64, Int64, list[Event]]:
    """Return the times in order, each once, the rows that they come from, and an event where that changed them."""
    times_ns, order = np.unique(t_ns, return_index=True)
    if len(order) == len(t_ns) and (np.diff(order) > 0).all():
        return times_ns, order, []
    repeated = len(t_ns) - len(order)
    detail = f"{source}: rows sorted by time, {repeated} row(s) with a repeated time refused"
    return times_ns, order, [Event(None, kind, detail)]
