"""``insgnss replay``: runs the filter over a flight, prints the summary, writes the run folder."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pandas as pd
import typer
from rich.console import Console
from rich.table import Table

from insgnss.cli.command import at_least
from insgnss.cli.file_options import (
    FlightFile,
    Force,
    FormatName,
    RunFolder,
    RunPage,
    check_files,
    table_form,
    tell_end,
)
from insgnss.cli.filter_options import FilterName, Integrity, Settings, chosen_filter
from insgnss.cli.memory import give_back_what_is_freed
from insgnss.cli.printing import AsJson, print_json, result_console, text_table
from insgnss.cli.progress import compiling, telling
from insgnss.cli.rows import Covariance, PointOption, Quaternion, Rate, Times, rows_wanted
from insgnss.log.flight import Flight
from insgnss.report.digest import digest
from insgnss.report.epochs import pseudoranges_used
from insgnss.results.saving import PAGE_KIND, RUN_KIND, check_file_replaceable, overwriting
from insgnss.runs.replay import replay as run_replay
from insgnss.runs.result import FILES, Run

if TYPE_CHECKING:
    from insgnss.config.filter import FilterConfig
    from insgnss.results.table_files import TableFormat

_EVENTS_SHOWN = 25
_UNITS = {"m": "m", "mps": "m/s", "deg": "deg"}


def replay(
    flight: FlightFile,
    output: RunFolder = None,
    filter: FilterName = "tight",
    settings: Settings = None,
    rate: Rate = "gnss",
    times: Times = None,
    point: PointOption = None,
    quaternion: Quaternion = False,
    covariance: Covariance = False,
    supervise: Annotated[
        bool,
        typer.Option(
            "--supervise", help="Also report what the receiver should do for each satellite, and when."
        ),
    ] = False,
    integrity: Integrity = False,
    aiding: Annotated[
        float | None,
        typer.Option(
            "--aiding",
            callback=at_least(0.01, 1e5),
            help="Also predict Doppler and code for the tracking loops, at this rate in Hz.",
        ),
    ] = None,
    format: FormatName = "parquet",
    report: RunPage = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Run the filter over a flight's logs, print a summary, write the result tables."""
    with overwriting(force):
        outputs = output, report, table_form(format)
        asked = rows_wanted(rate, times, point, quaternion=quaternion, covariance=covariance)
        asked |= {"aiding": aiding, "supervise": supervise, "integrity": integrity}
        run_and_tell(flight, chosen_filter(filter, settings), outputs, asked, force=force, as_json=as_json)


def run_and_tell(
    flight: Path,
    chosen: FilterConfig,
    outputs: tuple[Path | None, Path | None, TableFormat],
    asked: dict[str, Any],
    *,
    force: bool,
    as_json: bool,
) -> None:
    """Run a filter over a flight, save what is wanted, and print the result.

    Parameters
    ----------
    outputs : folder of the run, its page, and the form of its tables
    asked : arguments of ``insgnss.runs.replay.replay``
    """
    began = time.perf_counter()
    give_back_what_is_freed()
    output, report, form = outputs
    loaded = Flight.load(flight)
    with overwriting(force, loaded.files()), telling("starting") as tell:
        check_outputs(output, report)
        run = run_replay(loaded, chosen, progress=tell, **asked)
        written = write_run(run, output, report, form, tell)
    tell_run(loaded, run, written, began, as_json=as_json)


def check_outputs(output: Path | None, report: Path | None) -> None:
    """Refuse outputs that would replace files of other programs, before any work is done."""
    check_files(output, FILES, RUN_KIND)
    if report is not None:
        check_file_replaceable(report, PAGE_KIND)


def write_run(
    run: Run,
    output: Path | None,
    report: Path | None,
    form: TableFormat,
    tell: Callable[[str], None],
) -> list[str]:
    """Save a run and draw its page on request; return the files written."""
    if output is not None:
        tell("saving the run")
        run.save(output, form)
    if report is not None:
        tell("drawing the page")
        run.report(report)
    return [str(path) for path in (output, report) if path is not None]


def tell_run(flight: Flight, run: Run, written: list[str], began: float, *, as_json: bool) -> None:
    """Print a run's summary, the files read and written, and the time taken; or one JSON object."""
    if as_json:
        print_json({**digest(run), "files_read": len(flight.files()), "wrote": written})
        return
    _print_summary(flight, run)
    tell_end(began, " and ".join(written) or None, f"read {len(flight.files())} files; ")


def _print_summary(flight: Flight, run: Run) -> None:
    """Print the run's results: times, errors and sigmas, satellites, refusals, NIS, events."""
    console = result_console()
    nav = run.nav
    took = run.settings["took"]
    span = nav["time_s"].iloc[-1] - nav["time_s"].iloc[0]
    console.print(f"{flight.name}: {len(nav)} navigation rows over {span:.1f} s", highlight=False)
    console.print(_accuracy_table(run))
    console.print(_measurement_table(run))
    used = pseudoranges_used(run)
    if len(used):
        console.print(
            "pseudoranges used per epoch, a satellite once for each band:"
            f" {used.min()} to {used.max()}, mean {used.mean():.1f}",
            highlight=False,
        )
    _print_events(console, run)
    _print_aiding(console, run)
    _print_supervision(console, run)
    console.print(
        f"{compiling(took)}reading {took['read_s']:.2f} s, filter {took['filter_s']:.2f} s,"
        f" tables {took['tables_s']:.2f} s",
        highlight=False,
    )


def _print_events(console: Console, run: Run) -> None:
    """Print the first events; the others are in the table."""
    events = run.events
    rows = zip(events["time_s"].tolist(), events["kind"].tolist(), events["detail"].tolist(), strict=True)
    for time_s, kind, detail in list(rows)[:_EVENTS_SHOWN]:
        when = "         " if math.isnan(time_s) else f"{time_s:9.2f}"
        console.print(f"  {when}  {kind}: {detail}", highlight=False, markup=False, soft_wrap=True)
    if len(events) > _EVENTS_SHOWN:
        console.print(
            f"  ... {len(events) - _EVENTS_SHOWN} further events in the table 'events'", highlight=False
        )


def _print_aiding(console: Console, run: Run) -> None:
    """Print the amount of aiding, its stated sigma, and the time taken."""
    if run.aiding is None:
        return
    rows, config, took = len(run.aiding), run.settings["aiding"], run.settings["took"]
    sd = run.aiding["sd_doppler_hz"].median() if rows else math.nan
    console.print(
        f"aiding at {config['rate_hz']:g} Hz: {rows} rows of {run.aiding['sv'].nunique()} satellites, median sigma of"
        f" the Doppler {sd:.2f} Hz; {took['aiding_s']:.2f} s",
        highlight=False,
    )


def _print_supervision(console: Console, run: Run) -> None:
    """Print the transitions by reason, and the time in search with the supervisor and without it."""
    if run.transitions is None or run.search_times is None:
        return
    reasons = run.transitions["reason"].value_counts()
    listed = ", ".join(f"{reason} {count}" for reason, count in reasons.items() if count)
    sums = run.search_times.drop(columns="sv").sum()
    searched = sums["search_s"] + sums["control_s"]
    console.print(f"supervisor: {len(run.transitions)} transitions: {listed or 'none'}", highlight=False)
    console.print(
        f"held {sums['hold_s']:.1f} s of {sums['predicted_s']:.1f} satellite seconds; in search {searched:.2f} s,"
        f" without the supervisor {sums['unsupervised_s']:.2f} s, {sums['unsupervised_in_vain_s']:.2f} s in vain",
        highlight=False,
    )
    if run.receiver_events is not None:
        verdicts = run.receiver_events["verdict"].value_counts()
        judged = ", ".join(f"{verdict} {count}" for verdict, count in verdicts.items() if count)
        console.print(f"the receiver's own events: {judged or 'none'}", highlight=False)


def _accuracy_table(run: Run) -> Table:
    """Return errors beside sigmas where there is a reference, sigmas alone elsewhere."""
    known_s = run.heading_known_s()
    if known_s is not None and run.errors is not None and not known_s <= run.errors["time_s"].max():
        known_s = None  # the summary is of the whole reference then
    since = "" if known_s is None else f", once the heading is known ({known_s:.1f} s)"
    title = f"estimate minus reference{since}" if run.errors is not None else "sigma (no reference)"
    rows: list[tuple[str, ...]] = []
    if run.errors is None or run.errors.empty:
        for name in run.nav.columns:
            if name.startswith("sd_") and "bias" not in name and "clock" not in name:
                values = run.nav[name]
                shown = (values.iloc[0], values.median(), values.iloc[-1])
                rows.append((_label(name[3:]), *(f"{value:.3f}" for value in shown)))
        return text_table(title, ("", "at start", "median", "at end"), rows)
    columns = ["mean", "rms", "p95", "max", "mean_sigma", "rms_over_sigma", "rms_over_noise"]
    for label, row in run.error_summary().iterrows():
        cells = [f"{value:.3f}" for value in row[columns]]
        has_slow = f"sd_slow_{label}" in run.nav
        rows.append((_label(str(label)), *cells[:-1], cells[-1] if has_slow else ""))
    heads = ("mean", "rms", "95 %", "largest", "mean sigma", "rms of error/sigma", "without slow errors")
    return text_table(title, ("", *heads), rows)


def _measurement_table(run: Run) -> Table:
    """Return the ledger's totals and the normalised innovations of each kind."""
    kinds = list(run.measurements["kind"].cat.categories)
    counts = run.status_counts()
    rows = ((str(status), *(str(row.get(kind, 0)) for kind in kinds)) for status, row in counts.iterrows())
    table = text_table("measurements", ("status", *kinds), rows, left=("status",))
    table.add_row("in the log", *(str(int(counts[kind].sum())) if kind in counts else "0" for kind in kinds))
    nis = run.nis_summary()
    if run.heading_known_s() is not None:
        counted = [str(int(nis["used"][kind])) if kind in nis.index else "0" for kind in kinds]
        table.add_row("used with known heading", *counted)
    table.add_row("mean NIS (ideally 1)", *_nis(nis, kinds, "mean_nis"))
    table.add_row("share below the 95 % bound", *_nis(nis, kinds, "share_95"))
    return table


def _nis(nis: pd.DataFrame, kinds: list[str], column: str) -> list[str]:
    return [f"{float(nis[column][kind]):.3f}" if kind in nis.index else "-" for kind in kinds]


def _label(name: str) -> str:
    """Return 'vn, m/s' of a column's 'vn_mps'."""
    stem, _, unit = name.replace("slow_", "slow ").rpartition("_")
    return f"{stem}, {_UNITS.get(unit, unit)}"
