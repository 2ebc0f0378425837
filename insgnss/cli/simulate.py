"""``insgnss simulate``: a scenario becomes a folder of logs, with the truth and the flight file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from insgnss.cli.command import at_least
from insgnss.cli.file_options import Force
from insgnss.cli.printing import AsJson, print_json
from insgnss.cli.progress import telling
from insgnss.constants import S_PER_WEEK
from insgnss.results.saving import overwriting


def simulate(
    scenario: Annotated[str, typer.Argument(help="A scenario file (.toml), or a name in models/scenarios.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the logs.")],
    seed: Annotated[
        int,
        typer.Option("--seed", min=0, help="Seed of the random numbers: the same seed gives the same files."),
    ] = 1,
    clean: Annotated[bool, typer.Option("--clean", help="No noise, no sensor errors; faults stay.")] = False,
    duration: Annotated[
        float | None,
        typer.Option(
            "--duration", callback=at_least(1e-3, S_PER_WEEK), help="Simulate only this many seconds."
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a flight: IMU and GNSS CSV, RINEX navigation, the true trajectory and a flight file to replay them."""
    began = time.perf_counter()
    with overwriting(force, [Path(scenario)], output):
        # NumPy and SciPy are loaded only when there is something to simulate
        from insgnss.runs.simulate import check_output
        from insgnss.runs.simulate import simulate as simulated

        check_output(scenario, output)
        with telling("simulating") as tell:
            simulation = simulated(scenario, seed, noise=not clean, duration_s=duration, progress=tell)
            tell("writing")
            paths = simulation.save(output)
    log = simulation.log
    satellites = len(set(log.gnss.sv.tolist()))
    if as_json:
        about = {
            "name": simulation.config.name or scenario,
            "duration_s": simulation.scenario.duration_s,
            "seed": seed,
        }
        rows = {"imu_samples": len(log.imu.t_ns), "gnss_rows": len(log.gnss.t_ns), "satellites": satellites}
        print_json({**about, **rows, "wrote": [str(path) for path in paths]})
        return
    typer.echo(
        f"{simulation.config.name or scenario}: {simulation.scenario.duration_s:.0f} s,"
        f" {len(log.imu.t_ns)} inertial samples, {len(log.gnss.t_ns)} GNSS rows of {satellites} satellites"
    )
    if duration is not None and duration > simulation.scenario.duration_s:
        typer.echo(f"the scenario ends before the {duration:g} s of --duration")
    for path in paths:
        typer.echo(f"wrote {path} ({path.stat().st_size / 1e6:.2f} MB)")
    typer.echo(f"{time.perf_counter() - began:.2f} s in all")
