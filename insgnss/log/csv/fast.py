"""The fast CSV path: pieces of a megabyte, parsed by Arrow on all cores.

Besides the columns, only a few pieces are held in memory. If Arrow rejects anything, or if a required number is empty
or infinite, the whole file is read the exact way (``csv.exact``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, BinaryIO, Final

import numpy as np
import pyarrow as pa
import pyarrow.csv

from insgnss.log.csv.cells import DECIMALS, EMPTY_CELLS, decimals_to_int64
from insgnss.log.csv.columns import ColumnSelection, CsvRows, text_column
from insgnss.log.csv.dialect import Dialect

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
