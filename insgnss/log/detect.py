"""The format of a receiver's file, by its content; names and extensions do not count."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, Literal

from insgnss.errors import InputError
from insgnss.log.files import file_buffer
from insgnss.log.messages.bits import crc24q
from insgnss.log.novatel.frames import frames_in
from insgnss.log.novatel.rewritten import ascii_bytes
from insgnss.log.sbf.blocks import find_blocks

Format = Literal[
    "ubx", "sbf", "novatel", "rtcm", "ulog", "mcap", "android", "rinex_observation", "rinex_navigation"
]
NAMES: Final[dict[Format, str]] = {
    "ubx": "u-blox UBX",
    "sbf": "Septentrio SBF",
    "novatel": "NovAtel OEM",
    "rtcm": "RTCM 3",
    "ulog": "PX4 ULog",
    "mcap": "ROS 2 MCAP",
    "android": "Android GnssLogger",
    "rinex_observation": "RINEX observation",
    "rinex_navigation": "RINEX navigation",
}
_LOOKED_AT: Final = 1 << 18  # bytes; more than a second of any receiver
_HEAD: Final = 4096  # of text
_MAGIC: Final[dict[Format, bytes]] = {"ulog": b"ULog\x01\x12\x35", "mcap": b"\x89MCAP0\r\n"}
_UBX_SYNC: Final = b"\xb5\x62"
_UBX_TRIES: Final = 500  # sync words looked at, so that a file full of them costs at most a second
_UBX_LONGEST: Final = 8192  # a RAWX of 255 measurements
_NOVATEL_ASCII: Final = re.compile(rb"[#%][A-Z0-9_]+A,")
_RTCM_PREAMBLE: Final = b"\xd3"
_RTCM_FRAMING: Final = 6  # bytes of a frame besides its message
_RTCM_TRIES: Final = 2000
_RINEX_TYPE: Final = re.compile(r"^.{20}(.).{39}RINEX VERSION / TYPE", re.MULTILINE)
_ANDROID: Final = re.compile(r"^(#\s*Raw\s*,.*TimeNanos|Raw,)", re.MULTILINE)


def detect_format(path: Path) -> Format:
    """Return the format of a file (plain or gzipped).

    Blocks with valid check sums identify a binary format; of two formats the one with more bytes counts.

    Raises
    ------
    MissingFileError : no such file
    InputError : no format that is known; the advice says what the file looks like
    """
    buffer = file_buffer(path)
    data = bytes(buffer.slice(0, min(len(buffer), _LOOKED_AT)).to_pybytes())
    for kind, magic in _MAGIC.items():
        if data.startswith(magic):
            return kind
    head = data[:_HEAD].decode("latin-1")
    if "CRINEX VERS" in head[:200]:
        return "rinex_observation"
    rinex = _RINEX_TYPE.search(head.replace("\r", "\n"))
    if rinex is not None:
        return "rinex_observation" if rinex[1] in "OoCc" else "rinex_navigation"
    # a receiver's own format takes precedence over RTCM in the same file
    own: dict[Format, int] = {
        "ubx": _ubx_bytes(data),
        "sbf": _sbf_bytes(data),
        "novatel": _novatel_bytes(path, data),
    }
    if any(own.values()):
        return max(own, key=lambda kind: own[kind])
    if _rtcm_bytes(data):
        return "rtcm"
    if _ANDROID.search(data.decode("latin-1")):
        return "android"
    raise InputError(
        "not a supported receiver file",
        file=path,
        advice=f"{_looks_like(data)}; supported: {', '.join(NAMES.values())}",
    )


def _ubx_bytes(data: bytes) -> int:
    """Return how many bytes lie in UBX frames with a sound check sum (ISO 1145, 8-bit Fletcher)."""
    total, tries, at = 0, _UBX_TRIES, data.find(_UBX_SYNC)
    while 0 <= at <= len(data) - 8 and tries:
        tries -= 1
        end = at + 6 + int.from_bytes(data[at + 4 : at + 6], "little")
        fits = end + 2 <= len(data) and end - at <= _UBX_LONGEST
        if fits and _fletcher(data[at + 2 : end]) == data[end : end + 2]:
            total += end + 2 - at
            if total > _HEAD:
                break
            at = data.find(_UBX_SYNC, end + 2)
        else:
            at = data.find(_UBX_SYNC, at + 1)
    return total


def _fletcher(data: bytes) -> bytes:
    a = b = 0
    for byte in data:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return bytes((a, b))


def _sbf_bytes(data: bytes) -> int:
    """Return how many bytes lie in SBF blocks with a sound check sum, the least that the blocks can have."""
    found = find_blocks(data)
    known = (
        int.from_bytes(data[at + 6 : at + 8], "little") for starts in found.starts.values() for at in starts
    )
    return sum(known) + 8 * found.unread


def _novatel_bytes(path: Path, data: bytes) -> int:
    """Return how many bytes lie in NovAtel messages, binary or ASCII, with a sound check sum."""
    frames = frames_in(path, data)
    return ascii_bytes(data) + (len(data) - frames.foreign_bytes if frames.count else 0)


def _rtcm_bytes(data: bytes) -> int:
    """Return how many bytes lie in RTCM 3 frames with a sound check sum (CRC-24Q)."""
    total, tries, at = 0, _RTCM_TRIES, data.find(_RTCM_PREAMBLE)
    while 0 <= at <= len(data) - _RTCM_FRAMING and tries:
        tries -= 1
        length = int.from_bytes(data[at + 1 : at + 3], "big")
        end = at + _RTCM_FRAMING + length
        # six reserved bits above the ten of the length; a CRC over a frame and its check sum is zero
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
    if data.lstrip()[:3] in (b"$GP", b"$GN", b"$GL"):
        return "this is NMEA, which holds positions but no measurements"
    if data[:1] == _RTCM_PREAMBLE:
        return "this begins like RTCM 3, but no frame of it has a sound check sum"
    if _NOVATEL_ASCII.match(data.lstrip()):
        return "this begins like NovAtel ASCII, but no message of it has a sound check sum"
    if data[:1] == b"#" or b"," in data[:200]:
        return "this looks like CSV: name it in a flight file with its columns instead"
    return "it has no header of a known format"
