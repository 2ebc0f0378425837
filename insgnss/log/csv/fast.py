"""The fast CSV path: pieces of a megabyte, parsed by Arrow on all cores, gathered into arrays of their final size.

Besides the arrays, only a few pieces are held in memory. If Arrow rejects anything, or if a required number is empty
or infinite, the whole file is read the exact way (``csv_exact``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv

from insgnss.log.csv.cells import DECIMALS, EMPTY_CELLS, decimals_to_int64
from insgnss.log.csv.columns import ColumnSelection, CsvRows, TextColumn
from insgnss.log.csv.dialect import Dialect
from insgnss.tables import Float64

PIECE_BYTES: Final = 1 << 20
MOST_WORKERS: Final = 4  # each holds a piece and what it became
_SPARE_ROOM: Final = 1.02  # the first piece gives the number of rows to about one percent
_Columns = dict[str, Any]  # of a piece by name: an array of numbers, or of words their dictionary


class _NotPlainError(Exception):
    """A piece holds a cell that the exact path must look at."""


def read_fast(
    stream: BinaryIO, size: int, dialect: Dialect, places: dict[str, int], wanted: ColumnSelection
) -> CsvRows | None:
    """Return the wanted columns of ``size`` bytes, None when anything in them needs the exact path."""
    parser, room = _Parser(dialect, places, wanted), _ColumnArrays(size, wanted)
    waiting: deque[tuple[Future[_Columns], int]] = deque()
    workers = min(pa.cpu_count(), MOST_WORKERS)

    def take_first() -> None:
        parsed, length = waiting.popleft()
        room.take(parsed.result(), length)

    try:
        with ThreadPoolExecutor(workers) as pool:
            for number, piece in enumerate(_pieces(stream)):
                waiting.append((pool.submit(parser.parse, piece, 0 if number else dialect.skip), len(piece)))
                if len(waiting) > workers:
                    take_first()
            while waiting:
                take_first()
    except (pa.ArrowInvalid, _NotPlainError):
        return None
    return room.filled()


def _pieces(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the file in pieces of whole lines; one that has no line feed comes in one."""
    rest = b""
    while block := stream.read(PIECE_BYTES):
        end = block.rfind(b"\n") + 1
        if end:
            yield rest + block[:end]
            rest = b""
        rest += block[end:]
    if rest:
        yield rest


class _Parser:
    """Arrow's reader with the settings for one file."""

    def __init__(self, dialect: Dialect, places: dict[str, int], wanted: ColumnSelection) -> None:
        types = dict.fromkeys((*wanted.numeric, *wanted.optional), pa.float64())
        types |= dict.fromkeys(wanted.exact, DECIMALS)
        types |= dict.fromkeys(wanted.dates, pa.string())
        types |= dict.fromkeys((*wanted.text, *wanted.optional_text), pa.dictionary(pa.int32(), pa.string()))
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


class _ColumnArrays:
    """Arrays for all rows, filled piece by piece; the first piece gives the number of rows."""

    def __init__(self, size: int, wanted: ColumnSelection) -> None:
        self.size = size
        self.together = wanted.together
        self.integers = wanted.integers
        self.n = 0
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        self.block: Float64 | None = None
        self.words: dict[str, dict[str, int]] = {}

    def take(self, parsed: _Columns, length: int) -> None:
        """Copy the rows of the next piece, of so many bytes."""
        columns = {name: self._numbers(name, cells) for name, cells in parsed.items()}
        rows = len(next(iter(columns.values())))
        if not self.arrays:
            self._grow(columns, int(rows * max(self.size / length, 1.0) * _SPARE_ROOM) + 1)
        if self.n + rows > len(self.arrays[next(iter(columns))]):
            self._grow(columns, int((self.n + rows) * _SPARE_ROOM) + 1)
        for name, values in columns.items():
            self.arrays[name][self.n : self.n + rows] = values
        self.n += rows

    def _numbers(self, name: str, cells: Any) -> npt.NDArray[Any]:
        """Return a column of a piece; words as codes, stripped, and numbered as they first appear in the file."""
        if not isinstance(cells, pa.DictionaryArray):
            return np.asarray(cells)
        known = self.words.setdefault(name, {})
        number = [known.setdefault(word.strip(), len(known)) for word in cells.dictionary.to_pylist()]
        codes: npt.NDArray[np.int32] = np.array(number, np.int32)[
            cells.indices.to_numpy(zero_copy_only=False)
        ]
        return codes

    def _grow(self, columns: _Columns, room: int) -> None:
        """Make room for so many rows; existing rows are kept."""
        larger = {name: np.empty(room, values.dtype) for name, values in columns.items()}
        if self.together and set(self.together) <= columns.keys():
            self.block = np.empty((room, len(self.together)))
            larger |= {name: self.block[:, i] for i, name in enumerate(self.together)}
        for name, array in self.arrays.items():
            larger[name][: self.n] = array[: self.n]
        self.arrays = larger

    def filled(self) -> CsvRows:
        """Return the gathered columns."""
        rows = CsvRows(self.n, block=None if self.block is None else self.block[: self.n])
        for name, array in self.arrays.items():
            if name in self.words:
                rows.text[name] = TextColumn(array[: self.n], tuple(self.words[name]))
            else:
                (rows.exact if name in self.integers else rows.columns)[name] = array[: self.n]
        return rows
