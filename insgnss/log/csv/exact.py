"""The exact CSV path: every line is checked, every cell that is not a number is reported with file line and text.

It works on whole columns with Arrow's string functions, so that a log of a million rows with one bad cell still takes
seconds; only lines that differ from the rest are handled one by one.
"""

from __future__ import annotations

import codecs
import csv
import re
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from insgnss.errors import ColumnError, TimeError
from insgnss.log.csv.calendar import Calendar
from insgnss.log.csv.cell_advice import date_advice, number_advice
from insgnss.log.csv.cells import EMPTY_CELLS, are_foreign, floats, foreign_advice, integers
from insgnss.log.csv.columns import ColumnSelection, CsvRows, text_column
from insgnss.log.csv.dialect import DELIMITER_NAMES, Dialect, decoded
from insgnss.log.events import counted, first_events
from insgnss.tables import Bool, Event, Float64, Int64

MAX_BAD_SHARE: Final = 0.05  # more than this: the file is not what the flight file says it is
MAX_BAD_ROWS_SMALL_FILE: Final = 3  # so that one bad row in a file of ten is still only a bad row
_SEPARATOR: Final = "\x1f"  # parts the cells of lines whose quotes were taken off: no log holds it
_NOTHING: Final = r"^\s*($|#|%|//)"  # a line that is blank or a comment
_NO_NUMBER: Final = "not a finite number"
_CUT_LINES: Final = 20
_EXPONENT: Final = re.compile(rb"\d[eE][+-]?(\d+)")


class _Complaint(NamedTuple):
    """One refused row, or one unreadable optional cell."""

    line: int
    column: str  # "": the whole line
    reason: str
    cell: str = ""


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
    *cells, last = (line.rsplit(parting, 1)[-1].strip() for line in (*before, tail[-1]))
    exponent = _EXPONENT.search(last)
    exponents = (len(digits) for line in before for digits in _EXPONENT.findall(line))
    lacks_digits = exponent is not None and len(exponent[1]) < min(exponents, default=0)  # e-0 after e-05
    return len(before) == _CUT_LINES and (len(last) < min(map(len, cells)) or lacks_digits)


def read_exact(
    buffer: pa.Buffer,
    path: Path,
    dialect: Dialect,
    places: dict[str, int],
    wanted: ColumnSelection,
    *,
    cut: bool,
) -> CsvRows:
    """Read the wanted columns line by line; the last line is left out where it is ``cut``.

    Raises
    ------
    ColumnError : numbers written in another way than declared, or more than 5 % of the rows are bad
    TimeError : dates have a zone, and GPS time is declared
    """
    data = bytes(buffer.to_pybytes()).removeprefix(codecs.BOM_UTF8)
    text, is_utf8 = decoded(data)
    rows, lines, refused = _split_lines(data if is_utf8 else text.encode(), dialect, cut)
    cells = {name: pc.utf8_trim_whitespace(pc.list_element(rows, k)) for name, k in places.items()}
    measured = [name for name in wanted.measured if name in places]
    others = set(range(len(dialect.columns))) - set(places.values())
    own = _rows_of_this_log(rows, [cells[name] for name in measured], others)
    if not own.all():
        cells = {name: column.filter(pa.array(own)) for name, column in cells.items()}
    names = "', '".join(measured)
    left_out = f"of {len(own)} rows left out: nothing in '{names}', but in columns of other logs"
    events = counted("rows_of_other_logs", ~own, left_out, path)
    reader = _ColumnReader(path, wanted, lines[own], refused)
    exact: dict[str, Int64] = {}
    if wanted.calendar is not None:
        exact[wanted.dates[-1]] = reader.dates(wanted.calendar, [cells[name] for name in wanted.dates])
    for name, digits in wanted.exact.items():
        exact[name], readable = integers(cells[name], digits, wanted.decimal)
        reader.refuse_rows(name, cells[name], readable)
    numbers: dict[str, Float64] = {}
    for name in (*wanted.numeric, *(name for name in wanted.optional if name in places)):
        numbers[name], readable = floats(cells[name], wanted.decimal)
        if name in wanted.numeric:
            reader.refuse_rows(name, cells[name], readable)
        else:
            reader.note_cells(name, cells[name], ~readable & ~_is_empty(cells[name]))
    reader.check_share(dialect)
    good = reader.good
    words = {name: cells[name].filter(pa.array(good)) for name in wanted.words if name in places}
    return CsvRows(
        int(good.sum()),
        {name: values[good] for name, values in numbers.items()},
        {name: values[good] for name, values in exact.items()},
        {name: text_column(column.dictionary_encode()) for name, column in words.items()},
        {name: np.flatnonzero(bad[good]) for name, bad in reader.bad_cells.items()},
        [*_bad_events("bad_row", path, sorted(refused), "row refused"), *events, *reader.events],
        reader.lines[good],
    )


def _rows_of_this_log(rows: pa.Array, measured: list[pa.Array], others: set[int]) -> Bool:
    """Return which rows are of this log; all are where none has a cell in the columns ``measured``.

    A recorder that writes several sensors into one file leaves the cells of the others empty. A row that is also
    empty in the ``others`` lacks its own measurement.
    """
    own = np.ones(len(rows), np.bool_)
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
    """Collects the rows and cells that cannot be read."""

    def __init__(self, path: Path, wanted: ColumnSelection, lines: Int64, refused: list[_Complaint]) -> None:
        self.path = path
        self.wanted = wanted
        self.lines = lines
        self.refused = refused
        self.good = np.ones(len(lines), np.bool_)
        self.bad_cells: dict[str, Bool] = {}  # of optional columns
        self.events: list[Event] = []

    def dates(self, calendar: Calendar, parts: list[pa.Array]) -> Int64:
        t_ns, readable = calendar.to_gps(parts)
        name = "' and '".join(calendar.columns)
        if (zoned := calendar.contradicting_cell(parts)) is not None:
            raise TimeError(
                f"'{_short(zoned[1])}' has a zone, and the flight file declares GPS time, which has none",
                file=self.path,
                line=int(self.lines[zoned[0]]),
                column=name,
                key="time.scale",
                advice="write scale = 'utc' in place of 'gps'; dates in GPS time are written without a zone",
            )
        self._refuse(name, calendar.joined(parts), readable, "not a date and time")
        return t_ns

    def refuse_rows(self, name: str, cells: pa.Array, readable: Bool) -> None:
        """Refuse rows whose required number cannot be read."""
        self._refuse_foreign_numbers(name, cells, self.good & ~readable, len(cells))
        self._refuse(name, cells, readable, _NO_NUMBER)

    def note_cells(self, name: str, cells: pa.Array, bad: Bool) -> None:
        """Note the cells of an optional column that are neither empty nor numbers."""
        if bad.any():
            self._refuse_foreign_numbers(name, cells, bad, int((~_is_empty(cells)).sum()))
            self.bad_cells[name] = bad
            complaints = self._complaints(name, cells, bad, _NO_NUMBER)
            self.events += _bad_events("bad_cell", self.path, complaints, "cell left empty")

    def _refuse(self, name: str, cells: pa.Array, readable: Bool, fault: str) -> None:
        self.refused += self._complaints(name, cells, self.good & ~readable, fault)
        self.good &= readable

    def _complaints(self, name: str, cells: pa.Array, bad: Bool, fault: str) -> list[_Complaint]:
        return [
            _Complaint(line, name, f"'{_short(cell)}' is {fault}" if cell else "empty cell", cell)
            for line, cell in zip(
                self.lines[bad].tolist(), cells.filter(pa.array(bad)).to_pylist(), strict=True
            )
        ]

    def _refuse_foreign_numbers(self, name: str, cells: pa.Array, bad: Bool, filled: int) -> None:
        """Raise when so many of a column's filled cells are such numbers that it is not damage of a few cells."""
        most = min(most_bad_rows(filled), filled / 2)
        if np.count_nonzero(bad) <= most:
            return
        foreign = np.flatnonzero(bad & are_foreign(cells, self.wanted.decimal))
        if len(foreign) > most:
            cell = cells[int(foreign[0])].as_py()
            message, advice = foreign_advice(cell, self.wanted.decimal)
            line = int(self.lines[foreign[0]])
            raise ColumnError(message, file=self.path, line=line, column=name, advice=advice)

    def check_share(self, dialect: Dialect) -> None:
        """Raise when so many rows are bad that the file is something else than the flight file says."""
        total = len(self.lines) + sum(not complaint.column for complaint in self.refused)
        if len(self.refused) <= most_bad_rows(total):
            return
        first = sorted(self.refused)[:5]
        listed = "; ".join(
            f"line {c.line}" + (f" '{c.column}'" if c.column else "") + f": {c.reason}" for c in first
        )
        raise ColumnError(
            f"{len(self.refused)} of {total} rows cannot be read: {listed}",
            file=self.path,
            line=first[0].line,
            column=first[0].column or None,
            advice=self._advice(first[0], dialect),
        )

    def _advice(self, complaint: _Complaint, dialect: Dialect) -> str:
        calendar = self.wanted.calendar
        if not complaint.column:
            width, mark = len(dialect.columns), DELIMITER_NAMES[dialect.delimiter]
            return (
                f"line {dialect.header_line} has {width} columns separated by {mark}; look for decimal commas,"
                " a second header or another file's rows"
            )
        if calendar is not None and complaint.column == "' and '".join(calendar.columns):
            return date_advice(complaint.cell, calendar)
        return number_advice(complaint.cell, self.wanted.decimal)


def _bad_events(kind: str, path: Path, complaints: list[_Complaint], outcome: str) -> list[Event]:
    columns = {name: f", column '{name}'" if name else "" for _, name, _, _ in complaints}
    details = (f"{path}:{line}{columns[name]}: {reason}; {outcome}" for line, name, reason, _ in complaints)
    return first_events(kind, details, path, outcome)


def most_bad_rows(total: int) -> float:
    """Return how many of so many rows may be bad before the file is something else than declared."""
    return max(MAX_BAD_SHARE * total, MAX_BAD_ROWS_SMALL_FILE)


def _short(cell: str) -> str:
    return cell if len(cell) <= 40 else cell[:37] + "..."


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
    refused = []
    if cut and len(numbers) and numbers[-1] == len(lines):
        refused.append(_Complaint(len(lines), "", "the file ends in the middle of this line"))
        numbers = numbers[:-1]
    rows = _cells(lines.take(pa.array(numbers - 1)), dialect.delimiter)
    count = pc.list_value_length(rows).to_numpy(zero_copy_only=False)
    expected = len(dialect.columns)
    fits = count == expected
    longer = np.flatnonzero(count == expected + 1)
    last = pc.list_element(rows.take(pa.array(longer)), expected)
    fits[longer] = pc.match_substring_regex(last, r"^\s*$")  # a delimiter at the line's end
    refused += [
        _Complaint(int(numbers[i]), "", f"{count[i]} cells where line {dialect.header_line} has {expected}")
        for i in np.flatnonzero(~fits)
    ]
    fitting = np.flatnonzero(fits)
    return rows.take(pa.array(fitting)), numbers[fitting], refused


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
