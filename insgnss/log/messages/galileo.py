"""Galileo I/NAV pages of E1-B and E5b-I and F/NAV pages of E5a-I (OS SIS ICD 2.1) -> ephemerides, ionosphere, UTC."""

from __future__ import annotations

import math
from functools import partial
from typing import Final

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gpstime import GST_WEEK_OFFSET
from insgnss.log.messages.bits import Field, crc24q, orbit_fields, power, unpack, unsigned
from insgnss.log.messages.broadcast import (
    ELEMENTS,
    TIME_AGREES_NS,
    Broadcast,
    Stated,
    in_nearest_week,
)

WEEK_ROLLOVER: Final = 4096

# Groups of fields that stand together in both messages
CLOCK: Final = (
    Field("toc", 14, 60.0),
    Field("af0", 31, power(-34), True),
    Field("af1", 21, power(-46), True),
    Field("af2", 6, power(-59), True),
)
_orbit = partial(orbit_fields, bits=16, angles=-29, radii=-5)
HARMONICS: Final = _orbit("delta_n cuc cus crc crs")
INCLINATION_HARMONICS: Final = _orbit("cic cis")
IONOSPHERE: Final = (
    Field("ai0", 11, power(-2)),
    Field("ai1", 11, power(-8), True),
    Field("ai2", 14, power(-15), True),
    Field("", 5),  # flags of ionospheric disturbance
)
TIME: Final = (Field("week", 12), Field("tow", 20))


def sisa_m(index: int) -> float:
    """Return the accuracy of a SISA index [m], NaN where none is predicted (OS SIS ICD 2.1, table 90)."""
    if index <= 49:
        return index / 100.0
    if index <= 74:
        return 0.5 + (index - 50) * 0.02
    if index <= 99:
        return 1.0 + (index - 75) * 0.04
    return 2.0 + (index - 100) * 0.16 if index <= 125 else math.nan


def health_bits(
    e1: tuple[int, int] = (0, 0), e5a: tuple[int, int] = (0, 0), e5b: tuple[int, int] = (0, 0)
) -> float:
    """Return the health as RINEX 3.05 writes it (table A8) of each signal's validity flag and health status."""
    bits = 0
    for place, (invalid, status) in ((0, e1), (3, e5a), (6, e5b)):
        bits |= (int(invalid) | int(status) << 1) << place
    return float(bits)


def take(
    broadcast: Broadcast,
    sv: str,
    message: str,
    values: dict[str, float],
    near_ns: int | None,
    delays_s: tuple[float, float],
    health: float,
) -> None:
    """Add a complete message to ``broadcast``; ``values`` holds its fields, ``week`` and ``tow`` among them."""
    week = int(values["week"]) + GST_WEEK_OFFSET
    if near_ns is None:
        sent_ns = week * NS_PER_WEEK + round(values["tow"]) * NS_PER_S  # twelve bits reach from 1999 to 2078
    else:
        sent_ns = in_nearest_week(week, WEEK_ROLLOVER, values["tow"], near_ns)
        if abs(sent_ns - near_ns) > TIME_AGREES_NS:
            broadcast.refused[f"{message} message whose week contradicts the receiver time"] += 1
            return
    stated = Stated(delays_s, health, sisa_m(int(values["sisa"])), values["iod"])
    elements = tuple(values[name] for name in ELEMENTS)
    broadcast.keep(sv, message, stated, elements, values["toc"], sent_ns)


WORD_LENGTH: Final = 128  # of a word
PAGE_LENGTH: Final = 120  # of a page part with its tail
_INAV_CHECKED: Final = (114, 82)  # bits under the checksum: of the even part, of the odd part

_IOD: Final = (Field("", 6), Field("iod", 10))
_ORBIT_1: Final = (*_IOD, Field("toe_sow_s", 14, 60.0), *_orbit("m0 e sqrt_a"))
_ORBIT_2: Final = (*_IOD, *_orbit("omega0 i0 omega idot"))
_ORBIT_3: Final = (*_IOD, *_orbit("omega_dot"), *HARMONICS, Field("sisa", 8))
_CLOCK: Final = (*_IOD, Field("svid", 6), *INCLINATION_HARMONICS, *CLOCK)
_STATUS: Final = (
    Field("", 6),
    *IONOSPHERE,
    Field("bgd_e5a", 10, power(-32), True),
    Field("bgd_e5b", 10, power(-32), True),
    Field("e5b_hs", 2),
    Field("e1_hs", 2),
    Field("e5b_dvs", 1),
    Field("e1_dvs", 1),
    *TIME,
)
_UTC: Final = (Field("", 62), Field("leap", 8, 1.0, True))
_INAV_LAYOUTS: Final = {1: _ORBIT_1, 2: _ORBIT_2, 3: _ORBIT_3, 4: _CLOCK, 5: _STATUS}


def word_of_pages(even: int, odd: int) -> int | str:
    """Return the 128 bits of a word, joined from two page parts of 120 bits; a text says why they are refused."""
    if unsigned(even, PAGE_LENGTH, 0, 1) != 0 or unsigned(odd, PAGE_LENGTH, 0, 1) != 1:
        return "I/NAV page with its parts not in order"
    if unsigned(even, PAGE_LENGTH, 1, 1) or unsigned(odd, PAGE_LENGTH, 1, 1):
        return "I/NAV alert page"
    checked = even >> (PAGE_LENGTH - _INAV_CHECKED[0]) << _INAV_CHECKED[1] | odd >> (
        PAGE_LENGTH - _INAV_CHECKED[1]
    )
    if crc24q(checked, sum(_INAV_CHECKED)) != unsigned(odd, PAGE_LENGTH, _INAV_CHECKED[1], 24):
        return "I/NAV page with a wrong checksum"
    return unsigned(even, PAGE_LENGTH, 2, 112) << 16 | unsigned(odd, PAGE_LENGTH, 2, 16)


class InavMessages:
    """Collects words per satellite, from either signal; words 1 to 4 of one issue and a word 5 make an ephemeris."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast = broadcast
        self._words: dict[str, dict[int, tuple[int, dict[str, float]]]] = {}

    def add_pages(self, sv: str, even: int, odd: int, near_ns: int | None) -> None:
        """Take the two parts of a page, 120 bits each."""
        word = word_of_pages(even, odd)
        if isinstance(word, str):
            self._broadcast.refused[word] += 1
            return
        self.add(sv, word, near_ns)

    def add(self, sv: str, word: int, near_ns: int | None) -> None:
        """Take one word of 128 bits."""
        kind = unsigned(word, WORD_LENGTH, 0, 6)
        if kind == 6:
            self._broadcast.leap_seconds = int(unpack(word, WORD_LENGTH, _UTC)["leap"])
        if kind not in _INAV_LAYOUTS:
            return
        words = self._words.setdefault(sv, {})
        # the time in word 5 changes with every page, the rest of it does not
        body = word >> 55 if kind == 5 else word
        if kind in words and words[kind][0] == body:
            return
        values = unpack(word, WORD_LENGTH, _INAV_LAYOUTS[kind])
        if kind == 4 and int(values["svid"]) != int(sv[1:]):
            self._broadcast.refused["I/NAV word of another satellite"] += 1
            return
        words[kind] = (body, values)
        if kind == 5:
            self._broadcast.ionosphere_of("galileo", (values["ai0"], values["ai1"], values["ai2"]))
        self._complete(sv, words, near_ns)

    def _complete(self, sv: str, words: dict[int, tuple[int, dict[str, float]]], near_ns: int | None) -> None:
        if len(words) < len(_INAV_LAYOUTS) or len({words[kind][1]["iod"] for kind in (1, 2, 3, 4)}) > 1:
            return
        values: dict[str, float] = {}
        for kind in _INAV_LAYOUTS:
            values |= words[kind][1]
        e1, e5b = ((int(values[f"{band}_dvs"]), int(values[f"{band}_hs"])) for band in ("e1", "e5b"))
        health = health_bits(e1=e1, e5b=e5b)
        delays = (values["bgd_e5a"], values["bgd_e5b"])
        take(self._broadcast, sv, "INAV", values, near_ns, delays, health)


FNAV_LENGTH: Final = 238  # of a page: type, data, checksum
_FNAV_CHECKED: Final = 214

_PAGE_1: Final = (
    Field("", 6),
    Field("svid", 6),
    Field("iod", 10),
    *CLOCK,
    Field("sisa", 8),
    *IONOSPHERE,
    Field("bgd_e5a", 10, power(-32), True),
    Field("e5a_hs", 2),
    *TIME,
    Field("e5a_dvs", 1),
)
_PAGE_2: Final = (*_IOD, *_orbit("m0 omega_dot e sqrt_a omega0 idot"), *TIME)
_PAGE_3: Final = (*_IOD, *_orbit("i0 omega"), *HARMONICS, Field("toe_sow_s", 14, 60.0), *TIME)
_PAGE_4: Final = (
    *(*_IOD, *INCLINATION_HARMONICS, Field("", 56), Field("leap", 8, 1.0, True)),
    *(Field("", 99), Field("tow", 20)),
)
_FNAV_LAYOUTS: Final = {1: _PAGE_1, 2: _PAGE_2, 3: _PAGE_3, 4: _PAGE_4}


class FnavMessages:
    """Collects pages per satellite; pages 1 to 4 of one issue make an ephemeris."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast = broadcast
        self._pages: dict[str, dict[int, dict[str, float]]] = {}

    def add(self, sv: str, page: int, near_ns: int | None) -> None:
        """Take one page of 238 bits, its checksum the last 24."""
        if crc24q(page >> (FNAV_LENGTH - _FNAV_CHECKED), _FNAV_CHECKED) != page & 0xFFFFFF:
            self._broadcast.refused["F/NAV page with a wrong checksum"] += 1
            return
        kind = unsigned(page, FNAV_LENGTH, 0, 6)
        if kind not in _FNAV_LAYOUTS:
            return
        values = unpack(page, FNAV_LENGTH, _FNAV_LAYOUTS[kind])
        if kind == 1 and int(values["svid"]) != int(sv[1:]):
            self._broadcast.refused["F/NAV page of another satellite"] += 1
            return
        pages = self._pages.setdefault(sv, {})
        before = pages.get(kind)
        pages[kind] = values
        if kind == 1:
            self._broadcast.ionosphere_of("galileo", (values["ai0"], values["ai1"], values["ai2"]))
        if kind == 4:
            self._broadcast.leap_seconds = int(values["leap"])
        if before is None or _without_time(before) != _without_time(values):
            self._complete(sv, pages, near_ns)

    def _complete(self, sv: str, pages: dict[int, dict[str, float]], near_ns: int | None) -> None:
        if len(pages) < len(_FNAV_LAYOUTS) or len({page["iod"] for page in pages.values()}) > 1:
            return
        values = pages[4] | pages[3] | pages[2] | pages[1]  # week and time of page 1
        health = health_bits(e5a=(int(values["e5a_dvs"]), int(values["e5a_hs"])))
        take(self._broadcast, sv, "FNAV", values, near_ns, (values["bgd_e5a"], 0.0), health)


def _without_time(values: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if name not in ("week", "tow")}
