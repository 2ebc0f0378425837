"""Each format's reader by its name."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from insgnss.errors import InputError, TimeError
from insgnss.gpstime import ns_to_utc
from insgnss.log.android.reader import read_android
from insgnss.log.detect import NAMES, Format
from insgnss.log.files import file_buffer
from insgnss.log.nmea import read_nmea
from insgnss.log.novatel.reader import read_novatel
from insgnss.log.receiver import LogDeclarations, ReceiverLog, no_measurements
from insgnss.log.rinex.observations import read_rinex_obs
from insgnss.log.rosbag.reader import read_rosbag
from insgnss.log.rtcm.origin import judged_origin
from insgnss.log.rtcm.reader import read_rtcm
from insgnss.log.sbf.reader import read_sbf
from insgnss.log.ubx.reader import read_ubx
from insgnss.log.ulog.reader import read_ulog


def read_receiver(kind: Format, paths: Sequence[Path], declared: LogDeclarations) -> ReceiverLog:
    """Read the files of one receiver, all of one format.

    Where a binary log holds no solution of its own kind, the fixes of the NMEA sentences in it are the solution; where
    it holds no measurements, those of the RTCM messages in it are read, unless they are a base station's: as declared,
    or by its distance.

    Raises
    ------
    InputError or a subclass : a file is unreadable, holds no usable data, or the format allows only one file
    """
    if kind not in _WITH_OTHERS:
        return _READERS[kind](paths, declared)
    failure: InputError | None = None
    try:
        log = _READERS[kind](paths, declared)
    except InputError as error:
        log, failure = ReceiverLog(no_measurements()), error
    if log.solution is None and log.fixes is None:
        sentences = _nmea_inside(paths, declared.date or _first_day(log))
        if sentences is not None:
            log = replace(log, solution=sentences.solution, events=log.events + sentences.events)
            if kind == "rtcm" and isinstance(failure, TimeError):  # the sentences may know the date
                stream = read_rtcm(paths, _first_day(log))
                log = replace(stream, solution=log.solution, events=stream.events + log.events)
    if kind != "rtcm" and not len(log.gnss.t_ns):
        log = _with_rtcm(log, kind, paths, declared)
    elif kind == "rtcm":
        log = _of_the_receiver(log, paths, declared)
    if failure is not None and log.solution is None and not len(log.gnss.t_ns):
        raise failure
    return log


def _first_day(log: ReceiverLog) -> dt.date | None:
    """Return the date of a log's first measurement, sample or fix, None where it has none."""
    if not any(part is not None and len(part.t_ns) for part in (log.gnss, log.imu, log.solution)):
        return None
    day: dt.date = ns_to_utc(log.span_ns()[0]).astype("datetime64[D]").item()
    return day


def _with_rtcm(
    log: ReceiverLog, kind: Format, paths: Sequence[Path], declared: LogDeclarations
) -> ReceiverLog:
    """Return a log without measurements with those of the RTCM messages between its own."""
    try:
        stream = read_rtcm(paths, declared.date or _first_day(log))
    except TimeError:
        if log.solution is None and declared.rtcm != "base":
            raise
        return log
    except InputError:
        return log
    name = f"{paths[0]}: RTCM messages between those of {NAMES[kind]}"
    origin, event = judged_origin(stream, log.satellite_fixes(), declared.rtcm, name, _OWN_MEASUREMENTS[kind])
    if origin == "base":
        return replace(log, events=[*log.events, event])
    return replace(
        log,
        gnss=stream.gnss,
        navigation=log.navigation or stream.navigation,
        events=[*log.events, event, *stream.events],
    )


def _of_the_receiver(stream: ReceiverLog, paths: Sequence[Path], declared: LogDeclarations) -> ReceiverLog:
    """Return an RTCM log with the fixes of NMEA sentences in it, without its measurements where they are a base's."""
    if stream.solution is None and declared.rtcm != "base":
        return stream
    name = f"{paths[0]}: RTCM messages beside the receiver's NMEA"
    origin, event = judged_origin(stream, stream.solution, declared.rtcm, name, "the measurements")
    if origin == "own":
        # of a base that logs its own stream there is nothing to tell
        known = stream.station_m is not None
        return stream if known else replace(stream, events=[*stream.events, event])
    if stream.solution is None:
        raise InputError(
            "the RTCM measurements are declared a base station's, and the log holds no fixes of the receiver",
            file=paths[0],
            key="--rtcm",
            advice="leave the option out to convert the base station's measurements, for [gnss.base]",
        )
    return replace(stream, gnss=no_measurements(), events=[*stream.events, event])


def _nmea_inside(paths: Sequence[Path], date: dt.date | None) -> ReceiverLog | None:
    """Return the fixes of the NMEA sentences between the messages of another format, None without any."""
    # looked for in place: a log may be as large as the memory
    if not any(re.search(b"GGA,", file_buffer(path)) for path in paths):
        return None
    try:
        return read_nmea(paths, date)
    except InputError:
        return None


def _rinex(paths: Sequence[Path]) -> ReceiverLog:
    gnss, events = read_rinex_obs(paths)
    return ReceiverLog(gnss, events=events)


def _alone(kind: Format, paths: Sequence[Path]) -> Path:
    """Return the one file of a format whose files do not belong together."""
    if len(paths) > 1:
        raise InputError(
            f"{len(paths)} files of the format {NAMES[kind]}",
            file=paths[1],
            advice="convert them one by one, each into a folder of its own",
        )
    return paths[0]


_OWN_MEASUREMENTS: Final[dict[Format, str]] = {"ubx": "UBX-RXM-RAWX", "sbf": "MeasEpoch", "novatel": "RANGE"}
_WITH_OTHERS: Final = ("ubx", "sbf", "novatel", "rtcm")  # receivers send both over one port
_READERS: Final[dict[Format, Callable[[Sequence[Path], LogDeclarations], ReceiverLog]]] = {
    "ubx": lambda paths, _: read_ubx(paths),
    "sbf": lambda paths, _: read_sbf(*paths),
    "novatel": lambda paths, declared: read_novatel(paths, declared.imu_scales),
    "rinex_observation": lambda paths, _: _rinex(paths),
    "nmea": lambda paths, declared: read_nmea(paths, declared.date),
    "rtcm": lambda paths, declared: read_rtcm(paths, declared.date),
    "ulog": lambda paths, declared: read_ulog(_alone("ulog", paths), declared.topics),
    "mcap": lambda paths, declared: read_rosbag(_alone("mcap", paths), declared.topics, declared.rtcm),
    "android": lambda paths, _: read_android(*paths),
}
