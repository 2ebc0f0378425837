"""A saved run's folder: reading it, and the checks before it is used."""

from __future__ import annotations

import difflib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np
import pandas as pd
import pyarrow as pa
from pandas.api.types import is_bool_dtype, is_numeric_dtype

from insgnss.config.changes import entry
from insgnss.errors import ResultError
from insgnss.results.nav_columns import ATTITUDE, COMPONENTS, EVENT, PLACE, VELOCITY
from insgnss.results.record import RECORD, first_changed, saved_as
from insgnss.results.saving import RUN_KIND, reading
from insgnss.results.table_files import read_csv

SETTINGS: Final = "settings.json"
COLUMN_TYPES: Final = "columns.json"  # next to tables in CSV, which do not store them
_NO_RUN: Final = "this folder holds no run; name the folder of a run"
_WORDS: Final = (
    *("sv", "signal", "kind", "status", "state", "detail", "decision", "receiver"),
    *("from_state", "to_state", "reason", "event", "supervisor", "verdict", "fault", "axis"),
)
# Columns without which a table is of no use; a run of an earlier version may lack others
_COLUMNS: Final[Mapping[str, tuple[str, ...]]] = {
    "nav": (
        *("time_s", *PLACE, *VELOCITY, *ATTITUDE, "n_used"),
        *(f"sd_{name}" for name in COMPONENTS),
    ),
    "measurements": ("time_s", "sv", "signal", "kind", "innovation", "sd_innovation", "nis", "status"),
    "satellites": ("time_s", "sv", "az_deg", "el_deg", "body_az_deg", "body_el_deg", "state"),
    "events": EVENT,
    "errors": ("time_s", *(f"{sign}_{name}" for name in COMPONENTS for sign in ("d", "sd"))),
    "filtered": ("time_s",),
    "imu": ("time_s",),
    "imu_spectrum": ("frequency_hz",),
    "aiding": ("time_s", "sv"),
    "aiding_budget": ("time_s", "sv"),
    "supervision": ("time_s", "sv", "state", "decision", "receiver"),
    "transitions": ("time_s", "sv", "from_state", "to_state", "reason"),
    "search_times": ("sv",),
    "receiver_events": ("time_s", "sv", "event", "verdict"),
    "integrity": ("fault", "time_s", "axis", "separation_m", "limit_m", "alert_rows"),
}
# Of columns that are computed with wherever a run is read, and never empty: the largest size that can be true
_LARGEST: Final = {
    **{"time_s": 1e10, "lat_deg": 90.0, "lon_deg": 360.0, "h_m": 1e12},
    **dict.fromkeys(("vn_mps", "ve_mps", "vd_mps", "sd_n_m", "sd_e_m", "sd_d_m"), 1e12),
}
_LARGEST_OF_OTHERS: Final = 1e100  # its square is a number, too
_GROUPED: Final = ("sv", "signal", "kind", "status", "state")  # of the large tables: made of few words
# Of the settings: what is looked into, and as what
_TABLES_OF_SETTINGS: Final = (
    *(("flight",), ("filter",), ("took",), ("versions",), ("input_sha256",), ("flight", "gnss")),
    *(("filter", "heading"), ("filter", "adaptation"), ("filter", "gates")),
)
_LARGEST_WEEK: Final = 1e5


def read_run(
    folder: Path, tables: Sequence[str], optional: Sequence[str]
) -> tuple[dict[str, pd.DataFrame | None], dict[str, Any]]:
    """Return the tables and the settings of a saved run; a save that was interrupted is finished before.

    Raises
    ------
    ResultError : there is no such folder, it holds no complete run, or a file of it is damaged
    """
    if not folder.is_dir():
        raise ResultError("there is no such folder", file=folder, advice=_nearest_folders(folder))
    try:
        with reading(folder):
            contents = _tables(folder, tables, optional), _settings(folder / SETTINGS)
            _require_whole_run(folder)
            _require_one_run(folder, tables)
            return contents
    except OSError as error:
        raise ResultError(f"the folder cannot be read: {error.strerror}", file=folder) from error


def _require_whole_run(folder: Path) -> None:
    """Refuse a folder without all tables of the run that was saved there: one would be missing without a word.

    Raises
    ------
    ResultError : files are missing
    """
    needed = set(saved_as(RUN_KIND, folder)) - {COLUMN_TYPES}  # without which tables in CSV are read, too
    missing = [folder / name for name in sorted(needed) if not (folder / name).is_file()]
    if missing:
        others = f"; also missing: {', '.join(path.name for path in missing[1:])}" if missing[1:] else ""
        raise ResultError(
            f"this file of the run is missing{others}",
            file=missing[0],
            advice=f"copy the run's whole folder again; or {_replay_again(folder)}; if it was removed on purpose,"
            f" remove its entry in '{RECORD}'",
        )


def _replay_again(folder: Path) -> str:
    """Return the advice to replay; it overwrites the folder's files only if they are a run that was saved there."""
    place = "FOLDER --force" if saved_as(RUN_KIND, folder) else "NEW_FOLDER"
    return f"replay the flight again: insgnss replay FLIGHT --output {place}"


def _run_advice(folder: Path) -> str:
    """Return what to do about a folder that lacks what every run has."""
    return _replay_again(folder) if saved_as(RUN_KIND, folder) else _NO_RUN


def _require_one_run(folder: Path, tables: Sequence[str]) -> None:
    """Refuse a folder in which a file is not the one that was saved there with the others.

    Runs of former versions have no record of their files: nothing is compared.

    Raises
    ------
    ResultError : a table or the settings are of another run, or were changed
    """
    read = [_file_of(folder, name).name for name in tables]
    if any(name.endswith(".csv") and (folder / name).exists() for name in read):
        read.append(COLUMN_TYPES)
    if (other := first_changed(folder, (*read, SETTINGS), RUN_KIND)) is not None:
        raise ResultError(
            "the file is not the one that was saved with this run: it is of another run, or was changed since",
            file=other,
            advice=f"copy the run's whole folder again, with its '{RECORD}'; or {_replay_again(folder)}",
        )


def _nearest_folders(folder: Path) -> str:
    if folder.is_file():
        return "this is a file; name the folder of the run"
    near: list[str] = []
    if folder.parent.is_dir():
        beside = [entry.name for entry in folder.parent.iterdir() if entry.is_dir()]
        near = difflib.get_close_matches(folder.name, beside, n=3, cutoff=0.4)
    return (
        f"nearest: {', '.join(near)}" if near else "save a run with 'insgnss replay FLIGHT --output FOLDER'"
    )


def _tables(folder: Path, tables: Sequence[str], optional: Sequence[str]) -> dict[str, pd.DataFrame | None]:
    by_name: dict[str, pd.DataFrame | None] = {}
    for name in tables:
        path = _file_of(folder, name)
        if path.exists():
            read = _from_csv if path.suffix == ".csv" else _from_parquet
            by_name[name] = _checked(read(path), path)
        elif name in optional:
            by_name[name] = None
        else:
            raise ResultError(f"no table '{name}' in the folder", file=folder, advice=_run_advice(folder))
    return by_name


def _file_of(folder: Path, table: str) -> Path:
    """Return the path of a saved table: its Parquet file if that exists, its CSV file otherwise."""
    parquet = folder / f"{table}.parquet"
    return parquet if parquet.exists() else folder / f"{table}.csv"


def _from_parquet(path: Path) -> pd.DataFrame:
    try:
        # a file of Arrow's own: a Python file would be let go by one of Arrow's threads, and a process that ends just
        # then is aborted; its name is bytes, as it need not be UTF-8
        with pa.OSFile(os.fsencode(path)) as file:
            return pd.read_parquet(file, page_checksum_verification=True)
    except Exception as error:  # damaged bytes: the library's errors are of many kinds
        _damaged(path, error)


def _from_csv(path: Path) -> pd.DataFrame:
    types_file = path.parent / COLUMN_TYPES
    try:
        types = (
            json.loads(types_file.read_text(encoding="utf-8"))[path.stem] if types_file.is_file() else None
        )
        return read_csv(path, types)
    except (
        OSError,
        KeyError,
        TypeError,
        ValueError,
        AttributeError,
        RecursionError,
        pa.ArrowException,
    ) as error:
        raise _refusal(path, f"the table does not match {COLUMN_TYPES} in its folder: {error}") from error


def _damaged(path: Path, error: Exception) -> NoReturn:
    reason = (str(error) or type(error).__name__).splitlines()[0]
    raise _refusal(path, f"the file is damaged: {reason}") from error


def _refusal(path: Path, what: str, *, column: str | None = None, key: str | None = None) -> ResultError:
    """Return the error of a run's file that cannot be used."""
    return ResultError(what, file=path, column=column, key=key, advice=_replay_again(path.parent))


def _checked(table: pd.DataFrame, path: Path) -> pd.DataFrame:
    """Return a table whose columns can be computed with.

    Raises
    ------
    ResultError : a column is missing, holds no numbers or no words where it should, or impossible numbers
    """
    # a table in CSV without its types was made by hand, of what its user needs
    is_ours = path.suffix != ".csv" or (path.parent / COLUMN_TYPES).is_file()
    for name in _COLUMNS[path.stem] if is_ours and len(table.columns) else ():
        if name not in table:
            raise _refusal(path, "the table has no such column", column=name)
    if not table.columns.is_unique:
        raise _refusal(path, "the table has two columns of one name")
    # pandas would copy them, deeply, for each column that is looked at
    attrs, table.attrs = table.attrs, {}
    for name in map(str, table.columns):
        if name in _WORDS:
            table = _with_words(table, name, path)
        elif name in _COLUMNS[path.stem] or name.startswith(("d_", "sd_")):
            _check_numbers(table, name, path)
    table.attrs = attrs
    return table


def _with_words(table: pd.DataFrame, name: str, path: Path) -> pd.DataFrame:
    words = table[name]
    if len(words) and words.isna().all() and name not in _COLUMNS[path.stem]:
        return table  # a word that no row has
    content = words.cat.categories if isinstance(words.dtype, pd.CategoricalDtype) else words
    if len(content) and not pd.api.types.is_string_dtype(content):
        raise _refusal(path, "the column does not hold words", column=name)
    if name in _COLUMNS[path.stem] and words.isna().any():
        raise _refusal(path, "an empty cell in the column", column=name)
    if name in _GROUPED and path.stem != "events" and not isinstance(words.dtype, pd.CategoricalDtype):
        return table.astype({name: "category"})
    return table


def _check_numbers(table: pd.DataFrame, name: str, path: Path) -> None:
    if not is_numeric_dtype(table[name]) or is_bool_dtype(table[name]):
        raise _refusal(path, "the column does not hold numbers", column=name)
    values = table[name].to_numpy(np.float64)
    bad = ~(np.abs(values) <= _LARGEST.get(name, _LARGEST_OF_OTHERS))  # not a number, too
    if name not in _LARGEST or path.stem not in ("nav", "measurements"):
        bad &= ~np.isnan(values)  # an empty cell; an event of a whole file has no time
    if bad.any():
        detail = f"{values[bad][0]:g} in row {int(np.argmax(bad)) + 1} cannot be true: the table is damaged"
        raise _refusal(path, detail, column=name)


def _settings(path: Path) -> dict[str, Any]:
    """Return a run's settings; those that are looked into later are of the right kind.

    Raises
    ------
    ResultError : the file is missing, is not JSON, or an entry is of another kind
    """
    if not path.is_file():
        raise ResultError(f"no {SETTINGS} in the folder", file=path.parent, advice=_run_advice(path.parent))
    try:
        settings = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        _damaged(path, error)
    if not isinstance(settings, dict):
        raise _refusal(path, "the file holds no table of settings")
    for keys in _TABLES_OF_SETTINGS:
        _check_entry(settings, keys, path, lambda value: isinstance(value, dict))
    for table in (("took",), ("filter", "gates")):
        for name in entry(settings, table) or {}:
            _check_entry(settings, (*table, name), path, _is_number)
    for keys in (("flight", "name"), ("filter", "name"), ("made",)):
        _check_entry(settings, keys, path, lambda value: isinstance(value, str))
    _check_entry(settings, ("filter", "heading", "known_below_deg"), path, _is_number)
    _check_entry(
        settings, ("flight", "gps_week"), path, lambda week: _is_number(week) and 0 <= week < _LARGEST_WEEK
    )
    return settings


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST_OF_OTHERS


def _check_entry(settings: Mapping[str, Any], keys: Sequence[str], path: Path, is_right: Any) -> None:
    value = entry(settings, keys)
    if value is not None and not is_right(value):
        key = ".".join(keys)
        raise _refusal(path, f"the entry cannot be {str(value)[:40]!r}", key=key)
