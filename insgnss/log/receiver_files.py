"""Each format's reader by its name."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pymap3d

from insgnss.errors import InputError, TimeError
from insgnss.gpstime import ns_to_utc
from insgnss.log.android.reader import read_android
from insgnss.log.declared import LogDeclarations
from insgnss.log.detect import NAMES, Format
from insgnss.log.files import file_buffer
from insgnss.log.nmea import read_nmea
from insgnss.log.novatel.reader import read_novatel
from insgnss.log.receiver import ReceiverLog, no_measurements
from insgnss.log.rinex.observations import read_rinex_obs
from insgnss.log.rosbag.reader import read_rosbag
from insgnss.log.rtcm.reader import read_rtcm
from insgnss.log.sbf.reader import read_sbf
from insgnss.log.ubx.reader import read_ubx
from insgnss.log.ulog.reader import read_ulog
from insgnss.tables import Event, ReferenceTable


def read_receiver(kind: Format, paths: Sequence[Path], declared: LogDeclarations) -> ReceiverLog:
    """Read the files of one receiver, all of one format.

    Where a binary log holds no solution of its own kind, the fixes of the NMEA sentences in it are the solution; where
    it holds no measurements, those of the RTCM messages in it are read, unless they are a distant base station's.

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
    if kind != "rtcm" and not len(log.gnss.t_ns):
        log = _with_rtcm(log, kind, paths, declared.date or _first_day(log))
    if failure is not None and log.solution is None and not len(log.gnss.t_ns):
        raise failure
    return log


def _first_day(log: ReceiverLog) -> dt.date | None:
    """Return the date of a log's first measurement, sample or fix, None where it has none."""
    if not any(part is not None and len(part.t_ns) for part in (log.gnss, log.imu, log.solution)):
        return None
    day: dt.date = ns_to_utc(log.span_ns()[0]).astype("datetime64[D]").item()
    return day


def _with_rtcm(log: ReceiverLog, kind: Format, paths: Sequence[Path], date: dt.date | None) -> ReceiverLog:
    """Return a log without measurements with those of the RTCM messages between its own.

    Raises
    ------
    TimeError : the log has nothing else, and the date of the messages is unknown
    """
    try:
        stream = read_rtcm(paths, date)
    except TimeError:
        if log.solution is None:
            raise
        return log
    except InputError:
        return log
    fixes = log.satellite_fixes()
    away_m = _distance_m(fixes, stream.station_m)
    name = f"{paths[0]}: RTCM messages between those of {NAMES[kind]}"
    if away_m > _SAME_ANTENNA_M:
        detail = f"{name} hold the measurements of a station {away_m / 1e3:.3g} km away, a base: not read"
        return replace(log, events=[*log.events, Event(None, "rtcm_of_base", detail)])
    whose = "they do not say whose they are"
    if fixes is not None and stream.station_m is not None:
        whose = f"their station is {away_m:.0f} m from the fixes"
    detail = (
        f"{name} are read as this receiver's measurements; {whose}. If they are a base station's: name the"
        " measurements converted from them under [gnss.base] with format = 'csv' and the place of the base"
        f" (lat_deg, lon_deg, h_m), and record {_OWN_MEASUREMENTS[kind]} of this receiver for [gnss]"
    )
    return replace(
        log,
        gnss=stream.gnss,
        navigation=log.navigation or stream.navigation,
        events=[*log.events, Event(None, "rtcm_read", detail), *stream.events],
    )


def _distance_m(fixes: ReferenceTable | None, station_m: tuple[float, float, float] | None) -> float:
    """Return how far the middle of a receiver's fixes is from the place that a stream states, 0 without either."""
    if fixes is None or station_m is None:
        return 0.0
    middle = (float(np.median(part)) for part in (fixes.lat_deg, fixes.lon_deg, fixes.h_m))
    return float(np.linalg.norm(np.subtract(pymap3d.geodetic2ecef(*middle), station_m)))


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


_SAME_ANTENNA_M: Final = 50.0  # a receiver alone errs by less; a base is seldom so near
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
    "mcap": lambda paths, declared: read_rosbag(_alone("mcap", paths), declared.topics),
    "android": lambda paths, _: read_android(_alone("android", paths)),
}
