"""RANGE, RANGECMP and RANGECMP2, the raw measurements of NovAtel receivers, become rows.

OEM7 commands and logs reference manual. The accumulated Doppler range counts against the distance: L = -ADR. RANGECMP
sends it modulo 2^23 cycles, the wraps follow from the pseudorange; RANGECMP2 sends range and phase range as differences
to one whole number of metres for each satellite, and the Doppler in terms of the constellation's first carrier.
Of the standard deviations that the receiver states none is kept: they are thermal noise of the tracking loops alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS
from insgnss.gnss.signals import B1I_HZ, CHANNEL_OFFSET, CHANNELS, G1_HZ, G1_STEP_HZ, L1_HZ, carrier_hz
from insgnss.log.events import counted
from insgnss.log.files import records
from insgnss.log.gnss_rows import in_time_order, slipped_rows
from insgnss.log.novatel.frames import Frame, NovatelFrames
from insgnss.log.novatel.signals import SIGNALS, SIGNALS_2, SYSTEMS, satellite_name
from insgnss.tables import LLI_HALF_CYCLE, LLI_SLIP, Event, Float64, GnssTable, Int64

RANGE, RANGECMP, RANGECMP2 = 43, 140, 1273
COMPRESSED_FURTHER: Final = {1734: "RANGECMP3", 2050: "RANGECMP4", 2537: "RANGECMP5"}
_PHASE_LOCK, _PARITY_KNOWN, _CODE_LOCK, _HALF_CYCLE = 1 << 10, 1 << 11, 1 << 12, 1 << 28
_RANGE: Final = np.dtype(
    [
        *(("prn", "<u2"), ("channel", "<i2"), ("range_m", "<f8"), ("sd_range", "<f4"), ("adr", "<f8")),
        *(("sd_adr", "<f4"), ("doppler_hz", "<f4"), ("cn0", "<f4"), ("lock_s", "<f4"), ("status", "<u4")),
    ]
)
_COMPRESSED: Final = np.dtype(
    [
        *(("status", "<u4"), ("doppler_range", "<u8"), ("adr", "<i4"), ("sds", "u1"), ("prn", "u1")),
        *(("lock_cn0_channel", "<u4"), ("", "<u2")),
    ]
)
_SATELLITE: Final = np.dtype([("sv_channel", "u1"), ("prn", "u1"), ("fields", "<u8")])
_SIGNAL: Final = np.dtype([("first", "<u4"), ("second", "<u8")])
_SYSTEMS_2: Final = [*"GRS??ECJ?I", *"?" * 22]  # by RANGECMP2's own numbers
# Bits of RANGECMP2's signal block as those of the channel tracking status
_FLAGS_2: Final = {1 << 5: _PHASE_LOCK, 1 << 6: _PARITY_KNOWN, 1 << 7: _CODE_LOCK, 1 << 30: _HALF_CYCLE}
_ADR_CYCLE: Final = 2.0**23
_LONGEST_MS: Final = {RANGE: 1 << 40, RANGECMP: 65_535_968, RANGECMP2: 131_071}
_MOST_RANGE_M: Final = 1e9


@dataclass(frozen=True)
class _RangeColumns:
    """Measurements of one kind of message, one entry each."""

    t_ns: Int64
    system: npt.NDArray[Any]  # letter of RINEX
    prn: Int64
    channel: Int64  # GLONASS's, as sent
    code: npt.NDArray[Any]  # "" for an unknown signal
    range_m: Float64
    cycles: Float64  # RINEX sign
    doppler_hz: Float64
    cn0: Float64
    lock_ms: Int64
    status: Int64  # bits of the channel tracking status
    ceiling_ms: Int64

    def keep(self, rows: npt.NDArray[Any]) -> _RangeColumns:
        return _RangeColumns(**{name: values[rows] for name, values in vars(self).items()})


def measurements(files: list[NovatelFrames]) -> tuple[GnssTable | None, list[Event]]:
    """Return all measurements of the primary antenna, None when there are none.

    Of an epoch that was logged in several kinds of message the fullest kind counts: RANGE before its compressed forms.
    """
    parts: list[_RangeColumns] = []
    events: list[Event] = []
    seen: set[int] = set()
    for kind, rows_of in ((RANGE, _plain), (RANGECMP, _compressed), (RANGECMP2, _compressed_2)):
        for frames in files:
            chosen, more_events = _usable(frames, kind, seen)
            parts.append(rows_of(frames, chosen))
            events += more_events
        seen |= {int(t) for t in np.unique(np.concatenate([part.t_ns for part in parts]))}
    file = str(files[0].path)
    rows = _RangeColumns(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    )
    if not len(rows.t_ns):
        return None, events
    table, more_events = _table(rows, file)
    return table, events + more_events


def _usable(frames: NovatelFrames, kind: int, seen: set[int]) -> tuple[list[Frame], list[Event]]:
    """Return the messages whose epochs are dated, of the primary antenna and new."""
    found = frames.of(kind)
    own = [frame for frame in found if not frame.second]
    dated = [frame for frame in own if frame.t_ns >= 0]
    undated, before = len(own) - len(dated), "epoch(s) before the receiver knew the time left out"
    other, path = "epoch(s) of the secondary antenna left out", frames.path
    return [frame for frame in dated if frame.t_ns not in seen], [
        *counted("novatel_other_antenna", len(found) - len(own), other, path),
        *counted("novatel_time_unknown", undated, before, path),
    ]


def _places(frames: NovatelFrames, chosen: list[Frame], size: int) -> tuple[Int64, Int64]:
    """Return start and time of each of the records that follow a count of four bytes."""
    chosen = [f for f in chosen if f.length >= 4]
    stated = [int.from_bytes(frames.data[f.offset : f.offset + 4], "little") for f in chosen]
    counts = [min(n, (f.length - 4) // size) for n, f in zip(stated, chosen, strict=True)]
    starts = [np.arange(n, dtype=np.int64) * size + f.offset + 4 for f, n in zip(chosen, counts, strict=True)]
    t_ns = np.repeat(np.array([f.t_ns for f in chosen], np.int64), counts)
    return np.concatenate([*starts, np.zeros(0, np.int64)]), t_ns


def _letters(status: Int64) -> npt.NDArray[Any]:
    letters: npt.NDArray[Any] = np.array([*SYSTEMS, "?"])[status >> 16 & 7]
    return letters


def _codes(system: npt.NDArray[Any], number: Int64, signals: dict[str, dict[int, str]]) -> npt.NDArray[Any]:
    """Return the RINEX code of each signal's number, "" for an unknown one."""
    table = np.full((128, 32), "", "U3")
    for letter, codes in signals.items():
        for index, code in codes.items():
            table[ord(letter), index] = code
    rinex_codes: npt.NDArray[Any] = table[np.array([ord(letter) for letter in system], np.int64), number]
    return rinex_codes


def _plain(frames: NovatelFrames, chosen: list[Frame]) -> _RangeColumns:
    starts, t_ns = _places(frames, chosen, _RANGE.itemsize)
    rows = records(frames.data, starts, _RANGE)
    status = rows["status"].astype(np.int64)
    system = _letters(status)
    lock_ms = np.nan_to_num(np.ceil(rows["lock_s"].astype(np.float64) * 1e3), nan=0.0, posinf=0.0, neginf=0.0)
    return _RangeColumns(
        t_ns,
        system,
        rows["prn"].astype(np.int64),
        rows["channel"].astype(np.int64) - CHANNEL_OFFSET,
        _codes(system, status >> 21 & 31, SIGNALS),
        rows["range_m"].copy(),
        -rows["adr"],
        rows["doppler_hz"].astype(np.float64),
        rows["cn0"].astype(np.float64),
        np.minimum(lock_ms, 2.0**40).astype(np.int64),
        status,
        np.full(len(rows), _LONGEST_MS[RANGE]),
    )


def _carriers(system: npt.NDArray[Any], code: npt.NDArray[Any], channel: Int64) -> Float64:
    """Return the carrier of each row [Hz]; those of SBAS are GPS's."""
    keys = np.char.add(np.char.add(system.astype("U1"), code.astype("U3")), channel.astype("U8"))
    unique, first, index = np.unique(keys, return_index=True, return_inverse=True)
    hz = [
        carrier_hz("G" if system[k] == "S" else str(system[k]), str(code[k]), int(channel[k])) for k in first
    ]
    return np.array(hz, np.float64)[index] if len(unique) else np.zeros(0)


def _compressed(frames: NovatelFrames, chosen: list[Frame]) -> _RangeColumns:
    starts, t_ns = _places(frames, chosen, _COMPRESSED.itemsize)
    rows = records(frames.data, starts, _COMPRESSED)
    status, both = rows["status"].astype(np.int64), rows["doppler_range"]
    system = _letters(status)
    code = _codes(system, status >> 21 & 31, SIGNALS)
    last = rows["lock_cn0_channel"].astype(np.int64)
    channel = (last >> 26 & 63) - CHANNEL_OFFSET
    range_m = (both >> np.uint64(28)).astype(np.float64) / 128.0
    hz = _carriers(system, code, channel)
    adr = rows["adr"] / 256.0
    wraps = np.rint((-range_m * hz / C_MPS - adr) / _ADR_CYCLE)
    return _RangeColumns(
        t_ns,
        system,
        rows["prn"].astype(np.int64),
        channel,
        code,
        range_m,
        -(adr + wraps * _ADR_CYCLE),
        _signed((both & np.uint64(0xFFFFFFF)).astype(np.int64), 28) / 256.0,
        (last >> 21 & 31).astype(np.float64) + 20.0,
        np.ceil((last & 0x1FFFFF) * (1000.0 / 32.0)).astype(np.int64),
        status,
        np.full(len(rows), _LONGEST_MS[RANGECMP]),
    )


def _signed(values: Int64, bits: int) -> Int64:
    return values - (values >> bits - 1 << bits)


def _compressed_2(frames: NovatelFrames, chosen: list[Frame]) -> _RangeColumns:
    satellites: list[int] = []
    signals: list[int] = []
    t_ns: list[int] = []
    parent: list[int] = []
    for frame in chosen:
        at = frame.offset + 4
        stated = int.from_bytes(frames.data[frame.offset : at], "little")
        end = min(at + stated, frame.offset + frame.length)
        while at + _SATELLITE.itemsize <= end:
            n = min(frames.data[at + 9] >> 4, (end - at - _SATELLITE.itemsize) // _SIGNAL.itemsize)
            satellites.append(at)
            at += _SATELLITE.itemsize
            signals += range(at, at + n * _SIGNAL.itemsize, _SIGNAL.itemsize)
            parent += [len(satellites) - 1] * n
            t_ns += [frame.t_ns] * n
            at += n * _SIGNAL.itemsize
    of = np.array(parent, np.int64)
    heads, rows = records(frames.data, satellites, _SATELLITE)[of], records(frames.data, signals, _SIGNAL)
    fields = heads["fields"]
    first, second = rows["first"].astype(np.int64), rows["second"]
    letter = np.array(_SYSTEMS_2)[_bits(fields, 4, 5)]
    code = _codes(letter, first & 31, SIGNALS_2)
    channel = _bits(fields, 0, 4) - CHANNEL_OFFSET
    base_m, hz = _signed(_bits(fields, 10, 29), 29), _carriers(letter, code, channel)
    share = hz / np.where(letter == "R", G1_HZ + channel * G1_STEP_HZ, np.where(letter == "C", B1I_HZ, L1_HZ))
    status = np.zeros(len(rows), np.int64)
    for bit, meaning in _FLAGS_2.items():
        status[first & bit != 0] |= meaning
    doppler = _signed(_bits(fields, 39, 21), 21) + _signed(_bits(second, 47, 17), 17) / 256.0
    # numbers of GLONASS's satellites are slots here
    prn = heads["prn"].astype(np.int64) + np.where(letter == "R", 37, 0)
    return _RangeColumns(
        np.array(t_ns, np.int64),
        letter,
        prn,
        channel,
        code,
        base_m + _bits(second, 13, 14) / 128.0,
        (base_m + _bits(second, 27, 20) / 2048.0) * hz / C_MPS,
        doppler * share,
        _bits(second, 0, 5).astype(np.float64) + 20.0,
        first >> 8 & 0x1FFFF,
        status,
        np.full(len(rows), _LONGEST_MS[RANGECMP2]),
    )


def _bits(values: npt.NDArray[np.uint64], place: int, count: int) -> Int64:
    return (values >> np.uint64(place) & np.uint64((1 << count) - 1)).astype(np.int64)


# ------------------------------------------------------------------------------------------------------------- table


def _table(rows: _RangeColumns, file: str) -> tuple[GnssTable | None, list[Event]]:
    """Return the rows of known satellites and signals in the order of time, each once."""
    pairs, index = np.unique(
        np.char.add(rows.system.astype("U1"), rows.prn.astype("U8")), return_inverse=True
    )
    names = np.array([satellite_name(str(pair[0]), int(pair[1:])) for pair in pairs], "U3")[index]
    known = (names != "") & (rows.code != "")
    what = "measurements of unknown satellites or signals left out"
    events = counted("novatel_signal_unknown", ~known, what, file)
    has_range = (rows.status & _CODE_LOCK != 0) & (rows.range_m > 0.0) & (rows.range_m < _MOST_RANGE_M)
    has_phase = (rows.status & _PHASE_LOCK != 0) & np.isfinite(rows.cycles) & (np.abs(rows.cycles) < 1e12)
    has_doppler = (rows.status & (_PHASE_LOCK | _CODE_LOCK) != 0) & (np.abs(rows.doppler_hz) < 1e6)
    usable = np.flatnonzero(known & (has_range | has_doppler))
    _, once = np.unique(
        np.char.add(np.char.add(names, rows.code), rows.t_ns.astype("U20"))[usable], return_index=True
    )
    events += counted("gnss_epoch_repeated", len(usable) - len(once), "repeated measurements left out", file)
    usable = usable[np.sort(once)]
    if not len(usable):
        return None, events
    chosen, names = rows.keep(usable), names[usable]
    sv_names, sv = np.unique(names, return_inverse=True)
    codes, code = np.unique(chosen.code, return_inverse=True)
    stated = {name: int(chosen.channel[names == name][-1]) for name in map(str, sv_names) if name[0] == "R"}
    phase = has_phase[usable]
    half_open = phase & (chosen.status & _PARITY_KNOWN == 0)
    order = np.lexsort((code, sv, chosen.t_ns))
    table = GnssTable(
        chosen.t_ns,
        sv.astype(np.int16),
        code.astype(np.int16),
        np.where(has_range[usable], chosen.range_m, np.nan),
        np.where(has_doppler[usable], chosen.doppler_hz, np.nan),
        np.full(len(usable), np.nan),
        np.where((chosen.cn0 > 0.0) & (chosen.cn0 < 100.0), chosen.cn0, np.nan),
        tuple(map(str, sv_names)),
        tuple(map(str, codes)),
        carrier_cycles=np.where(phase, chosen.cycles, np.nan),
        lli=np.where(half_open, LLI_HALF_CYCLE, 0).astype(np.int8),
        glonass_channels={name: channel for name, channel in stated.items() if channel in CHANNELS},
    ).take(order)
    assert table.lli is not None
    slips = slipped_rows(
        table,
        chosen.lock_ms[order],
        chosen.status[order] & _HALF_CYCLE != 0,
        chosen.ceiling_ms[order],
    )
    table.lli[slips] |= LLI_SLIP
    table, reordered = in_time_order(table, file)
    return table, events + reordered
