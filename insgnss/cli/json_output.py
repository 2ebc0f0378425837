"""What ``--json`` prints: one JSON object on standard output, and nothing else there."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from insgnss.report.digest import without_nan

if TYPE_CHECKING:
    import pandas as pd

AsJson: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON object in place of the text, for scripts.")
]


def print_json(summary: dict[str, Any]) -> None:
    """Print a summary of plain data; numbers that JSON cannot write become null."""
    typer.echo(json.dumps(without_nan(summary), allow_nan=False, default=_plain))


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return a table's rows as plain data."""
    return [{str(name): _number(value) for name, value in row.items()} for row in table.to_dict("records")]


def _number(value: Any) -> Any:
    """Return NumPy's numbers as Python's, all else as it is."""
    return value.item() if hasattr(value, "item") else value


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else str(value)
