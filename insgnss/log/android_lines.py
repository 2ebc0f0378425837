"""The lines of an Android GnssLogger file by kind, each kind with the columns that its own header line names.

A file holds lines of several kinds in the order in which they came: "Raw,..." (measurements), "UncalAccel,...",
"UncalGyro,...", "Fix,..." and others. A comment line "# Raw,utcTimeMillis,TimeNanos,..." names the columns of a kind;
they differ between versions of the application.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv

from insgnss.tables import Float64, Int64

_HEADER: Final = re.compile(r"#\s*(\w+)\s*,(.*)")
_KIND: Final = re.compile(r"[A-Za-z]\w*")
_INTEGER: Final = r"^-?\d{1,18}$|^-?[1-8]\d{18}$"
_DECIMAL: Final = r"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?$"


@dataclass
class Lines:
    """The lines of one kind."""

    columns: tuple[str, ...] = ()
    texts: list[str] = field(default_factory=list)
    first_line: int = 0  # number in the file of the first of them


def lines_by_kind(text: str) -> dict[str, Lines]:
    """Return the data lines of each kind that a header line describes, and those of other kinds without columns."""
    kinds: dict[str, Lines] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("#"):
            match = _HEADER.match(line)
            if match is not None and "," in match[2]:
                columns = tuple(name.strip() for name in match[2].split(","))
                kinds.setdefault(match[1], Lines()).columns = columns
            continue
        kind, comma, _ = line.partition(",")
        if comma and _KIND.fullmatch(kind):
            of_kind = kinds.setdefault(kind, Lines(first_line=number))
            of_kind.first_line = of_kind.first_line or number
            of_kind.texts.append(line)
    return kinds


@dataclass(frozen=True)
class Cells:
    """The cells of one kind of line as text, and how many lines did not have as many cells as the header."""

    columns: dict[str, Any]  # name -> pyarrow array of strings
    n: int
    refused: int

    def integers(self, name: str) -> tuple[Int64, npt.NDArray[np.bool_]]:
        """Return a column as integers, exact to the last digit, and where there is one; zero elsewhere."""
        return self._numbers(name, _INTEGER, pa.int64(), 0)

    def decimals(self, name: str) -> Float64:
        """Return a column as floats, NaN where the cell is empty or no number."""
        values, present = self._numbers(name, _DECIMAL, pa.float64(), 0.0)
        return np.where(present & np.isfinite(values), values, np.nan)

    def texts(self, name: str) -> list[str]:
        """Return a column as text, empty where the file has no such column."""
        column = self.columns.get(name)
        return [""] * self.n if column is None else ["" if x is None else str(x) for x in column.to_pylist()]

    def _numbers(self, name: str, pattern: str, kind: Any, missing: float) -> tuple[Any, Any]:
        column = self.columns.get(name)
        if column is None:
            return np.full(self.n, missing, kind.to_pandas_dtype()), np.zeros(self.n, np.bool_)
        trimmed = pc.utf8_trim_whitespace(column)
        readable = pc.fill_null(pc.match_substring_regex(trimmed, pattern), False)
        chosen = pc.if_else(readable, trimmed, pa.scalar(str(missing), pa.string()))
        return pc.cast(chosen, kind).to_numpy(), readable.to_numpy(zero_copy_only=False)


def cells(lines: Lines) -> Cells:
    """Return the lines' cells by column; a line with too few or too many cells is refused and counted."""
    if not lines.texts or not lines.columns:
        return Cells({}, 0, len(lines.texts))
    names = ["", *lines.columns]
    doubled = {name for name, count in Counter(names).items() if count > 1}
    names = [f"{name}/{k}" if name in doubled or not name else name for k, name in enumerate(names)]
    refused: list[int] = []

    def refuse(_: Any) -> str:
        refused.append(1)
        return "skip"

    table = csv.read_csv(
        io.BytesIO("\n".join(lines.texts).encode("utf-8", "replace")),
        read_options=csv.ReadOptions(column_names=names),
        parse_options=csv.ParseOptions(quote_char=False, invalid_row_handler=refuse),
        convert_options=csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string())),
    )
    columns = {name: table.column(name).combine_chunks() for name in names}
    return Cells(columns, table.num_rows, len(refused))
