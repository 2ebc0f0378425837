"""A flight file's logs that state their format themselves: those without a declared one, and those taken for tables."""

from __future__ import annotations

from pathlib import Path
from typing import Final, TypeVar

from insgnss.config.flight import Base, Gnss, LogFormat
from insgnss.errors import InputError, MissingFileError
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import CsvTable, read_csv_table
from insgnss.log.detect import NAMES, Format, detect_format

# what a flight file calls the formats of GNSS logs that it may name; the others have to be converted
_DECLARED: Final[dict[Format, LogFormat]] = {
    "rinex_observation": "rinex",
    "ubx": "ubx",
    "sbf": "sbf",
    "android": "android",
}
_Log = TypeVar("_Log", Gnss, Base)


def with_stated_format(log: _Log) -> _Log:
    """Return a GNSS log with the format that its first file states, where neither format nor columns are declared.

    A file that states none, or cannot be opened, leaves the default; declared columns say that the log is a table.
    """
    if not log.files or {"format", "columns"} & log.model_fields_set:
        return log
    stated = _stated(log.files[0])
    return log if stated not in _DECLARED else log.model_copy(update={"format": _DECLARED[stated]})


def read_table(path: Path, wanted: ColumnSelection, *, of_gnss: bool = False) -> CsvTable:
    """Read a log that is declared as a table, as ``read_csv_table``; the advice names the format of one that is none.

    ``of_gnss`` : a flight file may also declare the log's format

    Raises
    ------
    InputError or a subclass : as ``read_csv_table``
    """
    try:
        return read_csv_table(path, wanted)
    except MissingFileError:
        raise
    except InputError as error:
        stated = _stated(path)
        if stated is None:
            raise
        raise type(error)(
            error.message,
            file=error.file,
            line=error.line,
            column=error.column,
            advice=_advice(stated, of_gnss=of_gnss),
        ) from error


def _stated(path: Path) -> Format | None:
    """Return the format that a file's content states, None without one."""
    try:
        return detect_format(path)
    except InputError:
        return None


def _advice(stated: Format, *, of_gnss: bool) -> str:
    what = f"this is a {NAMES[stated]} file, not a table"
    if of_gnss and stated in _DECLARED:
        return f"{what}: write format = '{_DECLARED[stated]}' beside files"
    if stated == "rinex_navigation":
        return f"{what}: name it under gnss.navigation"
    return f"{what}: 'insgnss convert' writes its content as tables, with a flight file that names them"
