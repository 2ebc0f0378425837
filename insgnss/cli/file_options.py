"""The options that name a command's files, and the line that says what it wrote and how long it took."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

from insgnss.errors import ConfigError

FlightFile: TypeAlias = Annotated[Path, typer.Argument(help="The flight file (TOML).")]
SavedRun: TypeAlias = Annotated[Path, typer.Argument(help="A saved run (its folder).")]
RunFolder: TypeAlias = Annotated[
    Path | None, typer.Option("--output", "-o", help="Folder for the run; without it nothing is saved.")
]
StudyFolder: TypeAlias = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Folder for tables and pictures; without it nothing is saved."),
]
RunPage: TypeAlias = Annotated[
    Path | None, typer.Option("--report", help="Also write the run's page, as 'insgnss report' does.")
]
Pictures: TypeAlias = Annotated[bool, typer.Option(help="Draw the pictures.")]
FormatName: TypeAlias = Annotated[str, typer.Option("--format", help="'parquet' or 'csv'.")]


def table_form(text: str) -> Literal["parquet", "csv"]:
    """Return the format of tables that an option names.

    Raises
    ------
    ConfigError : it is neither
    """
    if text == "parquet":
        return "parquet"
    if text == "csv":
        return "csv"
    raise ConfigError(f"unknown format '{text}'", key="--format", advice="write 'parquet' or 'csv'")


def tell_end(began: float, wrote: Path | str | None, before: str = "") -> None:
    """Print what a command wrote and how long it took [s]; ``before`` says what it read."""
    where = "nothing was written (no --output)" if wrote is None else f"wrote {wrote}"
    typer.echo(f"{before}{where}; {time.perf_counter() - began:.2f} s in all")
