"""One reader for every numeric CSV file: fast where the file is clean, exact about each bad cell where it is not.

The fast path hands the file to Arrow's reader, piece by piece (``csv_fast``). Whenever that one objects, or a required
cell is not a finite number, the file is read again line by line (``csv_exact``), so that each bad row is reported with
its file line, column and text and none is dropped silently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from insgnss.errors import InputError
from insgnss.log.csv_columns import Wanted, column_places
from insgnss.log.csv_dialect import DELIMITER_NAMES, FALLBACK_ENCODING, Dialect, detect_dialect
from insgnss.log.csv_exact import ExactRows, last_line_is_cut, read_exact
from insgnss.log.csv_fast import read_fast
from insgnss.log.files import byte_stream, file_buffer
from insgnss.tables import Event, Float64, Int64


@dataclass(frozen=True)
class TextColumn:
    """A column of words: the index of each row into the distinct words."""

    codes: npt.NDArray[np.int32]  # (n,)
    words: tuple[str, ...]


@dataclass(frozen=True)
class CsvTable:
    """The numbers of one CSV file, one array of n rows for each column found."""

    path: Path
    n: int
    columns: dict[str, Float64]
    exact: dict[str, Int64]
    text: dict[str, TextColumn]
    bad_cells: dict[str, Int64]  # optional columns: rows whose cell could not be read
    events: list[Event]
    dialect: Dialect
    lines: Int64 | None = None  # file line of each row, where the exact path found it
    block: Float64 | None = None  # (n, k) the columns wanted together, where they lie so

    @cached_property
    def line(self) -> Int64:
        """The 1-based file line of each row (blank lines are looked for only when somebody asks)."""
        if self.lines is not None:
            return self.lines
        raw = file_buffer(self.path).to_pybytes().splitlines()[self.dialect.skip :]
        filled = np.flatnonzero(np.fromiter((bool(text) for text in raw), np.bool_, len(raw)))
        return np.asarray(filled + self.dialect.skip + 1, dtype=np.int64)

    def take(self, rows: npt.NDArray[np.intp]) -> CsvTable:
        """Return the table with the given rows, in ascending order."""
        bad = {
            name: np.flatnonzero(np.isin(rows, cells)).astype(np.int64)
            for name, cells in self.bad_cells.items()
        }
        return replace(
            self,
            n=len(rows),
            columns={name: values[rows] for name, values in self.columns.items()},
            exact={name: values[rows] for name, values in self.exact.items()},
            text={name: TextColumn(column.codes[rows], column.words) for name, column in self.text.items()},
            bad_cells=bad,
            lines=self.line[rows],
            block=None,
        )


def read_csv_table(path: Path, wanted: Wanted) -> CsvTable:
    """Read the wanted columns of a CSV file (plain or gzipped).

    Raises
    ------
    MissingFileError, InputError : no such file, or it is empty, damaged or no CSV
    ColumnError : a column is missing, or more than 5 % of the rows cannot be read
    """
    buffer = file_buffer(path)
    dialect = detect_dialect(memoryview(buffer), wanted.all, path)
    places = column_places(dialect, wanted, path)
    events = _dialect_events(path, dialect)
    table = _read_fast(buffer, path, dialect, places, wanted, events)
    if table is None:
        rows = read_exact(buffer, path, dialect, places, wanted)
        table = _from_exact(path, dialect, rows, wanted, events)
    pa.default_memory_pool().release_unused()  # the columns have been copied out of Arrow's memory
    if table.n == 0:
        raise InputError("the file holds a header but no rows", file=path, line=dialect.header_line)
    return table


def _dialect_events(path: Path, dialect: Dialect) -> list[Event]:
    events = []
    if dialect.delimiter != ",":
        events.append(
            Event(None, "csv_delimiter", f"{path}: columns parted by {DELIMITER_NAMES[dialect.delimiter]}")
        )
    if dialect.header_in_comment:
        detail = f"{path}:{dialect.header_line}: the column names stand in a comment line"
        events.append(Event(None, "csv_header_in_comment", detail))
    if not dialect.header_is_utf8:
        detail = f"{path}:{dialect.header_line}: the header is no UTF-8, read as {FALLBACK_ENCODING}"
        events.append(Event(None, "csv_encoding", detail))
    return events


def _read_fast(
    buffer: pa.Buffer,
    path: Path,
    dialect: Dialect,
    places: dict[str, int],
    wanted: Wanted,
    events: list[Event],
) -> CsvTable | None:
    """Return the table as Arrow reads it, None when anything in the file needs the exact path."""
    if dialect.delimiter == " " or last_line_is_cut(memoryview(buffer), dialect.delimiter):
        return None
    with byte_stream(path, buffer) as stream:
        found = read_fast(stream, buffer.size, dialect, places, wanted)
    if found is None:
        return None
    text = {name: TextColumn(codes, found.words[name]) for name, codes in found.text.items()}
    return CsvTable(path, found.n, found.columns, found.exact, text, {}, events, dialect, block=found.block)


def merge_words(codes: npt.NDArray[np.int32], words: Sequence[str]) -> TextColumn:
    """Return the column with its words stripped, words that are then equal merged into one."""
    stripped = [word.strip() for word in words]
    distinct = list(dict.fromkeys(stripped))
    renumber = np.array([distinct.index(word) for word in stripped], dtype=np.int32)
    return TextColumn(renumber[codes] if len(renumber) else codes, tuple(distinct))


def _from_exact(
    path: Path, dialect: Dialect, rows: ExactRows, wanted: Wanted, events: list[Event]
) -> CsvTable:
    text = {name: merge_words(*rows.text[name]) for name in rows.text}
    return CsvTable(
        path,
        len(rows.lines),
        rows.columns,
        rows.exact,
        text,
        rows.bad_cells,
        events + rows.events,
        dialect,
        rows.lines,
    )
