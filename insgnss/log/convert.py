"""Receivers' files become our CSV pair, a navigation file and a first flight file in one folder."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from insgnss.constants import NS_PER_WEEK
from insgnss.errors import InputError, ResultError
from insgnss.gpstime import ns_to_datetime
from insgnss.log.android import read_android
from insgnss.log.csv_writer import write_gnss_csv, write_imu_csv, write_reference_csv
from insgnss.log.detect import NAMES, Format, detect_format
from insgnss.log.first_flight_file import (
    FLIGHT_FILE,
    GNSS_FILE,
    IMU_FILE,
    NAVIGATION_FILE,
    REFERENCE_FILE,
    flight_text,
)
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rinex import read_navigation
from insgnss.log.rinex_nav_writer import write_rinex_navigation
from insgnss.log.rinex_obs import read_rinex_obs
from insgnss.log.sbf import read_sbf
from insgnss.log.ubx import read_ubx
from insgnss.tables import Event


@dataclass(frozen=True)
class Conversion:
    """What was read and what was written."""

    formats: tuple[tuple[Path, Format], ...]  # each input
    log: ReceiverLog
    events: tuple[Event, ...]
    messages: int  # in the navigation file that was written
    written: tuple[Path, ...]
    kept: tuple[Path, ...]  # was there before and was left as it is


def convert(inputs: Sequence[Path], output: Path) -> Conversion:
    """Read receivers' files and write what a flight needs into the folder ``output``.

    The logs among the inputs must be of one format, that is of one receiver; they may hold inertial samples alone.
    RINEX navigation files beside them are copied. The receiver's own solution, where the log has one, becomes a
    reference. A flight file that is already there is kept: somebody may have filled it in.

    Raises
    ------
    InputError and its kin : an input is missing, unknown or unreadable, or there is no log among them
    ResultError : the folder cannot be written
    """
    formats = tuple((path, detect_format(path)) for path in inputs)
    log, events = _read(formats)
    navigation_files = [path for path, kind in formats if kind == "rinex_navigation"]
    if navigation_files:
        events += read_navigation(navigation_files)[1]
    if log.navigation is not None and not _has_messages(log):
        detail = "no whole ephemeris among the broadcast messages: no navigation file written"
        events.append(Event(None, "navigation_incomplete", detail))
        log = replace(log, navigation=None)
    if log.gnss.sat is not None and (navigation_files or log.navigation is not None):
        detail = "the phone's satellite states are not written: the navigation files stand in"
        events.append(Event(None, "satellite_states_not_used", detail))
        log = replace(log, gnss=replace(log.gnss, sat=None))
    try:
        output.mkdir(parents=True, exist_ok=True)
        copied = _copies(navigation_files, output)
    except OSError as error:
        raise ResultError(f"cannot be written: {error}", file=output) from error
    written, messages = _tables_written(log, output, copied)
    flight = output / FLIGHT_FILE
    kept = (flight,) if flight.exists() else ()
    if not kept:
        _write_text(flight, flight_text([path for path, _ in formats], log, [path.name for path in written]))
        written.append(flight)
    return Conversion(formats, log, tuple(events), messages, tuple(written), kept)


def _tables_written(log: ReceiverLog, output: Path, copied: list[Path]) -> tuple[list[Path], int]:
    """Write what the log has; return the files, those copied included, and the number of messages."""
    span_ns = log.span_ns()
    week = span_ns[0] // NS_PER_WEEK
    written: list[Path] = []
    messages = 0
    if len(log.gnss.t_ns):
        written.append(output / GNSS_FILE)
        write_gnss_csv(written[-1], log.gnss, week)
    written += copied
    if log.navigation is not None:
        written.append(output / NAVIGATION_FILE)
        messages = write_rinex_navigation(written[-1], log.navigation, ns_to_datetime(span_ns[1]))
    if log.imu is not None:
        written.append(output / IMU_FILE)
        write_imu_csv(written[-1], log.imu, week)
    if log.solution is not None:
        written.append(output / REFERENCE_FILE)
        write_reference_csv(written[-1], log.solution, week)
    return written, messages


def _has_messages(log: ReceiverLog) -> bool:
    navigation = log.navigation
    return navigation is not None and (
        len(navigation.ephemerides.sv_names) > 0 or navigation.state_vectors is not None
    )


def _read(formats: Sequence[tuple[Path, Format]]) -> tuple[ReceiverLog, list[Event]]:
    kinds = sorted({kind for _, kind in formats if kind != "rinex_navigation"})
    if len(kinds) != 1:
        found = " and ".join(NAMES[kind] for kind in kinds) or "navigation files alone"
        raise InputError(
            f"observations of one receiver are needed; the files are {found}",
            file=", ".join(str(path) for path, _ in formats),
            advice="convert each receiver's files into a folder of their own",
        )
    paths = [path for path, kind in formats if kind == kinds[0]]
    if kinds[0] == "ubx":
        log = read_ubx(paths)
    elif kinds[0] == "rinex_observation":
        gnss, events = read_rinex_obs(paths)
        log = ReceiverLog(gnss, events=events)
    elif kinds[0] == "sbf":
        log = read_sbf(*paths)
    elif len(paths) > 1:
        raise InputError(
            f"{len(paths)} files of the format {NAMES[kinds[0]]}",
            file=paths[1],
            advice="convert them one by one, each into a folder of its own",
        )
    else:
        log = read_android(paths[0])
    return log, list(log.events)


def _copies(paths: Sequence[Path], output: Path) -> list[Path]:
    """Copy the navigation files; two of one name, or one of a name written here, get a number."""
    copies: list[Path] = []
    taken = {GNSS_FILE, IMU_FILE, NAVIGATION_FILE, REFERENCE_FILE, FLIGHT_FILE}
    for number, path in enumerate(paths, 1):
        name = path.name if path.name not in taken else f"{number}_{path.name}"
        taken.add(name)
        copies.append(output / name)
        if not copies[-1].exists() or not os.path.samefile(path, copies[-1]):
            shutil.copyfile(path, copies[-1])
    return copies


def _write_text(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultError(f"cannot be written: {error}", file=path) from error
