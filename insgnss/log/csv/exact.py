"""The exact CSV path: every line is checked, every cell that is not a number is reported with file line and text.

It works on whole columns with Arrow's string functions, so that a log of a million rows with one bad cell still takes
seconds; only lines that differ from the rest are handled one by one.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from insgnss.errors import ColumnError, TimeError
from insgnss.log.csv.calendar import Calendar
from insgnss.log.csv.cell_advice import date_advice, number_advice
from insgnss.log.csv.cells import EMPTY_CELLS, floats, foreign_number, integers
from insgnss.log.csv.columns import ColumnSelection, CsvRows, text_column
from insgnss.log.csv.dialect import DELIMITER_NAMES, Dialect, decoded
from insgnss.log.first_events import first_events
from insgnss.tables import Bool, Event, Int64

MAX_BAD_SHARE: Final = 0.05  # more than this: the file is not what the flight file says it is
MAX_BAD_ROWS_SMALL_FILE: Final = 3  # so that one bad row in a file of ten is still only a bad row
_SEPARATOR: Final = "\x1f"  # parts the cells of lines whose quotes were taken off: no log holds it
_NOTHING: Final = r"^\s*($|#|%|//)"  # a line that is blank or a comment
_NO_NUMBER: Final = "not a finite number"
_CUT_LINES: Final = 20
_EXPONENT: Final = re.compile(rb"\d[eE][+-]?(\d+)")


@dataclass(frozen=True)
class _Complaint:
    """One refused row, or one unreadable optional cell."""

    line: int
    column: str | None
    reason: str


def last_line_is_cut(data: memoryview, delimiter: str) -> bool:
    """Return whether the file ends without a line end and with a line that lacks something the 20 before it have.

    It is shorter than each of them, its last cell is, or an exponent there has fewer digits than theirs. A recorder
    that lost power leaves such a line; its last number may lack digits, so the row cannot be trusted.
    """
    if bytes(data[-1:]) in (b"\r", b"\n"):
        return False
    tail = [line.strip() for line in bytes(data[-(1 << 16) :]).splitlines()]
    before = [line for line in tail[-_CUT_LINES - 2 : -1] if line][1:]
    if not before:
        return False
    if len(tail[-1]) < min(map(len, before)):
        return True
    parting = None if delimiter == " " else delimiter.encode()
    cell = _last_cell(tail[-1], parting)
    shortest = len(cell) < min(len(_last_cell(line, parting)) for line in before)
    return len(before) == _CUT_LINES and (shortest or _lacks_exponent_digits(cell, before))


def _last_cell(line: bytes, parting: bytes | None) -> bytes:
    return line.rsplit(parting, 1)[-1].strip()


def _lacks_exponent_digits(cell: bytes, before: list[bytes]) -> bool:
    """Return whether a cell's exponent has fewer digits than any in the lines before: ``e-0`` after ``e-05``."""
    own = _EXPONENT.search(cell)
    others = [len(found) for line in before for found in _EXPONENT.findall(line)]
    return own is not None and bool(others) and len(own[1]) < min(others)


def read_exact(
    buffer: pa.Buffer, path: Path, dialect: Dialect, places: dict[str, int], wanted: ColumnSelection
) -> CsvRows:
    """Read the wanted columns line by line.

    Raises
    ------
    ColumnError : numbers written in another way than declared, or more than 5 % of the rows are bad
    TimeError : dates have a zone, and GPS time is declared
    """
    data = _utf8(buffer)
    cut = last_line_is_cut(memoryview(data), dialect.delimiter)
    rows, lines, complaints = _split_lines(data, dialect, cut)
    strings = {name: pc.utf8_trim_whitespace(pc.list_element(rows, k)) for name, k in places.items()}
    measured = [name for name in wanted.measured if name in places]
    own = _rows_of_this_log(rows, [strings[name] for name in measured], set(places.values()))
    reader = _ColumnReader(path, dialect, lines[own], complaints, wanted.decimal)
    if not own.all():
        strings = {name: cells.filter(pa.array(own)) for name, cells in strings.items()}
        names = "', '".join(measured)
        left_out = f"{int((~own).sum())} of {len(own)} rows left out"
        detail = f"{path}: {left_out}: nothing in '{names}', but in columns of other logs"
        reader.rows.events.append(Event(None, "rows_of_other_logs", detail))
    if wanted.calendar is not None:
        reader.read_dates(wanted.calendar, [strings[name] for name in wanted.dates])
    for name, digits in wanted.exact.items():
        reader.read_integers(name, strings[name], digits)
    for name in wanted.numeric:
        reader.read_required(name, strings[name])
    for name in wanted.optional:
        if name in places:
            reader.read_optional(name, strings[name])
    reader.check_share()
    words = {name: strings[name] for name in (*wanted.text, *wanted.optional_text) if name in places}
    return reader.result(words)


def _rows_of_this_log(rows: pa.Array, measured: list[pa.Array], read: set[int]) -> Bool:
    """Return which rows are of this log; all are where none has a cell in the columns ``measured``.

    A recorder that writes several sensors into one file leaves the cells of the others empty. A row that is also
    empty in the columns that are not ``read`` lacks its own measurement.
    """
    own = np.ones(len(rows), np.bool_)
    others = set(range(len(rows[0]) if len(rows) else 0)) - read
    if not measured or not others:
        return own
    without = np.arange(len(rows))
    for cells in measured:
        without = without[_is_empty(cells)[without]]
        if not len(without):  # in most logs the first column shows that
            return own
    some = rows.take(pa.array(without))
    further = (_is_empty(pc.utf8_trim_whitespace(pc.list_element(some, k))) for k in others)
    own[without] = np.logical_and.reduce(list(further))
    return own if own.any() else ~own


def _is_empty(cells: pa.Array) -> Bool:
    empty: Bool = pc.is_in(cells, value_set=pa.array(EMPTY_CELLS, cells.type)).to_numpy(zero_copy_only=False)
    return empty


class _ColumnReader:
    """Turns columns of strings into numbers and collects unreadable cells."""

    def __init__(
        self, path: Path, dialect: Dialect, lines: Int64, complaints: list[_Complaint], decimal: str
    ) -> None:
        self.path = path
        self.dialect = dialect
        self.lines = lines
        self.decimal = decimal
        self.refused = complaints
        self.unreadable: dict[str, Bool] = {}
        self.advice: dict[str, str] = {}  # by column, what its first bad cell suggests
        self.good = np.ones(len(lines), np.bool_)
        self.rows = CsvRows()

    def read_dates(self, calendar: Calendar, parts: list[pa.Array]) -> None:
        self.rows.exact[calendar.columns[-1]], readable = calendar.to_gps(parts)
        name, advice = "' and '".join(calendar.columns), partial(date_advice, calendar=calendar)
        if (zoned := calendar.contradicting_cell(parts)) is not None:
            raise TimeError(
                f"'{_short(zoned[1])}' has a zone, and the flight file declares GPS time, which has none",
                file=self.path,
                line=int(self.lines[zoned[0]]),
                column=name,
                key="time.scale",
                advice="write scale = 'utc' in place of 'gps'; dates in GPS time are written without a zone",
            )
        self._refuse_rows(name, calendar.joined(parts), readable, "not a date and time", advice)

    def read_integers(self, name: str, cells: pa.Array, digits: int) -> None:
        self.rows.exact[name], readable = integers(cells, digits, self.decimal)
        self._refuse_rows(name, cells, readable)

    def read_required(self, name: str, cells: pa.Array) -> None:
        self.rows.columns[name], readable = floats(cells, self.decimal)
        self._refuse_rows(name, cells, readable)

    def read_optional(self, name: str, cells: pa.Array) -> None:
        self.rows.columns[name], readable = floats(cells, self.decimal)
        empty = _is_empty(cells)
        self.unreadable[name] = ~(readable | empty)
        bad = np.flatnonzero(self.unreadable[name])
        self._refuse_foreign_numbers(name, cells, bad, int((~empty).sum()))
        complaints = self._complaints(name, cells, bad, _NO_NUMBER)
        self.rows.events += _bad_events("bad_cell", self.path, complaints, "cell left empty")

    def _refuse_rows(
        self,
        name: str,
        cells: pa.Array,
        readable: Bool,
        fault: str = _NO_NUMBER,
        advice: Callable[[str], str] = number_advice,
    ) -> None:
        bad = np.flatnonzero(self.good & ~readable)
        if fault == _NO_NUMBER:
            self._refuse_foreign_numbers(name, cells, bad, len(cells))
        self.refused += self._complaints(name, cells, bad, fault)
        if len(bad):
            first = cells[int(bad[0])].as_py()
            foreign = foreign_number(first, self.decimal) if fault == _NO_NUMBER else None
            self.advice[name] = advice(first) if foreign is None else foreign[1]
        self.good &= readable

    def _complaints(
        self, name: str, cells: pa.Array, bad: npt.NDArray[np.intp], fault: str
    ) -> list[_Complaint]:
        texts = cells.take(pa.array(bad)).to_pylist()
        return [
            _Complaint(line, name, f"'{_short(cell)}' is {fault}" if cell else "empty cell")
            for line, cell in zip(self.lines[bad].tolist(), texts, strict=True)
        ]

    def _refuse_foreign_numbers(
        self, name: str, cells: pa.Array, bad: npt.NDArray[np.intp], filled: int
    ) -> None:
        """Raise when so many of a column's filled cells are such numbers that it is not damage of a few cells."""
        most = min(most_bad_rows(filled), filled / 2)
        if len(bad) <= most:
            return
        texts = cells.take(pa.array(bad)).to_pylist()
        foreign = (
            (i, found)
            for i, cell in zip(bad, texts, strict=True)
            if (found := foreign_number(cell, self.decimal)) is not None
        )
        seen = list(islice(foreign, int(most) + 1))
        if len(seen) > most:
            i, (message, advice) = seen[0]
            raise ColumnError(message, file=self.path, line=int(self.lines[i]), column=name, advice=advice)

    def check_share(self) -> None:
        """Raise when so many rows are bad that the file is something else than the flight file says."""
        total = len(self.lines) + sum(complaint.column is None for complaint in self.refused)
        if len(self.refused) <= most_bad_rows(total):
            return
        first = sorted(self.refused, key=lambda complaint: complaint.line)[:5]
        listed = "; ".join(
            f"line {c.line}" + (f" '{c.column}'" if c.column else "") + f": {c.reason}" for c in first
        )
        width, mark = len(self.dialect.columns), DELIMITER_NAMES[self.dialect.delimiter]
        of_lines = (
            f"line {self.dialect.header_line} has {width} columns parted by {mark}; look for decimal commas,"
            " a second header or another file's rows"
        )
        raise ColumnError(
            f"{len(self.refused)} of {total} rows cannot be read: {listed}",
            file=self.path,
            line=first[0].line,
            column=first[0].column,
            advice=self.advice.get(first[0].column or "", of_lines),
        )

    def result(self, text: dict[str, pa.Array]) -> CsvRows:
        """Return the good rows only."""
        keep = np.flatnonzero(self.good)
        rows = self.rows
        rows.n, rows.lines = len(keep), self.lines[keep]
        if len(keep) < len(self.good):
            rows.columns = {name: values[keep] for name, values in rows.columns.items()}
            rows.exact = {name: values[keep] for name, values in rows.exact.items()}
            text = {name: cells.take(pa.array(keep)) for name, cells in text.items()}
        for name, cells in text.items():
            rows.text[name] = text_column(cells.dictionary_encode())
        bad = {name: np.flatnonzero(found[keep]) for name, found in self.unreadable.items() if found.any()}
        rows.bad_cells = {name: found.astype(np.int64) for name, found in bad.items()}
        refused = sorted(self.refused, key=lambda complaint: complaint.line)
        rows.events = _bad_events("bad_row", self.path, refused, "row refused") + rows.events
        return rows


def _bad_events(kind: str, path: Path, complaints: list[_Complaint], outcome: str) -> list[Event]:
    def event(complaint: _Complaint) -> Event:
        place = f"{path}:{complaint.line}" + (f", column '{complaint.column}'" if complaint.column else "")
        return Event(None, kind, f"{place}: {complaint.reason}; {outcome}")

    return first_events(complaints, event, path, outcome)


def most_bad_rows(total: int) -> float:
    """Return how many of so many rows may be bad before the file is something else than declared."""
    return max(MAX_BAD_SHARE * total, MAX_BAD_ROWS_SMALL_FILE)


def _short(cell: str) -> str:
    return cell if len(cell) <= 40 else cell[:37] + "..."


def _utf8(buffer: pa.Buffer) -> bytes:
    data = bytes(buffer.to_pybytes()).removeprefix(codecs.BOM_UTF8)
    text, is_utf8 = decoded(data)
    return data if is_utf8 else text.encode()


def _lines(data: bytes) -> pa.Array:
    """Return the lines of a text without their ends, whichever they are."""
    data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = data if data.endswith(b"\n") else data + b"\n"
    ends = np.flatnonzero(np.frombuffer(data, np.uint8) == ord("\n")) + 1
    offsets = np.concatenate(([0], ends)).astype(np.int64)
    lines = pa.LargeStringArray.from_buffers(len(ends), pa.py_buffer(offsets), pa.py_buffer(data))
    return pc.ascii_rtrim(lines, "\n")


def _split_lines(data: bytes, dialect: Dialect, cut: bool) -> tuple[pa.Array, Int64, list[_Complaint]]:
    """Return the cells of each line of data, the file lines, and the lines with a wrong number of cells."""
    lines = _lines(data)
    filled = pc.invert(pc.match_substring_regex(lines, _NOTHING)).to_numpy(zero_copy_only=False)
    numbers = np.flatnonzero(filled) + 1
    numbers = numbers[numbers > dialect.skip]
    complaints = []
    if cut and len(numbers) and numbers[-1] == len(lines):
        complaints.append(_Complaint(len(lines), None, "the file ends in the middle of this line"))
        numbers = numbers[:-1]
    rows = _cells(lines.take(pa.array(numbers - 1)), dialect.delimiter)
    count = pc.list_value_length(rows).to_numpy(zero_copy_only=False)
    expected = len(dialect.columns)
    fits = count == expected
    longer = np.flatnonzero(count == expected + 1)
    last = pc.list_element(rows.take(pa.array(longer)), expected)
    fits[longer] = pc.match_substring_regex(last, r"^\s*$")  # a delimiter at the line's end
    complaints += [
        _Complaint(int(numbers[i]), None, f"{count[i]} cells where line {dialect.header_line} has {expected}")
        for i in np.flatnonzero(~fits)
    ]
    kept = np.flatnonzero(fits)
    return rows.take(pa.array(kept)), numbers[kept], complaints


def _cells(lines: pa.Array, delimiter: str) -> pa.Array:
    """Return each line as a list of its cells; quotes are taken off."""
    if delimiter == " ":
        return pc.ascii_split_whitespace(pc.ascii_trim_whitespace(lines))
    quoted = pc.match_substring(lines, '"')
    if not pc.any(quoted).as_py():
        return pc.split_pattern(lines, delimiter)
    parted = [
        _SEPARATOR.join(next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), []))
        for line in lines.filter(quoted).to_pylist()
    ]
    plain = pc.replace_substring(lines, delimiter, _SEPARATOR)
    return pc.split_pattern(pc.replace_with_mask(plain, quoted, pa.array(parted, lines.type)), _SEPARATOR)
