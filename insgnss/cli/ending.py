"""How a command ends: an error of ours becomes its text on standard error and its exit code, never a traceback."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from insgnss.errors import InsGnssError


@contextmanager
def own_errors_told() -> Iterator[None]:
    """Turn an ``InsGnssError`` into its message and exit code."""
    try:
        yield
    except InsGnssError as error:
        print(f"error: {error}", file=sys.stderr)
        raise typer.Exit(error.exit_code) from None
