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
from insgnss.log.csv.columns import ColumnSelection, CsvRows, TextColumn, column_places, unread_columns
from insgnss.log.csv.dialect import DELIMITER_NAMES, FALLBACK_ENCODING, Dialect, detect_dialect
from insgnss.log.csv.exact import last_line_is_cut, read_exact
from insgnss.log.csv.fast import read_fast
from insgnss.log.files import byte_stream, file_buffer
from insgnss.tables import Event, Float64, Int64


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
        "csv_delimiter": mark != "," and f": columns parted by {DELIMITER_NAMES[mark]}",
        "csv_lines_skipped": above and f": {above} line(s) above the header in line {line} skipped",
        "csv_header_in_comment": named and f":{line}: the column names are in a comment line",
        "csv_encoding": not utf8 and f":{line}: the header is not UTF-8, read as {FALLBACK_ENCODING}",
        "columns_not_read": unread and f" has further columns: {', '.join(unread)}",
    }
    return [Event(None, kind, f"{path}{detail}") for kind, detail in noticed.items() if detail]
