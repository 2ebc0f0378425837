"""How a result table becomes a file, Parquet or CSV."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal

import pandas as pd
import pyarrow as pa

TableFormat = Literal["parquet", "csv"]
_PIECE_ROWS: Final = 1 << 17


def pieces(table: pd.DataFrame) -> Iterator[pd.DataFrame]:
    """Yield a table in pieces: what is made of all rows of a big log's at once would take 50 MB more."""
    for first in range(0, len(table), _PIECE_ROWS):
        yield table.iloc[first : first + _PIECE_ROWS]


def write_table(
    folder: Path,
    name: str,
    table: pd.DataFrame | None,
    form: TableFormat,
    *,
    float_format: str = "%.17g",
    **parquet: Any,
) -> None:
    """Write a table into a folder that exists, in place of what stood there by its name; None leaves nothing there.

    Parameters
    ----------
    float_format : of CSV; the default gives back every bit
    parquet : further options of Parquet

    Raises
    ------
    OSError : the file cannot be written
    """
    for stale in ("parquet", "csv"):
        (folder / f"{name}.{stale}").unlink(missing_ok=True)
    if table is None:
        return
    path = folder / f"{name}.{form}"
    if form == "parquet":
        _write_parquet(path, table, **parquet)
    else:
        table.to_csv(path, index=False, float_format=float_format)


def _write_parquet(path: Path, table: pd.DataFrame, **options: Any) -> None:
    """Write a table as ``DataFrame.to_parquet`` does, in pieces and without an index."""
    parquet = importlib.import_module("pyarrow.parquet")  # late: 5 MB that the filter can use
    schema = pa.Schema.from_pandas(table, preserve_index=False)
    with parquet.ParquetWriter(path, schema, **options) as writer:
        for piece in pieces(table):
            writer.write_table(pa.Table.from_pandas(piece, schema=schema, preserve_index=False, nthreads=1))
