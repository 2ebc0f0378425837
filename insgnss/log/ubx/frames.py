"""Frames of the UBX protocol (u-blox interface descriptions, "UBX frame structure"): found, checked, sorted by kind.

A frame is B5 62, class, identifier, length (two bytes, little-endian), payload, and two bytes of Fletcher's checksum
over class to payload: CK_A = sum b_i, CK_B = sum (n - i) b_i, both modulo 256. Here both come from two running sums
over the whole file, kept modulo 256 as well, so that the check of a frame costs the same at any length:
CK_A = A(end) - A(start), CK_B = end CK_A - (W(end) - W(start)) with W the running sum of i b_i.

The package ``pyubx2`` reads the same frames and serves as the oracle in the tests. It builds one Python object with an
attribute for each value of each measurement: 0.5 MB/s of a log of raw measurements, 80 s for an hour of a receiver with
three bands at 4 Hz (38 MB). The frames found here (80 MB/s) are handed to NumPy in one piece for each kind, and that
hour is read to tables in 1.1 s, 35 MB/s (one core, otherwise idle).
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.log.events import framing_events, listed
from insgnss.tables import Event

SYNC: Final = b"\xb5\x62"
_HEAD: Final = 6
_FRAMING: Final = 8  # bytes of a frame besides its payload


@dataclass
class UbxFrames:
    """One file's bytes and where the payloads of each kind of message lie in it, in the order of the file."""

    path: Path
    data: bytes
    payloads: dict[int, list[tuple[int, int]]] = field(default_factory=dict)  # kind -> (offset, length)
    count: int = 0
    foreign_bytes: int = 0  # between the frames: NMEA, RTCM, damage
    bad_checksums: list[int] = field(default_factory=list)  # offsets
    cut_at: int | None = None  # offset of a frame that the end of the file cuts

    def of(self, kind: int) -> list[tuple[int, int]]:
        """Return offset and length of each payload of a kind (class * 256 + identifier)."""
        return self.payloads.get(kind, [])

    def events(self, known: set[int]) -> list[Event]:
        """Return the events for bytes that were damaged, foreign or of a kind that is not read."""
        events = framing_events(self, "ubx", "frame", "not UBX (NMEA, RTCM or damage)", len(self.data))
        others = Counter({kind: len(found) for kind, found in self.payloads.items() if kind not in known})
        by_name = {f"of {kind >> 8:02X} {kind & 255:02X}": n for kind, n in others.most_common()}
        return events + listed("ubx_not_used", "messages not used", by_name, self.path)


def frames_in(path: Path, data: bytes) -> UbxFrames:
    """Return all frames among the bytes of the file ``path`` whose checksum holds.

    After a frame with a wrong checksum the search goes on at its third byte, so a frame that begins within the
    damaged one is found.
    """
    frames = UbxFrames(path, data)
    running, weighted = _running_sums(data)
    length_of = struct.Struct("<H").unpack_from
    end, size = 0, len(data)  # end of the last good frame
    at = data.find(SYNC)
    while at >= 0:
        if at + _FRAMING > size:
            frames.cut_at = at
            break
        length: int = length_of(data, at + 4)[0]
        start, stop = at + 2, at + _HEAD + length
        if stop + 2 > size:
            # a length that reaches beyond the end: the last frame is cut, or these two bytes do not begin a frame
            frames.cut_at = at if frames.cut_at is None else frames.cut_at
            at = data.find(SYNC, at + 2)
            continue
        a = running[stop] - running[start] & 255
        b = stop * a - weighted[stop] + weighted[start] & 255
        if data[stop] != a or data[stop + 1] != b:
            frames.bad_checksums.append(at)
            at = data.find(SYNC, at + 2)
            continue
        frames.cut_at = None
        frames.payloads.setdefault(data[at + 2] << 8 | data[at + 3], []).append((at + _HEAD, length))
        frames.count += 1
        frames.foreign_bytes += at - end
        end = stop + 2
        at = data.find(SYNC, end)
    frames.foreign_bytes += size - end
    return frames


def _running_sums(data: bytes) -> tuple[bytes, bytes]:
    """Return A and W of the module's docstring, entry k over the bytes before k."""
    values = np.frombuffer(data, np.uint8)
    place = np.resize(np.arange(256, dtype=np.uint8), len(values))
    sums = []
    for summed in (values, values * place):
        total = np.zeros(len(values) + 1, np.uint8)
        np.cumsum(summed, dtype=np.uint8, out=total[1:])
        sums.append(total.tobytes())
    return sums[0], sums[1]
