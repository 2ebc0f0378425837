"""``insgnss check``: reads everything a flight names, reports defects, proposes corrected declarations."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from insgnss.cli.file_options import FlightFile
from insgnss.cli.printing import AsJson, print_json
from insgnss.cli.progress import telling

_FAILED = 3  # the exit code of an input error, as when replay meets it


def check(
    flight: FlightFile,
    as_json: AsJson = False,
    write: Annotated[
        Path | None,
        typer.Option(
            help="Write a copy of the flight file with the certain proposals, each with a comment that says why."
        ),
    ] = None,
    run: Annotated[
        Path | None,
        typer.Option(
            help="A saved run of this flight: also propose its lever arm, IMU time offset and mounting."
        ),
    ] = None,
) -> None:
    """Read all logs of a flight, compare them with each other, and propose corrections of the flight file."""
    # pandas and the compiled code are loaded only once the options are known to be right
    from insgnss.log.checks import write_corrected
    from insgnss.log.checks.corrected_file import check_new_file
    from insgnss.log.flight import Flight
    from insgnss.runs.check import examine
    from insgnss.runs.installation import installation_findings
    from insgnss.runs.result import Run

    began = time.perf_counter()
    if write is not None:
        check_new_file(write)
    loaded = Flight.load(flight)
    of_run = [] if run is None else installation_findings(Run.load(run), loaded.config)
    with telling("reading and checking") as tell:
        report = examine(loaded, tell)
    report = replace(report, findings=(*report.findings, *of_run))
    sure = report.sure_proposals
    written = write_corrected(loaded, sure, write) if write and sure else None
    files = loaded.files()
    took_s = time.perf_counter() - began - report.compile_s
    if as_json:
        findings = [asdict(finding) for finding in report.findings]
        proposals = [asdict(proposal) for proposal in report.proposals]
        about = {
            "flight": report.name,
            "severity": report.severity,
            "findings": findings,
            "proposals": proposals,
        }
        print_json({**about, "written": written, "files_read": len(files), "took_s": took_s})
    else:
        for line in report.lines():
            typer.echo(line)
        end = "nothing was written" if written is None else f"wrote {written}: read it, then check it"
        if write is None and sure:
            end += "; --write corrected.toml writes a flight file with the proposals"
        if write is not None and not report.proposals:
            end += ": no finding has a correction"
        left = len(report.proposals) - len(sure)
        if left and (write or not sure):
            end += f"; {left} likely key(s) are left for you to enter: only certain ones are written"
        compiled = f"compiled for {report.compile_s:.0f} s, " if report.compile_s else ""
        typer.echo(f"{compiled}read {len(files)} files in {took_s:.2f} s; {end}")
    if report.severity == "error":
        raise typer.Exit(_FAILED)
