"""Which columns of a CSV file are read, how strictly, and their places in the file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from insgnss.errors import ColumnError
from insgnss.log.csv.calendar import Calendar
from insgnss.log.csv.dialect import Dialect, column_number, is_data
from insgnss.tables import Event, Float64, Int64

# the columns that all logs of a flight read, by file (``FlightConfig.columns_by_file``)
FileColumns: TypeAlias = Mapping[Path, Sequence[str]]
NOTHING_SHARED: Final[FileColumns] = MappingProxyType({})


@dataclass(frozen=True)
class ColumnSelection:
    """Which columns of a file are read, and how strictly.

    A row whose ``numeric`` or ``exact`` cell is not a finite number is refused. A row without any of the ``measured``
    cells, but with one in a column that is not read, is another log's, and left out. An ``optional`` column may be
    absent, its cells may be empty (NaN); a cell that is neither empty nor a finite number is NaN and listed in
    ``bad_cells``. ``exact`` columns are returned as integers in units of 10^-digits, ``calendar`` ones as GPS time
    [ns] under the name of the column of times. ``text`` columns must exist, ``optional_text`` ones may. ``decimal``
    is the mark before the decimals of all numbers. What is ``chosen``, named by the user and not by default, must
    exist even where it is optional. What is read ``elsewhere``, by another log of the flight in the same file, is not
    reported as unread.
    """

    numeric: Sequence[str] = ()
    optional: Sequence[str] = ()
    text: Sequence[str] = ()
    optional_text: Sequence[str] = ()
    exact: Mapping[str, int] = field(default_factory=dict)
    chosen: Sequence[str] = ()
    elsewhere: Sequence[str] = ()
    measured: Sequence[str] = ()
    calendar: Calendar | None = None
    decimal: str = "."

    @property
    def dates(self) -> tuple[str, ...]:
        """The columns of dates and times."""
        return () if self.calendar is None else self.calendar.columns

    @property
    def words(self) -> tuple[str, ...]:
        """The columns of words."""
        return (*self.text, *self.optional_text)

    @property
    def integers(self) -> tuple[str, ...]:
        """The names under which integers are returned."""
        return (*self.exact, *self.dates[-1:])

    @property
    def required(self) -> tuple[str, ...]:
        """The names that the file must have."""
        return (*self._never_optional, *self.chosen)

    @property
    def all(self) -> tuple[str, ...]:
        """Every column name that is searched."""
        return (*self._never_optional, *self.optional, *self.optional_text)

    @property
    def _never_optional(self) -> tuple[str, ...]:
        return (*self.exact, *self.dates, *self.numeric, *self.text)


@dataclass(frozen=True)
class TextColumn:
    """A column of words: the index of each row into the distinct words."""

    codes: npt.NDArray[np.int32]  # (n,)
    words: tuple[str, ...]


def text_column(cells: pa.DictionaryArray) -> TextColumn:
    """Return words, stripped, as they first appear in the file."""
    words: dict[str, int] = {}
    number = [words.setdefault(word.strip(), len(words)) for word in cells.dictionary.to_pylist()]
    return TextColumn(np.array(number, np.int32)[cells.indices.to_numpy(zero_copy_only=False)], tuple(words))


@dataclass
class CsvRows:
    """The result of either path: one array of n rows for each column found."""

    n: int = 0
    columns: dict[str, Float64] = field(default_factory=dict)
    exact: dict[str, Int64] = field(default_factory=dict)
    text: dict[str, TextColumn] = field(default_factory=dict)
    bad_cells: dict[str, Int64] = field(default_factory=dict)  # rows of optional columns, unreadable
    events: list[Event] = field(default_factory=list)
    lines: Int64 | None = None  # file line of each row, where the exact path found it


def column_places(dialect: Dialect, wanted: ColumnSelection, path: Path) -> dict[str, int]:
    """Return the position of each wanted column that the file has."""
    for name in wanted.required:
        if dialect.place(name) is None:
            raise missing_column(name, dialect, path)
    for name in wanted.all:
        if dialect.columns.count(name) > 1:
            raise ColumnError(
                "the header names this column twice",
                file=path,
                line=dialect.header_line,
                column=name,
                advice="rename one of them in the file, or give the columns by number: time = 1",
            )
    places = {name: dialect.place(name) for name in wanted.all}
    return {name: place for name, place in places.items() if place is not None}


def unread_columns(dialect: Dialect, places: Mapping[str, int], wanted: ColumnSelection) -> list[str]:
    """Return the names of the columns that nothing reads; where the header has no name, the number."""
    read = {*places.values(), *map(dialect.place, wanted.elsewhere)}
    return [name or f"#{k + 1}" for k, name in enumerate(dialect.columns) if k not in read]


def missing_column(name: str, dialect: Dialect, path: Path) -> ColumnError:
    """Return the error of a column that the file lacks, with the columns that it has."""
    present = [column for column in dialect.columns if column]
    if column_number(name) is not None:
        advice = f"the line has {len(dialect.columns)} columns, counted from 1"
    elif sum(map(is_data, present)) * 2 >= len(present) > 0:
        advice = (
            "the first line holds numbers, not names: give every column by its number (time = 1, ...)"
            " under 'columns' in the flight file, or put a header line above it"
        )
    elif len(present) == 1:
        advice = (
            f"line {dialect.header_line} reads '{present[0][:60]}', and no line below it holds the columns by the names"
            " that are looked for: give the file's own names under 'columns' in the flight file"
        )
    else:
        near = difflib.get_close_matches(name, present, n=1, cutoff=0.4)
        hint = f"nearest: '{near[0]}'; " if near else ""
        advice = f"{hint}the file has {', '.join(present)}; map the names under 'columns' in the flight file"
    return ColumnError("column missing", file=path, line=dialect.header_line, column=name, advice=advice)
