"""How a result table becomes a file, Parquet or CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import pandas as pd

TableFormat = Literal["parquet", "csv"]


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
        table.to_parquet(path, index=False, **parquet)
    else:
        table.to_csv(path, index=False, float_format=float_format)
