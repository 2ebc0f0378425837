"""The exact CSV path: every line looked at, every cell that is no number reported with its file line and text.

It works on whole columns with Arrow's string functions, so that a log of a million rows with one bad cell still takes
seconds; only lines that differ from the rest are handled one by one.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from insgnss.errors import ColumnError
from insgnss.log.csv_columns import EMPTY_CELLS, Wanted
from insgnss.log.csv_dialect import DELIMITER_NAMES, Dialect, decoded
from insgnss.log.first_events import first_events
from insgnss.tables import Event, Float64, Int64

Bool = npt.NDArray[np.bool_]

MAX_BAD_SHARE: Final = 0.05  # more than this: the file is not what the flight file says it is
MAX_BAD_ROWS_SMALL_FILE: Final = 3  # so that one bad row in a file of ten is still only a bad row
NUMBER: Final = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_THOUSANDS: Final = re.compile(r"[+-]?\d{1,3}([,' \u00a0\u202f_]\d{3})+(\.\d*)?")
_SEPARATOR: Final = b"\x1f"  # the delimiter inside: a character that no log holds
_COMMENTS: Final = (b"#", b"%", b"//")
_CUT_LINES: Final = 20
_EXPONENT: Final = re.compile(rb"\d[eE][+-]?(\d+)")
_INT64_MAX: Final = Decimal(2**63 - 1)


@dataclass(frozen=True)
class ExactRows:
    """The good rows of a file, and an event for each refused row or unreadable cell."""

    lines: Int64
    columns: dict[str, Float64]
    exact: dict[str, Int64]
    text: dict[str, tuple[npt.NDArray[np.int32], list[str]]]
    bad_cells: dict[str, Int64]
    events: list[Event]


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
    buffer: pa.Buffer, path: Path, dialect: Dialect, places: dict[str, int], wanted: Wanted
) -> ExactRows:
    """Read the wanted columns line by line.

    Raises
    ------
    ColumnError : decimal commas or thousands separators, or more than 5 % of the rows are bad
    """
    rows, lines, complaints = _split_lines(_utf8(buffer), dialect)
    strings = _string_columns(rows, len(dialect.columns), places)
    reader = _ColumnReader(path, lines, complaints)
    for name, digits in wanted.exact.items():
        reader.read_integers(name, strings[name], digits)
    for name in wanted.numeric:
        reader.read_required(name, strings[name])
    for name in wanted.optional:
        if name in places:
            reader.read_optional(name, strings[name])
    reader.check_share(dialect)
    return reader.result(
        {name: strings[name] for name in (*wanted.text, *wanted.optional_text) if name in places}
    )


class _ColumnReader:
    """Turns columns of strings into numbers and collects what cannot be read."""

    def __init__(self, path: Path, lines: Int64, complaints: list[_Complaint]) -> None:
        self.path = path
        self.lines = lines
        self.refused = complaints
        self.unreadable: dict[str, Bool] = {}
        self.good = np.ones(len(lines), np.bool_)
        self.columns: dict[str, Float64] = {}
        self.exact: dict[str, Int64] = {}
        self.events: list[Event] = []

    def read_required(self, name: str, cells: pa.Array) -> None:
        self.columns[name], readable = _floats(cells)
        self._refuse_rows(name, cells, readable)

    def read_integers(self, name: str, cells: pa.Array, digits: int) -> None:
        self.exact[name], readable = _integers(cells, digits)
        self._refuse_rows(name, cells, readable)

    def read_optional(self, name: str, cells: pa.Array) -> None:
        self.columns[name], readable = _floats(cells)
        empty = pc.is_in(cells, value_set=pa.array(EMPTY_CELLS)).to_numpy(zero_copy_only=False)
        self.unreadable[name] = ~(readable | empty)
        bad = np.flatnonzero(self.unreadable[name])
        self._refuse_foreign_numbers(name, cells, bad)
        complaints = [_Complaint(int(self.lines[i]), name, _reason(cells[int(i)].as_py())) for i in bad]
        self.events += _bad_events("bad_cell", self.path, complaints, "cell left empty")

    def _refuse_rows(self, name: str, cells: pa.Array, readable: Bool) -> None:
        bad = np.flatnonzero(self.good & ~readable)
        self._refuse_foreign_numbers(name, cells, bad)
        self.refused += [_Complaint(int(self.lines[i]), name, _reason(cells[int(i)].as_py())) for i in bad]
        self.good &= readable

    def _refuse_foreign_numbers(self, name: str, cells: pa.Array, bad: npt.NDArray[np.intp]) -> None:
        for i in bad[:1000]:
            cell = cells[int(i)].as_py()
            if _DECIMAL_COMMA.fullmatch(cell) or _THOUSANDS.fullmatch(cell):
                raise ColumnError(
                    f"'{cell}' holds a decimal comma or a thousands separator",
                    file=self.path,
                    line=int(self.lines[i]),
                    column=name,
                    advice="write the file with a decimal point and without thousands separators",
                )

    def check_share(self, dialect: Dialect) -> None:
        """Raise when so many rows are bad that the file is something else than the flight file says."""
        total = len(self.lines) + sum(complaint.column is None for complaint in self.refused)
        if len(self.refused) <= max(MAX_BAD_SHARE * total, MAX_BAD_ROWS_SMALL_FILE):
            return
        first = sorted(self.refused, key=lambda complaint: complaint.line)[:5]
        listed = "; ".join(
            f"line {c.line}" + (f" '{c.column}'" if c.column else "") + f": {c.reason}" for c in first
        )
        raise ColumnError(
            f"{len(self.refused)} of {total} rows cannot be read: {listed}",
            file=self.path,
            line=first[0].line,
            column=first[0].column,
            advice=f"the header names {len(dialect.columns)} columns parted by {DELIMITER_NAMES[dialect.delimiter]};"
            " look for decimal commas, thousands separators, a second header or another file's rows",
        )

    def result(self, text: dict[str, pa.Array]) -> ExactRows:
        """Return the good rows only."""
        keep = np.flatnonzero(self.good)
        everything = len(keep) == len(self.good)
        words = {}
        for name, cells in text.items():
            encoded = (cells if everything else cells.take(pa.array(keep))).dictionary_encode()
            words[name] = (
                np.asarray(encoded.indices.to_numpy(zero_copy_only=False)),
                encoded.dictionary.to_pylist(),
            )
        refused = sorted(self.refused, key=lambda complaint: complaint.line)
        return ExactRows(
            self.lines[keep],
            {name: values if everything else values[keep] for name, values in self.columns.items()},
            {name: values if everything else values[keep] for name, values in self.exact.items()},
            words,
            {
                name: np.flatnonzero(bad[keep]).astype(np.int64)
                for name, bad in self.unreadable.items()
                if bad.any()
            },
            _bad_events("bad_row", self.path, refused, "row refused") + self.events,
        )


def _bad_events(kind: str, path: Path, complaints: list[_Complaint], outcome: str) -> list[Event]:
    def event(complaint: _Complaint) -> Event:
        place = f"{path}:{complaint.line}" + (f", column '{complaint.column}'" if complaint.column else "")
        return Event(None, kind, f"{place}: {complaint.reason}; {outcome}")

    return first_events(complaints, event, path, outcome)


def _reason(cell: str) -> str:
    if not cell:
        return "empty cell"
    shown = cell if len(cell) <= 40 else cell[:37] + "..."
    return f"'{shown}' is not a finite number"


def _utf8(buffer: pa.Buffer) -> bytes:
    data = bytes(buffer.to_pybytes())
    text, is_utf8 = decoded(data)
    return data if is_utf8 else text.encode()


def _split_lines(data: bytes, dialect: Dialect) -> tuple[list[bytes], Int64, list[_Complaint]]:
    """Return the data lines with unified delimiters, their file lines, and the lines with a wrong number of cells."""
    rows: list[bytes] = []
    numbers: list[int] = []
    complaints: list[_Complaint] = []
    expected = len(dialect.columns)
    raw = data.splitlines()
    cut = len(raw) if last_line_is_cut(memoryview(data), dialect.delimiter) else 0
    for number, line in enumerate(raw[dialect.skip :], start=dialect.skip + 1):
        if not line.strip() or line.lstrip().startswith(_COMMENTS):
            continue
        cells = _unify_delimiters(line, dialect.delimiter)
        count = cells.count(_SEPARATOR) + 1
        if count == expected + 1 and not cells[cells.rindex(_SEPARATOR) + 1 :].strip():
            cells, count = cells[: cells.rindex(_SEPARATOR)], expected  # a delimiter at the line's end
        if number == cut:
            complaints.append(_Complaint(number, None, "the file ends in the middle of this line"))
        elif count != expected:
            complaints.append(_Complaint(number, None, f"{count} cells where the header names {expected}"))
        else:
            rows.append(cells)
            numbers.append(number)
    return rows, np.array(numbers, dtype=np.int64), complaints


def _unify_delimiters(line: bytes, delimiter: str) -> bytes:
    if delimiter == " ":
        return _SEPARATOR.join(line.split())
    if b'"' in line:
        cells = next(csv.reader([line.decode()], delimiter=delimiter, skipinitialspace=True), [])
        return _SEPARATOR.join(cell.encode() for cell in cells)
    return line.replace(delimiter.encode(), _SEPARATOR)


def _string_columns(rows: list[bytes], width: int, places: dict[str, int]) -> dict[str, pa.Array]:
    """Return the wanted columns as strings without white space around them."""
    if not rows:
        return {name: pa.array([], pa.string()) for name in places}
    names = [str(place) for place in range(width)]
    table = pyarrow.csv.read_csv(
        pa.BufferReader(b"\n".join(rows) + b"\n"),
        read_options=pyarrow.csv.ReadOptions(column_names=names, use_threads=False),
        parse_options=pyarrow.csv.ParseOptions(
            delimiter=_SEPARATOR.decode(), quote_char=False, double_quote=False, ignore_empty_lines=False
        ),
        convert_options=pyarrow.csv.ConvertOptions(
            include_columns=[str(place) for place in places.values()],
            column_types={str(place): pa.large_string() for place in places.values()},
            strings_can_be_null=False,
        ),
    )
    return {
        name: pc.utf8_trim_whitespace(table.column(str(p)).combine_chunks()).cast(pa.string())
        for name, p in places.items()
    }


def _floats(cells: pa.Array) -> tuple[Float64, Bool]:
    """Return the cells as floats (NaN where unreadable) and which are finite numbers."""
    is_number = pc.match_substring_regex(cells, NUMBER)
    plain = pc.utf8_ltrim(pc.if_else(is_number, cells, None), characters="+")
    values = np.array(plain.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)
    finite = np.isfinite(values)
    values[~finite] = np.nan
    return values, finite


def _integers(cells: pa.Array, digits: int) -> tuple[Int64, Bool]:
    """Return the cells in units of 10^-digits, rounded half to even, and which are numbers that fit."""
    values = np.zeros(len(cells), np.int64)
    readable = pc.match_substring_regex(cells, NUMBER).to_numpy(zero_copy_only=False)
    for i in np.flatnonzero(readable):
        try:
            scaled = Decimal(cells[int(i)].as_py()).scaleb(digits).to_integral_value(ROUND_HALF_EVEN)
        except ArithmeticError:  # an exponent beyond any date
            readable[i] = False
            continue
        readable[i] = abs(scaled) <= _INT64_MAX
        values[i] = int(scaled) if readable[i] else 0
    return values, readable
