"""Galileo I/NAV pages of E1-B and E5b-I (OS SIS ICD 2.1, 4.3) -> ephemerides, ionosphere, leap seconds."""

from __future__ import annotations

from typing import Final

from insgnss.log.messages.bits import Field, angle, crc24q, power, unpack, unsigned
from insgnss.log.messages.broadcast import Broadcast
from insgnss.log.messages.galileo import (
    CLOCK,
    HARMONICS,
    INCLINATION_HARMONICS,
    IONOSPHERE,
    TIME,
    take,
)

LENGTH: Final = 128  # of a word
PAGE_LENGTH: Final = 120  # of a page part with its tail
_CHECKED: Final = (114, 82)  # bits under the check sum: of the even part, of the odd part

_IOD: Final = (Field("", 6), Field("iod", 10))
_ORBIT_1: Final = (
    *_IOD,
    Field("toe_sow_s", 14, 60.0),
    Field("m0", 32, angle(-31), True),
    Field("e", 32, power(-33)),
    Field("sqrt_a", 32, power(-19)),
)
_ORBIT_2: Final = (
    *_IOD,
    Field("omega0", 32, angle(-31), True),
    Field("i0", 32, angle(-31), True),
    Field("omega", 32, angle(-31), True),
    Field("idot", 14, angle(-43), True),
)
_ORBIT_3: Final = (*_IOD, Field("omega_dot", 24, angle(-43), True), *HARMONICS, Field("sisa", 8))
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
_LAYOUTS: Final = {1: _ORBIT_1, 2: _ORBIT_2, 3: _ORBIT_3, 4: _CLOCK, 5: _STATUS}


def word_of_pages(even: int, odd: int) -> int | str:
    """Return the 128 bits of a word from its two page parts of 120 bits, or the reason why there is no word."""
    if unsigned(even, PAGE_LENGTH, 0, 1) != 0 or unsigned(odd, PAGE_LENGTH, 0, 1) != 1:
        return "I/NAV page with its parts not in order"
    if unsigned(even, PAGE_LENGTH, 1, 1) or unsigned(odd, PAGE_LENGTH, 1, 1):
        return "I/NAV alert page"
    checked = even >> (PAGE_LENGTH - _CHECKED[0]) << _CHECKED[1] | odd >> (PAGE_LENGTH - _CHECKED[1])
    if crc24q(checked, sum(_CHECKED)) != unsigned(odd, PAGE_LENGTH, _CHECKED[1], 24):
        return "I/NAV page with a wrong check sum"
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
        kind = unsigned(word, LENGTH, 0, 6)
        if kind == 6:
            self._broadcast.leap_seconds = int(unpack(word, LENGTH, _UTC)["leap"])
        if kind not in _LAYOUTS:
            return
        words = self._words.setdefault(sv, {})
        # the time in word 5 changes with every page, the rest of it does not
        body = word >> 55 if kind == 5 else word
        if kind in words and words[kind][0] == body:
            return
        values = unpack(word, LENGTH, _LAYOUTS[kind])
        if kind == 4 and int(values["svid"]) != int(sv[1:]):
            self._broadcast.refused["I/NAV word of another satellite"] += 1
            return
        words[kind] = (body, values)
        if kind == 5:
            self._broadcast.ionosphere_of("galileo", (values["ai0"], values["ai1"], values["ai2"]))
        self._complete(sv, words, near_ns)

    def _complete(self, sv: str, words: dict[int, tuple[int, dict[str, float]]], near_ns: int | None) -> None:
        if len(words) < len(_LAYOUTS) or len({words[kind][1]["iod"] for kind in (1, 2, 3, 4)}) > 1:
            return
        values: dict[str, float] = {}
        for kind in _LAYOUTS:
            values |= words[kind][1]
        health = int(values["e1_dvs"]) | int(values["e1_hs"]) << 1
        health |= int(values["e5b_dvs"]) << 6 | int(values["e5b_hs"]) << 7  # bits as in RINEX 3.05, table A8
        delays = (values["bgd_e5a"], values["bgd_e5b"])
        take(self._broadcast, sv, "INAV", values, near_ns, delays, health)
