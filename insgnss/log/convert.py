"""Receivers' files become our CSV pair, a navigation file and a first flight file in one folder."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from insgnss.constants import NS_PER_WEEK
from insgnss.errors import InputError, ResultError
from insgnss.gpstime import ns_to_datetime
from insgnss.log.android import read_android
from insgnss.log.csv_writer import write_gnss_csv, write_imu_csv
from insgnss.log.detect import NAMES, Format, detect_format
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rinex import read_navigation
from insgnss.log.rinex_nav_writer import write_rinex_navigation
from insgnss.log.rinex_obs import read_rinex_obs
from insgnss.log.sbf import read_sbf
from insgnss.log.ubx import read_ubx
from insgnss.saving import overwriting, saving
from insgnss.tables import Event

GNSS_FILE: Final = "gnss_obs.csv"
IMU_FILE: Final = "imu.csv"
NAVIGATION_FILE: Final = "navigation.rnx"
FLIGHT_FILE: Final = "flight.toml"


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

    The observations of all inputs must be of one format, that is of one receiver; RINEX navigation files beside them
    are copied. A flight file that is already there is kept: somebody may have filled it in.

    Raises
    ------
    InputError and its kin : an input is missing, unknown or unreadable, or there are no observations among them
    ResultError : the folder cannot be written, or a file of somebody else has one of the names
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
    copies = _copies(navigation_files)
    there = [name for name, path in copies.items() if _is_same(path, output / name)]
    navigation = [*copies, *(() if log.navigation is None else (NAVIGATION_FILE,))]
    names = [GNSS_FILE, *navigation, *(() if log.imu is None else (IMU_FILE,))]
    flight = output / FLIGHT_FILE
    kept = (flight,) if flight.exists() else ()
    names += [] if kept else [FLIGHT_FILE]
    messages, week = 0, int(log.gnss.t_ns[0]) // NS_PER_WEEK
    new_names = [name for name in names if name not in there]
    try:
        with overwriting(False, inputs), saving(output, new_names, "conversion") as new:
            write_gnss_csv(new / GNSS_FILE, log.gnss, week)
            for name in set(copies) - set(there):
                shutil.copyfile(copies[name], new / name)
            if log.navigation is not None:
                created = ns_to_datetime(int(log.gnss.t_ns[-1]))
                messages = write_rinex_navigation(new / NAVIGATION_FILE, log.navigation, created)
            if log.imu is not None:
                write_imu_csv(new / IMU_FILE, log.imu, week)
            if not kept:
                text = flight_text(formats, log, week, navigation)
                (new / FLIGHT_FILE).write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultError(f"cannot be written: {error}", file=output) from error
    written = tuple(output / name for name in names)
    return Conversion(formats, log, tuple(events), messages, written, kept)


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
    elif len(paths) > 1:
        raise InputError(
            f"{len(paths)} files of the format {NAMES[kinds[0]]}",
            file=paths[1],
            advice="convert them one by one, each into a folder of its own",
        )
    else:
        log = read_sbf(paths[0]) if kinds[0] == "sbf" else read_android(paths[0])
    return log, list(log.events)


def _copies(paths: Sequence[Path]) -> dict[str, Path]:
    """Return the navigation files by the names of their copies, numbered where a name is taken."""
    copies: dict[str, Path] = {}
    taken = {GNSS_FILE, IMU_FILE, NAVIGATION_FILE, FLIGHT_FILE}
    for number, path in enumerate(paths, 1):
        name = path.name if path.name not in taken else f"{number}_{path.name}"
        taken.add(name)
        copies[name] = path
    return copies


def _is_same(one: Path, other: Path) -> bool:
    return other.exists() and os.path.samefile(one, other)


def flight_text(
    formats: Sequence[tuple[Path, Format]], log: ReceiverLog, week: int, navigation: Sequence[str]
) -> str:
    """Return a first flight file: what the log says, and in comments what only its user can know."""
    sources = ", ".join(path.name for path, _ in formats)
    first = ns_to_datetime(int(log.gnss.t_ns[0]))
    when = f"{first:%Y-%m-%d %H:%M:%S} GPS time"
    if log.imu is None:
        sensor = (
            "# The log has no inertial samples: put your sensor's CSV beside this file and describe it here."
        )
    else:
        sensor = "# The log's own samples, in the sensor's axes."
    channels = ", ".join(f"{sv} {channel:+d}" for sv, channel in sorted(log.gnss.glonass_channels.items()))
    lines = [
        f"# First flight file, from {_comment(sources)} ({when}).",
        "# DECLARE marks what no log can tell: settle each of them before trusting a result.",
        f"gps_week = {week}",
        "",
        "[imu]",
        sensor,
        f'files = ["{IMU_FILE}"]',
        'axes = ["+x", "+y", "+z"]  # DECLARE: which sensor axis points forward, right, down',
        'grade = "mems_consumer"  # DECLARE: the sensor\'s grade, a name of the library or a table of numbers',
        'sampling = "instant"  # rates at their time tags; "mean" for a sensor that averages over its interval',
        'gyro_unit = "rad/s"',
        'accel_unit = "m/s^2"',
        "",
        "[gnss]",
        f'files = ["{GNSS_FILE}"]',
        _navigation_line(navigation),
        "# lever_arm_m = [0.0, 0.0, 0.0]  # DECLARE: IMU to antenna, body axes forward-right-down",
        'oscillator = "tcxo"  # DECLARE when you know better',
    ]
    if channels:
        lines.append(f"# GLONASS channels stated by the log: {channels}")
    return "\n".join(lines) + "\n"


def _navigation_line(names: Sequence[str]) -> str:
    if names:
        listed = ", ".join(f'"{_escaped(name)}"' for name in names)
        return f"navigation = [{listed}]"
    return '# navigation = ["..."]  # DECLARE: the log has no broadcast messages; the day\'s RINEX navigation file'


def _escaped(name: str) -> str:
    """Return a file's name as it stands within a TOML string."""
    return "".join(
        f"\\u{ord(c):04X}" if c in '"\\' or (not c.isprintable() and ord(c) < 65536) else c for c in name
    )


def _comment(text: str) -> str:
    """Return a text that fits on a comment's line."""
    return "".join(c if c.isprintable() else "?" for c in text)
