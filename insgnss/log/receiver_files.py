"""Each format's reader by its name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from insgnss.errors import InputError
from insgnss.log.android.reader import read_android
from insgnss.log.declared import LogDeclarations
from insgnss.log.detect import NAMES, Format
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

    Raises
    ------
    InputError or a subclass : a file is unreadable, holds no usable data, or the format allows only one file
    """
    return _READERS[kind](paths, declared)


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
