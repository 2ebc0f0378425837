"""SBF's decoded broadcast messages (GPSNav and the like) become the tables of ``insgnss.tables``.

PolaRx5TR reference guide, firmware 5.5.0, 4.2.3 to 4.2.8: angles in semicircles, BeiDou's times in BeiDou time,
GLONASS's in GPS time. Numbers of single precision keep every bit that was broadcast, except the clocks' offsets of
GPS, QZSS and BeiDou (22 and 24 bits, all kept as well).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from insgnss.constants import M_PER_KM
from insgnss.log.messages.beidou import beidou_message
from insgnss.log.messages.broadcast import (
    ELEMENTS,
    Broadcast,
    Stated,
    StateVector,
    in_nearest_week,
)
from insgnss.log.messages.galileo import sisa_m
from insgnss.log.messages.gps_lnav import ura_m
from insgnss.log.sbf.blocks import (
    BDS_ION,
    BDS_NAV,
    FLOAT_MISSING,
    GAL_ION,
    GAL_NAV,
    GLO_NAV,
    GPS_ION,
    GPS_NAV,
    GPS_UTC,
    QZS_NAV,
    Blocks,
    block_records,
    block_times_ns,
    time_known,
)
from insgnss.log.sbf.signals import CHANNEL_OFFSET, SATELLITES

_FNAV: Final = 16
_SEMICIRCLES: Final = ("i0", "omega0", "omega", "m0", "delta_n", "omega_dot", "idot")
# IS-GPS-200N, 20.3.4.4: "four hours", "greater than four hours"
_FIT_S: Final = {0: 4 * 3600.0, 1: 6 * 3600.0}
_WEEK_ROLLOVER_GLONASS: Final = 1024


def broadcast(data: bytes, blocks: Blocks) -> Broadcast:
    """Return every message of the file, each distinct one once."""
    messages = Broadcast()
    for number, system in ((GPS_NAV, "G"), (QZS_NAV, "J")):
        for row in block_records(data, blocks, number):
            _take(messages, row, system, _lnav)
    for row in block_records(data, blocks, GAL_NAV):
        _take(messages, row, "E", _galileo)
    for row in block_records(data, blocks, BDS_NAV):
        _take(messages, row, "C", _beidou)
    for row in block_records(data, blocks, GLO_NAV):
        _glonass(messages, row)
    for number, system in ((GPS_ION, "gps"), (BDS_ION, "beidou"), (GAL_ION, "galileo")):
        for row in block_records(data, blocks, number):
            coefficients = row["coefficients"].astype(np.float64)
            if np.isfinite(coefficients).all() and (coefficients > FLOAT_MISSING).all():
                messages.ionosphere_of(system, tuple(coefficients.tolist()))
    for row in block_records(data, blocks, GPS_UTC)[:1]:
        messages.leap_seconds = int(row["leap"])
    return messages


def _take(
    messages: Broadcast, row: Any, system: str, content: Callable[[str, Any], tuple[str, Stated]]
) -> None:
    sv = SATELLITES.get(int(row["svid"]), "")
    received_ns = _received_ns(row)
    if not sv.startswith(system) or received_ns is None:
        messages.refused["SBF message of an unknown satellite or without a time"] += 1
        return
    elements = _elements(row)
    if not all(map(math.isfinite, elements)):
        messages.refused["SBF message with an invalid number"] += 1
        return
    messages.keep(sv, *content(sv, row), elements, float(row["toc_s"]), received_ns)


def _received_ns(row: Any) -> int | None:
    return int(block_times_ns(row)) if time_known(row) else None


def _elements(row: Any) -> tuple[float, ...]:
    values = {name: float(row["toe_s" if name == "toe_sow_s" else name]) for name in ELEMENTS}
    return tuple(value * math.pi if name in _SEMICIRCLES else value for name, value in values.items())


def _delay(value: float) -> float:
    return 0.0 if not math.isfinite(value) or value <= FLOAT_MISSING else float(value)


def _lnav(sv: str, row: Any) -> tuple[str, Stated]:
    health, accuracy_m = float(row["health"]), ura_m(int(row["ura"]) & 0x0F)
    fit_s = math.nan if sv[0] != "G" else _FIT_S[1] if row["fit"] else _FIT_S[0]
    return "LNAV", Stated((_delay(row["tgd"]), 0.0), health, accuracy_m, float(row["iode"]), fit_s)


def _galileo(_: str, row: Any) -> tuple[str, Stated]:
    fnav = int(row["source"]) == _FNAV
    delays = (_delay(row["bgd_e5a"]), _delay(row["bgd_e5b"]))
    health, accuracy_m = (
        _galileo_health(int(row["health"])),
        sisa_m(int(row["sisa_e5a" if fnav else "sisa_e5b"])),
    )
    return "FNAV" if fnav else "INAV", Stated(delays, float(health), accuracy_m, float(row["iod"]))


def _galileo_health(flags: int) -> int:
    """Return the bits as in RINEX 3.05, table A8: E1-B DVS and HS from bit 0, E5a from bit 3, E5b from bit 6."""
    health = 0
    for place, valid in ((0, 0), (6, 4), (3, 8)):
        if flags >> valid & 1:
            health |= (flags >> (valid + 1) & 0b111) << place
    return health


def _beidou(sv: str, row: Any) -> tuple[str, Stated]:
    delays, accuracy_m = (_delay(row["tgd1"]), _delay(row["tgd2"])), ura_m(int(row["ura"]) & 0x0F)
    return beidou_message(sv), Stated(delays, float(row["health"]), accuracy_m, float(row["aode"]))


def _glonass(messages: Broadcast, row: Any) -> None:
    sv = SATELLITES.get(int(row["svid"]), "")
    received_ns = _received_ns(row)
    r_e, v_e, a_e = (
        tuple((row[name].astype(np.float64) * M_PER_KM).tolist()) for name in ("r_km", "v_kmps", "a_kmps2")
    )
    clock_s, clock_rate = -float(row["tau"]), float(row["gamma"])  # ICD: t_GLONASS = t_satellite + tau
    if (
        not sv.startswith("R")
        or received_ns is None
        or not np.isfinite([*r_e, *v_e, *a_e, clock_s, clock_rate]).all()
    ):
        messages.refused["SBF message of an unknown satellite or without a time"] += 1
        return
    state = StateVector(
        sv,
        in_nearest_week(int(row["week_toe"]), _WEEK_ROLLOVER_GLONASS, float(row["toe_s"]), received_ns),
        r_e,
        v_e,
        a_e,
        clock_s,
        clock_rate,
        float(row["dtau"]) if row["dtau"] > FLOAT_MISSING else math.nan,
        float(int(row["health_b"]) >> 2 & 1 | int(row["health_l"]) << 1),
        int(row["channel"]) - CHANNEL_OFFSET,
    )
    messages.states.setdefault(state)
