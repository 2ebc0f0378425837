"""The exception tree: every error that a user can meet says where it happened and what to do.

A rejected measurement is data with a reason (see ``insgnss.status``), never an exception.
"""

from __future__ import annotations

from pathlib import Path


class InsGnssError(Exception):
    """Base of all errors raised on purpose; ``exit_code`` is what the command line returns.

    Parameters
    ----------
    message : the error
    advice : what to do about it
    file, line, column, key, satellite : where it is, as far as known
    """

    exit_code = 1

    def __init__(
        self,
        message: str,
        *,
        advice: str = "",
        file: str | Path | None = None,
        line: int | None = None,
        column: str | None = None,
        key: str | None = None,
        satellite: str | None = None,
    ) -> None:
        self.message = message
        self.advice = advice
        self.file = None if file is None else str(file)
        self.line = line
        self.column = column
        self.key = key
        self.satellite = satellite
        super().__init__(str(self))

    def place(self) -> str:
        """Return the place of the error as ``file:line, column 'c'``, empty when unknown."""
        parts = []
        if self.file is not None:
            parts.append(self.file if self.line is None else f"{self.file}:{self.line}")
        elif self.line is not None:
            parts.append(f"line {self.line}")
        if self.column is not None:
            parts.append(f"column '{self.column}'")
        if self.key is not None:
            # the options of a command begin with a dash
            parts.append(f"{'option' if self.key.startswith('-') else 'key'} '{self.key}'")
        if self.satellite is not None:
            parts.append(f"satellite {self.satellite}")
        return ", ".join(parts)

    def __str__(self) -> str:
        place = self.place()
        text = f"{place}: {self.message}" if place else self.message
        return f"{text}\n  -> {self.advice}" if self.advice else text


class ConfigError(InsGnssError):
    """A flight, filter or model file is wrong: unknown key, impossible value, missing entry."""

    exit_code = 2


class InputError(InsGnssError):
    """A log cannot be read or contradicts what the flight file declares."""

    exit_code = 3


class MissingFileError(InputError):
    """A file that the flight file names does not exist."""


class ColumnError(InputError):
    """A column is missing, or its cells are not what the column holds."""


class UnitsError(InputError):
    """The numbers of a sensor contradict the declared units or axes; ``fits`` are keys and values that would fit."""

    fits: tuple[tuple[str, str], ...] = ()


class TimeError(InputError):
    """Time tags cannot be used: no overlap, wrong unit, wrong time scale."""


class NavigationDataError(InputError):
    """Broadcast navigation data is missing, empty or of the wrong week."""


class GeometryError(InputError):
    """The geometry of antennas or satellites does not determine the requested quantity."""


class StartError(InsGnssError):
    """The filter could not be started: no position, no inertial data, or a contradictory start."""

    exit_code = 4


class ModelError(InsGnssError):
    """A name was not found in the model library."""

    exit_code = 2


class ResultError(InsGnssError):
    """A saved run cannot be read or written."""

    exit_code = 5


class MeasurementError(InsGnssError):
    """A user's own measurement has an impossible name, times or gate, or gives rows that cannot be used.

    Where its code raised an exception, that one is the cause (``__cause__``).
    """

    exit_code = 2
