"""``insgnss receiver``: the C/N0 down to which each receiver holds lock in a manoeuvre, and its errors."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from insgnss.cli.command import at_least
from insgnss.cli.file_options import Force, Pictures, StudyFolder, check_files, tell_end
from insgnss.cli.option_values import names_in, numbers_in, refuse_given
from insgnss.cli.printing import AsJson, print_json, records, result_console, text_table
from insgnss.cli.progress import counting
from insgnss.constants import S_PER_WEEK
from insgnss.results.saving import STUDY_KIND, overwriting

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from insgnss.studies.receiver.comparison import ReceiverStudy

_NO_INS = "none"


def receiver(
    context: typer.Context,
    scenario: Annotated[
        str, typer.Argument(help="A list of manoeuvres: a name in models/scenarios, or a file (TOML).")
    ] = "manoeuvring_5g",
    variants: Annotated[
        str,
        typer.Option(
            "--variants",
            help="Comma-separated: scalar, aided, two_stage, optimal, one_stage, one_stage_code.",
        ),
    ] = "scalar,aided,two_stage,optimal,one_stage",
    tracking: Annotated[str, typer.Option("--tracking", help="coherent or noncoherent.")] = "coherent",
    imu: Annotated[str, typer.Option("--imu", help="An IMU grade in the library, or 'none'.")] = "industrial",
    oscillator: Annotated[
        str, typer.Option("--oscillator", help="A name in the library, or a density in rad^2/s^3.")
    ] = "tcxo",
    cn0: Annotated[
        str, typer.Option("--cn0", help="C/N0 values in dBHz, separated by commas.")
    ] = "45,40,35,30,25,20",
    emitters: Annotated[
        str | None,
        typer.Option("--emitters", "-e", help="Fly past these: a name in models/emitters, or a file (TOML)."),
    ] = None,
    runs: Annotated[int, typer.Option("--runs", min=1, help="Runs of each receiver at each C/N0.")] = 20,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all noise.")] = 1,
    duration: Annotated[
        float | None,
        typer.Option(
            "--duration",
            callback=at_least(0.1, S_PER_WEEK),
            help="Length of a run in seconds. Default: until 40 s after averaging begins, or less; with --emitters the "
            "whole motion.",
        ),
    ] = None,
    settle: Annotated[
        float,
        typer.Option(
            "--settle",
            callback=at_least(0.0, S_PER_WEEK),
            help="Time in the run, in seconds, at which the C/N0 falls to its value.",
        ),
    ] = 40.0,
    average_from: Annotated[
        float | None,
        typer.Option(
            "--average-from",
            callback=at_least(0.0, S_PER_WEEK),
            help="Time in the run, in seconds, from which errors are averaged. Default: when the predicted errors of "
            "the slowest receiver have settled at the lowest C/N0, at most 120 s after the fall.",
        ),
    ] = None,
    step: Annotated[
        float, typer.Option("--step", callback=at_least(1e-6, 10.0), help="Integration time in seconds.")
    ] = 5e-3,
    interval: Annotated[
        float,
        typer.Option(
            "--interval", callback=at_least(1e-6, 1e3), help="Seconds between two updates of a second stage."
        ),
    ] = 0.1,
    latency: Annotated[
        float,
        typer.Option(
            "--latency",
            callback=at_least(0.0, 1e3),
            help="Delay in seconds before an inertial sample is available.",
        ),
    ] = 0.0,
    least: Annotated[
        float | None,
        typer.Option(
            "--min-cn0",
            "--least",
            callback=at_least(-30.0, 100.0),
            help="C/N0 in dBHz below which a channel is not used.",
        ),
    ] = None,
    estimate: Annotated[bool, typer.Option("--estimate", help="Let the receiver estimate its C/N0.")] = False,
    antenna: Annotated[
        str | None,
        typer.Option(
            "--antenna", "-a", help="Pattern of a level antenna: a name in the library, or a file (.csv)."
        ),
    ] = None,
    assumed_cn0: Annotated[
        float | None,
        typer.Option(
            "--assumed-cn0",
            "--told",
            callback=at_least(-30.0, 100.0),
            help="C/N0 in dBHz that the receiver assumes, whatever the true value.",
        ),
    ] = None,
    masking: Annotated[
        bool,
        typer.Option(
            "--masking", help="Leave out satellites that the antenna does not see at the filter's attitude."
        ),
    ] = False,
    output: StudyFolder = None,
    pictures: Pictures = True,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Fly receivers through a manoeuvre in closed loops; report errors, thresholds and loss of lock."""
    began = time.perf_counter()
    with overwriting(force, [], output):
        if emitters is not None:
            refuse_given(context, ("cn0",), "with --emitters: they determine the C/N0")
        levels, names = numbers_in(cn0, "--cn0"), names_in(variants)
        from insgnss.antenna.equipment import installation
        from insgnss.config.flight import MountedAntenna
        from insgnss.studies.receiver.comparison import ReceiverStudy, receiver_study
        from insgnss.studies.receiver.options import ReceiverOptions
        from insgnss.studies.receiver.variants import USUAL_VARIANTS

        check_files(output, ReceiverStudy.files(), STUDY_KIND)
        if imu == _NO_INS and variants == ",".join(USUAL_VARIANTS):
            names = ("scalar", "one_stage")
        options = ReceiverOptions(
            duration_s=duration,
            settle_s=settle,
            average_s=average_from,
            step_s=step,
            interval_s=interval,
            latency_s=latency,
            least_cn0_dbhz=least,
            estimates_cn0=estimate,
            told_cn0_dbhz=assumed_cn0,
            masking=masking,
        )
        mounted = None if antenna is None else installation([MountedAntenna(pattern=antenna)], Path())[0]
        with counting() as bars:
            bar = bars.add_task("receivers")
            study = receiver_study(
                scenario,
                variants=names,
                tracking=tracking,
                imu=None if imu == _NO_INS else imu,
                oscillator=_oscillator(oscillator),
                cn0=levels,
                runs=runs,
                seed=seed,
                options=options,
                emitters=emitters,
                antennas=mounted,
                report=lambda done, cases: bars.update(bar, completed=done, total=cases),
            )
        if output is not None:
            study.save(output, pictures=pictures)
    if as_json:
        tables = {"summary": records(study.summary), "thresholds": records(study.thresholds)}
        print_json({"asked": study.asked, **tables, "wrote": output})
        return
    console = result_console()
    console.print(_summary(study.summary))
    if emitters is None:
        console.print(_thresholds(study.thresholds))
    typer.echo(_averaged(study))
    tell_end(began, output)


def _averaged(study: ReceiverStudy) -> str:
    """Return from when errors are averaged, and which have not settled by then."""
    options = study.asked["options"]
    text = (
        f"errors are averaged from {options['average_s']:g} s to {options['duration_s']:g} s of each run; "
        f"C/N0 falls at {options['settle_s']:g} s"
    )
    if study.asked["emitters"] is not None:
        text = text.partition(";")[0]
    for name, rows in study.summary[study.summary["unsettled"] != ""].groupby("variant", sort=False):
        levels = ", ".join(f"{level:g}" for level in rows["cn0_dbhz"])
        text += f"\nnot settled by then: {rows['unsettled'].iloc[-1]} of {name} at {levels} dBHz"
    return text


def _oscillator(text: str) -> str | dict[str, float]:
    try:
        return {"drift_density": float(text)}
    except ValueError:
        return text


def _summary(table: pd.DataFrame) -> Table:
    columns = {
        "C/N0, dBHz": "cn0_dbhz",
        "lost, share": "lost",
        "position, m": "position_m",
        "velocity, m/s": "velocity_mps",
        "attitude, deg": "attitude_deg",
        "replicas, m/s": "rate_mps",
        "phase, rad": "phase_rad",
        "NEES (1)": "nees",
    }
    rows = []
    for row in table.to_dict("records"):
        bounds = f"{_number(row['nees_low'])} to {_number(row['nees_high'])}"
        rows.append((str(row["variant"]), *(_number(row[column]) for column in columns.values()), bounds))
    title = "errors (rms), of the runs that held lock"
    return text_table(title, ("receiver", *columns, "bounds"), rows, left=("receiver",))


def _thresholds(table: pd.DataFrame) -> Table:
    caption = "linear theory of aided channels: residual INS error of 0.06 m/s^2, whatever the IMU"
    heads = ("receiver", "C/N0, dBHz", "95 % from", "to", "J/S, dB", "linear theory, dBHz")
    numbers = ("cn0_dbhz", "low_dbhz", "high_dbhz", "js_db", "linear_cn0_dbhz")
    rows = (
        (str(row["variant"]), *(_number(row[name]) for name in numbers)) for row in table.to_dict("records")
    )
    return text_table("half of the runs lose lock", heads, rows, left=("receiver",), caption=caption)


def _number(value: object) -> str:
    number = float(str(value))
    return "-" if math.isnan(number) else f"{number:.4g}"
