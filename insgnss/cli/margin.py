"""``insgnss margin``: how much interference an aided phase loop stands, in general and along a saved run."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from insgnss.cli.command import at_least
from insgnss.cli.file_options import (
    Force,
    FormatName,
    Pictures,
    StudyFolder,
    check_files,
    run_files,
    table_form,
    tell_end,
)
from insgnss.cli.margin_flown import flown_study
from insgnss.cli.option_values import refuse_given
from insgnss.cli.printing import AsJson, print_json, result_console, text_table
from insgnss.cli.progress import counting
from insgnss.constants import S_PER_WEEK
from insgnss.errors import ConfigError
from insgnss.results.matplotlib_figure import save_figure
from insgnss.results.saving import PICTURE_KIND, overwriting

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from insgnss.interference.lock_thresholds import LockThreshold
    from insgnss.interference.margin import PhaseLoop
    from insgnss.results.table_files import TableFormat

_TABLE: Final = "margin"
_PICTURES: Final = ("margin_drift.png", "margin_diagram.png", "margin_type_1.png", "margin_type_2.png")
_SIMULATED: Final = "margin_thresholds.png"
# What a saved run takes from the file of emitters
_OF_THE_LOOP: Final = (
    *("signal", "discriminator", "threshold", "oscillator", "imu", "interval", "bandwidth", "accumulation"),
    *("cn0", "acceleration", "lasting", "simulate", "seed"),
)


def margin(
    context: typer.Context,
    run: Annotated[
        Path | None, typer.Argument(help="A saved run (its folder): the receiver moves along its path.")
    ] = None,
    emitters: Annotated[
        str | None,
        typer.Option(
            "--emitters",
            "-e",
            help="Emitters, receiver and dynamics: a name in models/emitters, or a file (TOML).",
        ),
    ] = None,
    signal: Annotated[
        str, typer.Option("--signal", "-s", help="A name, or its RINEX code such as G:C1C.")
    ] = "GPS L1 C/A",
    discriminator: Annotated[
        str, typer.Option("--discriminator", "-d", help="Q, atan(Q/I), sign(I)Q or IQ.")
    ] = "IQ",
    threshold: Annotated[
        float | None,
        typer.Option(
            "--threshold",
            callback=at_least(1e-3, 1.0),
            help="Phase error (rms) over aperture at loss of lock, in place of table 1 of Shatilov (2009).",
        ),
    ] = None,
    oscillator: Annotated[
        str, typer.Option("--oscillator", help="A name in the library, or a density in rad^2/s^3.")
    ] = "tcxo",
    imu: Annotated[
        str, typer.Option("--imu", help="An IMU grade in the library, or a density in rad^2/s^3.")
    ] = "tactical",
    interval: Annotated[
        float,
        typer.Option(
            "--interval",
            callback=at_least(1e-6, S_PER_WEEK),
            help="Seconds between two corrections of the inertial system.",
        ),
    ] = 1.0,
    bandwidth: Annotated[
        float | None,
        typer.Option(
            "--bandwidth",
            callback=at_least(1.0, 1e12),
            help="Front end's bandwidth DF_c in Hz; by default the signal's main lobe.",
        ),
    ] = None,
    accumulation: Annotated[
        float | None,
        typer.Option(
            "--accumulation",
            callback=at_least(1e-6, 1e3),
            help="Coherent integration time in seconds; by default one data symbol.",
        ),
    ] = None,
    cn0: Annotated[
        float | None,
        typer.Option(
            "--cn0",
            callback=at_least(-30.0, 100.0),
            help="C/N0 without interference, in dBHz: includes thermal noise.",
        ),
    ] = None,
    acceleration: Annotated[
        float | None,
        typer.Option(
            "--acceleration",
            callback=at_least(0.0, 1e5),
            help="Acceleration along the line of sight, one sigma in m/s^2, that a loop without INS must follow.",
        ),
    ] = None,
    lasting: Annotated[
        float,
        typer.Option(
            "--acceleration-time",
            "--lasting",
            callback=at_least(1e-6, S_PER_WEEK),
            help="Correlation time of that acceleration, in seconds.",
        ),
    ] = 5.0,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Also find the thresholds of the discriminators by simulation.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the simulation.")] = 1,
    output: StudyFolder = None,
    step: Annotated[
        float,
        typer.Option(
            "--step",
            callback=at_least(0.0, S_PER_WEEK),
            help="Seconds between two epochs of the run; 0: all.",
        ),
    ] = 1.0,
    format: FormatName = "parquet",
    pictures: Pictures = True,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Report the J/S that a phase loop withstands, and where along a run it loses lock."""
    began = time.perf_counter()
    inputs = [] if run is None or emitters is None else [*run_files(run), Path(emitters)]
    with overwriting(force, inputs, output):
        form = table_form(format)
        if run is None:
            refuse_given(context, ("step",), "without a run")
        else:
            refuse_given(context, _OF_THE_LOOP, "with a run: the file of emitters has the receiver's loop")
        if (run is None) != (emitters is None):
            raise ConfigError(
                "a run and emitters belong together", key="--emitters", advice="give both, or neither"
            )
        console = result_console(quiet=as_json)
        if run is not None and emitters is not None:
            answer, written = flown_study(console, run, emitters, output, form, step, pictures)
        else:
            _check_outputs(output, drawn=pictures, simulated=simulate)
            loops, carrier = _loops(signal, discriminator, threshold, bandwidth, accumulation)
            drifts = _drifts(oscillator, imu, interval, carrier)
            rows = _margins(loops, drifts, cn0)
            if acceleration is not None:
                _add_unaided(rows, loops, next(iter(drifts.values())), (acceleration, lasting, carrier), cn0)
            console.print(_margin_table(loops, drifts, cn0, rows))
            thresholds = _simulated(console, seed) if simulate else []
            written = [] if output is None else [_saved(rows, output, form)]
            if output is not None and pictures:
                written += _pictures(output, loops, drifts, carrier, cn0, thresholds)
            answer = {"drift_rad2_per_s3": drifts, "loops": rows}
            answer |= {
                "simulated": [{"discriminator": f.discriminator.name, "c_a": f.ratio()} for f in thresholds]
            }
    if as_json:
        print_json({**answer, "wrote": [str(path) for path in written]})
        return
    tell_end(began, ", ".join(str(p) for p in written) or None)


def _check_outputs(output: Path | None, *, drawn: bool, simulated: bool) -> None:
    """Refuse outputs that would replace files of other programs, before any work is done."""
    from insgnss.results.table_files import table_files

    check_files(output, table_files((_TABLE,)), _TABLE)
    if drawn:
        check_files(output, (*_PICTURES, *((_SIMULATED,) if simulated else ())), PICTURE_KIND)


def _saved(rows: list[dict[str, Any]], output: Path, form: TableFormat) -> Path:
    """Write the margins of all discriminators as one table; return the folder."""
    import pandas as pd

    from insgnss.results.table_files import save_study

    table = pd.DataFrame(rows)
    alone = pd.DataFrame(table.pop("margin_alone_db").tolist())
    alone.columns = [f"margin_{name.split()[0].lower()}_alone_db" for name in alone.columns]
    return save_study(output, {_TABLE: table.join(alone)}, form, _TABLE)


def _loops(
    signal: str, kind: str, threshold: float | None, bandwidth: float | None, accumulation: float | None
) -> tuple[dict[str, PhaseLoop], float]:
    """Return the loop that was asked for, with those of the other discriminators, and the carrier."""
    from insgnss.interference.discriminators import DISCRIMINATORS, discriminator
    from insgnss.interference.margin import PhaseLoop
    from insgnss.interference.spectra import modulation_of, signal_named

    named_signal = signal_named(signal)
    modulation = modulation_of(named_signal)
    band, period = bandwidth or modulation.null_to_null_hz, accumulation or modulation.symbol_s
    asked = discriminator(kind, threshold)
    kinds = [asked, *(d for d in DISCRIMINATORS if d.name != asked.name)]
    return {d.name: PhaseLoop(d, band, period) for d in kinds}, named_signal.carrier_hz


def _drifts(oscillator: str, imu: str, interval: float, carrier: float) -> dict[str, float]:
    """Return the one-sided densities of oscillator and INS [rad^2/s^3], by their names."""
    from insgnss.config.library import imu_grade
    from insgnss.config.library import oscillator as oscillator_of
    from insgnss.interference.checks import positive
    from insgnss.interference.drift import density_of_grade, density_of_walk

    def number(key: str, text: str) -> float | None:
        try:
            value = float(text)
        except ValueError:
            return None
        return float(positive(key, value, "a one-sided density in rad^2/s^3, or a name in the library"))

    of_oscillator, of_imu = number("--oscillator", oscillator), number("--imu", imu)
    names = ["oscillator", "INS"]
    if of_oscillator is None:
        of_oscillator = float(density_of_walk(oscillator_of(oscillator).h_minus2_per_s, carrier))
        names[0] += f" {oscillator}"
    if of_imu is None:
        of_imu = density_of_grade(imu_grade(imu), carrier, interval_s=interval).total
        names[1] += f" {imu}"
    return dict(zip(names, (of_oscillator, of_imu), strict=True))


def _margin_table(
    loops: dict[str, PhaseLoop], drifts: dict[str, float], cn0: float | None, rows: list[dict[str, Any]]
) -> Table:
    """Return the margin of each discriminator, and the gain of an oscillator or an INS without drift."""
    total = sum(drifts.values())
    parts = ", ".join(f"{name} {value:.4g}" for name, value in drifts.items())
    first = next(iter(loops.values()))
    title = (
        f"drift {total:.4g} rad²/s³ one-sided ({parts}); DF_c {first.bandwidth_hz / 1e6:.4g} MHz, "
        f"T {first.accumulation_s * 1e3:g} ms" + ("" if cn0 is None else f", C/N0 {cn0:g} dBHz")
    )
    alone = [f"J/S, {name} alone, dB" for name in drifts]
    names = ["discriminator", "C_A", "J/S, dB", "bandwidth, Hz", "least C/N0, dBHz", *alone]
    if "unaided_db" in rows[0]:
        names += ["J/S without INS, dB", "order"]
    cells = (
        (
            *(row["discriminator"], f"{row['c_a']:.3f}", f"{row['margin_db']:.2f}"),
            *(f"{row['bandwidth_hz']:.3f}", f"{row['least_cn0_dbhz']:.2f}"),
            *(f"{value:.2f}" for value in row["margin_alone_db"].values()),
            *((f"{row['unaided_db']:.2f}", str(row["unaided_order"])) if "unaided_db" in row else ()),
        )
        for row in rows
    )
    return text_table(title, names, cells, left=("discriminator",))


def _margins(
    loops: dict[str, PhaseLoop], drifts: dict[str, float], cn0: float | None
) -> list[dict[str, Any]]:
    """Return the margin of each discriminator as plain data."""
    from insgnss.interference.margin import bandwidth_at_margin_hz, margin_db, threshold_cn0_dbhz

    total = sum(drifts.values())
    return [
        {
            "discriminator": name,
            "c_a": loop.discriminator.threshold_ratio,
            "margin_db": float(margin_db(total, loop, cn0)),
            "bandwidth_hz": float(bandwidth_at_margin_hz(total, loop)),
            "least_cn0_dbhz": float(threshold_cn0_dbhz(total, loop)),
            "margin_alone_db": {n: float(margin_db(value, loop, cn0)) for n, value in drifts.items()},
        }
        for name, loop in loops.items()
    ]


def _add_unaided(
    rows: list[dict[str, Any]],
    loops: dict[str, PhaseLoop],
    oscillator: float,
    motion: tuple[float, float, float],
    cn0: float | None,
) -> None:
    """Add the margin of each loop that follows a lasting acceleration without aiding, and its order.

    ``motion`` is one sigma [m/s^2], the correlation time [s] and the carrier [Hz].
    """
    from insgnss.interference.margin import margin_in_motion_db
    from insgnss.interference.steady_acceleration import threshold_in_motion

    for row, loop in zip(rows, loops.values(), strict=True):
        threshold = threshold_in_motion(oscillator, *motion, loop.discriminator.threshold_rms_rad)
        row["unaided_db"] = float(margin_in_motion_db(oscillator, *motion, loop, cn0))
        row["unaided_order"] = int(threshold.order)


def _simulated(console: Console, seed: int) -> list[LockThreshold]:
    """Return the thresholds of all discriminators, with a bar of the progress on standard error."""
    import numpy as np

    from insgnss.interference.discriminators import DISCRIMINATORS
    from insgnss.interference.lock_thresholds import LIFETIME, lock_threshold

    thresholds = []
    with counting() as bar:
        for kind in DISCRIMINATORS:
            task = bar.add_task(kind.name, total=1.0)

            def tell(name: str, share: float, task: int = task) -> None:
                bar.update(task, completed=share)  # type: ignore[arg-type]

            thresholds.append(lock_threshold(kind, np.random.default_rng(seed), progress=tell))
    for one in thresholds:
        console.print(
            f"{one.discriminator.name}: C_A {one.ratio():.4f} at {LIFETIME:.0f} / B "
            f"(table 1: {one.discriminator.threshold_ratio:.3f}); "
            f"{one.level[0]:.3f} at {one.lifetime[0]:.0f} / B, {one.level[-1]:.3f} at {one.lifetime[-1]:.0f} / B",
            highlight=False,
        )
    return thresholds


def _pictures(
    output: Path,
    loops: dict[str, PhaseLoop],
    drifts: dict[str, float],
    carrier: float,
    cn0: float | None,
    simulated: list[LockThreshold],
) -> list[Path]:
    """Write the pictures of the margin, figures 4 to 6 among them; return their paths."""
    from insgnss.interference import figures

    type_2 = next(loop for loop in loops.values() if loop.discriminator.type == 2)
    drawn = (
        figures.margin_figure(loops, cn0, drifts),
        figures.diagram_figure(loops, carrier),
        figures.trade_off_figure(loops["Q"], carrier),
        figures.trade_off_figure(type_2, carrier),
    )
    written = [save_figure(figure, output / name) for name, figure in zip(_PICTURES, drawn, strict=True)]
    if simulated:
        written.append(save_figure(figures.threshold_figure(simulated), output / _SIMULATED))
    return written
