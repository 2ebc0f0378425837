"""Which columns of a CSV file are read, how strictly, and where they stand in the file."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from insgnss.errors import ColumnError
from insgnss.log.csv_dialect import Dialect, is_number

# Cells that say "no value here"; anything else that is no number is a bad cell
EMPTY_CELLS: Final = (
    "",
    "nan",
    "NaN",
    "NAN",
    "-nan",
    "na",
    "NA",
    "n/a",
    "N/A",
    "null",
    "NULL",
    "none",
    "None",
)


@dataclass(frozen=True)
class Wanted:
    """Which columns of a file are read, and how strictly.

    A row whose ``numeric`` or ``exact`` cell is not a finite number is refused. An ``optional`` column may be absent,
    its cells may be empty (NaN); a cell that is neither empty nor a finite number is NaN and listed in ``bad_cells``.
    ``exact`` columns are returned as integers in units of 10^-digits. ``text`` columns must exist, ``optional_text``
    ones may. The numbers of columns named ``together`` lie side by side in memory where the file has all of them. What
    is ``chosen``, named by the user and not by default, must exist even where it is optional.
    """

    numeric: Sequence[str] = ()
    optional: Sequence[str] = ()
    text: Sequence[str] = ()
    optional_text: Sequence[str] = ()
    exact: Mapping[str, int] = field(default_factory=dict)
    together: Sequence[str] = ()
    chosen: Sequence[str] = ()

    @property
    def required(self) -> tuple[str, ...]:
        """The names that the file must have."""
        return (*self.exact, *self.numeric, *self.text)

    @property
    def all(self) -> tuple[str, ...]:
        """Every name that is looked for."""
        return (*self.required, *self.optional, *self.optional_text)


def column_places(dialect: Dialect, wanted: Wanted, path: Path) -> dict[str, int]:
    """Return the position of each wanted column that the file has."""
    for name in (*wanted.required, *wanted.chosen):
        if name not in dialect.columns:
            raise _missing_column(name, dialect, path)
    for name in wanted.all:
        if dialect.columns.count(name) > 1:
            raise ColumnError(
                "the header names this column twice",
                file=path,
                line=dialect.header_line,
                column=name,
                advice="rename one of them in the file",
            )
    return {name: dialect.columns.index(name) for name in wanted.all if name in dialect.columns}


def _missing_column(name: str, dialect: Dialect, path: Path) -> ColumnError:
    present = [column for column in dialect.columns if column]
    if present and all(is_number(column) for column in present):
        advice = "the first line holds numbers: put a header line above it that names the columns"
    else:
        near = difflib.get_close_matches(name, present, n=1, cutoff=0.4)
        hint = f"nearest: '{near[0]}'; " if near else ""
        advice = f"{hint}the file has {', '.join(present)}; map the names under 'columns' in the flight file"
    return ColumnError("column missing", file=path, line=dialect.header_line, column=name, advice=advice)
