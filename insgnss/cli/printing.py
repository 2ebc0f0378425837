"""What a command prints: a result as text, names unchanged with any brackets, or as one JSON object."""

from __future__ import annotations

import json
import sys
from collections.abc import Container, Iterable
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from insgnss.report.digest import without_nan

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console
    from rich.table import Table


def result_console(width: int = 120, *, quiet: bool = False) -> Console:
    """Return a console on standard output in which no text is markup."""
    from rich.console import Console  # late: a command that fails on its options does without the library

    return Console(file=sys.stdout, width=width, quiet=quiet, markup=False, emoji=False)


def text_table(
    title: str | None,
    heads: Iterable[str],
    rows: Iterable[Iterable[str]],
    *,
    left: Container[str] = ("",),
    caption: str | None = None,
) -> Table:
    """Return a table of texts: the columns under the heads ``left`` stand to the left, the others to the right."""
    from rich.table import Table

    table = Table(title=title, caption=caption)
    for head in heads:
        table.add_column(head, justify="left" if head in left else "right")
    for row in rows:
        table.add_row(*row)
    return table


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
