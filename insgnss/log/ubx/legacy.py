"""UBX-RXM-RAW and UBX-RXM-SFRB, the raw messages of u-blox receivers before RXM-RAWX (LEA-4T to LEA-6T).

u-blox 6 receiver description, "RXM-RAW", "RXM-SFRB": GPS L1 C/A and SBAS alone, whole milliseconds of receiver time,
no time of lock. A subframe comes as ten words of 24 bits, parity taken off.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.gpstime import LATEST_WEEK
from insgnss.log.messages.bits import joined
from insgnss.log.messages.gps_lnav import LnavMessages
from insgnss.log.ubx.frames import UbxFrames
from insgnss.log.ubx.observations import (
    CARRIER_VALID,
    HALF_CYCLE_KNOWN,
    LOCK_CEILING_MS,
    MEASUREMENT,
    RANGE_VALID,
    RawEpochs,
    satellite_name,
)
from insgnss.tables import Event, Int64

RAW_LEGACY: Final = 0x0210
SFRB: Final = 0x0211
_EPOCH: Final = np.dtype([("tow_ms", "<i4"), ("week", "<i2"), ("count", "u1"), ("", "u1")])
_MEASUREMENT: Final = np.dtype(
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
    data, head = frames.data, _EPOCH.itemsize
    headers = [
        (o, np.frombuffer(data, _EPOCH, 1, o)[0])
        for o, n in frames.of(RAW_LEGACY)
        if n >= head and n == head + _MEASUREMENT.itemsize * data[o + 6]
    ]
    dated = [
        (o, h)
        for o, h in headers
        if 0 < h["week"] <= LATEST_WEEK and 0 <= h["tow_ms"] <= NS_PER_WEEK // 1_000_000
    ]
    events = []
    wrong = len(frames.of(RAW_LEGACY)) - len(dated)
    if wrong:
        detail = f"{frames.path}: {wrong} RXM-RAW frame(s) without a date or of a wrong length; refused"
        events.append(Event(None, "ubx_damaged", detail))
    rows = [np.frombuffer(data, _MEASUREMENT, int(h["count"]), o + head) for o, h in dated]
    epochs = RawEpochs(
        np.array([_time_ns(h) for _, h in dated], np.int64),
        np.array([o for o, _ in dated], np.int64),
        np.full(len(dated), -128, np.int64),
        np.zeros(len(dated), np.bool_),
        np.array([h["count"] for _, h in dated], np.int64),
        _as_rawx(np.concatenate(rows) if rows else np.zeros(0, _MEASUREMENT)),
    )
    return epochs, events


def _time_ns(head: np.void) -> int:
    return int(head["week"]) * NS_PER_WEEK + int(head["tow_ms"]) * (NS_PER_S // 1000)


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
