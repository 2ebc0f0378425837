"""The options of ``replay`` and ``smooth`` that say which rows, at which times, with which columns."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from insgnss.errors import ColumnError, ConfigError, InputError, MissingFileError

Rate = Annotated[
    str,
    typer.Option("--rate", help="Navigation rows: 'gnss' (each epoch), 'imu' (each sample) or a rate in Hz."),
]
Times = Annotated[
    Path | None,
    typer.Option(
        "--times", help="File of times for the rows instead: column time_s (CSV), or one to a line."
    ),
]
PointOption = Annotated[
    str | None,
    typer.Option(
        "--point",
        help="Also where a point of the body is: forward,right,down in m from the IMU, or its name in the flight file.",
    ),
]
Quaternion = Annotated[
    bool, typer.Option("--quaternion", help="Also the attitude as a quaternion, body to north-east-down.")
]
Covariance = Annotated[
    bool, typer.Option("--covariance", help="Also the covariances of position, velocity and attitude.")
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
        raise ConfigError("--rate and --times say the same thing twice", key="--times", advice="give one")
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
        raise ConfigError(f"a rate of {text} Hz cannot be written", key="--rate", advice=advice)
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


def read_times(path: Path) -> list[float]:
    """Return the times of a file: its column ``time_s``, or its only column, with a name above it or not.

    Raises
    ------
    MissingFileError, InputError, ColumnError : it cannot be read, has no such column, or a cell is not a number
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [(at, row) for at, row in enumerate(csv.reader(file), start=1) if any(map(str.strip, row))]
    except FileNotFoundError:
        raise MissingFileError("no such file", file=path, advice="check the path") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot be read: {error}", file=path, advice="give a text file") from error
    head = [cell.strip() for cell in rows[0][1]] if rows else []
    column = head.index("time_s") if "time_s" in head else 0
    if "time_s" in head or (len(head) == 1 and not _is_number(head[0])):
        rows = rows[1:]
    elif len(head) > 1:
        raise ColumnError(
            "no column 'time_s'", file=path, line=rows[0][0], advice="name the column of the times time_s"
        )
    for at, row in rows:
        if len(row) <= column or not _is_number(row[column]):
            raise ColumnError(
                "no time in seconds of the GPS week",
                file=path,
                line=at,
                column="time_s",
                advice="mend the line",
            )
    if not rows:
        raise InputError("holds no times", file=path, advice="write one to a line")
    return [float(row[column]) for _, row in rows]


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
