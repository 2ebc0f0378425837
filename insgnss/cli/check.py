"""``insgnss check``: reads everything a flight names and reports what looks wrong."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from insgnss.cli.ending import own_errors_told
from insgnss.cli.json_output import AsJson, print_json
from insgnss.cli.progress import telling
from insgnss.log.doctor import check_flight
from insgnss.log.flight import Flight

_FAILED = 3  # the exit code of an input error, as when replay meets it


def check(
    flight: Annotated[Path, typer.Argument(help="The flight file (TOML).")],
    as_json: AsJson = False,
) -> None:
    """Read all logs of a flight and report rates, gaps, units, axes, overlap, satellites and ephemerides."""
    began = time.perf_counter()
    with own_errors_told():
        loaded = Flight.load(flight)
        with telling("reading and checking"):
            report = check_flight(loaded)
    files = loaded.files()
    took_s = time.perf_counter() - began
    if as_json:
        found = [asdict(finding) for finding in report.findings]
        about = {"flight": report.name, "severity": report.severity, "findings": found}
        print_json({**about, "files_read": len(files), "took_s": took_s})
    else:
        for line in report.lines():
            typer.echo(line)
        typer.echo(f"read {len(files)} files in {took_s:.2f} s; nothing was written")
    if report.severity == "error":
        raise typer.Exit(_FAILED)
