"""The common part of BeiDou's D1 and D2: words, time, accuracy (BDS-SIS-ICD B1I 3.0, 5.1 and 5.2)."""

from __future__ import annotations

from typing import Final

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gnss.orbits.ephemeris_rows import is_beidou_geo
from insgnss.gpstime import BDT_TO_GPS_NS, BDT_WEEK_OFFSET
from insgnss.log.messages.bits import Field, power, unsigned
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
CLOCK: Final = (
    Field("af2", 11, power(-66), True),
    Field("af0", 24, power(-33), True),
    Field("af1", 22, power(-50), True),
    Field("aode", 5),
)


def beidou_message(sv: str) -> str:
    """Return which message a satellite sends: "D2" from a geostationary one, "D1" from the others."""
    return "D2" if is_beidou_geo(sv, "") else "D1"


def information_bits(words: list[int]) -> int:
    """Return the 224 information bits of ten words of 30 bits (right-aligned, interleaving undone, parity last)."""
    message = words[0] >> 4 & 0x3FFFFFF
    for word in words[1:]:
        message = message << 22 | (word >> 8 & 0x3FFFFF)
    return message


def header(subframe: int) -> tuple[int, int] | None:
    """Return a subframe's number and its second of the BeiDou week, None if it is not a subframe."""
    number, sow = unsigned(subframe, LENGTH, 15, 3), unsigned(subframe, LENGTH, 18, 20)
    if unsigned(subframe, LENGTH, 0, 11) != PREAMBLE or not 1 <= number <= 5 or sow >= 604_800:
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
