"""``insgnss compare``: saved runs of one flight against each other, in numbers and on a page."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insgnss.cli.file_options import Force, run_files, tell_end
from insgnss.cli.printing import AsJson, print_json, result_console, text_table
from insgnss.cli.progress import telling
from insgnss.errors import ConfigError
from insgnss.results.saving import PAGE_KIND, check_file_replaceable, overwriting

if TYPE_CHECKING:
    from rich.table import Table

    from insgnss.report.compare import Comparison


def compare(
    runs: Annotated[
        list[Path], typer.Argument(help="Saved runs (their folders); the others are compared with the first.")
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Path of the comparison page; without it none is written."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Compare runs of a flight: differences over time, statistics, sigmas side by side."""
    began = time.perf_counter()
    with overwriting(force, run_files(*runs)):
        if len(runs) < 2:
            raise ConfigError("only one run is given", key="RUNS", advice="give two or more")
        if output is not None:
            check_file_replaceable(output, PAGE_KIND)
        # pandas and Plotly are loaded only when the command runs
        from insgnss.report.compare import compare_runs, write_comparison
        from insgnss.runs.result import Run

        with telling("comparing"):
            loaded = {name: Run.load(path) for name, path in zip(_names(runs), runs, strict=True)}
            comparison = compare_runs(loaded)
            page = None if output is None else write_comparison(comparison, output)
    if as_json:
        print_json({**comparison.as_json(), "wrote": page})
        return
    result_console().print(_table(comparison))
    tell_end(began, page, f"read {len(runs)} runs; ")


def _names(paths: list[Path]) -> list[str]:
    """Return a name for each folder: its own if unique, else the path, else numbered."""
    for given in ([path.resolve().name for path in paths], [str(path) for path in paths]):
        names = [name.encode("utf-8", "backslashreplace").decode() for name in given]
        if len(set(names)) == len(names):
            return names
    return [f"{name} ({i})" for i, name in enumerate(names, 1)]


def _table(comparison: Comparison) -> Table:
    from insgnss.report.labels import label, number

    title = f"difference from '{comparison.first}', sigma, error against the flight's reference"
    heads = ("run", "", "mean", "rms", "95 %", "largest", "median sigma", "rms error")
    table, last = text_table(title, heads, (), left=("run", ""), caption=str(comparison.span)), ""
    for row in comparison.statistics.itertuples(index=False, name=None):
        if row[0] != last and last:
            table.add_section()
        last = row[0]
        table.add_row(row[0], label(row[1]).axis(), *(number(float(value)) for value in row[2:]))
    return table
