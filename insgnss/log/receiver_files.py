"""Each format's reader by its name."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from insgnss.errors import InputError
from insgnss.gpstime import ns_to_utc
from insgnss.log.android.reader import read_android
from insgnss.log.declared import LogDeclarations
from insgnss.log.detect import NAMES, Format
from insgnss.log.files import file_buffer
from insgnss.log.nmea import read_nmea
from insgnss.log.novatel.reader import read_novatel
from insgnss.log.receiver import ReceiverLog
from insgnss.log.rinex.observations import read_rinex_obs
from insgnss.log.rosbag.reader import read_rosbag
from insgnss.log.rtcm.reader import read_rtcm
from insgnss.log.sbf.reader import read_sbf
from insgnss.log.ubx.reader import read_ubx
from insgnss.log.ulog.reader import read_ulog


def read_receiver(kind: Format, paths: Sequence[Path], declared: LogDeclarations) -> ReceiverLog:
    """Read the files of one receiver, all of one format.

    Where a binary log holds no solution of its own kind, the fixes of the NMEA sentences in it are the solution.

    Raises
    ------
    InputError or a subclass : a file is unreadable, holds no usable data, or the format allows only one file
    """
    if kind not in _WITH_NMEA:
        return _READERS[kind](paths, declared)
    try:
        log = _READERS[kind](paths, declared)
    except InputError:
        sentences = _nmea_inside(paths, declared.date)
        if sentences is None:
            raise
        return sentences
    if log.solution is not None or log.fixes is not None:
        return log
    first_day = ns_to_utc(log.span_ns()[0]).astype("datetime64[D]").item()
    sentences = _nmea_inside(paths, declared.date or first_day)
    if sentences is None:
        return log
    return replace(log, solution=sentences.solution, events=log.events + sentences.events)


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


_WITH_NMEA: Final = ("ubx", "sbf", "novatel", "rtcm")  # receivers send both over one port
_READERS: Final[dict[Format, Callable[[Sequence[Path], LogDeclarations], ReceiverLog]]] = {
    "ubx": lambda paths, _: read_ubx(paths),
    "sbf": lambda paths, _: read_sbf(*paths),
    "novatel": lambda paths, declared: read_novatel(paths, declared.imu_scales),
    "rinex_observation": lambda paths, _: _rinex(paths),
    "nmea": lambda paths, declared: read_nmea(paths, declared.date),
    "rtcm": lambda paths, declared: read_rtcm(paths, declared.date),
    "ulog": lambda paths, declared: read_ulog(_alone("ulog", paths), declared.topics),
    "mcap": lambda paths, declared: read_rosbag(_alone("mcap", paths), declared.topics),
    "android": lambda paths, _: read_android(_alone("android", paths)),
}
