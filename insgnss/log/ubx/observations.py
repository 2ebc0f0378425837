"""UBX-RXM-RAWX, the raw measurements of a u-blox receiver, as observation rows (ZED-F9P interface description, 3.17.5).

Of the standard deviations that the receiver states none is kept: they are classes of signal strength, no statistics.

UBX-RXM-RAW and UBX-RXM-SFRB are the raw messages of receivers before RXM-RAWX (LEA-4T to LEA-6T; u-blox 6 receiver
description): GPS L1 C/A and SBAS alone, whole milliseconds of receiver time, no time of lock. A subframe comes as ten
words of 24 bits, parity taken off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_MS, NS_PER_S, NS_PER_WEEK, S_PER_WEEK
from insgnss.gnss.signals import CHANNEL_OFFSET
from insgnss.gpstime import LATEST_WEEK
from insgnss.log.events import counted, first_events
from insgnss.log.gnss_rows import in_time_order, slipped_rows
from insgnss.log.messages.bits import joined
from insgnss.log.messages.gps_lnav import LnavMessages
from insgnss.log.satellites import CHANNELS_IN_USE, SBAS_OFFSET, rinex_name
from insgnss.log.ubx.frames import UbxFrames
from insgnss.tables import LLI_HALF_CYCLE, LLI_SLIP, Bool, Event, Float64, GnssTable, Int64

RAWX: Final = 0x0215
_EPOCH: Final = np.dtype(
    [("tow_s", "<f8"), ("week", "<u2"), ("leap_s", "i1"), ("count", "u1"), ("status", "u1"), ("", "u1", 3)]
)
MEASUREMENT: Final = np.dtype(
    [
        ("pseudorange_m", "<f8"),
        ("carrier_cycles", "<f8"),
        ("doppler_hz", "<f4"),
        ("gnss", "u1"),
        ("satellite", "u1"),
        ("signal", "u1"),
        ("frequency", "u1"),  # GLONASS channel plus 7
        ("lock_ms", "<u2"),
        ("cn0_dbhz", "u1"),
        ("sigmas", "u1", 3),
        ("status", "u1"),
        ("", "u1"),
    ]
)
LEAP_KNOWN, CLOCK_RESET = 1, 2  # bits of the epoch's status
# bits of the measurement's status
RANGE_VALID, CARRIER_VALID, HALF_CYCLE_KNOWN, HALF_CYCLE_SUBTRACTED = 1, 2, 4, 8
LOCK_CEILING_MS: Final = 64_500  # the lock time counts no further

SYSTEMS: Final = {0: "G", 1: "S", 2: "E", 3: "C", 5: "J", 6: "R", 7: "I"}  # 4 is IMES, indoors

# Signal identifiers of each system as RINEX codes (interface description, 1.5.4 "Signal identifiers")
SIGNALS: Final[dict[str, dict[int, str]]] = {
    "G": {0: "C1C", 3: "C2L", 4: "C2S", 6: "C5I", 7: "C5Q"},
    "S": {0: "C1C"},
    "E": {0: "C1C", 1: "C1B", 3: "C5I", 4: "C5Q", 5: "C7I", 6: "C7Q", 8: "C6B", 9: "C6C", 10: "C6A"},
    "C": {
        **{0: "C2I", 1: "C2I", 2: "C7I", 3: "C7I", 4: "C6I", 10: "C6I"},  # B1I, B2I, B3I with D1 and with D2
        **{5: "C1P", 6: "C1D", 7: "C5P", 8: "C5D"},
    },
    "J": {0: "C1C", 1: "C1Z", 4: "C2S", 5: "C2L", 8: "C5I", 9: "C5Q", 12: "C1E"},
    "R": {0: "C1C", 2: "C2C"},
    "I": {0: "C5A"},
}


@dataclass(frozen=True)
class RawEpochs:
    """The epochs of one file in its order."""

    t_ns: Int64  # (m,) receiver time tag
    offset: Int64  # (m,) place of each in the file
    leap_s: Int64  # (m,) GPS minus UTC, -128 where the receiver does not know it
    reset: Bool  # (m,) the receiver's clock was set here
    count: Int64  # (m,) measurements of each
    measurements: npt.NDArray[np.void]  # all of them, in order


def raw_epochs(frames: UbxFrames) -> tuple[RawEpochs, list[Event]]:
    """Return a file's epochs, and an event for each frame that contradicts itself or has no date."""
    data = frames.data
    good = [(o, n) for o, n in frames.of(RAWX) if n >= 16 and n == 16 + 32 * data[o + 11]]
    what = "RXM-RAWX frames whose length and count differ; refused"
    events = counted("ubx_damaged", len(frames.of(RAWX)) - len(good), what, frames.path)
    heads = np.frombuffer(b"".join([data[o : o + 16] for o, _ in good]), _EPOCH)
    dated = np.isfinite(heads["tow_s"]) & (heads["tow_s"] >= 0.0) & (heads["tow_s"] < S_PER_WEEK + 1.0)
    dated &= (heads["week"] > 0) & (heads["week"] <= LATEST_WEEK)
    undated = (
        f"{frames.path}: byte {good[k][0]}: RXM-RAWX without a date; refused"
        for k in np.flatnonzero(~dated).tolist()
    )
    events += first_events("ubx_damaged", undated, frames.path, "epochs refused")
    used = [place for place, has_date in zip(good, dated, strict=True) if has_date]
    heads = heads[dated]
    body = b"".join([data[o + 16 : o + n] for o, n in used])
    events += counted("gnss_epoch_empty", heads["count"] == 0, "epochs without a measurement", frames.path)
    tow_ns = np.rint(heads["tow_s"] * NS_PER_S).astype(np.int64)  # a double resolves 0.1 ns of a week
    known = heads["status"] & LEAP_KNOWN > 0
    epochs = RawEpochs(
        tow_ns + heads["week"].astype(np.int64) * NS_PER_WEEK,
        np.array([o for o, _ in used], dtype=np.int64),
        np.where(known, heads["leap_s"], -128).astype(np.int64),
        heads["status"] & CLOCK_RESET > 0,
        heads["count"].astype(np.int64),
        np.frombuffer(body, MEASUREMENT),
    )
    resets = [
        Event(int(t), "clock_reset", f"{frames.path}: the receiver set its clock")
        for t in epochs.t_ns[epochs.reset]
    ]
    return epochs, events + resets


def observation_table(files: list[RawEpochs], path: Path) -> tuple[GnssTable, list[Event]]:
    """Return one row for each measurement of a known satellite and signal, epochs in order and each once."""
    t_ns = np.concatenate([epochs.t_ns for epochs in files])
    count = np.concatenate([epochs.count for epochs in files])
    measured = np.concatenate([epochs.measurements for epochs in files])
    _, first = np.unique(t_ns, return_index=True)
    once = np.zeros(len(t_ns), np.bool_)
    once[first] = True
    rows = np.repeat(once, count)
    events = []
    if not once.all():
        again = np.flatnonzero(~once)
        detail = f"{path}: {len(again)} repeated epoch(s) left out"
        events.append(Event(int(t_ns[again[0]]), "gnss_epoch_repeated", detail))
    table, lock_ms, halved, unknown = _rows(np.repeat(t_ns, count)[rows], measured[rows], path)
    order = np.argsort(table.t_ns, kind="stable")
    slips = np.zeros(len(order), np.bool_)
    slips[order] = slipped_rows(table.take(order), lock_ms[order], halved[order], LOCK_CEILING_MS)
    assert table.lli is not None
    table.lli[slips] |= LLI_SLIP
    table, reordered = in_time_order(table, str(path))
    return table, events + unknown + reordered


def _rows(
    t_ns: Int64, measured: npt.NDArray[np.void], path: Path
) -> tuple[GnssTable, Int64, Bool, list[Event]]:
    """Return the rows, the lock time of each, whether a half cycle was subtracted, and the events of omitted rows."""
    satellite = _named(measured["gnss"], measured["satellite"], satellite_name)
    signal = _named(
        measured["gnss"], measured["signal"], lambda gnss, k: SIGNALS.get(SYSTEMS.get(gnss, ""), {}).get(k)
    )
    known = (satellite.index >= 0) & (signal.index >= 0)
    what = "measurements of unknown satellites or signals left out"
    events = counted("ubx_unknown_signal", ~known, what, path)
    measured = measured[known]
    status = measured["status"]
    range_m = _valid(measured["pseudorange_m"], status & RANGE_VALID > 0)
    carrier = _valid(measured["carrier_cycles"], status & CARRIER_VALID > 0)
    doppler = _valid(measured["doppler_hz"].astype(np.float64), True)
    unreadable = (status & RANGE_VALID > 0) & np.isnan(range_m) | np.isnan(doppler)
    is_open = np.isfinite(carrier) & (status & HALF_CYCLE_KNOWN == 0)
    table = GnssTable(
        t_ns[known],
        satellite.index[known].astype(np.int16),
        signal.index[known].astype(np.int16),
        range_m,
        doppler,
        np.full(len(measured), np.nan),
        np.where(measured["cn0_dbhz"] > 0, measured["cn0_dbhz"], np.nan),
        satellite.names,
        signal.names,
        bad_cells=np.flatnonzero(unreadable).astype(np.int64),
        carrier_cycles=carrier,
        lli=np.where(is_open, LLI_HALF_CYCLE, 0).astype(np.int8),
        glonass_channels=_channels(measured),
    )
    return table, measured["lock_ms"].astype(np.int64), status & HALF_CYCLE_SUBTRACTED > 0, events


@dataclass(frozen=True)
class _SatelliteNames:
    index: npt.NDArray[np.intp]  # of each measurement into the names, -1 when it has none
    names: tuple[str, ...]  # sorted


def _named(
    system: npt.NDArray[np.uint8], number: npt.NDArray[np.uint8], name_of: Callable[[int, int], str | None]
) -> _SatelliteNames:
    """Return names for pairs of system and number; ``name_of`` gives None for unknown ones."""
    pairs, index = np.unique(system.astype(np.int64) * 256 + number, return_inverse=True)
    words = [name_of(int(pair) >> 8, int(pair) & 255) for pair in pairs]
    names = tuple(sorted({word for word in words if word is not None}))
    place = np.array([-1 if word is None else names.index(word) for word in words] + [-1], dtype=np.intp)
    return _SatelliteNames(place[index], names)


def satellite_name(gnss: int, number: int) -> str | None:
    """Return the satellite of u-blox's two identifiers ("G05"), None when it is not known (GLONASS: 255)."""
    system = SYSTEMS.get(gnss, "")
    return rinex_name(system, number - (SBAS_OFFSET if system == "S" else 0)) or None


def _valid(values: Float64, valid: Bool | bool) -> Float64:
    return np.where(valid & np.isfinite(values), values, np.nan)


def _channels(measured: npt.NDArray[np.void]) -> dict[str, int]:
    """Return the frequency channel of each GLONASS satellite, the one seen last."""
    glonass = measured[measured["gnss"] == 6]
    pairs = np.unique(glonass["satellite"].astype(np.int64) * 256 + glonass["frequency"]).tolist()
    stated = [(rinex_name("R", pair >> 8), (pair & 255) - CHANNEL_OFFSET) for pair in pairs]
    return {name: channel for name, channel in stated if name and channel in CHANNELS_IN_USE}


RAW_LEGACY: Final = 0x0210
SFRB: Final = 0x0211
_LEGACY_EPOCH: Final = np.dtype([("tow_ms", "<i4"), ("week", "<i2"), ("count", "u1"), ("", "u1")])
_LEGACY_MEASUREMENT: Final = np.dtype(
    [
        *(("carrier_cycles", "<f8"), ("pseudorange_m", "<f8"), ("doppler_hz", "<f4")),
        *(("satellite", "u1"), ("quality", "i1"), ("cn0_dbhz", "i1"), ("lli", "u1")),
    ]
)
_RANGE_GOOD, _CARRIER_GOOD, _LOCK_HELD = 4, 5, 6  # least quality of each
_GPS, _SBAS = 0, 1
_FIRST_SBAS: Final = 120


def legacy_epochs(frames: UbxFrames) -> tuple[RawEpochs, list[Event]]:
    """Return a file's RXM-RAW epochs in the form of RXM-RAWX, and an event for those without a date."""
    data, head = frames.data, _LEGACY_EPOCH.itemsize
    headers = [
        (o, np.frombuffer(data, _LEGACY_EPOCH, 1, o)[0])
        for o, n in frames.of(RAW_LEGACY)
        if n >= head and n == head + _LEGACY_MEASUREMENT.itemsize * data[o + 6]
    ]
    dated = [
        (o, h)
        for o, h in headers
        if 0 < h["week"] <= LATEST_WEEK and 0 <= h["tow_ms"] <= NS_PER_WEEK // 1_000_000
    ]
    what = "RXM-RAW frame(s) without a date or of a wrong length; refused"
    events = counted("ubx_damaged", len(frames.of(RAW_LEGACY)) - len(dated), what, frames.path)
    rows = [np.frombuffer(data, _LEGACY_MEASUREMENT, int(h["count"]), o + head) for o, h in dated]
    epochs = RawEpochs(
        np.array([int(h["week"]) * NS_PER_WEEK + int(h["tow_ms"]) * NS_PER_MS for _, h in dated], np.int64),
        np.array([o for o, _ in dated], np.int64),
        np.full(len(dated), -128, np.int64),
        np.zeros(len(dated), np.bool_),
        np.array([h["count"] for _, h in dated], np.int64),
        _as_rawx(np.concatenate(rows) if rows else np.zeros(0, _LEGACY_MEASUREMENT)),
    )
    return epochs, events


def _as_rawx(rows: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """Return the measurements in the layout of RXM-RAWX."""
    out = np.zeros(len(rows), MEASUREMENT)
    for name in ("pseudorange_m", "carrier_cycles", "doppler_hz", "satellite"):
        out[name] = rows[name]
    out["gnss"] = np.where(rows["satellite"] >= _FIRST_SBAS, _SBAS, _GPS)
    out["cn0_dbhz"] = np.maximum(rows["cn0_dbhz"], 0)
    quality = rows["quality"]
    held = (quality >= _LOCK_HELD) & (rows["lli"] & 1 == 0)
    out["lock_ms"] = np.where(held, LOCK_CEILING_MS, 0)
    out["status"] = (
        RANGE_VALID * (quality >= _RANGE_GOOD) + CARRIER_VALID * (quality >= _CARRIER_GOOD) + HALF_CYCLE_KNOWN
    )
    return out


def add_legacy_subframes(frames: UbxFrames, lnav: LnavMessages, epoch_offset: Int64, epoch_ns: Int64) -> None:
    """Give the GPS subframes of a file to ``lnav``, each with the last time stated before it."""
    for offset, length in frames.of(SFRB):
        sv = satellite_name(_GPS, frames.data[offset + 1]) if length >= 42 else None
        if sv is None:
            continue
        words = np.frombuffer(frames.data, "<u4", 10, offset + 2) & 0xFFFFFF
        last = max(int(np.searchsorted(epoch_offset, offset)) - 1, 0)
        near_ns = int(epoch_ns[last]) if len(epoch_ns) else None
        lnav.add(sv, joined(words.tolist(), 24), near_ns)
