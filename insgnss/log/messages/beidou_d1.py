"""BeiDou D1 subframes of the MEO and IGSO satellites (BDS-SIS-ICD B1I 3.0, 5.2) -> ephemerides and ionosphere."""

from __future__ import annotations

from typing import Final

from insgnss.log.messages.beidou import CLOCK, CLOCK_HEAD, HEADER, LENGTH, header, klobuchar, take
from insgnss.log.messages.bits import Field, angle, power, unpack
from insgnss.log.messages.broadcast import Broadcast
from insgnss.log.messages.gps_lnav import KLOBUCHAR

_SUBFRAME_1: Final = (Field("", HEADER), *CLOCK_HEAD, *KLOBUCHAR, *CLOCK)
_SUBFRAME_2: Final = (
    Field("", HEADER),
    Field("delta_n", 16, angle(-43), True),
    Field("cuc", 18, power(-31), True),
    Field("m0", 32, angle(-31), True),
    Field("e", 32, power(-33)),
    Field("cus", 18, power(-31), True),
    Field("crc", 18, power(-6), True),
    Field("crs", 18, power(-6), True),
    Field("sqrt_a", 32, power(-19)),
    Field("toe_high", 2),
)
_SUBFRAME_3: Final = (
    Field("", HEADER),
    Field("toe_low", 15),
    Field("i0", 32, angle(-31), True),
    Field("cic", 18, power(-31), True),
    Field("omega_dot", 24, angle(-43), True),
    Field("cis", 18, power(-31), True),
    Field("idot", 14, angle(-43), True),
    Field("omega0", 32, angle(-31), True),
    Field("omega", 32, angle(-31), True),
)
_LAYOUTS: Final = {1: _SUBFRAME_1, 2: _SUBFRAME_2, 3: _SUBFRAME_3}
_SUBFRAME_S: Final = 6  # from the start of one subframe to that of the next


class D1Messages:
    """Collects subframes per satellite; 1, 2 and 3 of one frame with toe equal to toc make an ephemeris."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast = broadcast
        self._frames: dict[str, tuple[int, dict[int, int]]] = {}  # start of the frame, its subframes
        self._taken: dict[str, tuple[int, ...]] = {}  # bodies of the last complete frame

    def add(self, sv: str, subframe: int, near_ns: int | None) -> None:
        """Take the 224 information bits of a subframe."""
        number_and_time = header(subframe)
        if number_and_time is None:
            self._broadcast.refused["D1 subframe without its preamble, number or time"] += 1
            return
        number, sow = number_and_time
        if number not in _LAYOUTS:
            return
        start = sow - _SUBFRAME_S * (number - 1)
        if sv not in self._frames or self._frames[sv][0] != start:
            self._frames[sv] = (start, {})
        frame = self._frames[sv][1]
        frame[number] = subframe & ((1 << (LENGTH - HEADER)) - 1)
        bodies = tuple(frame[k] for k in (1, 2, 3) if k in frame)
        if len(bodies) == len(_LAYOUTS) and self._taken.get(sv) != bodies:
            self._taken[sv] = bodies
            self._complete(sv, frame, start, near_ns)

    def _complete(self, sv: str, frame: dict[int, int], start: int, near_ns: int | None) -> None:
        values: dict[str, float] = {}
        for number, layout in _LAYOUTS.items():
            values |= unpack(frame[number], LENGTH, layout)
        values["toe_sow_s"] = 8.0 * (int(values["toe_high"]) << 15 | int(values["toe_low"]))
        if values["toe_sow_s"] != values["toc"]:
            self._broadcast.refused["D1 frame whose toe and toc differ"] += 1
            return
        self._broadcast.ionosphere_of("beidou", klobuchar(values))
        take(self._broadcast, sv, "D1", values, start % 604_800, near_ns)
