"""How a command ends: an error of ours becomes its text on standard error and its exit code, never a traceback.

A warning of ours becomes its text alone, without the line of the program that gave it.

Functions name their arguments in their errors; the user of a command knows its options. ``names_of_options`` says which
is which, for all commands alike.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, Final

import typer

from insgnss.errors import InsGnssError

_UNITS: Final = ("", "_s", "_m", "_deg", "_hz", "_dbhz", "_db", "_chips", "_dbic", "_bytes")
_ARGUMENT: Final = re.compile(r"\b[a-z][a-z0-9]*(?:_[a-z0-9]+)+\b")  # in a text: two words or more
# arguments of functions whose option has another name; an error names all of them that the command has
_OTHER_NAMES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "output": ("--times", "--rate"),  # of rows; no argument names the folder of a result
        "average_s": ("--average-from",),
        "from_s": ("--from",),
        "least_cn0_dbhz": ("--min-cn0",),
        "told_cn0_dbhz": ("--assumed-cn0",),
        "estimates_cn0": ("--estimate",),
        "losses_db": ("--loss",),
        "coherent_s": ("--look",),
        "block_s": ("--look",),
        "windows": ("--window",),
        "threshold_ratio": ("--threshold",),
        "drift_density": ("--oscillator",),
    }
)


@contextmanager
def own_errors_told(options: Callable[[str], str] = str) -> Iterator[None]:
    """Turn an ``InsGnssError`` into its message and exit code, and a warning of the package into its text.

    ``options`` returns the name by which the user knows an argument that an error names.
    """
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _sentence_of(warnings.showwarning)
            yield
    except InsGnssError as error:
        # a key of a file is called what the file calls it
        if error.file is None:
            error.key = None if error.key is None else options(error.key)
            error.message, error.advice = (
                _ARGUMENT.sub(lambda word: options(word[0]), text) for text in (error.message, error.advice)
            )
        print(f"error: {error}", file=sys.stderr)
        raise typer.Exit(error.exit_code) from None


def names_of_options(options: Mapping[str, str]) -> Callable[[str], str]:
    """Return a function from an argument's name to that of the option that it comes from, or to itself.

    Parameters
    ----------
    options : of a command: their names by those of the arguments of its function
    """

    def option_of(key: str) -> str:
        others = [name for name in _OTHER_NAMES.get(key, ()) if name in options.values()]
        if others:
            return ", ".join(others)
        stems = [key.removesuffix(unit) for unit in _UNITS if key.endswith(unit)]
        return next((options[stem] for stem in stems if stem in options), key)

    return option_of


@contextmanager
def argument_of(option: str, *keys: str) -> Iterator[None]:
    """Name an option in errors of this block: for arguments, ``keys``, that several options of a command give."""
    try:
        yield
    except InsGnssError as error:
        if error.key in keys and error.file is None:
            error.key = option
        raise


def _sentence_of(otherwise: Callable[..., None]) -> Callable[..., None]:
    """Return a ``warnings.showwarning`` for warnings of this package; those of others go to ``otherwise``."""
    own = __name__.partition(".")[0]

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if category.__module__.partition(".")[0] == own:
            print(f"warning: {message}", file=sys.stderr)
        else:
            otherwise(message, category, *place, **more)

    return show
