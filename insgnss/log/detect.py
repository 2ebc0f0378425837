"""The format of a file by its content, not by name and extension: receivers' files, a flight's logs, failed tables."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal, TypeVar

from insgnss.config.flight import Base, FurtherAntenna, Gnss, LogFormat
from insgnss.errors import InputError, MissingFileError
from insgnss.log.android.lines import RAW_TABLE
from insgnss.log.csv.dialect import UTF16_MARKS
from insgnss.log.files import first_bytes
from insgnss.log.messages.bits import crc24q
from insgnss.log.nmea import nmea_bytes
from insgnss.log.novatel.frames import NovatelFrames
from insgnss.log.novatel.frames import frames_in as novatel_frames
from insgnss.log.novatel.rewritten import ascii_bytes
from insgnss.log.sbf.blocks import find_blocks
from insgnss.log.ubx.frames import UbxFrames
from insgnss.log.ubx.frames import frames_in as ubx_frames

Format = Literal[
    "ubx",
    "sbf",
    "novatel",
    "rtcm",
    "ulog",
    "mcap",
    "android",
    "nmea",
    "rinex_observation",
    "rinex_navigation",
]
NAMES: Final[dict[Format, str]] = {
    "ubx": "u-blox UBX",
    "sbf": "Septentrio SBF",
    "novatel": "NovAtel OEM",
    "rtcm": "RTCM 3",
    "ulog": "PX4 ULog",
    "mcap": "ROS 2 MCAP",
    "android": "Android GnssLogger",
    "nmea": "NMEA 0183",
    "rinex_observation": "RINEX observation",
    "rinex_navigation": "RINEX navigation",
}
_LOOKED_AT: Final = 1 << 18  # bytes; more than a second of any receiver
_HEAD: Final = 4096  # of text
_MAGIC: Final[dict[Format, bytes]] = {"ulog": b"ULog\x01\x12\x35", "mcap": b"\x89MCAP0\r\n"}
_OTHER_BAGS: Final = {
    b"#ROSBAG V": "a ROS 1 bag: convert it with 'rosbags-convert --src IN.bag --dst OUT --dst-storage mcap'",
    b"SQLite format 3\0": "a ROS 2 bag in SQLite (.db3): convert it to MCAP, with 'ros2 bag convert' or 'mcap convert'",
}
_NOVATEL_ASCII: Final = re.compile(rb"[#%][A-Z0-9_]+A,")
_RTCM_PREAMBLE: Final = b"\xd3"
_RTCM_FRAMING: Final = 6  # bytes of a frame besides its message
_RTCM_TRIES: Final = 2000
_CONTROL: Final = bytes(c for c in (*range(32), 127) if c not in b"\t\n\r\f\x1b")
# share of control characters in a text with a few damaged bytes; of random bytes 0.11
_MOST_CONTROL: Final = 0.02
_RINEX_TYPE: Final = re.compile(r"^.{20}(.).*RINEX VERSION / TYPE", re.MULTILINE)
_SP3: Final = re.compile(r"#[a-d][PV ][ 12]\d{3} [ \d]\d [ \d]\d")
_NO_LOGS: Final = {"C": ("satellite clocks (RINEX clock)", "precise"), "M": ("weather data (RINEX)", "")}
# a file of inertial data alone may lack both the lines of raw measurements and their header
_ANDROID: Final = re.compile(
    r"^(#\s*Raw\s*,.*TimeNanos|Raw,|#\s*(Uncal)?(Accel|Gyro)\s*,.*elapsedRealtimeNanos"
    r"|MessageType,.*elapsedRealtimeNanos,MeasurementX)",
    re.MULTILINE,
)


def detect_format(path: Path) -> Format:
    """Return the format of a file (plain or gzipped).

    Blocks with valid checksums identify a binary format; of two formats the one with more bytes counts.

    Raises
    ------
    MissingFileError : no such file
    InputError : no format that is known; the advice says what the file looks like
    """
    data = beginning(path)
    for kind, magic in _MAGIC.items():
        if data.startswith(magic):
            return kind
    head = data[:_HEAD].decode("latin-1")
    if "CRINEX VERS" in head[:200]:
        return "rinex_observation"
    rinex = _RINEX_TYPE.search(head.replace("\r", "\n").expandtabs())
    if rinex is not None:
        if rinex[1] in _NO_LOGS:
            raise _no_log(path, *_NO_LOGS[rinex[1]])
        return "rinex_observation" if rinex[1] in "Oo" else "rinex_navigation"
    if _SP3.match(head):
        raise _no_log(path, "precise orbits (SP3)", "precise")
    if "ANTEX VERSION / SYST" in head:
        raise _no_log(path, "phase centres of antennas (ANTEX)", "antennas")
    # a receiver's own format takes precedence over RTCM and NMEA in the same file
    own: dict[Format, int] = {
        "ubx": _framed_bytes(ubx_frames(path, data)),
        "sbf": _sbf_bytes(data),
        "novatel": _framed_bytes(novatel_frames(path, data)) + ascii_bytes(data),
    }
    if any(own.values()):
        return max(own, key=lambda kind: own[kind])
    if _rtcm_bytes(data):
        return "rtcm"
    if RAW_TABLE.match(head) or _ANDROID.search(data.decode("latin-1")):
        return "android"
    if nmea_bytes(data):
        return "nmea"
    raise InputError(
        "not a supported receiver file",
        file=path,
        advice=f"{_looks_like(data)}; supported: {', '.join(NAMES.values())}",
    )


def beginning(path: Path) -> bytes:
    """Return the first bytes of a file (plain or packed), more than a second of any receiver.

    Raises
    ------
    MissingFileError, InputError : no such file, or it cannot be read
    """
    return first_bytes(path, _LOOKED_AT)


def _no_log(path: Path, what: str, key: str) -> InputError:
    """Return the error of a file that belongs to a flight, but not of a receiver's log."""
    advice = f"convert the log without it, and name it in the flight file as gnss.{key}" if key else ""
    return InputError(f"the file holds {what}, not a receiver's log", file=path, advice=advice)


def _framed_bytes(frames: UbxFrames | NovatelFrames) -> int:
    """Return how many bytes lie in frames with a valid checksum."""
    return len(frames.data) - frames.foreign_bytes if frames.count else 0


def _sbf_bytes(data: bytes) -> int:
    """Return how many bytes lie in SBF blocks with a valid checksum, the least that the blocks can have."""
    blocks = find_blocks(data)
    known = (
        int.from_bytes(data[at + 6 : at + 8], "little") for starts in blocks.starts.values() for at in starts
    )
    return sum(known) + 8 * blocks.others.total()


def _rtcm_bytes(data: bytes) -> int:
    """Return how many bytes lie in RTCM 3 frames with a valid checksum (CRC-24Q)."""
    total, tries, at = 0, _RTCM_TRIES, data.find(_RTCM_PREAMBLE)
    while 0 <= at <= len(data) - _RTCM_FRAMING and tries:
        tries -= 1
        length = int.from_bytes(data[at + 1 : at + 3], "big")
        end = at + _RTCM_FRAMING + length
        # six reserved bits above the ten of the length; a CRC over a frame and its checksum is zero
        if (
            length < 1 << 10
            and end <= len(data)
            and not crc24q(int.from_bytes(data[at:end], "big"), 8 * (end - at))
        ):
            total += end - at
            if total > _HEAD:
                break
            at = data.find(_RTCM_PREAMBLE, end)
        else:
            at = data.find(_RTCM_PREAMBLE, at + 1)
    return total


def _looks_like(data: bytes) -> str:
    for magic, bag in _OTHER_BAGS.items():
        if data.startswith(magic):
            return f"this looks like {bag}"
    if data.lstrip()[:3] in (b"$GP", b"$GN", b"$GL"):
        return "this begins like NMEA, but no sentence of it has a valid checksum"
    if data[:1] == _RTCM_PREAMBLE:
        return "this begins like RTCM 3, but no frame of it has a valid checksum"
    if _NOVATEL_ASCII.match(data.lstrip()):
        return "this begins like NovAtel ASCII, but no message of it has a valid checksum"
    if data.startswith(UTF16_MARKS):
        return "this is text in UTF-16: save it in UTF-8"
    if len(data.translate(None, _CONTROL)) < (1.0 - _MOST_CONTROL) * len(data):
        return (
            "this is a binary file of no known kind, or a damaged one: convert it to RINEX with the program of the"
            " receiver's maker"
        )
    if data[:1] == b"#" or any(mark in data[:200] for mark in (b",", b";", b"\t")):
        return "this looks like CSV: name it in a flight file with its columns instead"
    return "it has no header of a known format"


# what a flight file calls the formats of GNSS logs that it may name; the others have to be converted
_DECLARED: Final[dict[Format, LogFormat]] = {
    "rinex_observation": "rinex",
    "ubx": "ubx",
    "sbf": "sbf",
    "android": "android",
}
# texts that a table may look like: one of Android's columns, or with a sentence in some lines
_LIKE_TABLES: Final[tuple[Format, ...]] = ("android", "nmea")
_Log = TypeVar("_Log", Gnss, Base)


def with_stated_format(log: _Log) -> _Log:
    """Return a GNSS log with the format that its first file states, where none is declared.

    A file that states none, or cannot be opened, leaves the default. Declared columns say that it is a table.
    """
    if not log.files or {"format", "columns"} & log.model_fields_set:
        return log
    stated = _stated(log.files[0])
    return log if stated not in _DECLARED else log.model_copy(update={"format": _DECLARED[stated]})


def with_stated_format_of_antenna(antenna: FurtherAntenna, main: Gnss) -> FurtherAntenna:
    """Return a further antenna with the format that its first file states, where none is declared.

    A file that states none has the format that ``main``, the table [gnss] as it is written, declares, else the default.
    Columns that [gnss] declares are also the antenna's: a table may look like Android's, but not like another format.
    """
    if antenna.format is not None:
        return antenna
    stated = _stated(antenna.files[0])
    like_table = stated in _LIKE_TABLES and "columns" in main.model_fields_set
    log_format = _DECLARED.get(stated) if stated is not None and not like_table else None
    default: LogFormat = (
        main.format if "format" in main.model_fields_set else Gnss.model_fields["format"].default
    )
    return antenna.model_copy(update={"format": log_format or default})


@contextmanager
def naming_format(path: Path, *, of_gnss: bool = False) -> Iterator[None]:
    """Name the format of a file that is read as a table, where that fails and it is a file of another kind.

    Parameters
    ----------
    of_gnss : a flight file may declare the log's format

    Raises
    ------
    InputError or a subclass : that of the reader; the advice names the format
    """
    try:
        yield
    except MissingFileError:
        raise
    except InputError as error:
        stated = _stated(path)
        if stated is None:
            raise
        raise type(error)(
            error.message,
            file=error.file,
            line=error.line,
            column=error.column,
            advice=_advice(stated, error.advice, of_gnss=of_gnss),
        ) from error


def _stated(path: Path) -> Format | None:
    """Return the format that a file's content states, None without one."""
    try:
        return detect_format(path)
    except InputError:
        return None


def _advice(stated: Format, of_table: str, *, of_gnss: bool) -> str:
    """Return the advice of a file of a format, and that of the table which it may be after all."""
    todo = "'insgnss convert' writes its content as tables, with a flight file that names them"
    if of_gnss and stated in _DECLARED:
        todo = f"write format = '{_DECLARED[stated]}' beside files"
    elif stated == "rinex_navigation":
        todo = "name it under gnss.navigation"
    advice = f"this is a {NAMES[stated]} file, not a table: {todo}"
    return f"{advice}; if it is a table, {of_table}" if of_table and stated in _LIKE_TABLES else advice
