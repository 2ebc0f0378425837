"""The options of ``replay`` and ``smooth`` that say which rows, at which times, with which columns."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer

from insgnss.errors import ColumnError, ConfigError, InputError, MissingFileError
from insgnss.log.csv.cells import NUMBER
from insgnss.log.csv.dialect import DELIMITERS, is_comment, is_data, split_cells
from insgnss.runs.wanted_times import dated_text_ns

_TIME_COLUMNS: Final = ("time_s", "utc")
_WRITE_TIMES: Final = "write seconds of the GPS week, or dates with a zone: 2025-09-24T09:36:22.25Z"
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d+,\d+")
_THOUSANDS: Final = re.compile(r"[+-]?\d{1,3},\d{3}")  # or a decimal comma: both could be meant

Rate = Annotated[
    str,
    typer.Option("--rate", help="Navigation rows: 'gnss' (each epoch), 'imu' (each sample) or a rate in Hz."),
]
Times = Annotated[
    Path | None,
    typer.Option(
        "--times",
        help="File of output times, in place of --rate: column time_s or utc (CSV), or one time per line; seconds of"
        " the GPS week, or UTC such as 2025-09-24T09:36:22.25Z.",
    ),
]
PointOption = Annotated[
    str | None,
    typer.Option(
        "--point",
        help="Also write position and velocity of a point of the body: forward,right,down in m from the IMU, or its"
        " name in the flight file.",
    ),
]
Quaternion = Annotated[
    bool,
    typer.Option("--quaternion", help="Also write the attitude as a quaternion, body to north-east-down."),
]
Covariance = Annotated[
    bool, typer.Option("--covariance", help="Also write the covariances of position, velocity and attitude.")
]


def rows_wanted(
    rate: str, times: Path | None, point: str | None, *, quaternion: bool, covariance: bool
) -> dict[str, Any]:
    """Return the arguments of ``insgnss.replay`` for these options.

    Raises
    ------
    ConfigError, InputError : an option or the file of times cannot be used
    """
    if times is not None and rate != "gnss":
        raise ConfigError("--rate and --times exclude each other", key="--times", advice="give one of them")
    output = rate_of(rate) if times is None else read_times(times)
    return {
        "output": output,
        "point": None if point is None else point_of(point),
        "quaternion": quaternion,
        "covariance": covariance,
    }


def rate_of(text: str) -> Literal["gnss", "imu"] | float:
    """Return the output rate an option names."""
    if text == "gnss":
        return "gnss"
    if text == "imu":
        return "imu"
    advice = "write 'gnss', 'imu' or a rate in Hz, as in --rate 10"
    try:
        rate = float(text)
    except ValueError:
        raise ConfigError(f"invalid output rate '{text}'", key="--rate", advice=advice) from None
    if not 0.0 < rate <= 1e5:
        raise ConfigError(f"output rate {text} Hz is out of range", key="--rate", advice=advice)
    return rate


def point_of(text: str) -> str | list[float]:
    """Return the coordinates that an option has, or the name of a point."""
    parts = text.split(",")
    if len(parts) == 1:
        return text
    try:
        return [float(part) for part in parts]
    except ValueError:
        raise ConfigError(
            f"invalid point '{text}'",
            key="--point",
            advice="write forward,right,down in metres, as in --point=1.2,0,-0.5, or a name of the flight file",
        ) from None


def read_times(path: Path) -> list[float | str]:
    """Return the times of a file: its column ``time_s`` or ``utc``, or its only column, with a name above it or not.

    Seconds of the GPS week become numbers; dates with a zone stay text. Columns are parted by commas, semicolons, tabs
    or white space; decimal commas are read where they cannot be delimiters. Lines that begin with # are comments.

    Raises
    ------
    MissingFileError, InputError, ColumnError : it cannot be read, has no such column, or a cell is not a time
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise MissingFileError("no such file", file=path, advice="check the path") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read: {error}", file=path, advice="give a text file") from error
    numbered = enumerate(map(str.strip, text.splitlines()), start=1)
    lines = [(at, line) for at, line in numbered if line and not is_comment(line)]
    if not lines:
        raise InputError("holds no times", file=path, advice=_WRITE_TIMES)
    at, head = lines[0]
    candidates = [(d, split_cells(head, d)) for d in DELIMITERS]
    named = [(d, cells) for d, cells in candidates if set(cells) & set(_TIME_COLUMNS)]
    if named:
        delimiter, cells = max(named, key=lambda one: len(one[1]))
        name = next(name for name in _TIME_COLUMNS if name in cells)
        place, width = cells.index(name), len(cells)
    else:
        delimiter, place, width, name = None, 0, 1, "time_s"
        if any(len(cells) > 1 for d, cells in candidates if d != " "):
            raise ColumnError(
                "no column 'time_s' or 'utc'",
                file=path,
                line=at,
                advice="name the column of the times in a header",
            )
    if named or not is_data(head):
        lines = lines[1:]
    if not lines:
        raise InputError("holds no times", file=path, advice=_WRITE_TIMES)
    rows = [(at, [line] if width == 1 else split_cells(line, str(delimiter))) for at, line in lines]
    return [_time_of(row, place, width, (path, at, name)) for at, row in rows]


def _time_of(row: list[str], place: int, width: int, where: tuple[Path, int, str]) -> float | str:
    """Return the time of one row: a number, or the text of a date with a zone."""
    file, line, column = where
    refused = partial(ColumnError, file=file, line=line, column=column)
    while len(row) > width and not row[-1]:
        row = row[:-1]  # the line ends with delimiters
    if len(row) > width:
        advice = "write decimal points, or separate the columns by semicolons"
        raise refused(f"{len(row)} cells, but the header names {width}", advice=advice)
    if len(row) <= place or not row[place]:
        raise refused("no time", advice=_WRITE_TIMES)
    cell = row[place].strip("\"'")
    if re.fullmatch(NUMBER, cell):
        return float(cell)
    if _DECIMAL_COMMA.fullmatch(cell):
        if width == 1 or _THOUSANDS.fullmatch(cell):
            raise refused(
                f"'{cell}' has a comma", advice="write a decimal point, and no thousands separators"
            )
        return float(cell.replace(",", "."))
    moment = dated_text_ns([cell])[0]
    if isinstance(moment, str):
        raise refused(f"'{cell}' {moment}", advice=_WRITE_TIMES)
    return cell
