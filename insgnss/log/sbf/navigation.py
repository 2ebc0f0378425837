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
from insgnss.log.messages.galileo import health_bits, sisa_m
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
    if not sv.startswith(system) or not time_known(row):
        messages.refused["SBF message of an unknown satellite or without a time"] += 1
        return
    elements = tuple(
        float(row["toe_s" if name == "toe_sow_s" else name]) * (math.pi if name in _SEMICIRCLES else 1.0)
        for name in ELEMENTS
    )
    if not all(map(math.isfinite, elements)):
        messages.refused["SBF message with an invalid number"] += 1
        return
    messages.keep(sv, *content(sv, row), elements, float(row["toc_s"]), int(block_times_ns(row)))


def _delay(value: float) -> float:
    return 0.0 if not math.isfinite(value) or value <= FLOAT_MISSING else float(value)


def _lnav(sv: str, row: Any) -> tuple[str, Stated]:
    health, accuracy_m = float(row["health"]), ura_m(int(row["ura"]) & 0x0F)
    fit_s = math.nan if sv[0] != "G" else _FIT_S[1] if row["fit"] else _FIT_S[0]
    return "LNAV", Stated((_delay(row["tgd"]), 0.0), health, accuracy_m, float(row["iode"]), fit_s)


def _galileo(_: str, row: Any) -> tuple[str, Stated]:
    fnav = int(row["source"]) == _FNAV
    delays = (_delay(row["bgd_e5a"]), _delay(row["bgd_e5b"]))
    # four bits for each of E1-B, E5b and E5a: whether the block states it, validity flag, health status
    e1, e5b, e5a = (
        (part >> 1 & 1, part >> 2 & 0b11) if part & 1 else (0, 0)
        for part in (int(row["health"]) >> place for place in (0, 4, 8))
    )
    health = health_bits(e1=e1, e5a=e5a, e5b=e5b)
    accuracy_m = sisa_m(int(row["sisa_e5a" if fnav else "sisa_e5b"]))
    return "FNAV" if fnav else "INAV", Stated(delays, health, accuracy_m, float(row["iod"]))


def _beidou(sv: str, row: Any) -> tuple[str, Stated]:
    delays, accuracy_m = (_delay(row["tgd1"]), _delay(row["tgd2"])), ura_m(int(row["ura"]) & 0x0F)
    return beidou_message(sv), Stated(delays, float(row["health"]), accuracy_m, float(row["aode"]))


def _glonass(messages: Broadcast, row: Any) -> None:
    sv = SATELLITES.get(int(row["svid"]), "")
    r_e, v_e, a_e = (
        tuple((row[name].astype(np.float64) * M_PER_KM).tolist()) for name in ("r_km", "v_kmps", "a_kmps2")
    )
    clock_s, clock_rate = -float(row["tau"]), float(row["gamma"])  # ICD: t_GLONASS = t_satellite + tau
    is_finite = np.isfinite([*r_e, *v_e, *a_e, clock_s, clock_rate]).all()
    if not sv.startswith("R") or not time_known(row) or not is_finite:
        messages.refused["SBF message of an unknown satellite or without a time"] += 1
        return
    received_ns, toe_s = int(block_times_ns(row)), float(row["toe_s"])
    t_ns = in_nearest_week(int(row["week_toe"]), _WEEK_ROLLOVER_GLONASS, toe_s, received_ns)
    delay_s = float(row["dtau"]) if row["dtau"] > FLOAT_MISSING else math.nan
    health = float(int(row["health_b"]) >> 2 & 1 | int(row["health_l"]) << 1)
    channel = int(row["channel"]) - CHANNEL_OFFSET
    state = StateVector(sv, t_ns, r_e, v_e, a_e, clock_s, clock_rate, delay_s, health, channel)
    messages.states.setdefault(state)
