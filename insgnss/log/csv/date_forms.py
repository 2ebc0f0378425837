"""Dates with names of months, days of the year or digits alone, written as year, month and day with marks between."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable
from typing import Final, NamedTuple

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
