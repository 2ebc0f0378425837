"""``insgnss outage``: how a solution drifts where measurements are taken away, and how it comes back."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated

import typer

from insgnss.cli.command import at_least
from insgnss.cli.file_options import FlightFile, Force, Pictures, StudyFolder, check_files, tell_end
from insgnss.cli.filter_options import FilterName, Settings, chosen_filter
from insgnss.cli.option_values import names_in, refuse_given
from insgnss.cli.printing import AsJson, print_json, records, result_console, text_table
from insgnss.cli.progress import telling
from insgnss.constants import S_PER_WEEK
from insgnss.errors import ConfigError
from insgnss.results.saving import STUDY_KIND, overwriting

if TYPE_CHECKING:
    from rich.table import Table

    from insgnss.studies.outage.study import OutageStudy, Windows

_ROWS = 12  # of the printed percentiles
_ADVICE = "give one of --window FROM:UNTIL, --every, --random, --bank"


def outage(
    context: typer.Context,
    flight: FlightFile,
    window: Annotated[
        list[str] | None,
        typer.Option("--window", help="FROM:UNTIL in seconds of the week; repeatable."),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(
            "--every",
            callback=at_least(1e-3, S_PER_WEEK),
            help="Seconds from the start of one window to the start of the next.",
        ),
    ] = None,
    random: Annotated[
        int | None, typer.Option("--random", min=1, help="Number of random windows, not overlapping.")
    ] = None,
    bank: Annotated[
        float | None,
        typer.Option(
            "--bank",
            callback=at_least(0.0, 180.0),
            help="Windows where the bank angle exceeds this many degrees.",
        ),
    ] = None,
    length: Annotated[
        float,
        typer.Option(
            "--length",
            callback=at_least(1e-3, S_PER_WEEK),
            help="Length of a window in seconds, with --every and --random.",
        ),
    ] = 30.0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random windows.")] = 1,
    satellites: Annotated[
        str, typer.Option("--sv", help="Remove only these satellites, such as G01,G07; all by default.")
    ] = "",
    constellations: Annotated[
        str, typer.Option("--constellation", help="Remove only these constellations, such as R,E.")
    ] = "",
    kinds: Annotated[
        str,
        typer.Option(
            "--kind",
            help="Remove only these kinds: pseudorange, range_rate, carrier_difference, attitude_difference.",
        ),
    ] = "",
    after: Annotated[
        float,
        typer.Option(
            "--after", callback=at_least(0.0, S_PER_WEEK), help="Seconds evaluated after each window."
        ),
    ] = 60.0,
    rate: Annotated[
        float,
        typer.Option(
            "--rate", callback=at_least(1e-5, 1e5), help="Rate in Hz at which the solutions are compared."
        ),
    ] = 1.0,
    filter: FilterName = "tight",
    settings: Settings = None,
    output: StudyFolder = None,
    pictures: Pictures = True,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Remove measurements in windows, replay, and report drift, predicted sigma and recovery time."""
    began = time.perf_counter()
    with overwriting(force, [flight], output):
        windows = _windows(window, every, random, bank, length, seed)
        if random is None and every is None:
            refuse_given(context, ("length", "seed"), "without --every or --random")
        elif random is None:
            refuse_given(context, ("seed",), "without --random")
        from insgnss.studies.outage.study import OutageStudy, outage_study
        from insgnss.studies.outage.windows import Removal

        check_files(output, OutageStudy.files(), STUDY_KIND)
        chosen = chosen_filter(filter, settings)
        removal = Removal(names_in(satellites), names_in(constellations), names_in(kinds))
        with telling("starting") as tell:
            study = outage_study(
                flight,
                windows,
                removal,
                filter=chosen,
                after_s=after,
                rate_hz=rate,
                progress=tell,
            )
            if output is not None:
                tell("saving")
                study.save(output, pictures=pictures)
    if as_json:
        tables = {"windows": records(study.windows), "percentiles": records(study.percentiles)}
        skipped = [skipped._asdict() for skipped in study.skipped]
        answer = {"asked": dict(study.asked), **tables, "skipped": skipped, "took": dict(study.took)}
        print_json({**answer, "wrote": output})
        return
    _print(study)
    tell_end(began, output)


def _windows(
    given: list[str] | None,
    every: float | None,
    random: int | None,
    bank: float | None,
    length: float,
    seed: int,
) -> Windows:
    """Return the windows that the options ask for, which must do so in one way."""
    from insgnss.studies.outage.study import Banked, Periodic, Random

    ways: list[Windows] = []
    if given:
        ways.append([_window(text) for text in given])
    if every is not None:
        ways.append(Periodic(length, every))
    if random is not None:
        ways.append(Random(length, random, seed))
    if bank is not None:
        ways.append(Banked(bank))
    if len(ways) != 1:
        what = "nothing says when" if not ways else "more than one option says when"
        raise ConfigError(f"{what} measurements are removed", key="--window", advice=_ADVICE)
    return ways[0]


def _window(text: str) -> tuple[float, float]:
    first, _, last = text.partition(":")
    try:
        return float(first), float(last)
    except ValueError:
        advice = "write FROM:UNTIL, as in --window 293800:293830"
        raise ConfigError(f"invalid window '{text}'", key="--window", advice=advice) from None


def _print(study: OutageStudy) -> None:
    console = result_console()
    for against in study.percentiles["against"].unique():
        console.print(_table(study, str(against)))
    back = study.windows["sd_back_s"].dropna()
    times = (
        f"median {back.median():.1f} s, longest {back.max():.1f} s"
        if len(back)
        else "longer than evaluated (see --after)"
    )
    console.print(f"{len(study.windows)} window(s); removed: {study.asked['removal']}", highlight=False)
    console.print(
        f"time until the position sigma is within 10 % of the undisturbed one: {times}"
        f" ({len(back)} of {len(study.windows)} windows)",
        highlight=False,
    )
    for skipped in study.skipped:
        console.print(f"no filter at {skipped.from_s:.1f} s: that window was left out", highlight=False)


def _table(study: OutageStudy, against: str) -> Table:
    heads = (
        "since the loss, s",
        "windows",
        "50 %, m",
        "95 %, m",
        "largest, m",
        "rms, m",
        "sigma, m",
        "rms/sigma",
    )
    all_rows = study.percentiles
    all_rows = all_rows[(all_rows["against"] == against) & (all_rows["measure"] == "position_m")]
    numbers = ("p50", "p95", "max", "rms", "sd", "sd_ratio")
    rows = (
        (f"{row['since_s']:g}", str(row["n"]), *(f"{row[name]:.3f}" for name in numbers))
        for row in all_rows.iloc[:: max(len(all_rows) // _ROWS, 1)].to_dict("records")
    )
    return text_table(f"position against the {against}", heads, rows)
