"""Galileo F/NAV pages of E5a-I (OS SIS ICD 2.1, 4.2) -> ephemerides, ionosphere, leap seconds."""

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

LENGTH: Final = 238  # of a page: type, data, check sum
_CHECKED: Final = 214

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
_PAGE_2: Final = (
    Field("", 6),
    Field("iod", 10),
    Field("m0", 32, angle(-31), True),
    Field("omega_dot", 24, angle(-43), True),
    Field("e", 32, power(-33)),
    Field("sqrt_a", 32, power(-19)),
    Field("omega0", 32, angle(-31), True),
    Field("idot", 14, angle(-43), True),
    *TIME,
)
_PAGE_3: Final = (
    Field("", 6),
    Field("iod", 10),
    Field("i0", 32, angle(-31), True),
    Field("omega", 32, angle(-31), True),
    *HARMONICS,
    Field("toe_sow_s", 14, 60.0),
    *TIME,
)
_PAGE_4: Final = (
    Field("", 6),
    Field("iod", 10),
    *INCLINATION_HARMONICS,
    Field("", 56),
    Field("leap", 8, 1.0, True),
    Field("", 99),
    Field("tow", 20),
)
_LAYOUTS: Final = {1: _PAGE_1, 2: _PAGE_2, 3: _PAGE_3, 4: _PAGE_4}


class FnavMessages:
    """Collects pages per satellite; pages 1 to 4 of one issue make an ephemeris."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast = broadcast
        self._pages: dict[str, dict[int, dict[str, float]]] = {}

    def add(self, sv: str, page: int, near_ns: int | None) -> None:
        """Take one page of 238 bits, its check sum the last 24."""
        if crc24q(page >> (LENGTH - _CHECKED), _CHECKED) != page & 0xFFFFFF:
            self._broadcast.refused["F/NAV page with a wrong check sum"] += 1
            return
        kind = unsigned(page, LENGTH, 0, 6)
        if kind not in _LAYOUTS:
            return
        values = unpack(page, LENGTH, _LAYOUTS[kind])
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
        if len(pages) < len(_LAYOUTS) or len({page["iod"] for page in pages.values()}) > 1:
            return
        values = pages[4] | pages[3] | pages[2] | pages[1]  # week and time of page 1
        health = int(values["e5a_dvs"]) << 3 | int(values["e5a_hs"]) << 4  # bits as in RINEX 3.05, table A8
        take(self._broadcast, sv, "FNAV", values, near_ns, (values["bgd_e5a"], 0.0), health)


def _without_time(values: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if name not in ("week", "tow")}
