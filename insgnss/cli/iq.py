"""``insgnss iq``: a scenario as samples of a radio front end, through receivers with and without inertial aiding."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insgnss.cli.command import at_least
from insgnss.cli.file_options import Force, Pictures, StudyFolder, check_files
from insgnss.cli.printing import AsJson, print_json, records, result_console, text_table
from insgnss.cli.progress import telling
from insgnss.constants import S_PER_WEEK
from insgnss.results.saving import RECORDING_KIND, STUDY_KIND, check_file_replaceable, overwriting

if TYPE_CHECKING:
    from rich.table import Table

    from insgnss.studies.samples.study import SampleStudy


def iq(
    scenario: Annotated[str, typer.Argument(help="A scenario file (.toml), or a name in models/scenarios.")],
    loss: Annotated[
        list[float] | None,
        typer.Option(
            "--loss",
            callback=at_least(-100.0, 100.0),
            help="Loss in dB, subtracted from every C/N0; repeatable, one run for each.",
        ),
    ] = None,
    receiver: Annotated[
        list[str] | None, typer.Option("--receiver", "-r", help="'aided' or 'unaided'; both by default.")
    ] = None,
    duration: Annotated[
        float, typer.Option("--duration", callback=at_least(1e-3, S_PER_WEEK), help="Seconds of the flight.")
    ] = 60.0,
    settings: Annotated[
        Path | None, typer.Option("--settings", help="Sampling, acquisition and loops (TOML).")
    ] = None,
    record: Annotated[
        Path | None, typer.Option("--record", help="Write the samples to this file and run no receiver.")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all noise.")] = 1,
    threads: Annotated[
        int, typer.Option("--threads", min=1, max=1024, help="Number of receivers that run in parallel.")
    ] = 2,
    output: StudyFolder = None,
    pictures: Pictures = True,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Make GPS L1 C/A samples of a flight; acquire, track and navigate with them, with and without aiding."""
    began = time.perf_counter()
    place = output if record is None else record.parent
    with overwriting(force, [Path(scenario)], place):
        # the numerical libraries are loaded only when the command runs
        from insgnss.config.sample_receiver import SampleReceiver
        from insgnss.config.strict import load_toml
        from insgnss.runs.simulate import simulate
        from insgnss.studies.samples.study import RECEIVERS, SampleStudy, record_samples, sample_receiver

        if record is not None:
            check_file_replaceable(record, RECORDING_KIND)
        else:
            check_files(output, SampleStudy.files(), STUDY_KIND)
        use = SampleReceiver() if settings is None else load_toml(settings, SampleReceiver)
        losses = tuple(loss or ((0.0,) if record is not None else (0.0, 10.0)))
        with telling("simulating") as tell:
            simulation = simulate(scenario, seed, duration_s=duration, progress=tell)
            if record is not None:
                tell("writing samples")
                count = record_samples(simulation, record, losses[0], duration, use, seed)
                results = {"samples": count, "rate_hz": use.rate_hz, "wrote": [str(record)]}
                study = None
            else:
                study = sample_receiver(
                    simulation,
                    losses_db=losses,
                    duration_s=duration,
                    receivers=tuple(receiver or RECEIVERS),
                    settings=use,
                    seed=seed,
                    threads=threads,
                    progress=tell,
                )
                reason = _without_errors(study, duration)
                results = {"summary": records(study.summary)} | ({"note": reason} if reason else {})
                if output is not None:
                    tell("writing")
                    results["wrote"] = [str(study.save(output, pictures=pictures))]
    if as_json:
        print_json(results)
        return
    _print(study, results, output if record is None else record)
    typer.echo(f"{time.perf_counter() - began:.2f} s in all")


def _print(study: SampleStudy | None, results: dict[str, object], output: Path | None) -> None:
    """Print what was made."""
    if study is None:
        typer.echo(f"wrote {results['samples']} samples at {results['rate_hz']:g} Hz to {output}")
        return
    result_console(110).print(_table(study))
    if "note" in results:
        typer.echo(results["note"])
    typer.echo("nothing was written" if output is None else f"wrote {output}")


def _without_errors(study: SampleStudy, duration_s: float) -> str:
    """Return why receivers have no errors, and which duration gives them; "" if all have errors."""
    from insgnss.studies.samples.tables import SETTLED_S

    rows = study.summary[study.summary["channels"] == 0]
    if rows.empty:
        return ""
    first_s = float(rows["first_fix_s"].max())
    if math.isnan(first_s):
        return "No errors: no receiver has a position fix. Give a longer --duration, or a smaller --loss."
    time_s = study.epochs["time_s"]
    missing_s = first_s + SETTLED_S - float(time_s.max() - time_s.min())
    return (
        f"No errors: they are counted from {SETTLED_S:g} s after the first fix on, and the flight ends before. "
        f"Give --duration {math.ceil(duration_s + missing_s)} or more."
    )


def _table(study: SampleStudy) -> Table:
    """Return the summary as a table of the terminal."""
    heads = (
        "C/N0",
        "receiver",
        "on signal",
        "at end",
        "position rms",
        "largest",
        "error/sigma",
        "velocity rms",
    )
    rows = (
        (
            f"{row['cn0_dbhz']:.1f}",
            str(row["receiver"]),
            _number(100.0 * row["share_on_signal"], "%", 0),
            f"{row['on_signal_at_end']:.0f} of {row['channels']:.0f}" if row["channels"] else "-",
            _number(row["position_rms_m"], "m"),
            _number(row["position_largest_m"], "m"),
            _number(row["position_over_sigma"], ""),
            _number(row["velocity_rms_mps"], "m/s"),
        )
        for row in study.summary.to_dict("records")
    )
    return text_table("errors from 5 s after the first fix on", heads, rows, left=("receiver",))


def _number(value: float, unit: str, digits: int = 2) -> str:
    return "-" if not math.isfinite(value) else f"{value:.{digits}f} {unit}".strip()
