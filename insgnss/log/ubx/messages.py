"""UBX-RXM-SFRBX, the broadcast messages as a u-blox receiver hands them on (ZED-F9P integration manual, 3.13.1).

The receiver has checked all parities and undone inversion and interleaving; each message comes in words of 32 bits.
Not read: the CNAV kinds of GPS, QZSS and BeiDou, Galileo's E6, SBAS and NavIC; they are counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np

from insgnss.gnss.signals import CHANNEL_OFFSET
from insgnss.log.events import listed
from insgnss.log.messages.beidou import D1Messages, D2Messages, beidou_message, information_bits
from insgnss.log.messages.bits import joined
from insgnss.log.messages.broadcast import Broadcast
from insgnss.log.messages.galileo import FnavMessages, InavMessages
from insgnss.log.messages.glonass_strings import GlonassMessages
from insgnss.log.messages.gps_lnav import LnavMessages, data_bits
from insgnss.log.ubx.frames import UbxFrames
from insgnss.log.ubx.observations import SYSTEMS, add_legacy_subframes, satellite_name
from insgnss.tables import Event, Int64

SFRBX: Final = 0x0213
_HEAD: Final = 8
# Which signals carry which kind of message; what is missing here is counted and passed over
_KINDS: Final = {
    ("G", 0): "lnav",
    ("J", 0): "lnav",
    ("E", 1): "inav",  # E1-B
    ("E", 5): "inav",  # E5b-I
    ("E", 3): "fnav",
    **{("C", signal): "d1" for signal in (0, 2, 4)},
    **{("C", signal): "d2" for signal in (1, 3, 10)},
    ("R", 0): "glonass",
    ("R", 2): "glonass",
}
_WORDS: Final = {"lnav": 10, "inav": 8, "fnav": 8, "d1": 10, "d2": 10, "glonass": 4}


class UbxMessages:
    """Collects the messages of all files of a log, in the order of the files."""

    def __init__(self) -> None:
        self.broadcast = Broadcast()
        self._lnav = LnavMessages(self.broadcast)
        self._inav = InavMessages(self.broadcast)
        self._fnav = FnavMessages(self.broadcast)
        self._d1 = D1Messages(self.broadcast)
        self._d2 = D2Messages(self.broadcast)
        self._glonass = GlonassMessages(self.broadcast)
        self._takers: dict[str, Callable[[str, list[int], int | None, int], None]] = {
            "lnav": lambda sv, words, near, _: self._lnav.add(sv, data_bits(words), near),
            "inav": lambda sv, words, near, _: self._inav.add_pages(
                sv, joined(words[:4], 32) >> 8, joined(words[4:], 32) >> 8, near
            ),
            "fnav": lambda sv, words, near, _: self._fnav.add(sv, joined(words, 32) >> 18, near),
            "d1": lambda sv, words, near, _: self._d1.add(sv, information_bits(words), near),
            "d2": lambda sv, words, near, _: self._d2.add(sv, information_bits(words), near),
            "glonass": self._glonass_string,
        }
        self._unused: Counter[str] = Counter()

    def add_file(self, frames: UbxFrames, epoch_offset: Int64, epoch_ns: Int64) -> None:
        """Take all messages of a file.

        Parameters
        ----------
        frames : the file
        epoch_offset, epoch_ns : where in the file the receiver stated which GPS time, ascending offsets
        """
        add_legacy_subframes(frames, self._lnav, epoch_offset, epoch_ns)
        subframes = frames.of(SFRBX)
        # the last time before a message, the first one for those before it
        index = (
            np.searchsorted(epoch_offset, np.array([offset for offset, _ in subframes], dtype=np.int64)) - 1
        )
        nearest = epoch_ns[np.maximum(index, 0)].tolist() if len(epoch_ns) else [None] * len(subframes)
        for (offset, length), near_ns in zip(subframes, nearest, strict=True):
            if length >= _HEAD:
                self._take(frames.data[offset : offset + length], near_ns)
            else:
                self.broadcast.refused["RXM-SFRBX frame too short"] += 1

    def _take(self, payload: bytes, near_ns: int | None) -> None:
        gnss, number, signal, frequency, count = payload[:5]
        sv, system = satellite_name(gnss, number), SYSTEMS.get(gnss, "?")
        kind = _KINDS.get((system, signal))
        if sv is None or kind is None:
            what = "of unknown satellites" if sv is None else f"of system {system}, signal {signal}"
            self._unused[what] += 1
            return
        if kind == "d1" and signal == 0:  # receivers before the ninth generation do not state the signal
            kind = beidou_message(sv).lower()
        if count < _WORDS[kind] or len(payload) < _HEAD + 4 * count:
            self.broadcast.refused["RXM-SFRBX frame with too few words"] += 1
            return
        words = np.frombuffer(payload, "<u4", _WORDS[kind], _HEAD).tolist()
        self._takers[kind](sv, words, near_ns, frequency)

    def _glonass_string(self, sv: str, words: list[int], near_ns: int | None, frequency: int) -> None:
        channel = frequency - CHANNEL_OFFSET if frequency <= 13 else None
        # the fourth word holds the numbers of frame and superframe, zero where not known
        self._glonass.add(sv, joined(words[:3], 32) >> 11, words[3], near_ns, channel)

    def events(self, file: str) -> list[Event]:
        """Return the events of refused and unused messages, with counts."""
        unused = dict(self._unused.most_common())
        return [
            *self.broadcast.refused_events(file),
            *listed("navigation_not_used", "messages of a kind not used", unused, file),
        ]
