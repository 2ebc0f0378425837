"""The options that name a command's files, what it may replace, and the line that says what it wrote."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

from insgnss.errors import ConfigError
from insgnss.results.saving import check_replaceable

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
    Path | None,
    typer.Option("--report", help="Also write the report page to this path, as 'insgnss report' does."),
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


Force: TypeAlias = Annotated[
    bool, typer.Option("--force", help="Replace files that this program did not write, or that were changed.")
]


def run_files(*runs: Path | None) -> list[Path]:
    """Return the files that saved runs may be made of, and any other source as it is."""
    from insgnss.runs.result import FILES  # with pandas, late

    return [path for run in runs if run is not None for path in (run, *(run / name for name in FILES))]


def check_files(output: Path | None, names: Iterable[str], kind: str) -> None:
    """Refuse an output folder in which a file of another program has one of the names; None: nothing is written.

    Raises
    ------
    ResultError : there is such a file, or nothing can be written there
    """
    if output is not None:
        check_replaceable(output, names, kind)
