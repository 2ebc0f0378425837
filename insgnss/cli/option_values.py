"""Options that hold several values with commas between them, and options that a command would not use."""

from __future__ import annotations

import math
from collections.abc import Container

import typer

from insgnss.errors import ConfigError


def names_in(text: str) -> tuple[str, ...]:
    """Return the names, without blanks and without empty ones."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def numbers_in(text: str, key: str) -> list[float]:
    """Return the numbers.

    Raises
    ------
    ConfigError : one of them is not a finite number; ``key`` is the option
    """
    numbers = [_number_or_nan(name) for name in names_in(text)]
    if not numbers or not all(map(math.isfinite, numbers)):
        raise ConfigError(f"'{text}' is not a list of numbers", key=key, advice="write them as in 45,40,35")
    return numbers


def _number_or_nan(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def refuse_given(context: typer.Context, names: Container[str], when: str) -> None:
    """Refuse options that stand on the command line and are not used.

    Parameters
    ----------
    context : of the command
    names : of the options, as its function has them
    when : in which they are not used, as in "with a run"

    Raises
    ------
    ConfigError : one of them is given
    """
    given = [
        option.opts[0]
        for option in context.command.params
        if option.name in names and _stands_there(context, str(option.name))
    ]
    if given:
        verb = "is" if len(given) == 1 else "are"
        raise ConfigError(f"{', '.join(given)} {verb} not used {when}", key=given[0], advice="leave it out")


def _stands_there(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
