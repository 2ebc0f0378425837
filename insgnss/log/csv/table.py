"""One reader for every numeric CSV file: fast where the file is clean, exact about each bad cell where it is not.

The fast path hands the file to Arrow's reader, pieces of a megabyte on all cores; besides the columns, only a few
pieces are held in memory. Whenever Arrow objects, or a required cell is not a finite number, the file is read again
line by line (``csv.exact``), so that each bad row is reported with its file line, column and text and none is dropped
silently.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv

from insgnss.errors import InputError
from insgnss.log.csv.cells import DECIMALS, EMPTY_CELLS, decimals_to_int64
from insgnss.log.csv.columns import (
    ColumnSelection,
    CsvRows,
    TextColumn,
    column_places,
    text_column,
    unread_columns,
)
from insgnss.log.csv.dialect import DELIMITER_NAMES, FALLBACK_ENCODING, Dialect, detect_dialect
from insgnss.log.csv.exact import last_line_is_cut, read_exact
from insgnss.log.files import byte_stream, file_buffer
from insgnss.tables import Event, Float64, Int64

PIECE_BYTES: Final = 1 << 20
MOST_WORKERS: Final = 4  # each holds a piece
_Columns = dict[str, Any]  # of a piece by name: an array of numbers, or of words with their dictionary


class _NotPlainError(Exception):
    """A piece holds a cell that the exact path must look at."""


def read_fast(
    stream: BinaryIO, dialect: Dialect, places: dict[str, int], wanted: ColumnSelection
) -> CsvRows | None:
    """Return the wanted columns of a file, None when anything in it needs the exact path."""
    parser = _Parser(dialect, places, wanted)
    workers = min(pa.cpu_count(), MOST_WORKERS)
    parts: list[_Columns] = []
    waiting: deque[Future[_Columns]] = deque()
    try:
        with ThreadPoolExecutor(workers) as pool:
            for number, piece in enumerate(_pieces(stream)):
                waiting.append(pool.submit(parser.parse, piece, 0 if number else dialect.skip))
                if len(waiting) > workers:
                    parts.append(waiting.popleft().result())
            parts += [piece.result() for piece in waiting]
    except (pa.ArrowInvalid, _NotPlainError):
        return None
    names = list(parts[0])
    n = sum(len(part[names[0]]) for part in parts)
    columns = {name: _column(name, parts) for name in names}
    text = {name: columns.pop(name) for name in wanted.words if name in columns}
    exact = {name: columns.pop(name) for name in wanted.integers}
    return CsvRows(n, columns, exact, text)


def _pieces(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the file in pieces of whole lines; one that has no line feed comes in one."""
    while piece := stream.read(PIECE_BYTES):
        yield piece + stream.readline()


def _column(name: str, parts: list[_Columns]) -> Any:
    """Return a column of all pieces, which lose it."""
    cells = [part.pop(name) for part in parts]
    if isinstance(cells[0], pa.DictionaryArray):
        return text_column(pa.chunked_array(cells).unify_dictionaries().combine_chunks())
    return np.concatenate(cells)


class _Parser:
    """Arrow's reader with the settings for one file."""

    def __init__(self, dialect: Dialect, places: dict[str, int], wanted: ColumnSelection) -> None:
        types = dict.fromkeys((*wanted.numeric, *wanted.optional), pa.float64())
        types |= dict.fromkeys(wanted.exact, DECIMALS)
        types |= dict.fromkeys(wanted.dates, pa.string())
        types |= dict.fromkeys(wanted.words, pa.dictionary(pa.int32(), pa.string()))
        self.wanted = wanted
        self.places = {name: str(place) for name, place in places.items()}
        self.names = [str(place) for place in range(len(dialect.columns))]
        self.parsing = pyarrow.csv.ParseOptions(delimiter=dialect.delimiter)
        self.converting = pyarrow.csv.ConvertOptions(
            include_columns=list(self.places.values()),
            column_types={place: types[name] for name, place in self.places.items()},
            null_values=list(EMPTY_CELLS),
            strings_can_be_null=False,
            decimal_point=wanted.decimal,
        )

    def parse(self, piece: bytes, skip: int) -> _Columns:
        """Return the columns of a piece; an exception says that the exact path must look at it."""
        reading = pyarrow.csv.ReadOptions(
            column_names=self.names, skip_rows=skip, use_threads=False, block_size=len(piece) + 1
        )
        table = pyarrow.csv.read_csv(pa.BufferReader(piece), reading, self.parsing, self.converting)
        chunks = {name: table.column(place) for name, place in self.places.items()}
        cells = {name: c.chunk(0) if c.num_chunks else c.combine_chunks() for name, c in chunks.items()}
        dates = [cells.pop(name) for name in self.wanted.dates]
        columns = {name: self._values(name, column) for name, column in cells.items()}
        if self.wanted.calendar is not None:
            columns[self.wanted.dates[-1]], readable = self.wanted.calendar.to_gps(dates)
            if not readable.all() or self.wanted.calendar.contradicting_cell(dates) is not None:
                raise _NotPlainError
        return columns

    def _values(self, name: str, cells: pa.Array) -> Any:
        if isinstance(cells, pa.DictionaryArray):
            if name in self.wanted.text and not set(EMPTY_CELLS).isdisjoint(cells.dictionary.to_pylist()):
                raise _NotPlainError  # a row of another log, perhaps
            return cells
        optional = name in self.wanted.optional
        if cells.null_count and not optional:
            raise _NotPlainError
        if name in self.wanted.exact:
            return decimals_to_int64(cells, self.wanted.exact[name])
        values = cells.to_numpy(zero_copy_only=False)
        if np.isinf(values).any() if optional else not np.isfinite(values).all():
            raise _NotPlainError
        return values


@dataclass(kw_only=True)
class CsvTable(CsvRows):
    """The numbers of one CSV file."""

    path: Path
    dialect: Dialect

    @cached_property
    def line(self) -> Int64:
        """The 1-based file line of each row (blank lines are searched only on demand)."""
        if self.lines is not None:
            return self.lines
        raw = file_buffer(self.path).to_pybytes().splitlines()[self.dialect.skip :]
        filled = np.flatnonzero(np.fromiter((bool(text) for text in raw), np.bool_, len(raw)))
        return np.asarray(filled + self.dialect.skip + 1, dtype=np.int64)

    def column_or_nan(self, name: str) -> Float64:
        """Return a column; one that the file has not is a single NaN, spread out without taking room."""
        return self.columns[name] if name in self.columns else np.broadcast_to(np.nan, self.n)

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
        )


def read_csv_table(path: Path, wanted: ColumnSelection) -> CsvTable:
    """Read the wanted columns of a CSV file (plain or gzipped).

    Raises
    ------
    MissingFileError, InputError : no such file, or it is empty, damaged or no CSV
    ColumnError : a column is missing, or more than 5 % of the rows cannot be read
    """
    buffer = file_buffer(path)
    dialect = detect_dialect(memoryview(buffer), wanted.all, wanted.required, wanted.decimal, path)
    places = column_places(dialect, wanted, path)
    cut = last_line_is_cut(memoryview(buffer), dialect.delimiter)
    rows = None
    if not cut and dialect.delimiter != " ":
        with byte_stream(path, buffer) as stream:
            rows = read_fast(stream, dialect, places, wanted)
    if rows is None:
        rows = read_exact(buffer, path, dialect, places, wanted, cut=cut)
    pa.default_memory_pool().release_unused()  # the columns have been copied out of Arrow's memory
    if rows.n == 0:
        raise InputError("the file holds a header but no rows", file=path, line=dialect.header_line)
    events = _dialect_events(path, dialect, unread_columns(dialect, places, wanted)) + rows.events
    return CsvTable(**vars(rows) | {"events": events}, path=path, dialect=dialect)


def _dialect_events(path: Path, dialect: Dialect, unread: Sequence[str]) -> list[Event]:
    mark, line, above = dialect.delimiter, dialect.header_line, dialect.lines_above
    named, utf8 = dialect.header_in_comment, dialect.header_is_utf8
    noticed = {
        "csv_delimiter": mark != "," and f": columns separated by {DELIMITER_NAMES[mark]}",
        "csv_lines_skipped": above and f": {above} line(s) above the header in line {line} skipped",
        "csv_header_in_comment": named and f":{line}: the column names are in a comment line",
        "csv_encoding": not utf8 and f":{line}: the header is not UTF-8, read as {FALLBACK_ENCODING}",
        "columns_not_read": unread and f" has further columns: {', '.join(unread)}",
    }
    return [Event(None, kind, f"{path}{detail}") for kind, detail in noticed.items() if detail]
