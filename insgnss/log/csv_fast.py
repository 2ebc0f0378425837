"""The fast CSV path: pieces of some megabytes, parsed by Arrow on all cores, gathered into arrays of their final size.

Nothing but a few pieces is held beside the arrays. Whatever Arrow objects to, an empty or infinite cell where a number
must stand, makes the whole file go the exact way (``csv_exact``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from insgnss.log.csv_columns import EMPTY_CELLS, Wanted
from insgnss.log.csv_dialect import Dialect
from insgnss.tables import Float64, Int64

PIECE_BYTES: Final = 1 << 20
MOST_WORKERS: Final = 4  # each holds a piece and what it became
_SPARE_ROOM: Final = 1.02  # the first piece tells how many rows the file has, to about a hundredth
_DECIMALS: Final = pa.decimal128(38, 18)


@dataclass
class FastColumns:
    """The columns of a file, n rows each; of text the codes and, by code, the stripped words."""

    n: int = 0
    columns: dict[str, Float64] = field(default_factory=dict)
    exact: dict[str, Int64] = field(default_factory=dict)
    text: dict[str, npt.NDArray[np.int32]] = field(default_factory=dict)
    words: dict[str, tuple[str, ...]] = field(default_factory=dict)
    block: Float64 | None = None  # (n, k) the columns wanted together, if the file has them all


def read_fast(
    stream: BinaryIO, size: int, dialect: Dialect, places: dict[str, int], wanted: Wanted
) -> FastColumns | None:
    """Return the wanted columns of ``size`` bytes, None when anything in them needs the exact path."""
    parser = _Parser(dialect, places, wanted)
    room = _Room(size, places, wanted)
    waiting: deque[Future[pa.Table]] = deque()
    workers = min(pa.cpu_count(), MOST_WORKERS)
    skip = dialect.skip
    try:
        with ThreadPoolExecutor(workers) as pool:
            for piece in _pieces(stream):
                room.expect(len(piece))
                waiting.append(pool.submit(parser.parse, piece, skip))
                skip = 0
                if len(waiting) > workers and not room.take(waiting.popleft().result()):
                    return None
            if not all(room.take(parsed.result()) for parsed in waiting):
                return None
    except pa.ArrowInvalid:
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

    def __init__(self, dialect: Dialect, places: dict[str, int], wanted: Wanted) -> None:
        types = dict.fromkeys((*wanted.numeric, *wanted.optional), pa.float64())
        types |= dict.fromkeys(wanted.exact, _DECIMALS)
        types |= dict.fromkeys((*wanted.text, *wanted.optional_text), pa.dictionary(pa.int32(), pa.string()))
        self.names = [str(place) for place in range(len(dialect.columns))]
        self.parsing = pyarrow.csv.ParseOptions(delimiter=dialect.delimiter)
        self.converting = pyarrow.csv.ConvertOptions(
            include_columns=[str(place) for place in places.values()],
            column_types={str(place): types[name] for name, place in places.items()},
            null_values=list(EMPTY_CELLS),
            strings_can_be_null=False,
        )

    def parse(self, piece: bytes, skip: int) -> pa.Table:
        """Return a piece as one chunk."""
        reading = pyarrow.csv.ReadOptions(
            column_names=self.names, skip_rows=skip, use_threads=False, block_size=len(piece) + 1
        )
        return pyarrow.csv.read_csv(pa.BufferReader(piece), reading, self.parsing, self.converting)


class _Room:
    """Arrays for all rows, filled piece by piece."""

    def __init__(self, size: int, places: dict[str, int], wanted: Wanted) -> None:
        self.size = size
        self.first_piece = 0
        self.places = places
        self.wanted = wanted
        self.n = 0
        self.room = 0
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        together = len(wanted.together) > 0 and set(wanted.together) <= places.keys()
        self.block: Float64 | None = np.empty((0, len(wanted.together))) if together else None
        self.words: dict[str, dict[str, int]] = {name: {} for name in (*wanted.text, *wanted.optional_text)}

    def expect(self, piece: int) -> None:
        """Note the length of the first piece, by which the rows of the whole are estimated."""
        self.first_piece = self.first_piece or piece

    def take(self, piece: pa.Table) -> bool:
        """Copy the rows of the next piece; return whether the fast path can go on."""
        end = self.n + piece.num_rows
        if end > self.room:
            self._grow(end)
        for name, place in self.places.items():
            column = piece.column(str(place))
            if not len(column):
                continue
            values = self._values(name, column.chunk(0))
            if values is None:
                return False
            self.arrays[name][self.n : end] = values
        self.n = end
        return True

    def _grow(self, end: int) -> None:
        """Make room for all rows there are, by the first piece; later, for a little more than are known."""
        share = min(self.first_piece / self.size, 1.0) if self.n == 0 else 1.0
        self.room = int(end / share * _SPARE_ROOM) + 1
        if self.block is not None:
            self.block = _larger(self.block, self.n, np.empty((self.room, len(self.wanted.together))))
            self.arrays |= {name: self.block[:, i] for i, name in enumerate(self.wanted.together)}
        for name in self.places:
            if self.block is None or name not in self.wanted.together:
                number = (
                    np.int64 if name in self.wanted.exact else np.int32 if name in self.words else np.float64
                )
                self.arrays[name] = _larger(self.arrays.get(name), self.n, np.empty(self.room, number))

    def _values(self, name: str, cells: pa.Array) -> npt.NDArray[Any] | None:
        """Return the cells of one column as numbers, None when the exact path must look at them."""
        if name in self.words:
            return self._codes(name, cells)
        optional = name in self.wanted.optional
        if cells.null_count and not optional:
            return None
        if name in self.wanted.exact:
            return _decimals_to_int64(cells, self.wanted.exact[name])
        values = cells.to_numpy(zero_copy_only=False)
        wrong = np.isinf(values).any() if optional else not np.isfinite(values).all()
        return None if wrong else values

    def _codes(self, name: str, cells: pa.Array) -> npt.NDArray[np.int32]:
        """Return the words of a column as codes; words are stripped, and numbered as they first appear."""
        known = self.words[name]
        number = [known.setdefault(word.strip(), len(known)) for word in cells.dictionary.to_pylist()]
        codes: npt.NDArray[np.int32] = np.array(number, np.int32)[
            cells.indices.to_numpy(zero_copy_only=False)
        ]
        return codes

    def filled(self) -> FastColumns:
        """Return what was gathered."""
        found = FastColumns(self.n, block=None if self.block is None else self.block[: self.n])
        for name, array in self.arrays.items():
            if name in self.words:
                found.text[name] = array[: self.n]
                found.words[name] = tuple(self.words[name])
            elif name in self.wanted.exact:
                found.exact[name] = array[: self.n]
            else:
                found.columns[name] = array[: self.n]
        return found


def _larger(array: npt.NDArray[Any] | None, used: int, room: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the larger ``room``, beginning with the ``used`` rows of ``array``."""
    if array is not None and used:
        room[:used] = array[:used]
    return room


def _decimals_to_int64(cells: pa.Array, digits: int) -> Int64:
    """Return decimal cells in units of 10^-digits, rounded half to even."""
    rounded = pc.round(cells, ndigits=digits, round_mode="half_to_even").cast(pa.decimal128(38, digits))
    return np.frombuffer(rounded.buffers()[1], np.int64)[
        2 * rounded.offset : 2 * (rounded.offset + len(rounded)) : 2
    ]
