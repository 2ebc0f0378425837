"""``insgnss convert``: receivers' own files become our CSV pair, a navigation file and a first flight file."""

from __future__ import annotations

import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from insgnss.cli.file_options import Force
from insgnss.cli.printing import AsJson, print_json
from insgnss.cli.progress import telling
from insgnss.errors import ConfigError
from insgnss.results.saving import overwriting

PARTS = ("imu", "gnss", "reference")

if TYPE_CHECKING:
    from insgnss.log.convert import Conversion
    from insgnss.log.receiver import ReceiverLog, RtcmOrigin


def convert(
    inputs: Annotated[
        list[Path],
        typer.Argument(
            help="UBX, SBF, NovAtel OEM, RTCM 3, PX4 ULog, ROS 2 MCAP, Android GnssLogger, NMEA, RINEX files. ULog,"
            " MCAP, NovAtel's ASCII and RANGECMP3 to 5 need the extras 'ulog', 'mcap', 'novatel' (all: 'receivers')."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the output files.")],
    date: Annotated[
        datetime | None,
        typer.Option(
            formats=["%Y-%m-%d"],
            help="UTC date of the first epoch, for RTCM streams and NMEA that do not contain it.",
        ),
    ] = None,
    imu_scale: Annotated[
        str,
        typer.Option(
            metavar="RAD,MPS",
            help="Angle and velocity of one count of a NovAtel inertial sensor of unknown type.",
        ),
    ] = "",
    topic: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART=TOPIC",
            help="The topic to read, where several fit: imu=vehicle_imu:1, reference=vehicle_gps_position,"
            " gnss=/ublox/rawx.",
        ),
    ] = None,
    rtcm: Annotated[
        str,
        typer.Option(
            metavar="own|base",
            help="Origin of RTCM messages in a log of another format: this receiver, or a base station, whose messages"
            " are not read.",
        ),
    ] = "",
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Convert a receiver's own files to CSV, a RINEX navigation file and a draft flight file.

    If one file holds the measurements and another the inertial samples, give both in one call. They may be of
    different makers, such as an autopilot's ULog and its receiver's UBX. The receiver's own solution becomes
    reference.csv. An autopilot's log also has its receiver's fixes: they become fixes.csv.
    """
    began = time.perf_counter()
    # the readers and their libraries are loaded only when the command runs
    from insgnss.log.convert import convert as convert_files
    from insgnss.log.receiver import LogDeclarations

    with overwriting(force, inputs, output):
        declared = LogDeclarations(
            None if date is None else date.date(), _scales(imu_scale), _topics(topic or []), _origin(rtcm)
        )
        with telling("converting"):
            done = convert_files(inputs, output, declared)
    if as_json:
        print_json(_digest(done))
        return
    for line in _summary(done):
        typer.echo(line)
    files = (
        f"read {len(inputs)} file{'s' if len(inputs) > 1 else ''}, wrote {len(done.written)} into {output}"
    )
    typer.echo(f"{files}; {time.perf_counter() - began:.2f} s in all")


def _scales(text: str) -> tuple[float, float] | None:
    """Return the two numbers of ``--imu-scale``, None without it."""
    if not text:
        return None
    try:
        angle, velocity = (float(part) for part in text.split(","))
    except ValueError:
        angle = velocity = 0.0
    if not (0.0 < angle < 1.0 and 0.0 < velocity < 1.0):
        raise ConfigError(
            f"'{text}' is not two positive numbers",
            key="--imu-scale",
            advice="write rad and m/s of a count: 1e-9,2e-8",
        )
    return angle, velocity


def _origin(text: str) -> RtcmOrigin | None:
    """Return whose the RTCM messages are, None without ``--rtcm``."""
    if text in ("own", "base"):
        return "own" if text == "own" else "base"
    if text:
        raise ConfigError(f"'{text}' is neither 'own' nor 'base'", key="--rtcm")
    return None


def _topics(named: list[str]) -> dict[str, str]:
    """Return the topics by the parts they are named for."""
    topics: dict[str, str] = {}
    for text in named:
        part, _, name = text.partition("=")
        if part not in PARTS or not name or part in topics:
            raise ConfigError(
                f"'{text}' names no topic",
                key="--topic",
                advice=f"write each of {', '.join(PARTS)} once: imu=/imu/data",
            )
        topics[part] = name
    return topics


def _digest(done: Conversion) -> dict[str, Any]:
    """Return the summary as plain data."""
    import numpy as np

    gnss, imu = done.log.gnss, done.log.imu
    return {
        "formats": {str(path): kind for path, kind in done.formats},
        "measurements": len(gnss.t_ns),
        "satellites": len(set(gnss.sv.tolist())),
        "signals": list(gnss.signal_names),
        "with_pseudorange": int(np.isfinite(gnss.pseudorange_m).sum()),
        "messages": done.messages,
        "imu_samples": 0 if imu is None else len(imu.t_ns),
        "solution_rows": 0 if done.log.solution is None else len(done.log.solution.t_ns),
        "events": [{"kind": event.kind, "detail": event.detail} for event in done.events],
        "wrote": [str(path) for path in done.written],
        "kept": [str(path) for path in done.kept],
    }


def _without_measurements(log: ReceiverLog) -> str:
    """Return what stands in for measurements, and where they may be."""
    fixes = log.satellite_fixes()
    held = "" if fixes is None else f": {len(fixes.t_ns)} fixes of the receiver take their place"
    return f"no raw measurements{held}. If another file has some, convert both in one call into a new folder"


def _summary(done: Conversion) -> list[str]:
    import numpy as np

    from insgnss.log.checks.report import from_events
    from insgnss.log.detect import NAMES

    gnss = done.log.gnss
    lines = [f"{path}: {NAMES[kind]}" for path, kind in done.formats]
    if len(gnss.t_ns):
        span_s = (int(gnss.t_ns[-1]) - int(gnss.t_ns[0])) / 1e9
        without = int(np.isnan(gnss.pseudorange_m).sum())
        lines.append(
            f"{len(gnss.t_ns)} measurements of {len(np.unique(gnss.sv))} satellites, signals"
            f" {', '.join(gnss.signal_names)}; {len(np.unique(gnss.t_ns))} epochs over {span_s:.1f} s"
            + (f"; {without} of them without a pseudorange" if without else "")
        )
    else:
        lines.append(_without_measurements(done.log))
    if done.messages:
        lines.append(f"{done.messages} broadcast messages")
    if done.log.imu is not None:
        lines.append(f"{len(done.log.imu.t_ns)} inertial samples, in the sensor's axes")
    if done.log.solution is not None:
        whose = "simulator's truth" if done.log.solution_from == "truth" else "receiver's own solution"
        lines.append(f"{len(done.log.solution.t_ns)} rows of the {whose}")
    lines += [finding.line() for finding in from_events("input", done.events, frozenset())]
    lines += [f"wrote {path}" for path in done.written]
    lines += [f"kept {path}, which was there before" for path in done.kept]
    return lines
