"""The common part of Galileo's two messages: scales, accuracy index, checks (OS SIS ICD 2.1, 5.1)."""

from __future__ import annotations

import math
from typing import Final

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gpstime import GST_WEEK_OFFSET
from insgnss.log.messages.bits import Field, angle, power
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
HARMONICS: Final = (
    Field("delta_n", 16, angle(-43), True),
    Field("cuc", 16, power(-29), True),
    Field("cus", 16, power(-29), True),
    Field("crc", 16, power(-5), True),
    Field("crs", 16, power(-5), True),
)
INCLINATION_HARMONICS: Final = (Field("cic", 16, power(-29), True), Field("cis", 16, power(-29), True))
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


def take(
    broadcast: Broadcast,
    sv: str,
    message: str,
    values: dict[str, float],
    near_ns: int | None,
    delays_s: tuple[float, float],
    health: int,
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
    stated = Stated(delays_s, float(health), sisa_m(int(values["sisa"])), values["iod"])
    elements = tuple(values[name] for name in ELEMENTS)
    broadcast.keep(sv, message, stated, elements, values["toc"], sent_ns)
