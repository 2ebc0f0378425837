"""GPS and QZSS LNAV subframes (IS-GPS-200N, 20.3.3; IS-QZSS-PNT-005, 4.1.2) -> ephemerides, ionosphere, leap seconds.

A subframe comes as 240 bits: ten words of 24 data bits, inversion undone and parity taken off.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Final

from insgnss.constants import S_PER_WEEK
from insgnss.log.messages.bits import Field, joined, orbit_fields, power, twos_complement, unpack, unsigned
from insgnss.log.messages.broadcast import (
    ELEMENTS,
    TIME_AGREES_NS,
    Broadcast,
    Stated,
    in_nearest_week,
)

LENGTH: Final = 240
WEEK_ROLLOVER: Final = 1024
PREAMBLE: Final = 0x8B
_HEADER: Final = 48  # telemetry and handover word
_IONOSPHERE_PAGE: Final = 56  # "SV ID" of subframe 4, page 18 (table 20-V)
_UNDEFINED_URA: Final = 15

_CLOCK: Final = (
    Field("", _HEADER),
    Field("week", 10),
    Field("", 2),
    Field("ura", 4),
    Field("health", 6),
    Field("iodc_high", 2),
    Field("", 88),
    Field("tgd", 8, power(-31), True),
    Field("iodc_low", 8),
    Field("toc", 16, power(4)),
    Field("af2", 8, power(-55), True),
    Field("af1", 16, power(-43), True),
    Field("af0", 22, power(-31), True),
)
_orbit = partial(orbit_fields, bits=16, angles=-29, radii=-5)
_ORBIT_1: Final = (
    *(Field("", _HEADER), Field("iode", 8), *_orbit("crs delta_n m0 cuc e cus sqrt_a")),
    *(Field("toe_sow_s", 16, power(4)), Field("fit", 1)),
)
_ORBIT_2: Final = (
    *(Field("", _HEADER), *_orbit("cic omega0 cis i0 crc omega omega_dot"), Field("iode", 8)),
    *_orbit("idot"),
)
_SCALES: Final = (power(-30), power(-27), power(-24), power(-24), 2.0**11, 2.0**14, 2.0**16, 2.0**16)
KLOBUCHAR: Final = tuple(Field(f"k{i}", 8, scale, True) for i, scale in enumerate(_SCALES))
_UTC: Final = (
    Field("", 50),
    Field("page", 6),
    *KLOBUCHAR,
    Field("", 72),
    Field("leap", 8, 1.0, True),
)


def data_bits(words: list[int]) -> int:
    """Return the 240 data bits of ten words of 30 bits (right-aligned, six parity bits last)."""
    return joined([word >> 6 for word in words], 24)


class LnavMessages:
    """Collects subframes per satellite; a set whose issues agree becomes an ephemeris."""

    def __init__(self, broadcast: Broadcast) -> None:
        self._broadcast = broadcast
        self._subframes: dict[tuple[str, int], int] = {}  # body of each satellite's last subframe 1, 2, 3
        self._sent_sow: dict[str, int] = {}  # of the last subframe 1

    def add(self, sv: str, subframe: int, near_ns: int | None) -> None:
        """Take one subframe of 240 bits, received at about ``near_ns``."""
        number = unsigned(subframe, LENGTH, 43, 3)
        if unsigned(subframe, LENGTH, 0, 8) != PREAMBLE or not 1 <= number <= 5:
            self._broadcast.refused["LNAV subframe without its preamble or number"] += 1
            return
        body = subframe & ((1 << (LENGTH - _HEADER)) - 1)
        if number == 4:
            self._ionosphere(sv[0], body)
        if number > 3:
            return
        if number == 1:
            self._sent_sow[sv] = (unsigned(subframe, LENGTH, 24, 17) * 6 - 6) % S_PER_WEEK
        if self._subframes.get((sv, number)) != body:
            self._subframes[sv, number] = body
            self._complete(sv, near_ns)

    def _complete(self, sv: str, near_ns: int | None) -> None:
        """Add the satellite's message when its three subframes are there and belong together."""
        bodies = [self._subframes.get((sv, number)) for number in (1, 2, 3)]
        if None in bodies:
            return
        clock, orbit_1, orbit_2 = (
            unpack(body or 0, LENGTH, layout)
            for body, layout in zip(bodies, (_CLOCK, _ORBIT_1, _ORBIT_2), strict=True)
        )
        if not clock["iodc_low"] == orbit_1["iode"] == orbit_2["iode"]:
            return  # a new message has begun: its other subframes are still to come
        if near_ns is None:
            self._broadcast.refused["LNAV message without a receiver time for its week"] += 1
            return
        values = clock | orbit_1 | orbit_2
        sent_ns = in_nearest_week(int(values["week"]), WEEK_ROLLOVER, self._sent_sow[sv], near_ns)
        if abs(sent_ns - near_ns) > TIME_AGREES_NS:
            self._broadcast.refused["LNAV message whose week contradicts the receiver time"] += 1
            return
        elements = tuple(values[name] for name in ELEMENTS)
        self._broadcast.keep(sv, "LNAV", _stated(sv, values), elements, values["toc"], sent_ns)

    def _ionosphere(self, system: str, body: int) -> None:
        values = unpack(body, LENGTH, _UTC)
        if values["page"] != _IONOSPHERE_PAGE:
            return
        coefficients = tuple(values[field.name] for field in KLOBUCHAR)
        self._broadcast.ionosphere_of("qzss" if system == "J" else "gps", coefficients)
        if system == "G":
            self._broadcast.leap_seconds = int(values["leap"])


def _stated(sv: str, values: dict[str, float]) -> Stated:
    iodc = int(values["iodc_high"]) << 8 | int(values["iodc_low"])
    tgd = values["tgd"]
    if sv[0] == "J" and twos_complement(round(tgd / power(-31)) & 0xFF, 8) == -128:
        tgd = 0.0  # "not available" (IS-QZSS-PNT-005, 4.1.2.3)
    fit_s = fit_interval_s(sv[0], int(values["fit"]), iodc)
    return Stated((tgd, 0.0), values["health"], ura_m(int(values["ura"])), values["iode"], fit_s)


def ura_m(index: int) -> float:
    """Return the nominal accuracy of a URA index [m], NaN where there is none (IS-GPS-200N, 20.3.3.3.1.3)."""
    if index == _UNDEFINED_URA:
        return math.nan
    if index > 6:
        return float(2 ** (index - 2))
    # rounded in the document itself
    return {1: 2.8, 3: 5.7, 5: 11.3}.get(index, float(2 ** (1 + index // 2)))


def fit_interval_s(system: str, flag: int, iodc: int) -> float:
    """Return the curve fit interval [s] (IS-GPS-200N, table 20-XII; QZSS: 2 h, longer is not said)."""
    if system == "J":
        return math.nan if flag else 7200.0
    if not flag:
        return 14400.0
    if 240 <= iodc <= 247:
        return 28800.0
    if 248 <= iodc <= 255 or iodc == 496:
        return 50400.0
    if 497 <= iodc <= 503 or 1021 <= iodc <= 1023:
        return 93600.0
    return 21600.0
