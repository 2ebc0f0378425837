"""How a command ends: an error of ours becomes its text on standard error and its exit code, never a traceback.

A warning of ours becomes its text alone, without the line of the program that gave it.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

import typer

from insgnss.errors import InsGnssError

# what the options are called in Python, where an error may arise that names them
_OPTIONS: Final = {"output": "--rate, --times", "point": "--point"}


@contextmanager
def own_errors_told() -> Iterator[None]:
    """Turn an ``InsGnssError`` into its message and exit code, and a warning of the package into its text."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _sentence_of(warnings.showwarning)
            yield
    except InsGnssError as error:
        error.key = _OPTIONS.get(str(error.key), error.key)
        print(f"error: {error}", file=sys.stderr)
        raise typer.Exit(error.exit_code) from None


def _sentence_of(otherwise: Callable[..., None]) -> Callable[..., None]:
    """Return a ``warnings.showwarning`` for warnings of this package; those of others go to ``otherwise``."""
    own = __name__.partition(".")[0]

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if category.__module__.partition(".")[0] == own:
            print(f"warning: {message}", file=sys.stderr)
        else:
            otherwise(message, category, *place, **more)

    return show
