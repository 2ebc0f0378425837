"""The lines of an Android GnssLogger file by kind, each kind with the columns that its own header line names.

A file holds lines of several kinds in the order in which they came: "Raw,..." (measurements), "UncalAccel,...",
"UncalGyro,...", "Fix,..." and others. A comment line "# Raw,utcTimeMillis,TimeNanos,..." names the columns of a kind;
they differ between versions of the application. Tables made of such files begin with "MessageType,..." instead, or
hold "Raw" lines alone, without the kind at their beginning.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from insgnss.constants import NS_PER_MS
from insgnss.gpstime import UNIX_TO_GPS_S, unix_to_gps_ns
from insgnss.log.events import counted
from insgnss.tables import Bool, Event, Float64, Int64

_HEADER: Final = re.compile(r"#\s*(\w+)\s*,(.*)")
# In a header that has lost the mark of its comment
_NAMES_IN_IT: Final = re.compile(r"[,\s](TimeNanos|utcTimeMillis)\b")
_TABLE_HEADER: Final = "MessageType,"
# The first line of a table of "Raw" lines alone
RAW_TABLE: Final = re.compile(
    r"(?!#|Raw,|MessageType,)(?=.*\bTimeNanos\b)(?=.*\bFullBiasNanos\b).*", re.IGNORECASE
)
_KIND: Final = re.compile(r"[A-Za-z]\w*")
_INTEGER: Final = r"^-?\d{1,18}$|^-?[1-8]\d{18}$"
_WHOLE: Final = r"^(-?\d{1,18})\.0*$"  # as a table writes integers beside empty cells
_SCIENTIFIC: Final = r"^-?\d\.?\d*[eE]\+?\d{1,2}$"
_DECIMAL: Final = r"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?$"
_LEAST_DIGITS: Final = 15  # what a spreadsheet keeps; of nanoseconds since 1980 the rest is 5 microseconds
_BEYOND_INT64: Final = 9 * 10**18


@dataclass
class AndroidLines:
    """The lines of one kind."""

    columns: tuple[str, ...] = ()
    texts: list[str] = field(default_factory=list)


def lines_by_kind(text: str) -> dict[str, AndroidLines]:
    """Return the data lines of each kind that a header line describes, and those of other kinds without columns."""
    table = RAW_TABLE.match(text)
    if table is not None:
        rows = text[table.end() :].splitlines()
        return {"Raw": AndroidLines(_names(table[0]), [f"Raw,{row}" for row in rows if row])}
    kinds: dict[str, AndroidLines] = {}
    of_all: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("#"):
            match = _HEADER.match(line)
            if match is not None and "," in match[2]:
                kinds.setdefault(match[1], AndroidLines()).columns = _names(match[2])
            continue
        kind, comma, rest = line.partition(",")
        if number == 1 and line.startswith(_TABLE_HEADER):
            of_all = _names(rest)
            continue
        of_kind = kinds.get(kind)
        if of_kind is None:
            if not comma or not _KIND.fullmatch(kind):
                continue
            of_kind = kinds[kind] = AndroidLines()
            if _NAMES_IN_IT.search(line):
                of_kind.columns = _names(rest)
                continue
        of_kind.texts.append(line)
    for of_kind in kinds.values():
        of_kind.columns = of_kind.columns or of_all
    return kinds


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(","))


@dataclass(frozen=True)
class AndroidCells:
    """The cells of one kind of line as text, and how many lines did not have as many cells as the others."""

    columns: dict[str, Any]  # name in lower case -> pyarrow array of strings
    n: int
    refused: int
    # columns used several times
    _parsed: dict[tuple[str, str], tuple[Any, Any]] = field(default_factory=dict)

    def has(self, name: str) -> bool:
        """Return whether the file has a column of this name, in capitals or not."""
        return name.lower() in self.columns

    def integers(self, name: str) -> tuple[Int64, Bool]:
        """Return a column as integers, exact to the last digit, and where there is one; zero elsewhere."""
        return self._numbers(name, _INTEGER, pa.int64(), 0)

    def rounded(self, name: str) -> tuple[Int64, Bool, Bool]:
        """Return a column as ``integers`` does, with the cells that a table has cut to 15 digits or more; and those."""
        values, present = self.integers(name)
        if present.all() or not self.has(name):
            return values, present, np.zeros(self.n, np.bool_)
        values, cut = values.copy(), ~present
        texts = self.texts(name)
        numbers = {text: _cut_number(text.strip()) for text in {texts[k] for k in np.flatnonzero(cut)}}
        for k in np.flatnonzero(cut):
            number = numbers[texts[k]]
            cut[k], values[k] = number is not None, number or 0
        return values, present | cut, cut

    def decimals(self, name: str) -> Float64:
        """Return a column as floats, NaN where the cell is empty or no number."""
        values, present = self._numbers(name, _DECIMAL, pa.float64(), 0.0)
        return np.where(present & np.isfinite(values), values, np.nan)

    def gps_times(self, *names: str) -> tuple[Int64, Bool]:
        """Return the GPS time [ns] of a column of Unix milliseconds, and where it is a date; zero elsewhere.

        Of several ``names`` the first counts that the file has.
        """
        unix_ms, given = self.integers(next(filter(self.has, names), names[0]))
        given &= (unix_ms > UNIX_TO_GPS_S * 1000) & (unix_ms < 10 * UNIX_TO_GPS_S * 1000)
        t_ns = np.zeros(self.n, np.int64)
        t_ns[given] = unix_to_gps_ns(unix_ms[given] * NS_PER_MS)
        return t_ns, given

    def texts(self, name: str) -> list[str]:
        """Return a column as text, empty where the file has no such column."""
        column = self.columns.get(name.lower())
        return [""] * self.n if column is None else ["" if x is None else str(x) for x in column.to_pylist()]

    def _numbers(self, name: str, pattern: str, kind: Any, missing: float) -> tuple[Any, Any]:
        column = self.columns.get(name.lower())
        if column is None:
            return np.full(self.n, missing, kind.to_pandas_dtype()), np.zeros(self.n, np.bool_)
        key = (name, pattern)
        if key not in self._parsed:
            trimmed = pc.utf8_trim_whitespace(column)
            readable = pc.fill_null(pc.match_substring_regex(trimmed, pattern), False)
            if pattern == _INTEGER and not pc.all(readable).as_py():
                trimmed = _written_out(trimmed)
                readable = pc.fill_null(pc.match_substring_regex(trimmed, pattern), False)
            chosen = pc.if_else(readable, trimmed, pa.scalar(str(missing), pa.string()))
            self._parsed[key] = (pc.cast(chosen, kind).to_numpy(), readable.to_numpy(zero_copy_only=False))
        values, present = self._parsed[key]
        return values, present.copy()  # the caller narrows it down


def _cut_number(text: str) -> int | None:
    """Return an integer that is written in scientific notation or with decimals, None where it has lost too much."""
    if re.fullmatch(_DECIMAL, text, re.ASCII) is None:
        return None
    number = Decimal(text)
    if len(number.as_tuple().digits) < _LEAST_DIGITS or abs(number) >= _BEYOND_INT64:
        return None
    return int(number)


def _written_out(cells: Any) -> Any:
    """Return cells such as 123.0 and 1.2345E+4 as 123 and 12345.

    A column in scientific notation whose numbers all end before the unit, as 1.23E+14, has lost digits and stays.
    """
    scientific = pc.fill_null(pc.match_substring_regex(cells, _SCIENTIFIC), False)
    numbers = [Decimal(text) for text in cells.filter(scientific).to_pylist()]
    if any(number.adjusted() < len(number.as_tuple().digits) for number in numbers):
        texts = pa.array([f"{number:f}" for number in numbers], cells.type)
        cells = pc.replace_with_mask(cells, scientific, texts)
    return pc.replace_substring_regex(cells, _WHOLE, r"\1")


def cells(lines: AndroidLines) -> AndroidCells:
    """Return the lines' cells by column; a line with too few or too many cells is refused and counted.

    Some writers leave out the last columns that their header names, or add cells without a name: what most lines have
    counts. A name that appears twice in the header is one column, its first cell that is not empty.
    """
    if not lines.texts or not lines.columns:
        return AndroidCells({}, 0, len(lines.texts))
    names = ["", *(name.lower() for name in lines.columns)]
    table, refused = _table(lines.texts, len(names))
    if 2 * refused > len(lines.texts):
        usual = Counter(text.count(",") + 1 for text in lines.texts).most_common(1)[0][0]
        if usual > 1:
            table, refused = _table(lines.texts, usual)
    columns: dict[str, Any] = {}
    for name, column in zip(names, table.columns, strict=False):
        column = column.combine_chunks()
        first = columns.get(name)
        columns[name] = (
            column if first is None else pc.if_else(pc.equal(pc.utf8_length(first), 0), column, first)
        )
    return AndroidCells(columns, table.num_rows, refused)


def _table(texts: list[str], width: int) -> tuple[Any, int]:
    """Return the lines of ``width`` cells as a table of text, and how many have another number."""
    refused: list[int] = []

    def refuse(_: Any) -> str:
        refused.append(1)
        return "skip"

    numbers = [str(k) for k in range(width)]
    table = csv.read_csv(
        io.BytesIO("\n".join(texts).encode("utf-8", "replace")),
        read_options=csv.ReadOptions(column_names=numbers),
        parse_options=csv.ParseOptions(quote_char=False, invalid_row_handler=refuse),
        convert_options=csv.ConvertOptions(column_types=dict.fromkeys(numbers, pa.string())),
    )
    return table, len(refused)


def refused_lines(kind: str, table: AndroidCells) -> list[Event]:
    """Return the event of the lines that ``cells`` refused, none where there were none."""
    return counted("bad_row", table.refused, f"{kind} line(s) with a wrong number of cells refused")
