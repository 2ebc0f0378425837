"""The common part of BeiDou's messages and its D1 and D2 (BDS-SIS-ICD B1I 3.0, 5.1 to 5.3) -> ephemerides, ionosphere.

Satellites in MEO and IGSO send D1: subframes 1, 2 and 3 carry the message. Geostationary ones send D2: subframe 1 of
each frame of 3 s carries one page; ten pages, 30 s, carry the message. Fields that span two pages are joined here by
writing the pages' contents one after the other.
"""

from __future__ import annotations

from functools import partial
from typing import Final

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gnss.orbits.ephemeris_rows import is_beidou_geo
from insgnss.gpstime import BDT_TO_GPS_NS, BDT_WEEK_OFFSET
from insgnss.log.messages.bits import Field, orbit_fields, power, unpack, unsigned
from insgnss.log.messages.broadcast import (
    ELEMENTS,
    TIME_AGREES_NS,
    Broadcast,
    Stated,
    in_nearest_week,
)
from insgnss.log.messages.gps_lnav import KLOBUCHAR, ura_m

LENGTH: Final = 224  # information bits of a subframe: 26 of the first word, 22 of each other
HEADER: Final = 38  # preamble, reserved bits, subframe number, seconds of the week
PREAMBLE: Final = 0b11100010010
WEEK_ROLLOVER: Final = 8192

CLOCK_HEAD: Final = (
    Field("health", 1),
    Field("", 5),  # age of the clock's data
    Field("ura", 4),
    Field("week", 13),
    Field("toc", 17, 8.0),
    Field("tgd1", 10, 1e-10, True),
    Field("tgd2", 10, 1e-10, True),
)
AF0, AF1 = Field("af0", 24, power(-33), True), Field("af1", 22, power(-50), True)
AF2, AODE = Field("af2", 11, power(-66), True), Field("aode", 5)
CLOCK: Final = (AF2, AF0, AF1, AODE)


def beidou_message(sv: str) -> str:
    """Return which message a satellite sends: "D2" from a geostationary one, "D1" from the others."""
    return "D2" if is_beidou_geo(sv, "") else "D1"


def information_bits(words: list[int]) -> int:
    """Return the 224 information bits of ten words of 30 bits (right-aligned, interleaving undone, parity last)."""
    message = words[0] >> 4 & 0x3FFFFFF
    for word in words[1:]:
        message = message << 22 | (word >> 8 & 0x3FFFFF)
    return message


def header(broadcast: Broadcast, message: str, subframe: int) -> tuple[int, int] | None:
    """Return a subframe's number and its second of the BeiDou week; anything else is counted, and None."""
    number, sow = unsigned(subframe, LENGTH, 15, 3), unsigned(subframe, LENGTH, 18, 20)
    if unsigned(subframe, LENGTH, 0, 11) != PREAMBLE or not 1 <= number <= 5 or sow >= 604_800:
        broadcast.refused[f"{message} subframe without its preamble, number or time"] += 1
        return None
    return number, sow


def klobuchar(values: dict[str, float]) -> tuple[float, ...]:
    """Return alpha and beta of an unpacked message."""
    return tuple(values[field.name] for field in KLOBUCHAR)


def take(
    broadcast: Broadcast, sv: str, message: str, values: dict[str, float], sow: int, near_ns: int | None
) -> None:
    """Add a complete message to ``broadcast``; ``sow`` is the second of the week at which its clock was sent."""
    if near_ns is None:
        # the first 157 years of BeiDou time
        near_bdt_ns = (int(values["week"]) * NS_PER_WEEK) + sow * NS_PER_S
    else:
        near_bdt_ns = near_ns - BDT_TO_GPS_NS - BDT_WEEK_OFFSET * NS_PER_WEEK
    sent_ns = in_nearest_week(int(values["week"]), WEEK_ROLLOVER, sow, near_bdt_ns)
    if abs(sent_ns - near_bdt_ns) > TIME_AGREES_NS:
        broadcast.refused[f"{message} message whose week contradicts the receiver time"] += 1
        return
    to_gps = BDT_WEEK_OFFSET * NS_PER_WEEK + BDT_TO_GPS_NS
    accuracy_m = ura_m(int(values["ura"]))  # the index means what it does for GPS (5.2.4.5)
    stated = Stated((values["tgd1"], values["tgd2"]), values["health"], accuracy_m, values["aode"])
    elements = tuple(values[name] for name in ELEMENTS)
    broadcast.keep(sv, message, stated, elements, values["toc"], sent_ns + to_gps)


class _Parts:
    """The parts of each satellite's message, subframes of a frame or pages of a cycle, as they come."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._begun: dict[str, tuple[int, dict[int, int]]] = {}  # when the message began, its parts
        self._taken: dict[str, dict[int, int]] = {}  # parts of the last complete message

    def add(self, sv: str, start: int, number: int, subframe: int) -> dict[int, int] | None:
        """Keep a part; return all parts once they are there, None where they are not or are those of the last time."""
        if sv not in self._begun or self._begun[sv][0] != start:
            self._begun[sv] = (start, {})
        parts = self._begun[sv][1]
        parts[number] = subframe & ((1 << (LENGTH - HEADER)) - 1)
        if len(parts) < self._count or self._taken.get(sv) == parts:
            return None
        self._taken[sv] = dict(parts)
        return parts


_orbit = partial(orbit_fields, bits=18, angles=-31, radii=-6)
_SUBFRAMES: Final = {
    1: (Field("", HEADER), *CLOCK_HEAD, *KLOBUCHAR, *CLOCK),
    2: (Field("", HEADER), *_orbit("delta_n cuc m0 e cus crc crs sqrt_a"), Field("toe_high", 2)),
    3: (Field("", HEADER), Field("toe_low", 15), *_orbit("i0 cic omega_dot cis idot omega0 omega")),
}
_SUBFRAME_S: Final = 6  # from the start of one subframe to that of the next


class D1Messages:
    """Collects subframes per satellite; 1, 2 and 3 of one frame with toe equal to toc make an ephemeris."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast, self._frames = broadcast, _Parts(len(_SUBFRAMES))

    def add(self, sv: str, subframe: int, near_ns: int | None) -> None:
        """Take the 224 information bits of a subframe."""
        number_and_time = header(self._broadcast, "D1", subframe)
        if number_and_time is None:
            return
        number, sow = number_and_time
        start = sow - _SUBFRAME_S * (number - 1)
        frame = self._frames.add(sv, start, number, subframe) if number in _SUBFRAMES else None
        if frame is None:
            return
        values: dict[str, float] = {}
        for number, layout in _SUBFRAMES.items():
            values |= unpack(frame[number], LENGTH, layout)
        values["toe_sow_s"] = 8.0 * (int(values["toe_high"]) << 15 | int(values["toe_low"]))
        if values["toe_sow_s"] != values["toc"]:
            self._broadcast.refused["D1 frame whose toe and toc differ"] += 1
            return
        self._broadcast.ionosphere_of("beidou", klobuchar(values))
        take(self._broadcast, sv, "D1", values, start % 604_800, near_ns)


_PAGES: Final = 10
_PAGE_S: Final = 3
_START: Final = HEADER + 4  # the page's number ends here
# Where the content of pages 3 to 10 begins and how many bits it has (figures 5-14-3 to 5-14-10)
_CONTENT: Final = {
    **{3: (_START + 38, 28), **{page: (_START, 64) for page in (4, 5, 6, 7)}},
    **{8: (_START, 66), 9: (_START, 64), 10: (_START, 19)},
}
_PAGE_1: Final = (Field("", _START), *CLOCK_HEAD)
_PAGE_2: Final = (Field("", _START), *KLOBUCHAR)
_ORBIT: Final = (
    *(AF0, AF1, AF2, AODE, *_orbit("delta_n cuc m0 cus e sqrt_a cic cis"), Field("toe_sow_s", 17, 8.0)),
    *_orbit("i0 crc crs omega_dot omega0 omega idot"),
)
_ORBIT_LENGTH: Final = sum(bits for _, bits in _CONTENT.values())


class D2Messages:
    """Collects pages per satellite; ten pages of one cycle with toe equal to toc make an ephemeris."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast, self._cycles = broadcast, _Parts(_PAGES)

    def add(self, sv: str, subframe: int, near_ns: int | None) -> None:
        """Take the 224 information bits of a subframe."""
        number_and_time = header(self._broadcast, "D2", subframe)
        if number_and_time is None:
            return
        number, sow = number_and_time
        if number != 1:
            return
        page = unsigned(subframe, LENGTH, HEADER, 4)
        if not 1 <= page <= _PAGES:
            self._broadcast.refused["D2 page without a number"] += 1
            return
        start = sow - _PAGE_S * (page - 1)
        cycle = self._cycles.add(sv, start, page, subframe)
        if cycle is None:
            return
        orbit = 0
        for page, (first, bits) in _CONTENT.items():
            orbit = orbit << bits | unsigned(cycle[page], LENGTH, first, bits)
        values = unpack(orbit, _ORBIT_LENGTH, _ORBIT) | unpack(cycle[1], LENGTH, _PAGE_1)
        if values["toe_sow_s"] != values["toc"]:
            self._broadcast.refused["D2 cycle whose toe and toc differ"] += 1
            return
        self._broadcast.ionosphere_of("beidou", klobuchar(unpack(cycle[2], LENGTH, _PAGE_2)))
        take(self._broadcast, sv, "D2", values, start % 604_800, near_ns)
