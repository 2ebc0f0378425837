"""What a command prints: a result as text, names unchanged with any brackets, or as one JSON object."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from insgnss.report.digest import without_nan

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console


def result_console(width: int = 120, *, quiet: bool = False) -> Console:
    """Return a console on standard output in which no text is markup."""
    from rich.console import Console  # late: a command that fails on its options does without the library

    return Console(file=sys.stdout, width=width, quiet=quiet, markup=False, emoji=False)


AsJson: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON object in place of the text, for scripts.")
]


def print_json(summary: dict[str, Any]) -> None:
    """Print a summary of plain data; numbers that JSON cannot write become null."""
    typer.echo(json.dumps(without_nan(summary), allow_nan=False, default=_plain))


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return a table's rows as plain data."""
    return [
        # NumPy's numbers as Python's, all else as it is
        {str(name): value.item() if hasattr(value, "item") else value for name, value in row.items()}
        for row in table.to_dict("records")
    ]


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else str(value)
