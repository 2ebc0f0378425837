"""``insgnss columns``: the meaning of each column of a table."""

from __future__ import annotations

from typing import Annotated

import typer


def columns(
    table: Annotated[
        str | None, typer.Argument(help="A table: imu.csv, nav, measurements, ...; by default all.")
    ] = None,
) -> None:
    """Print the names, units and meanings of the columns of all tables, or of one, as Markdown."""
    from insgnss.errors import ConfigError
    from insgnss.runs.columns.page import SHEETS, columns_page, sheet_text

    if table is not None and table not in SHEETS:
        raise ConfigError(f"unknown table '{table}'", key="TABLE", advice=f"one of: {', '.join(SHEETS)}")
    typer.echo(columns_page() if table is None else sheet_text(SHEETS[table]), nl=False)
