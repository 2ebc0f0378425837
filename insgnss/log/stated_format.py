"""The format that a log states itself: where a flight file declares none, and in errors of tables."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

from insgnss.config.flight import Base, FurtherAntenna, Gnss, LogFormat
from insgnss.errors import InputError, MissingFileError
from insgnss.log.detect import NAMES, Format, detect_format

# what a flight file calls the formats of GNSS logs that it may name; the others have to be converted
_DECLARED: Final[dict[Format, LogFormat]] = {
    "rinex_observation": "rinex",
    "ubx": "ubx",
    "sbf": "sbf",
    "android": "android",
}
# texts that a table may look like: one of Android's columns, or with a sentence in some lines
_LIKE_TABLES: Final[tuple[Format, ...]] = ("android", "nmea")
_Log = TypeVar("_Log", Gnss, Base)


def with_stated_format(log: _Log) -> _Log:
    """Return a GNSS log with the format that its first file states, where none is declared.

    A file that states none, or cannot be opened, leaves the default. Declared columns say that it is a table.
    """
    if not log.files or {"format", "columns"} & log.model_fields_set:
        return log
    stated = _stated(log.files[0])
    return log if stated not in _DECLARED else log.model_copy(update={"format": _DECLARED[stated]})


def with_stated_format_of_antenna(antenna: FurtherAntenna, main: Gnss) -> FurtherAntenna:
    """Return a further antenna with the format that its first file states, where none is declared.

    A file that states none has the format that ``main``, the table [gnss] as it is written, declares, else the default.
    Columns that [gnss] declares are also the antenna's: a table may look like Android's, but not like another format.
    """
    if antenna.format is not None:
        return antenna
    stated = _stated(antenna.files[0])
    like_table = stated in _LIKE_TABLES and "columns" in main.model_fields_set
    log_format = _DECLARED.get(stated) if stated is not None and not like_table else None
    default: LogFormat = (
        main.format if "format" in main.model_fields_set else Gnss.model_fields["format"].default
    )
    return antenna.model_copy(update={"format": log_format or default})


@contextmanager
def naming_format(path: Path, *, of_gnss: bool = False) -> Iterator[None]:
    """Name the format of a file that is read as a table, where that fails and it is a file of another kind.

    Parameters
    ----------
    of_gnss : a flight file may declare the log's format

    Raises
    ------
    InputError or a subclass : that of the reader; the advice names the format
    """
    try:
        yield
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
            advice=_advice(stated, error.advice, of_gnss=of_gnss),
        ) from error


def _stated(path: Path) -> Format | None:
    """Return the format that a file's content states, None without one."""
    try:
        return detect_format(path)
    except InputError:
        return None


def _advice(stated: Format, of_table: str, *, of_gnss: bool) -> str:
    """Return the advice of a file of a format, and that of the table which it may be after all."""
    todo = "'insgnss convert' writes its content as tables, with a flight file that names them"
    if of_gnss and stated in _DECLARED:
        todo = f"write format = '{_DECLARED[stated]}' beside files"
    elif stated == "rinex_navigation":
        todo = "name it under gnss.navigation"
    advice = f"this is a {NAMES[stated]} file, not a table: {todo}"
    return f"{advice}; if it is a table, {of_table}" if of_table and stated in _LIKE_TABLES else advice
