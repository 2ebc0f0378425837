"""NovAtel's broadcast messages become the tables of ``insgnss.tables``.

RAWEPHEM and QZSSRAWEPHEM hold the satellites' own subframes; GPSEPHEM, QZSSEPHEMERIS, GLOEPHEMERIS, GALEPHEMERIS,
GALINAVEPHEMERIS, GALFNAVEPHEMERIS, BDSEPHEMERIS and IONUTC are decoded by the receiver (OEM7 commands and logs
reference manual), in radians, metres and seconds; times of GLONASS in GPS time, of BeiDou in its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gnss.signals import CHANNEL_OFFSET, CHANNELS, UNKNOWN_CHANNEL
from insgnss.gpstime import LATEST_WEEK
from insgnss.log.files import records
from insgnss.log.messages.beidou import beidou_message
from insgnss.log.messages.broadcast import ELEMENTS, Broadcast, Stated, StateVector, nearest_in_week
from insgnss.log.messages.galileo import health_bits, sisa_m
from insgnss.log.messages.gps_lnav import LnavMessages
from insgnss.log.novatel.frames import NovatelFrames
from insgnss.log.novatel.signals import satellite_name

_QZSS_FIRST: Final = 193
_ELEMENTS: Final = ("toe", *ELEMENTS[1:])
_SUBFRAMES: Final = np.dtype([("prn", "<u4"), ("week", "<u4"), ("toe", "<u4"), ("subframe", "u1", (3, 30))])


def _doubles(*names: str) -> list[tuple[str, str]]:
    return [(name, "<f8") for name in names]


def _words(*names: str) -> list[tuple[str, str]]:
    return [(name, "<u4") for name in names]


_HARMONICS: Final = ("cuc", "cus", "crc", "crs", "cic", "cis")
_GPS: Final = np.dtype(
    [
        *(*_words("prn"), *_doubles("tow"), *_words("health", "iode", "iode2", "week", "z_week")),
        *_doubles(
            "toe", "a", "delta_n", "m0", "e", "omega", *_HARMONICS, "i0", "idot", "omega0", "omega_dot"
        ),
        *(*_words("iodc"), *_doubles("toc", "tgd", "af0", "af1", "af2"), *_words("spoofing")),
        *_doubles("n", "variance"),
    ]
)
_GALILEO_BOTH: Final = np.dtype(
    [
        *_words("prn", "has_fnav", "has_inav"),
        *((name, "u1") for name in ("hs_e1", "hs_e5a", "hs_e5b", "dvs_e1", "dvs_e5a", "dvs_e5b", "sisa", "")),
        *(*_words("iod", "toe"), *_doubles("sqrt_a", "delta_n", "m0", "e", "omega", *_HARMONICS)),
        *(*_doubles("i0", "idot", "omega0", "omega_dot"), *_words("fnav_toc")),
        *(*_doubles("fnav_af0", "fnav_af1", "fnav_af2"), *_words("inav_toc")),
        *_doubles("inav_af0", "inav_af1", "inav_af2"),
        *_doubles("bgd_e5a", "bgd_e5b"),
    ]
)
_GALILEO_ORBIT: Final = (
    *(*_words("toe", "toc"), *_doubles("m0", "delta_n", "e", "sqrt_a", "i0", "idot", "omega0", "omega")),
    *_doubles("omega_dot", *_HARMONICS, "af0", "af1", "af2", "bgd_e5a"),
)
_GALILEO_INAV: Final = np.dtype(
    [
        *_words("prn"),
        *(
            (name or f"_{k}", "u1")
            for k, name in enumerate(("hs_e5b", "dvs_e5b", "", "", "hs_e1", "dvs_e1", "", ""))
        ),
        *(("iod", "<u2"), ("sisa", "u1"), ("source", "u1"), *_GALILEO_ORBIT, *_doubles("bgd_e5b")),
    ]
)
_GALILEO_FNAV: Final = np.dtype(
    [
        *_words("prn"),
        *((name or f"_{k}", "u1") for k, name in enumerate(("hs_e5a", "dvs_e5a", "", ""))),
        *(("iod", "<u2"), ("sisa", "u1"), ("", "u1"), *_GALILEO_ORBIT),
    ]
)
_BEIDOU: Final = np.dtype(
    [
        *(*_words("prn", "week"), *_doubles("ura"), *_words("health"), *_doubles("tgd1", "tgd2")),
        *(*_words("aodc", "toc"), *_doubles("af0", "af1", "af2"), *_words("aode", "toe")),
        *_doubles("sqrt_a", "e", "omega", "delta_n", "m0", "omega0", "omega_dot", "i0", "idot", *_HARMONICS),
    ]
)
_GLONASS: Final = np.dtype(
    [
        *(("slot", "<u2"), ("channel", "<u2"), ("kind", "u1"), ("", "u1"), ("week", "<u2"), ("ms", "<u4")),
        *(("offset_s", "<u4"), ("day", "<u2"), ("_reserved", "u1", (2,)), *_words("issue", "health")),
        *((name, "<f8", (3,)) for name in ("r_e", "v_e", "a_e")),
        *_doubles("tau", "delta_tau", "gamma"),
    ]
)
_IONOSPHERE: Final = np.dtype(
    [
        *(("coefficients", "<f8", (8,)), *_words("week_t", "tot"), *_doubles("a0", "a1")),
        *(*_words("week_lsf", "dn"), ("leap", "<i4")),
    ]
)
RAW: Final = {41: "G", 1331: "J"}  # RAWEPHEM, QZSSRAWEPHEM
IONUTC: Final = 8


def broadcast(files: list[NovatelFrames]) -> Broadcast:
    """Return every message of the files, each distinct one once; subframes override decoded messages."""
    messages = Broadcast()
    lnav = LnavMessages(messages)
    for frames in files:
        for kind, system in RAW.items():
            _raw(frames, kind, system, lnav)
    raw = {(message.sv, message.toe_ns) for message in messages.ephemerides}
    for frames in files:
        for kind, (layout, take) in DECODED.items():
            chosen = [f for f in frames.of(kind) if f.length >= layout.itemsize]
            for frame, row in zip(
                chosen, records(frames.data, [f.offset for f in chosen], layout), strict=True
            ):
                take(messages, row, frame.t_ns, raw)
        chosen = [f for f in frames.of(IONUTC) if f.length >= _IONOSPHERE.itemsize]
        for row in records(frames.data, [f.offset for f in chosen], _IONOSPHERE):
            if np.isfinite(row["coefficients"]).all():
                messages.ionosphere_of("gps", tuple(row["coefficients"].tolist()))
                messages.leap_seconds = int(row["leap"]) if 0 < row["leap"] < 100 else messages.leap_seconds
    return messages


def _raw(frames: NovatelFrames, kind: int, system: str, lnav: LnavMessages) -> None:
    chosen = [f for f in frames.of(kind) if f.length >= _SUBFRAMES.itemsize]
    for frame, row in zip(chosen, records(frames.data, [f.offset for f in chosen], _SUBFRAMES), strict=True):
        sv = satellite_name(system, int(row["prn"]))
        if sv:
            for subframe in row["subframe"]:
                lnav.add(
                    sv, int.from_bytes(subframe.tobytes(), "big"), frame.t_ns if frame.t_ns >= 0 else None
                )


def _take(
    messages: Broadcast,
    sv: str,
    kind: str,
    row: Any,
    near_ns: int,
    stated: Stated,
    named: dict[str, float],
) -> None:
    """Keep a message; ``named`` are the numbers that the row has under other names."""
    values = [named[name] if name in named else float(row[name]) for name in _ELEMENTS]
    toc = named.get("toc", float(row["toc"]) if "toc" in row.dtype.names else math.nan)
    if not sv or near_ns < 0 or not all(map(math.isfinite, (*values, toc, *stated[0]))):
        messages.refused[
            "ephemeris of an unknown satellite, without a time or with an invalid number; refused"
        ] += 1
        return
    messages.keep(sv, kind, stated, tuple(values), toc, near_ns)


def _gps(messages: Broadcast, row: Any, near_ns: int, raw: set[tuple[str, int]]) -> None:
    number = int(row["prn"])
    sv = satellite_name("J" if number >= _QZSS_FIRST else "G", number)
    toe = float(row["toe"])
    if math.isfinite(toe) and near_ns >= 0 and (sv, nearest_in_week(toe % 604_800, near_ns)) in raw:
        return
    sqrt_a, accuracy = math.sqrt(max(float(row["a"]), 0.0)), math.sqrt(max(float(row["variance"]), 0.0))
    health, issue = float(row["health"]), float(row["iode"])
    stated = Stated(
        (float(row["tgd"]), 0.0), health, accuracy if math.isfinite(accuracy) else math.nan, issue
    )
    _take(messages, sv, "LNAV", row, near_ns, stated, {"sqrt_a": sqrt_a})


def _galileo_both(messages: Broadcast, row: Any, near_ns: int, _: set[tuple[str, int]]) -> None:
    stated = _galileo_stated(row, "e1", "e5a", "e5b")
    for kind in ("inav", "fnav"):
        if row[f"has_{kind}"]:
            clock = {name: float(row[f"{kind}_{name}"]) for name in ("af0", "af1", "af2", "toc")}
            _take(messages, satellite_name("E", int(row["prn"])), kind.upper(), row, near_ns, stated, clock)


def _inav(messages: Broadcast, row: Any, near_ns: int, _: set[tuple[str, int]]) -> None:
    sv = satellite_name("E", int(row["prn"]))
    _take(messages, sv, "INAV", row, near_ns, _galileo_stated(row, "e1", "e5b"), {})


def _fnav(messages: Broadcast, row: Any, near_ns: int, _: set[tuple[str, int]]) -> None:
    sv = satellite_name("E", int(row["prn"]))
    _take(messages, sv, "FNAV", row, near_ns, _galileo_stated(row, "e5a"), {})


def _galileo_stated(row: Any, *signals: str) -> Stated:
    """Return what a message of Galileo states of these signals."""
    health = health_bits(**{signal: (row[f"dvs_{signal}"], row[f"hs_{signal}"]) for signal in signals})
    bgd_e5b = float(row["bgd_e5b"]) if "e5b" in signals else 0.0
    return Stated((float(row["bgd_e5a"]), bgd_e5b), health, sisa_m(int(row["sisa"])), float(row["iod"]))


def _beidou(messages: Broadcast, row: Any, near_ns: int, _: set[tuple[str, int]]) -> None:
    sv = satellite_name("C", int(row["prn"]))
    delays = (float(row["tgd1"]), float(row["tgd2"]))
    accuracy = float(row["ura"]) if math.isfinite(row["ura"]) else math.nan
    stated = Stated(delays, float(int(row["health"]) & 1), accuracy, float(row["aode"]))
    _take(messages, sv, beidou_message(sv), row, near_ns, stated, {})


def _glonass(messages: Broadcast, row: Any, near_ns: int, _: set[tuple[str, int]]) -> None:
    sv = satellite_name("R", int(row["slot"]))
    numbers = [*row["r_e"], *row["v_e"], *row["a_e"], row["tau"], row["gamma"]]
    if not sv or not 0 < row["week"] <= LATEST_WEEK or not np.isfinite(numbers).all():
        messages.refused["GLONASS ephemeris of an unknown satellite or without a time; refused"] += 1
        return
    # leap seconds make it end in odd seconds; a receiver's milliseconds are rounded away
    t_ns = int(row["week"]) * NS_PER_WEEK + round(int(row["ms"]) / 1000) * NS_PER_S
    channel = int(row["channel"]) - CHANNEL_OFFSET
    r_e, v_e, a_e = (tuple(row[name].tolist()) for name in ("r_e", "v_e", "a_e"))
    state = StateVector(
        *(sv, t_ns, r_e, v_e, a_e, -float(row["tau"]), float(row["gamma"])),
        group_delay_s=float(row["delta_tau"]) if math.isfinite(row["delta_tau"]) else math.nan,
        health=float(int(row["health"]) & 0b1111 != 0),
        channel=channel if channel in CHANNELS else UNKNOWN_CHANNEL,
    )
    messages.states.setdefault(state)


DECODED: Final[
    dict[int, tuple[np.dtype[np.void], Callable[[Broadcast, Any, int, set[tuple[str, int]]], None]]]
] = {
    **{7: (_GPS, _gps), 1336: (_GPS, _gps)},
    **{723: (_GLONASS, _glonass), 1696: (_BEIDOU, _beidou)},
    **{1122: (_GALILEO_BOTH, _galileo_both), 1309: (_GALILEO_INAV, _inav), 1310: (_GALILEO_FNAV, _fnav)},
}
