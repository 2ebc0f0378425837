"""Dates with times of day, such as 2025-08-28T17:30:22.961Z, as GPS time in integer nanoseconds.

Names of months, days of the year and digits alone are first written as year, month and day with marks between.
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from insgnss.constants import NS_PER_DAY, NS_PER_S
from insgnss.gpstime import LEAP_SECONDS, UNIX_TO_GPS_S
from insgnss.log.csv.cells import integers
from insgnss.tables import Bool, Int64

_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTH: Final = (
    r"(?P<month>jan(?:uary)?|feb(?:ruary)?|mar(?:ch)?|apr(?:il)?|may|june?|july?|aug(?:ust)?|sept?(?:ember)?|"
    r"oct(?:ober)?|nov(?:ember)?|dec(?:ember)?)\.?"
)
_BETWEEN: Final = r"(?:[-/.,]\s?|\s)"
_DAY: Final = r"(?P<day>\d\d?)"
_YEAR: Final = r"(?P<year>\d{4})"
_NAMED: Final = [
    re.compile(rf"{pattern}(?=[Tt\s])", re.IGNORECASE | re.ASCII)
    for pattern in (
        f"{_DAY}{_BETWEEN}?{_MONTH}{_BETWEEN}?{_YEAR}",  # 24-Sep-2025, 24 Sep 2025, 24Sep2025
        f"{_MONTH}{_BETWEEN}{_DAY}{_BETWEEN}+{_YEAR}",  # Sep 24, 2025
        f"{_YEAR}{_BETWEEN}{_MONTH}{_BETWEEN}{_DAY}",  # 2025-Sep-24
    )
]
_DAY_OF_YEAR: Final = re.compile(r"(\d{4})[-/: ](\d{3})(?:[Tt\s]+|:)(?=\d)", re.ASCII)
_COMPACT: Final = re.compile(r"(\d{6}|\d{8})(?=[Tt\s])", re.ASCII)
_COMPACT_TIME: Final = re.compile(r"(?<=[Tt\s])(\d\d)(\d\d)(\d\d)", re.ASCII)
_SHORT_TIME: Final = re.compile(r"(?<=T)\d{1,5}(?=[.,]?$)", re.ASCII)
_WEEKDAY: Final = re.compile(r"(?:mon|tue|wed|thu|fri|sat|sun)[a-z]*\.?,?\s+", re.IGNORECASE)
_REWRITTEN: Final = (
    # 20250924093443, and 240925093443 with a declared order
    (re.compile(r"(\d{8}|\d{6})(\d{6})(?=\D|$)", re.ASCII), r"\1T\2"),
    (  # 2025 09 24 09 34 43
        re.compile(r"(\d+)\s+(\d\d?)\s+(\d+)\s+(\d\d?)\s+(\d\d?)\s+(\d\d?[.,]?)$", re.ASCII),
        r"\1-\2-\3T\4:\5:\6",
    ),
    (  # Sep 24 09:34:43 2025, with UTC or GMT before the year
        re.compile(
            rf"{_MONTH}\s+{_DAY}\s+(?P<clock>[\d:]+[.,]?)(?P<zone>\s(?:UTC|GMT))?\s+{_YEAR}$",
            re.IGNORECASE | re.ASCII,
        ),
        r"\g<day> \g<month> \g<year> \g<clock>\g<zone>",
    ),
)
_FIRST_SHORT_YEAR: Final = 80  # NMEA's years of two digits: 80 to 99 are 1980 to 1999


class DateForm(NamedTuple):
    """What is declared about the text of a date with its time."""

    order: str
    is_order_declared: bool = False
    has_time_apart: bool = False  # the time of day comes from a column of its own


def with_numbers(text: str, form: DateForm) -> tuple[str, str]:
    """Return a date and time with numbers and marks between them, and the order of its year, month and day.

    A month's name and a day of the year need no declared order. Six digits are read where the order is declared.
    A time of up to five digits in a column of its own lost its leading zeros, as spreadsheets take them off NMEA's.
    Text in none of these forms stays.
    """
    text = text.replace("_", "T")  # 2025-09-24_09:34:43
    if match := _WEEKDAY.match(text):
        text = text[match.end() :]
    for expression, pattern in _REWRITTEN:
        if match := expression.match(text):
            text = match.expand(pattern) + text[match.end() :]
    if form.has_time_apart:
        text = _SHORT_TIME.sub(lambda short: short[0].zfill(6), text)
    text = _COMPACT_TIME.sub(r"\1:\2:\3", text)
    for expression, date in _FORMS:
        if match := expression.match(text):
            parsed = date(match, form)
            rest = text[match.end() :].lstrip().removeprefix("T").removeprefix("t")
            return (text, form.order) if parsed is None else (f"{parsed[0]}T{rest}", parsed[1])
    return text, form.order


def full_year(digits: str) -> str:
    """Return a year of two digits with its century: 80 to 99 are 1980 to 1999."""
    return f"{'19' if int(digits) >= _FIRST_SHORT_YEAR else '20'}{digits}"


def _named(match: re.Match[str], _: DateForm) -> tuple[str, str]:
    month = _MONTHS.index(match["month"][:3].lower()) + 1
    return f"{match['year']}-{month}-{match['day']}", "ymd"


def _of_year(match: re.Match[str], _: DateForm) -> tuple[str, str] | None:
    year, day = int(match[1]), int(match[2])
    if not (1 <= day <= 366 and dt.MINYEAR <= year < dt.MAXYEAR):
        return None
    date = dt.date(year, 1, 1) + dt.timedelta(days=day - 1)
    return None if date.year != year else (date.isoformat(), "ymd")


def _compact(match: re.Match[str], form: DateForm) -> tuple[str, str] | None:
    """Return a date of eight digits, or of six where the order of year, month and day is declared."""
    digits = match[1]
    if len(digits) == 6 and not form.is_order_declared:
        return None
    year = len(digits) - 4
    parts, at = [], 0
    for part in form.order:
        length = year if part == "y" else 2
        parts.append(digits[at : at + length])
        at += length
    if year == 2:
        k = form.order.index("y")
        parts[k] = full_year(parts[k])
    return "-".join(parts), form.order


_DateOf = Callable[[re.Match[str], DateForm], tuple[str, str] | None]
_FORMS: Final[tuple[tuple[re.Pattern[str], _DateOf], ...]] = (
    *((pattern, _named) for pattern in _NAMED),
    (_COMPACT, _compact),
    (_DAY_OF_YEAR, _of_year),
)


_SHORTEST: Final = len("2025-08-28T17:30:22")  # pyarrow takes a date alone for its midnight
_FIRST_YEAR, _LAST_YEAR = 1969, 2261  # local dates of nanoseconds since 1970 in 64 bits
_DAY_DIGITS: Final = len(str(NS_PER_DAY - 1))
_UNIX_EPOCH: Final = dt.datetime(1970, 1, 1)
_ONE_DAY: Final = dt.timedelta(days=1)
_FRACTION: Final = (
    r"^(?P<before>(?:.*?[Tt\s:_]|\d{6})\d[\d:]*)(?:(?P<mark>[.,])(?P<fraction>\d+))?(?P<after>[^.,]*)$"
)
_COLON_MS: Final = r"(:\d\d:\d\d):(\d{3})([^\d:].*)?$"  # 17:30:22:961
_ZONE: Final = (
    r"([Tt\s:_]|\d{6})\d[\d:]*([.,]\d+)?\s*([AaPp][Mm])?\s*([Zz]|(UTC|GMT)(\s+\d{4})?|[+-]\d\d(:?\d\d)?)$"
)
_MOMENT: Final = re.compile(
    r"(\d+)([-/.:])(\d\d?)\2(\d+)(?:[Tt]|\s+)(?P<hour>\d\d?):(?P<minute>\d\d)(?::(?P<second>\d\d)[.,]?)?"
    r"\s*(?:(?P<half>[AaPp])[Mm])?\s*(?:[Zz]|UTC|GMT|(?P<east>[+-]\d\d):?(?P<minutes>\d\d)?)?",
    re.ASCII,
)
_LEAP_DAYS_S: Final = np.array([day for day, _ in LEAP_SECONDS], "datetime64[s]").astype(np.int64)
_LEAP_S: Final = np.array([0, *(seconds for _, seconds in LEAP_SECONDS)])


class _Moment(NamedTuple):
    """A date and time of day without the fraction of its second."""

    unix_s: int
    leap: bool = False  # the second after this one, 60
    readable: bool = True


_UNREADABLE: Final = _Moment(0, readable=False)


@dataclass(frozen=True)
class Calendar:
    """Columns of dates and times, and their meaning.

    The offset of a zone ("Z", "+02:00") is subtracted; the result is UTC or GPS time as ``scale`` says. Leap seconds
    are those in force at each cell, or ``leap_seconds`` for all.
    """

    times: tuple[str, ...]  # the column of times, or of dates with times; or of hours, minutes and seconds
    order: Literal["ymd", "dmy", "mdy"]
    scale: Literal["gps", "utc"]
    leap_seconds: int | None
    is_order_declared: bool = False  # years of two digits are read then
    # the column of dates, or of years, months and days, or of years and days of the year
    date_columns: tuple[str, ...] = ()
    date: dt.date | None = None  # of every row, where the one column holds times of day
    day_digits: int | None = (
        None  # a number in the column of times counts 10^digits ns of its day; None: undeclared
    )

    @property
    def columns(self) -> tuple[str, ...]:
        """All its columns, the dates' first."""
        return (*self.date_columns, *self.times)

    @property
    def has_time_apart(self) -> bool:
        """Whether the times of day stand in columns of their own."""
        return bool(self.date_columns) or self.date is not None

    def to_gps(self, parts: list[pa.Array]) -> tuple[Int64, Bool]:
        """Return GPS time [ns] of each cell, and which cells are dates with a time; fractions round half to even."""
        if self.day_digits is None or not self.has_time_apart:
            return self.text_to_gps(self.joined(parts))
        times = pc.ascii_trim_whitespace(parts[-1])
        # longer numbers are beyond a day: six digits may be hours, minutes and seconds
        is_count = pc.match_substring_regex(times, rf"^\d{{1,{_DAY_DIGITS - self.day_digits}}}([.,]\d*)?$")
        counts = pc.replace_substring(pc.if_else(is_count, times, "0"), ",", ".")
        after_ns, _ = integers(counts, self.day_digits, ".")
        midnights = pc.if_else(is_count, "00:00:00", times)
        t_ns, readable = self.text_to_gps(self.joined([*parts[:-1], midnights]))
        return t_ns + after_ns, readable & (after_ns < NS_PER_DAY)

    def text_to_gps(self, cells: pa.Array) -> tuple[Int64, Bool]:
        """Return the same of cells that hold both date and time."""
        parsed = _iso_8601(cells) if self.order == "ymd" else None
        unix_ns, leap, readable = _any_form(cells, self.form) if parsed is None else parsed
        unix_s = unix_ns // NS_PER_S
        readable &= unix_s >= 0
        shift_s = leap.astype(np.int64) - UNIX_TO_GPS_S
        if self.scale == "utc":
            by_date = _leap_seconds(unix_s)
            readable &= ~leap | (_leap_seconds(unix_s + 1) > by_date)
            shift_s += by_date if self.leap_seconds is None else self.leap_seconds
        else:
            readable &= ~leap
        return np.where(readable, unix_ns + shift_s * NS_PER_S, 0), readable

    @property
    def form(self) -> DateForm:
        """What the flight file declares about the text of a date."""
        return DateForm(self.order, self.is_order_declared, self.has_time_apart)

    def contradicting_cell(self, parts: list[pa.Array]) -> tuple[int, str] | None:
        """Return the first cell with a zone, which only UTC has, where GPS time is declared; None without one."""
        if self.scale == "utc" or not len(parts[0]):
            return None
        cells = self.joined(parts)
        place = pc.index(has_zone(cells), True).as_py()
        return None if place < 0 else (place, cells[place].as_py())

    def joined(self, parts: list[pa.Array]) -> pa.Array:
        """Return the cells of all columns, or of times after the date of all, as one column of strings."""
        stripped = [pc.ascii_trim_whitespace(part) for part in parts]
        n_date = len(self.date_columns)
        time = _of_parts(stripped[n_date:], ":")
        if self.date is not None:
            return _join([pa.scalar(f"{self.date}", time.type), time], "T")
        date = _of_parts(stripped[:n_date], "-") if n_date else time
        if n_date == 2:
            # a day of the year has three digits
            date = pc.replace_substring_regex(date, r"-(\d\d)$", r"-0\1")
        return _join([date, time], "T") if n_date else time


def _of_parts(parts: list[pa.Array], between: str) -> pa.Array:
    """Return one column, or numbers such as 9, 4 and 3.5 as 9:04:03.5."""
    if len(parts) == 1:
        return parts[0]
    numbers = [pc.replace_substring_regex(part, r"[.,]0*$", "") for part in parts]
    return pc.replace_substring_regex(_join(numbers, between), rf"{between}(\d)\b", rf"{between}0\1")


def _join(parts: list[pa.Array], between: str) -> pa.Array:
    return pc.binary_join_element_wise(*parts, pa.scalar(between, parts[-1].type))


def has_zone(cells: pa.Array) -> pa.Array:
    """Return whether each cell of dates and times ends in a zone: Z, UTC or an offset."""
    return pc.match_substring_regex(cells, _ZONE)


def _leap_seconds(unix_s: Int64) -> Int64:
    return np.asarray(_LEAP_S[np.searchsorted(_LEAP_DAYS_S, unix_s, side="right")])


def _iso_8601(cells: pa.Array) -> tuple[Int64, Bool, Bool] | None:
    """Return Unix time [ns] as pyarrow reads it, None when a cell is in a form that it does not know."""
    if not len(cells) or pc.min(pc.binary_length(cells)).as_py() < _SHORTEST:
        return None
    has_zone = not cells[0].as_py()[_SHORTEST:].strip(".0123456789") == ""
    try:
        times = cells.cast(pa.timestamp("ns", tz="UTC" if has_zone else None))
    except pa.ArrowInvalid:
        return None
    unix_ns = times.cast(pa.int64()).to_numpy(zero_copy_only=False)
    return unix_ns, np.zeros(len(cells), np.bool_), np.ones(len(cells), np.bool_)


def _any_form(cells: pa.Array, form: DateForm) -> tuple[Int64, Bool, Bool]:
    """Return Unix time [ns], which cells are leap seconds, and which can be read.

    The text around the fraction is the same for all cells of a second, and read once; the fraction is read for each.
    """
    parts = pc.extract_regex(pc.replace_substring_regex(cells, _COLON_MS, r"\1.\2\3"), _FRACTION)
    before, mark, fraction, after = (pc.fill_null(part, "") for part in parts.flatten())
    around = _join([before, mark, after], "").dictionary_encode()
    moments = [_moment(text, form) for text in around.dictionary.to_pylist()]
    values = np.array(moments or [_UNREADABLE], np.int64)[around.indices.to_numpy(zero_copy_only=False)]
    return values[:, 0] * NS_PER_S + _nanoseconds(fraction), values[:, 1] == 1, values[:, 2] == 1


def _moment(text: str, form: DateForm) -> _Moment:
    """Return what a date with its time and zone means."""
    order = form.order
    match = _MOMENT.fullmatch(text)
    if match is None:
        text, order = with_numbers(text, form)
        match = _MOMENT.fullmatch(text)
    if match is None:
        return _UNREADABLE
    date = dict(zip(order, (match[1], match[3], match[4]), strict=True))
    if len(date["y"]) == 2 and form.is_order_declared:
        date["y"] = full_year(date["y"])
    hour, second, minutes = int(match["hour"]), int(match["second"] or 0), int(match["minutes"] or 0)
    if (
        len(date["y"]) != 4
        or len(date["m"] + date["d"]) > 4
        or minutes > 59
        or (match["half"] and not 1 <= hour <= 12)
    ):
        return _UNREADABLE
    if match["half"]:
        hour = hour % 12 + (12 if match["half"] in "Pp" else 0)
    away = dt.timedelta(hours=abs(int(match["east"] or 0)), minutes=minutes)
    try:
        when = dt.datetime(
            int(date["y"]), int(date["m"]), int(date["d"]), hour, int(match["minute"]), min(second, 59)
        )
    except ValueError:
        return _UNREADABLE
    if not _FIRST_YEAR <= when.year <= _LAST_YEAR or abs(away) >= _ONE_DAY or second > 60:
        return _UNREADABLE
    utc = when + away if (match["east"] or "+")[0] == "-" else when - away
    return _Moment((utc - _UNIX_EPOCH) // dt.timedelta(seconds=1), second == 60)


def _nanoseconds(fraction: pa.Array) -> Int64:
    """Return digits behind the decimal mark as nanoseconds, rounded half to even."""
    digits = pc.ascii_rpad(pc.utf8_slice_codeunits(fraction, 0, 9), 9, "0")
    ns = digits.cast(pa.int64()).to_numpy(zero_copy_only=False)
    rest = pc.ascii_rtrim(pc.utf8_slice_codeunits(fraction, 9), "0")
    above, half = (compare(rest, "5").to_numpy(zero_copy_only=False) for compare in (pc.greater, pc.equal))
    return np.asarray(ns + (above | (half & (ns % 2 == 1))))
