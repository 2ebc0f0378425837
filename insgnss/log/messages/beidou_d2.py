"""BeiDou D2 pages of the geostationary satellites (BDS-SIS-ICD B1I 3.0, 5.3) -> ephemerides and ionosphere.

Subframe 1 of each frame of 3 s carries one page; ten pages, 30 s, carry the message. Fields that span two pages are
joined here by writing the pages' contents one after the other.
"""

from __future__ import annotations

from typing import Final

from insgnss.log.messages.beidou import CLOCK_HEAD, HEADER, LENGTH, header, klobuchar, take
from insgnss.log.messages.bits import Field, angle, power, unpack, unsigned
from insgnss.log.messages.broadcast import Broadcast
from insgnss.log.messages.gps_lnav import KLOBUCHAR

_PAGES: Final = 10
_PAGE_S: Final = 3
_START: Final = HEADER + 4  # the page's number ends here
# Where the content of pages 3 to 10 begins and how many bits it has (figures 5-14-3 to 5-14-10)
_CONTENT: Final = {
    3: (_START + 38, 28),
    4: (_START, 64),
    5: (_START, 64),
    6: (_START, 64),
    7: (_START, 64),
    8: (_START, 66),
    9: (_START, 64),
    10: (_START, 19),
}
_PAGE_1: Final = (Field("", _START), *CLOCK_HEAD)
_PAGE_2: Final = (Field("", _START), *KLOBUCHAR)
_ORBIT: Final = (
    Field("af0", 24, power(-33), True),
    Field("af1", 22, power(-50), True),
    Field("af2", 11, power(-66), True),
    Field("aode", 5),
    Field("delta_n", 16, angle(-43), True),
    Field("cuc", 18, power(-31), True),
    Field("m0", 32, angle(-31), True),
    Field("cus", 18, power(-31), True),
    Field("e", 32, power(-33)),
    Field("sqrt_a", 32, power(-19)),
    Field("cic", 18, power(-31), True),
    Field("cis", 18, power(-31), True),
    Field("toe_sow_s", 17, 8.0),
    Field("i0", 32, angle(-31), True),
    Field("crc", 18, power(-6), True),
    Field("crs", 18, power(-6), True),
    Field("omega_dot", 24, angle(-43), True),
    Field("omega0", 32, angle(-31), True),
    Field("omega", 32, angle(-31), True),
    Field("idot", 14, angle(-43), True),
)
_ORBIT_LENGTH: Final = sum(bits for _, bits in _CONTENT.values())


class D2Messages:
    """Collects pages per satellite; ten pages of one cycle with toe equal to toc make an ephemeris."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast = broadcast
        self._cycles: dict[str, tuple[int, dict[int, int]]] = {}  # start of the cycle, its pages
        self._taken: dict[str, tuple[int, ...]] = {}

    def add(self, sv: str, subframe: int, near_ns: int | None) -> None:
        """Take the 224 information bits of a subframe."""
        number_and_time = header(subframe)
        if number_and_time is None:
            self._broadcast.refused["D2 subframe without its preamble, number or time"] += 1
            return
        number, sow = number_and_time
        if number != 1:
            return
        page = unsigned(subframe, LENGTH, HEADER, 4)
        if not 1 <= page <= _PAGES:
            self._broadcast.refused["D2 page without a number"] += 1
            return
        start = sow - _PAGE_S * (page - 1)
        if sv not in self._cycles or self._cycles[sv][0] != start:
            self._cycles[sv] = (start, {})
        cycle = self._cycles[sv][1]
        cycle[page] = subframe & ((1 << (LENGTH - HEADER)) - 1)
        needed = tuple(cycle[k] for k in range(1, _PAGES + 1) if k in cycle)
        if len(needed) == _PAGES and self._taken.get(sv) != needed:
            self._taken[sv] = needed
            self._complete(sv, cycle, start, near_ns)

    def _complete(self, sv: str, cycle: dict[int, int], start: int, near_ns: int | None) -> None:
        orbit = 0
        for page, (first, bits) in _CONTENT.items():
            orbit = orbit << bits | unsigned(cycle[page], LENGTH, first, bits)
        values = unpack(orbit, _ORBIT_LENGTH, _ORBIT) | unpack(cycle[1], LENGTH, _PAGE_1)
        if values["toe_sow_s"] != values["toc"]:
            self._broadcast.refused["D2 cycle whose toe and toc differ"] += 1
            return
        self._broadcast.ionosphere_of("beidou", klobuchar(unpack(cycle[2], LENGTH, _PAGE_2)))
        take(self._broadcast, sv, "D2", values, start % 604_800, near_ns)
