"""``insgnss report``: one page of a saved run, that opens in any browser without a network."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from insgnss.cli.file_options import Force, SavedRun, run_files
from insgnss.cli.printing import AsJson, print_json
from insgnss.cli.progress import telling
from insgnss.results.saving import PAGE_KIND, check_file_replaceable, overwriting


def report(
    run: SavedRun,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Path of the page; by default report.html in the run's folder."),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option("--figures", help="Also write figures for a paper into this folder."),
    ] = None,
    form: Annotated[
        str, typer.Option("--figure-format", "--form", help="Format of the figures: pdf, svg or png.")
    ] = "pdf",
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write the report page of a run: summary, map, errors, satellites, innovations, events, settings."""
    began = time.perf_counter()
    place = run / "report.html" if output is None else output
    with overwriting(force, run_files(run)):
        # a file in place of the run is a wrong run, not a place that cannot be written
        if output is not None or not run.is_file():
            check_file_replaceable(place, PAGE_KIND)
        # pandas and Plotly are loaded only when the command runs
        from insgnss.report.figures import check_figures, save_figures
        from insgnss.report.page import write_report
        from insgnss.runs.result import Run

        with telling("drawing"):
            loaded = Run.load(run)
            if figures is not None:
                check_figures(loaded, figures, form)
            page = write_report(loaded, place)
            drawn = [] if figures is None else save_figures(loaded, figures, form)
    if as_json:
        written = [str(path) for path in (page, *drawn)]
        print_json({"bytes": page.stat().st_size, "wrote": written})
        return
    size = page.stat().st_size / 1e6
    more = f" and {len(drawn)} figures into {figures}" if drawn else ""
    typer.echo(f"wrote {page} ({size:.1f} MB){more}; {time.perf_counter() - began:.2f} s in all")
