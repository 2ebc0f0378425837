"""Advice for cells that are not the numbers, dates or times that the flight file declares."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import replace
from typing import Final, Literal

import pyarrow as pa

from insgnss.gpstime import ns_to_datetime
from insgnss.log.csv.calendar import Calendar
from insgnss.log.csv.cells import NUMBER, are_foreign, foreign_advice

_Order = Literal["ymd", "dmy", "mdy"]
_ORDERS: Final[tuple[_Order, ...]] = ("ymd", "dmy", "mdy")
_EXAMPLES: Final = {"ymd": "2025-08-28", "dmy": "28.08.2025", "mdy": "08/28/2025"}
_TABLES: Final = "[imu.time], [gnss.time] or [reference.time]"
_MINUS_SIGNS: Final = "\u2212\u2013\ufe63\uff0d"
_DATE: Final = re.compile(r"\d{1,4}([-/.])\d{1,2}\1\d{1,4}")
_CLOCK: Final = re.compile(r"(?:.*[Tt\s])?\d\d?:\d\d")
_EIGHT_DIGITS: Final = re.compile(r"\d{8}")
_SERIAL_DAYS: Final = re.compile(r"[2-6]\d{4}([.,]\d*)?(?=T|$)")  # 20000 is in 1954, 69999 in 2091


def number_advice(cell: str, decimal: str) -> str:
    """Return the advice for a column of numbers that holds cells like this one."""
    if are_foreign(pa.array([cell]), decimal)[0]:
        return foreign_advice(cell, decimal)[1]
    orders = _dates_by_order(cell, Calendar(("time",), "ymd", "gps", None))
    if orders or (_DATE.match(cell) and _CLOCK.match(cell)):
        order = "" if "ymd" in orders or not orders else f", date_order = '{next(iter(orders))}'"
        return (
            f"these are dates: write origin = 'calendar'{order} and scale = 'utc' (or 'gps') under {_TABLES}"
        )
    if _CLOCK.match(cell):
        return (
            "these are times of day: name the column of their dates as columns.date, or write their date as time.date,"
            " with time.origin = 'calendar'"
        )
    if _is_date_alone(cell):
        return "these are dates: name this column as columns.date, that of the times of day as columns.time"
    plain = "".join(_plain_letter(letter) for letter in cell)
    if plain != cell and re.match(NUMBER, plain):
        return f"write numbers with the digits 0 to 9 and the hyphen as minus sign: {plain}"
    return "check under 'columns' in the flight file which column holds what"


def _plain_letter(letter: str) -> str:
    """Return the ASCII form of a digit or minus sign of another script or of typography, others as they are."""
    if letter in _MINUS_SIGNS:
        return "-"
    value = unicodedata.digit(letter, None)
    return letter if value is None else str(value)


def date_advice(cell: str, calendar: Calendar) -> str:
    """Return the advice for a column of dates and times, or two joined by T, that holds cells like this one."""
    if orders := _dates_by_order(cell, calendar):
        meanings = ", ".join(f"'{order}' if this is {date}" for order, date in orders.items())
        return f"write time.date_order under {_TABLES}: {meanings}"
    for digits, unit in ((9, "s"), (6, "ms")):
        if calendar.day_digits is None and _dates_by_order(cell, replace(calendar, day_digits=digits)):
            return f"for a count since midnight write time.unit = '{unit}' under {_TABLES} (s, ms, us or ns)"
    if calendar.day_digits is not None and _dates_by_order(cell, replace(calendar, day_digits=None)):
        return f"leave time.unit out under {_TABLES}: these are hours, minutes and seconds, not a count since midnight"
    if _SERIAL_DAYS.match(cell):
        return (
            "a spreadsheet stores dates as days since 1899-12-30, as 45924.399 for 2025-09-24 09:34: such numbers are"
            " not read; let it write the column as yyyy-mm-dd hh:mm:ss.000. For seconds declare time.origin"
            " ('gps_week', 'gps_epoch' or 'unix_epoch') instead of 'calendar'"
        )
    if re.match(NUMBER, cell) and not _is_date_alone(cell):
        return (
            "these are numbers, not dates: declare time.unit and time.origin ('gps_week', 'gps_epoch' or 'unix_epoch')"
            " instead of origin = 'calendar'"
        )
    if not calendar.has_time_apart and _is_date_alone(cell):
        return (
            "the cell has no time of day: name this column as columns.date, that of the times as columns.time"
        )
    if _CLOCK.match(cell) and not _DATE.match(cell) and cell[0].isdigit() and not calendar.has_time_apart:
        return f"the cell has no date: name the column of dates as columns.date, or write time.date under {_TABLES}"
    return (
        f"time.date_order = '{calendar.order}' reads {_EXAMPLES[calendar.order]} 17:30:22.961, with T or a space"
        " between them, and a zone (Z, +02:00) after them; the orders are 'ymd', 'dmy' and 'mdy'. Every order also"
        " reads 28-Aug-2025 (English names) and 2025:240 (day of the year). The year has four digits, or two where"
        " date_order is written"
    )


def _dates_by_order(cell: str, calendar: Calendar) -> dict[str, str]:
    """Return what a cell means in each order of year, month and day that reads it."""
    dates = {}
    parts = (
        cell.rsplit("T", 1) if calendar.date_columns else [cell.rpartition("T")[2] if calendar.date else cell]
    )
    in_one = replace(calendar, times=("time",), date_columns=("date",) if calendar.date_columns else ())
    for order in _ORDERS if calendar.date is None else _ORDERS[:1]:
        declared = replace(in_one, order=order, is_order_declared=True)
        t_ns, readable = declared.to_gps([pa.array([part]) for part in parts])
        if readable[0]:
            dates[str(order)] = f"{ns_to_datetime(int(t_ns[0])):%Y-%m-%d}"
    return dates


def _is_date_alone(cell: str) -> bool:
    """Return whether a cell is a date without a time of day; six digits may be any number."""
    if re.match(NUMBER, cell) and not _EIGHT_DIGITS.fullmatch(cell):
        return False
    return bool(_dates_by_order(f"{cell}T00:00:00", Calendar(("time",), "ymd", "gps", None)))
