"""``insgnss point``: solves every GNSS epoch for itself, prints the summary, writes the tables."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from insgnss.cli.file_options import (
    FlightFile,
    Force,
    FormatName,
    StudyFolder,
    check_files,
    table_form,
    tell_end,
)
from insgnss.cli.filter_options import FilterName, Settings, chosen_filter
from insgnss.cli.printing import AsJson, print_json, result_console, text_table
from insgnss.cli.progress import compiling, telling
from insgnss.results.saving import overwriting

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from insgnss.runs.point import PointRun

_MEDIANS: Final = ["n_used", "gdop", "hdop", "vdop", "hpl_m", "vpl_m", "sd_n_m", "sd_e_m", "sd_d_m"]


def point(
    flight: FlightFile,
    output: StudyFolder = None,
    filter: FilterName = "tight",
    settings: Settings = None,
    false_alarm: Annotated[
        float, typer.Option("--false-alarm", help="Probability that an epoch without a fault is refused.")
    ] = 1e-3,
    missed_detection: Annotated[
        float,
        typer.Option(
            "--missed-detection",
            help="Probability of missed detection of a fault that exceeds the protection level.",
        ),
    ] = 1e-3,
    format: FormatName = "parquet",
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Solve each GNSS epoch independently: position, velocity, clocks, DOP, residuals, fault exclusion."""
    began = time.perf_counter()
    with overwriting(force):
        form = table_form(format)
        # pandas and the compiled code are loaded only once the options are known to be right
        from insgnss.log.flight import Flight
        from insgnss.runs.point import FILES, STUDY_NAME
        from insgnss.runs.point import point as solve

        chosen = chosen_filter(filter, settings)
        loaded = Flight.load(flight)
        with overwriting(force, loaded.files()), telling("starting") as tell:
            check_files(output, FILES, STUDY_NAME)
            run = solve(
                loaded,
                chosen,
                false_alarm=false_alarm,
                missed_detection=missed_detection,
                progress=tell,
            )
            if output is not None:
                tell("saving the tables")
                run.save(output, form)
    n_read = len(loaded.files()) - len(loaded.inertial_files())
    if as_json:
        print_json({**_digest(loaded.name, run), "files_read": n_read, "wrote": output})
        return
    _print_summary(result_console(), loaded.name, run)
    tell_end(began, output, f"read {n_read} files; ")


def _digest(name: str, run: PointRun) -> dict[str, Any]:
    """Return the summary as plain data."""
    reference = run.errors is not None and not run.errors.empty
    return {
        "flight": name,
        "epochs": len(run.point),
        "trusted": int(run.trusted().sum()),
        "verdicts": run.verdict_counts().to_dict(),
        "measurements": run.status_counts().to_dict(),
        "errors": run.error_summary().to_dict(orient="index") if reference else {},
        "median": {label: float(value) for label, value in run.point[_MEDIANS].median().items()},
        "took": dict(run.settings["took"]),
    }


def _print_summary(console: Console, name: str, run: PointRun) -> None:
    """Print verdicts, errors against the reference, satellites and dilution, residuals by satellite."""
    table, took = run.point, run.settings["took"]
    console.print(
        f"{name}: {len(table)} epochs, {int(run.trusted().sum())} with a trusted position",
        highlight=False,
    )
    console.print(_count_table(run))
    if run.errors is not None and not run.errors.empty:
        console.print(_error_table(run))
    middle = table[_MEDIANS].median()
    console.print(
        "median: " + ", ".join(f"{label} {value:.2f}" for label, value in middle.items()), highlight=False
    )
    rate = len(table) / max(took["solve_s"], 1e-9)
    console.print(
        f"{compiling(took)}reading {took['read_s']:.2f} s, solving {took['solve_s']:.2f} s ({rate:.0f} epochs/s)",
        highlight=False,
    )


def _count_table(run: PointRun) -> Table:
    """Return the number of epochs with each verdict, and of rows with each status."""
    verdicts = ((str(name), *(str(int(n)) for n in row)) for name, row in run.verdict_counts().iterrows())
    table = text_table("epochs and measurements", ("", "position", "velocity"), verdicts)
    table.add_section()
    for status, row in run.status_counts().iterrows():
        table.add_row(str(status), *(str(int(row.get(kind, 0))) for kind in ("pseudorange", "range_rate")))
    return table


def _error_table(run: PointRun) -> Table:
    """Return the errors of the trusted epochs against the reference."""
    rows, summary = [], run.error_summary()
    for label, row in summary[summary["n"] > 0].iterrows():  # a reference may have no vertical velocity
        stem, _, unit = str(label).rpartition("_")
        sizes = (f"{row[name]:.3f}" for name in ("p50", "p95", "max"))
        rows.append((f"{stem}, {'m/s' if unit == 'mps' else unit}", str(int(row["n"])), *sizes))
    return text_table("trusted epochs against reference", ("", "epochs", "50 %", "95 %", "largest"), rows)
