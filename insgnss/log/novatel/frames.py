"""NovAtel OEM binary messages (OEM4 to OEM7): found by their sync bytes and checksum, sorted by kind.

OEM7 commands and logs reference manual, "Binary" and "Description of ASCII and binary logs with short headers": AA 44
12 with a header whose length it states (28), or AA 44 13 with one of 12 bytes; then the message, then a CRC-32
(polynomial EDB88320 reflected, start 0) over all before it.

NovAtel's own library (``novatel_edie``) serves as the oracle of the tests. The package does not read with it: it makes
an object of each message, and ends the process on some messages whose checksum holds but whose counts do not
(2.10.11, RANGECMP).
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from insgnss.constants import NS_PER_MS, NS_PER_WEEK
from insgnss.gpstime import LATEST_WEEK
from insgnss.log.events import framing_events, listed
from insgnss.tables import Event

SYNC: Final = b"\xaa\x44"
LONG, SHORT = 0x12, 0x13
LONG_HEADER, SHORT_HEADER = 28, 12
_CRC_BYTES: Final = 4
_TIME_UNKNOWN: Final = 20  # the least time status; from there on the header's time is at least approximate
_RESPONSE: Final = 0x80  # bits of the message type: an answer to a command, no log
_NO_BINARY: Final = 0x60
_SOURCE, _SECONDARY = 0x1F, 1  # bits that OEM7 gives a meaning; older receivers leave others there
_LONG: Final = struct.Struct("<3xBHBxHxxxBHI")  # header length, kind, type, length, time status, week, ms
_SHORT: Final = struct.Struct("<3xBHHI")  # length, kind, week, ms


class Frame(NamedTuple):
    """The place and the header of one message."""

    offset: int  # of what follows the header
    length: int
    t_ns: int  # GPS time of the header, -1 where the receiver did not know it
    second: bool  # of the secondary antenna


@dataclass
class NovatelFrames:
    """One file's bytes and its sound messages of each kind, in the order of the file."""

    path: Path
    data: bytes
    size: int  # of the file [bytes]
    frames: dict[int, list[Frame]] = field(default_factory=dict)
    count: int = 0
    foreign_bytes: int = 0
    bad_checksums: list[int] = field(default_factory=list)  # offsets
    cut_at: int | None = None
    gaps: list[tuple[int, int]] = field(default_factory=list)  # begin and end of bytes outside messages

    def of(self, *kinds: int) -> list[Frame]:
        """Return the messages of these kinds, in the order of the file."""
        frames = [frame for kind in kinds for frame in self.frames.get(kind, [])]
        return sorted(frames) if len(kinds) > 1 else frames

    def events(self, known: frozenset[int]) -> list[Event]:
        """Return the events for bytes that were damaged, foreign or of a kind that is not read."""
        events = framing_events(self, "novatel", "message", "not NovAtel messages (NMEA, damage)", self.size)
        others = Counter({kind: len(frames) for kind, frames in self.frames.items() if kind not in known})
        by_number = {f"of {kind}": n for kind, n in others.most_common()}
        return events + listed("novatel_not_used", "messages not read, by number", by_number, self.path)


def check_sum(data: bytes | memoryview) -> int:
    """Return NovAtel's CRC-32: the usual one without its inversions before and after."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def frames_in(path: Path, data: bytes) -> NovatelFrames:
    """Return the messages in the bytes of the file ``path``; after a wrong checksum the search goes on within."""
    frames, view, end = NovatelFrames(path, data, len(data)), memoryview(data), 0
    at = data.find(SYNC)
    while at >= 0:
        whole = _whole_length(data, at)
        if whole == 0:
            at = data.find(SYNC, at + 1)
            continue
        if at + whole > len(data):
            frames.cut_at = at if frames.cut_at is None else frames.cut_at
            at = data.find(SYNC, at + 1)
            continue
        stop = at + whole - _CRC_BYTES
        if check_sum(view[at:stop]) != int.from_bytes(data[stop : stop + _CRC_BYTES], "little"):
            frames.bad_checksums.append(at)
            at = data.find(SYNC, at + 1)
            continue
        frames.cut_at = None
        _keep(frames, at, stop)
        frames.gaps += [(end, at)] if at > end else []
        end = at + whole
        at = data.find(SYNC, end)
    frames.gaps += [(end, len(data))] if len(data) > end else []
    frames.foreign_bytes = sum(b - a for a, b in frames.gaps)
    return frames


def _whole_length(data: bytes, at: int) -> int:
    """Return the length with header and checksum of the message that may begin here, 0 where none does."""
    kind = data[at + 2] if at + 2 < len(data) else 0
    if kind == LONG and at + LONG_HEADER <= len(data) and data[at + 3] >= LONG_HEADER:
        return data[at + 3] + int.from_bytes(data[at + 8 : at + 10], "little") + _CRC_BYTES
    if kind == SHORT and at + SHORT_HEADER <= len(data):
        return SHORT_HEADER + data[at + 3] + _CRC_BYTES
    return LONG_HEADER + _CRC_BYTES if kind in (LONG, SHORT) and at + LONG_HEADER > len(data) else 0


def _keep(frames: NovatelFrames, at: int, stop: int) -> None:
    """Note the valid message from ``at``, whose checksum is at ``stop``."""
    frames.count += 1
    if frames.data[at + 2] == SHORT:
        _, kind, week, ms = _SHORT.unpack_from(frames.data, at)
        known, second, start = True, False, at + SHORT_HEADER
    else:
        head, kind, form, _, status, week, ms = _LONG.unpack_from(frames.data, at)
        known, second, start = status > _TIME_UNKNOWN, form & _SOURCE == _SECONDARY, at + head
        if form & _RESPONSE or form & _NO_BINARY:
            return
    timed = known and 0 < week <= LATEST_WEEK and ms < NS_PER_WEEK // 1_000_000
    t_ns = week * NS_PER_WEEK + ms * NS_PER_MS if timed else -1
    frames.frames.setdefault(kind, []).append(Frame(start, stop - start, t_ns, second))
