"""Converts receivers' files to two CSV files, a navigation file and a first flight file in one folder."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from insgnss.constants import NS_PER_WEEK
from insgnss.errors import InputError, InsGnssError, ResultError
from insgnss.gpstime import ns_to_datetime
from insgnss.log.csv.writer import (
    write_fixes_csv,
    write_gnss_csv,
    write_imu_csv,
    write_reference_csv,
    write_samples_csv,
)
from insgnss.log.detect import Format, beginning, detect_format
from insgnss.log.first_flight_file import (
    FIXES_FILE,
    FLIGHT_FILE,
    GNSS_FILE,
    IMU_FILE,
    NAVIGATION_FILE,
    REFERENCE_FILE,
    flight_text,
)
from insgnss.log.gnss_log import with_files
from insgnss.log.joined_logs import FormatLog, join_logs
from insgnss.log.phone_satellites import states_beside
from insgnss.log.receiver import LogDeclarations, ReceiverLog
from insgnss.log.receiver_files import read_receiver
from insgnss.log.rinex.nav_writer import write_rinex_navigation
from insgnss.results.saving import check_replaceable, check_writable, overwriting, saving
from insgnss.tables import Event

_KIND: Final = "conversion"


@dataclass(frozen=True)
class Conversion:
    """The files read and written."""

    formats: tuple[tuple[Path, Format], ...]  # each input
    log: ReceiverLog
    events: tuple[Event, ...]
    messages: int  # in the navigation file that was written
    written: tuple[Path, ...]
    kept: tuple[Path, ...]  # was there before and was left as it is


def convert(inputs: Sequence[Path], output: Path, declared: LogDeclarations | None = None) -> Conversion:
    """Read receivers' files and write a flight's inputs into the folder ``output``.

    Logs of one format are of one receiver; they may hold inertial samples alone. Of several formats exactly one holds
    measurements (or fixes, without any) and at most one inertial samples: an autopilot's log and its receiver's. RINEX
    navigation files beside them are copied. The receiver's own solution, where the log has one, becomes a reference;
    without measurements its fixes take their place. A flight file that is already there is kept: somebody may have
    filled it in. ``declared`` is what the files do not state.

    Raises
    ------
    InputError or a subclass : an input is missing, unknown or unreadable, none of them is a log, or logs of several
        formats do not fit together
    ResultError : the folder cannot be written, or another program's file has one of the names
    """
    declared = LogDeclarations() if declared is None else declared
    formats = tuple((path, detect_format(path)) for path in inputs)
    with overwriting(False, inputs):
        _check_output(formats, declared, output)
    log, events = _read(formats, declared)
    navigation_files = [path for path, kind in formats if kind == "rinex_navigation"]
    navigation, more_events = with_files(log.navigation, navigation_files, log.gnss.sat is not None)
    events += more_events
    gnss, more_events = states_beside(log.gnss, navigation)
    events += more_events
    # beside measurements, which hold more, the fixes are of no use
    log = replace(log, gnss=gnss, fixes=None if len(gnss.t_ns) else log.satellite_fixes())
    if log.navigation is not None and not log.navigation.has_messages and gnss.sat is None:
        detail = "no complete ephemeris in the broadcast messages: no navigation file written"
        events.append(Event(None, "navigation_incomplete", detail))
        log = replace(log, navigation=None)
    copies = _copies(navigation_files, log)
    files, there = _files(log, copies), _in_place(copies, output)
    tables = list(files)
    flight = output / FLIGHT_FILE
    existing = (flight,) if flight.exists() else ()
    names = tables if existing else [*tables, FLIGHT_FILE]
    try:
        with (
            overwriting(False, inputs),
            saving(output, [name for name in names if name not in there], _KIND) as new,
        ):
            results = {name: write(new / name) for name, write in files.items() if name not in there}
            if not existing:
                text = flight_text([path for path, _ in formats], log, tables)
                (new / FLIGHT_FILE).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultError(f"cannot be written: {error}", file=output) from error
    written = tuple(output / name for name in names)
    messages = results.get(NAVIGATION_FILE) or 0
    return Conversion(formats, log, tuple(events), messages, written, existing)


def _check_output(formats: Sequence[tuple[Path, Format]], declared: LogDeclarations, output: Path) -> None:
    """Refuse an output folder in which the conversion would replace a file of another program.

    The content of a log decides which files it becomes. If the folder holds files, the beginnings of the logs
    are read first: the whole logs become at least the files that the beginnings become, fixes excepted.

    Raises
    ------
    ResultError : the folder cannot be written, or there is such a file
    """
    check_writable(output)
    if not output.is_dir():
        return
    try:
        if not any(output.iterdir()):
            return
        log = _read_beginnings(formats, declared)
    except (InsGnssError, OSError):  # whether the whole logs can be read is checked when they are
        return
    if log.navigation is not None and not log.navigation.has_messages:
        log = replace(log, navigation=None)
    log = replace(log, fixes=None)  # which are not written if measurements come later
    copies = _copies([path for path, kind in formats if kind == "rinex_navigation"], log)
    there = _in_place(copies, output)
    check_replaceable(output, [name for name in _files(log, copies) if name not in there], _KIND)


def _read_beginnings(formats: Sequence[tuple[Path, Format]], declared: LogDeclarations) -> ReceiverLog:
    """Return what the first bytes of the logs hold.

    Raises
    ------
    InputError or a subclass : they hold nothing that can be used
    OSError : they cannot be copied
    """
    with tempfile.TemporaryDirectory() as folder:
        copies: list[tuple[Path, Format]] = []
        for path, kind in formats:
            copies.append((Path(folder) / f"{len(copies)}", kind))
            copies[-1][0].write_bytes(beginning(path))
        return _read(copies, declared)[0]


def _files(log: ReceiverLog, copies: Mapping[str, Path]) -> dict[str, Callable[[Path], int | None]]:
    """Return the files for the log's content by name, and what writes each; of messages it gives their number."""
    first_ns, last_ns = log.span_ns()
    week = first_ns // NS_PER_WEEK
    files: dict[str, Callable[[Path], int | None]] = {}
    if len(log.gnss.t_ns):
        files[GNSS_FILE] = partial(write_gnss_csv, gnss=log.gnss, week=week)
    files |= {name: partial(_copy, source) for name, source in copies.items()}
    if log.navigation is not None:
        created = ns_to_datetime(last_ns)
        files[NAVIGATION_FILE] = partial(write_rinex_navigation, navigation=log.navigation, created=created)
    if log.imu is not None:
        files[IMU_FILE] = partial(write_imu_csv, imu=log.imu, week=week)
    files |= {each.file: partial(write_samples_csv, samples=each, week=week) for each in log.further}
    if log.solution is not None:
        files[REFERENCE_FILE] = partial(write_reference_csv, reference=log.solution, week=week)
    if log.fixes is not None:
        files[FIXES_FILE] = partial(write_fixes_csv, fixes=log.fixes, week=week)
    return files


def _copy(source: Path, path: Path) -> None:
    shutil.copyfile(source, path)


def _read(
    formats: Sequence[tuple[Path, Format]], declared: LogDeclarations
) -> tuple[ReceiverLog, list[Event]]:
    kinds = dict.fromkeys(kind for _, kind in formats if kind != "rinex_navigation")
    if not kinds:
        raise InputError(
            "only navigation files are given",
            file=", ".join(str(path) for path, _ in formats),
            advice="give a receiver's log in one call with them",
        )
    logs = []
    for kind in kinds:
        paths = tuple(path for path, file_format in formats if file_format == kind)
        logs.append(FormatLog(kind, paths, read_receiver(kind, paths, declared)))
    log = join_logs(logs)
    return log, list(log.events)


def _copies(paths: Sequence[Path], log: ReceiverLog) -> dict[str, Path]:
    """Return the navigation files by the names of their copies, numbered where a name is taken."""
    copies: dict[str, Path] = {}
    taken = {GNSS_FILE, IMU_FILE, NAVIGATION_FILE, REFERENCE_FILE, FIXES_FILE, FLIGHT_FILE}
    taken |= {samples.file for samples in log.further}
    for number, path in enumerate(paths, 1):
        name = path.name if path.name not in taken else f"{number}_{path.name}"
        taken.add(name)
        copies[name] = path
    return copies


def _in_place(copies: Mapping[str, Path], output: Path) -> list[str]:
    """Return the names of the files that are in the output folder already."""
    return [
        name
        for name, path in copies.items()
        if (output / name).exists() and os.path.samefile(path, output / name)
    ]
