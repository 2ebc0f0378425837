"""How a result table becomes a file, Parquet or CSV, and how a CSV file becomes the same table again."""

from __future__ import annotations

import importlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
import pyarrow.csv
from pandas.api.types import is_string_dtype

from insgnss.results.saving import saving, writing

TableFormat = Literal["parquet", "csv"]
ColumnTypes = Mapping[str, str | list[str]]  # of each column its type, or the words that it is made of
_WORDS: Final = "str"
_PIECE_ROWS: Final = 1 << 14  # eight times as many take 8 MiB more, and an hour's table 0.1 s less


def words(codes: npt.NDArray[Any], names: Iterable[str]) -> pd.Categorical:
    """Return a column of words by their numbers; -1 is an empty cell."""
    return pd.Categorical.from_codes(codes, categories=pd.Index(list(names), dtype="str"))


def pieces(table: pd.DataFrame) -> Iterator[pd.DataFrame]:
    """Yield a table in pieces: converting all rows of a big log at once would take 50 MB more."""
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
    """Write a table into a folder that exists; None writes nothing.

    Parameters
    ----------
    float_format : of CSV; the default gives back every bit
    parquet : further options of Parquet

    Raises
    ------
    OSError : the file cannot be written
    """
    if table is None:
        return
    path = folder / f"{name}.{form}"
    if form == "parquet":
        _write_parquet(path, table, **parquet)
    else:
        table.to_csv(path, index=False, float_format=float_format)


def table_files(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names of all files that tables may be in."""
    return tuple(f"{name}.{form}" for name in names for form in ("parquet", "csv"))


def save_study(folder: str | Path, tables: Mapping[str, pd.DataFrame], form: TableFormat, kind: str) -> Path:
    """Write the tables of a study into ``folder`` (made if needed), all at once or none; return the folder.

    Raises
    ------
    ResultError : the folder cannot be written, or another program's file has one of the names
    """
    folder = Path(folder)
    with writing("the study", folder), saving(folder, table_files(tables), kind) as new:
        for name, table in tables.items():
            write_table(new, name, table, form, float_format="%.10g")
    return folder


def _write_parquet(path: Path, table: pd.DataFrame, **options: Any) -> None:
    """Write a table as ``DataFrame.to_parquet`` does, in pieces and without an index."""
    parquet = importlib.import_module("pyarrow.parquet")  # late: 5 MB that the filter can use
    schema = pa.Schema.from_pandas(table, preserve_index=False)
    if table.attrs:  # under the name that pandas writes and reads; older versions of pyarrow do not write it
        about = {"PANDAS_ATTRS": json.dumps(table.attrs)}
        schema = schema.with_metadata({**(schema.metadata or {}), **about})
    with pa.OSFile(os.fsencode(path), "wb") as file, parquet.ParquetWriter(file, schema, **options) as writer:
        for piece in pieces(table):
            writer.write_table(pa.Table.from_pandas(piece, schema=schema, preserve_index=False, nthreads=1))


def column_types(table: pd.DataFrame) -> dict[str, str | list[str]]:
    """Return the types that a CSV file does not state: the width of numbers, and the words of a column."""
    return {
        str(name): dtype.categories.tolist()
        if isinstance(dtype, pd.CategoricalDtype)
        else str(dtype).replace("object", _WORDS)  # as pandas before 3 calls them
        for name, dtype in table.dtypes.items()
    }


def read_csv(path: Path, types: ColumnTypes | None) -> pd.DataFrame:
    """Return a table that ``write_table`` wrote as CSV, bit by bit; ``types`` are those of all its columns.

    Without types numbers are what they look like and words are categories.

    Raises
    ------
    OSError, KeyError, TypeError, ValueError : no such file, or it is not of these columns and types
    """
    convert = pyarrow.csv.ConvertOptions()
    if types is not None:
        convert.column_types = {name: _arrow_type(kind) for name, kind in types.items()}
        convert.include_columns = list(types)
    table = pyarrow.csv.read_csv(
        pa.memory_map(os.fsencode(path)),
        parse_options=pyarrow.csv.ParseOptions(newlines_in_values=True),
        convert_options=convert,
    )
    frame: pd.DataFrame = table.to_pandas()
    if types is None:
        return frame.astype(dict.fromkeys(frame.columns[frame.dtypes.map(is_string_dtype)], "category"))
    for name, kind in types.items():
        unknown = set(frame[name].dropna()) - set(kind) if isinstance(kind, list) else set()
        if unknown:
            raise ValueError(f"'{min(unknown)}' is none of the words of '{name}'")
    return frame.astype(
        {
            name: pd.CategoricalDtype(pd.Index(kind, dtype="str")) if isinstance(kind, list) else kind
            for name, kind in types.items()
            if kind not in (_WORDS, "object")  # they are words already
        }
    )


def _arrow_type(kind: str | list[str]) -> pa.DataType:
    """Return the type as which a column's cells are read, the widest of its kind."""
    if isinstance(kind, list) or kind in (_WORDS, "object"):
        return pa.string()
    return {"f": pa.float64(), "i": pa.int64(), "b": pa.bool_()}[np.dtype(kind).kind]
