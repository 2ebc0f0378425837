"""``insgnss check``: reads everything a flight names and reports what looks wrong."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from insgnss.cli.ending import own_errors_told
from insgnss.log.doctor import check_flight
from insgnss.log.flight import Flight

_FAILED = 3  # the exit code of an input error, as when replay meets it


def check(
    flight: Annotated[Path, typer.Argument(help="The flight file (TOML).")],
) -> None:
    """Read all logs of a flight and report rates, gaps, units, axes, overlap, satellites and ephemerides."""
    began = time.perf_counter()
    with own_errors_told():
        loaded = Flight.load(flight)
        report = check_flight(loaded)
    for line in report.lines():
        typer.echo(line)
    files = loaded.files()
    typer.echo(f"read {len(files)} files in {time.perf_counter() - began:.2f} s; nothing was written")
    if report.severity == "error":
        raise typer.Exit(_FAILED)
