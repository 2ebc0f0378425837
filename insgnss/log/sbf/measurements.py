"""SBF's MeasEpoch blocks become rows: all signals of all epochs of a file at once.

The first signal of a satellite is given in full (type 1), its others as differences to it (type 2). PolaRx5TR
reference guide, firmware 5.5.0, MeasEpoch:

- type 1: P = (CodeMSB 2^32 + CodeLSB) mm, D = Doppler 1e-4 Hz, L = P / lambda + (CarrierMSB 65536 + CarrierLSB) 1e-3
- type 2: P = P1 + (CodeOffsetMSB 65536 + CodeOffsetLSB) mm, D = D1 f / f1 + (DopplerOffsetMSB 65536 +
  DopplerOffsetLSB) 1e-4 Hz, L as above with its own P and wavelength
- C/N0 = 0.25 CN0, and 10 dB-Hz more except for the signals 1 and 2
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.gnss.signals import signal_of
from insgnss.log.events import counted
from insgnss.log.files import records
from insgnss.log.sbf.blocks import (
    CHANNEL_1,
    CHANNEL_2,
    HEADER_LENGTH,
    LAYOUTS,
    MEAS_EPOCH,
    Blocks,
    block_records,
    block_times_ns,
    time_known,
)
from insgnss.log.sbf.signals import CHANNEL_OFFSET, E6_B_USED, E6_SIGNAL, G3_HZ, SATELLITES, SIGNALS
from insgnss.tables import Event, Float64, GnssTable, Int8, Int16, Int64

Records = np.ndarray[tuple[int], np.dtype[np.void]]

_EXTENDED: Final = 31  # the signal's number does not fit the field and is in the flags, 32 less
_HALF_CYCLE: Final = 0x04
_DOPPLER_MISSING: Final = -(2**31)
_CARRIER_MISSING: Final = -128
_CN0_MISSING: Final = 255
_UNKNOWN: Final = -1
_LOCK_CLIPPED_S: Final = np.array([65_534, 254])  # of type 1 and 2
_LOCK_MISSING_S: Final = np.array([65_535, 255])


def measurements(data: bytes, blocks: Blocks) -> tuple[GnssTable, list[Event]]:
    """Return all measurements of the main antenna, one row for each epoch, satellite and signal.

    The loss-of-lock indicator says "slip" when the lock has not lasted since the signal's row before.
    """
    heads = block_records(data, blocks, MEAS_EPOCH)
    timed = time_known(heads)
    starts = np.array(blocks.starts.get(MEAS_EPOCH, []), dtype=np.int64)[timed]
    heads = heads[timed]
    t_ns = block_times_ns(heads)
    channels = _SubBlocks(data, starts, heads)
    table, events = _table(channels, t_ns, heads["flags"])
    events += counted("sbf_time_unknown", ~timed, "epoch(s) before the receiver knew the time left out")
    return table, events + _clock_jumps(t_ns, heads["clock_jumps_ms"])


class _SubBlocks:
    """Where the sub-blocks of all epochs are, type 2 with the type 1 it belongs to."""

    def __init__(self, data: bytes, starts: Int64, heads: Records) -> None:
        first: list[int] = []
        epoch_1: list[int] = []
        second: list[int] = []
        parent: list[int] = []
        self.cut = 0
        lengths = zip(heads["n1"].tolist(), heads["length1"].tolist(), heads["length2"].tolist(), strict=True)
        for epoch, (start, (n1, length_1, length_2)) in enumerate(zip(starts.tolist(), lengths, strict=True)):
            end = start + int.from_bytes(data[start + 6 : start + 8], "little")
            at = start + HEADER_LENGTH + LAYOUTS[MEAS_EPOCH].itemsize
            for _ in range(n1):
                if at + max(length_1, CHANNEL_1.itemsize) > end or length_1 < CHANNEL_1.itemsize:
                    self.cut += 1
                    break
                n2 = data[at + CHANNEL_1.itemsize - 1]
                first.append(at)
                epoch_1.append(epoch)
                at += length_1
                if n2 and (at + n2 * length_2 > end or length_2 < CHANNEL_2.itemsize):
                    self.cut += 1
                    break
                second += range(at, at + n2 * length_2, length_2) if n2 else ()
                parent += [len(first) - 1] * n2
                at += n2 * length_2
        self.first = records(data, first, CHANNEL_1)
        self.second = records(data, second, CHANNEL_2)
        self.parent = np.array(parent, dtype=np.int64)
        self.epoch_1 = np.array(epoch_1, dtype=np.int64)

    def epochs(self) -> Int64:
        return np.concatenate((self.epoch_1, self.epoch_1[self.parent]))

    def svid(self) -> Int64:
        svid = self.first["svid"].astype(np.int64)
        return np.concatenate((svid, svid[self.parent]))

    def both(self, name: str) -> Int64:
        """Return a field that both types have."""
        return np.concatenate((self.first[name].astype(np.int64), self.second[name].astype(np.int64)))

    def numbers(self) -> Int64:
        low = self.both("type") & 0x1F
        return np.where(low == _EXTENDED, (self.both("info") >> 3) + 32, low)


def _table(channels: _SubBlocks, t_ns: Int64, flags: npt.NDArray[np.uint8]) -> tuple[GnssTable, list[Event]]:
    number = channels.numbers()
    svid = channels.svid()
    # type 1 states a satellite's channel
    stated = np.where(np.isin(number[: len(channels.first)], (8, 9, 10, 11)), channels.first["info"] >> 3, 8)
    own = stated.astype(np.int64) - CHANNEL_OFFSET
    channel = np.concatenate((own, own[channels.parent]))
    carrier_hz = _carriers(number, channel)
    pseudorange, doppler = _code_and_doppler(channels, carrier_hz)
    msb, lsb = channels.both("carrier_msb"), channels.both("carrier_lsb")
    cycles = pseudorange * (carrier_hz / C_MPS) + (msb * 65_536 + lsb) * 1e-3
    cycles[(msb == _CARRIER_MISSING) & (lsb == 0)] = np.nan
    names, sv = _satellites(svid, number)
    codes, signal = _signals(number, flags[channels.epochs()])
    main = channels.both("type") >> 5 == 0
    known = (sv >= 0) & (signal >= 0)
    rows = np.flatnonzero(main & known & ~(np.isnan(pseudorange) & np.isnan(doppler)))
    rows = rows[np.lexsort((signal[rows], sv[rows], channels.epochs()[rows]))]
    epochs = channels.epochs()[rows]
    cn0 = channels.both("cn0")[rows]
    second = rows >= len(channels.first)
    of_signal = sv[rows].astype(np.int64) * len(codes) + signal[rows]
    slipped = _slips(t_ns[epochs], of_signal, channels.both("lock_s")[rows], second.astype(np.int64))
    half = (channels.both("info")[rows] & _HALF_CYCLE) != 0
    phase = ~np.isnan(cycles[rows])
    table = GnssTable(
        t_ns[epochs],
        sv[rows],
        signal[rows],
        pseudorange[rows],
        doppler[rows],
        np.full(len(rows), np.nan),
        np.where(
            cn0 == _CN0_MISSING, np.nan, 0.25 * cn0 + np.where(np.isin(number[rows], (1, 2)), 0.0, 10.0)
        ),
        names,
        codes,
        carrier_cycles=cycles[rows],
        lli=np.where(phase, slipped + 2 * half, 0).astype(np.int8),
        glonass_channels=_channel_of(names, sv[rows], channel[rows]),
    )
    unknown = "measurement(s) of an unknown satellite or signal left out"
    cut = "measurement block(s) whose sub-blocks do not fit their length, cut there"
    return table, [
        *counted("sbf_other_antenna", ~main, "measurement(s) of auxiliary antennas left out"),
        *counted("sbf_signal_unknown", main & ~known, unknown),
        *counted("sbf_damaged", channels.cut, cut),
    ]


def _carriers(number: Int64, channel: Int64) -> Float64:
    centre = np.full(64, np.nan)
    step = np.zeros(64)
    for index, (system, code) in SIGNALS.items():
        known = signal_of(system, code)
        centre[index], step[index] = (known.carrier_hz, known.channel_step_hz) if known else (G3_HZ, 0.0)
    return np.asarray(centre[number] + step[number] * channel)


def _code_and_doppler(channels: _SubBlocks, carrier_hz: Float64) -> tuple[Float64, Float64]:
    """Return pseudorange [m] and Doppler [Hz] of all rows, NaN where missing."""
    first, second, parent = channels.first, channels.second, channels.parent
    code_mm = (first["misc"].astype(np.int64) & 0x0F) << 32 | first["code_lsb"].astype(np.int64)
    doppler_1 = np.where(first["doppler"] == _DOPPLER_MISSING, np.nan, first["doppler"] * 1e-4)
    offsets = second["offsets_msb"].astype(np.int64)
    code_msb = ((offsets & 0x07) ^ 4) - 4  # two's complement of three bits
    doppler_msb = ((offsets >> 3) ^ 16) - 16  # of five bits
    code_offset = code_msb * 65_536 + second["code_lsb"]
    doppler_offset = (doppler_msb * 65_536 + second["doppler_lsb"].astype(np.int64)) * 1e-4
    missing_code = (code_msb == -4) & (second["code_lsb"] == 0) | (code_mm[parent] == 0)
    missing_doppler = (doppler_msb == -16) & (second["doppler_lsb"] == 0)
    ratio = carrier_hz[len(first) :] / carrier_hz[parent]
    code_2 = np.where(missing_code, np.nan, (code_mm[parent] + code_offset) * 1e-3)
    doppler_2 = np.where(missing_doppler, np.nan, doppler_1[parent] * ratio + doppler_offset)
    code_1 = np.where(code_mm == 0, np.nan, code_mm * 1e-3)
    return np.concatenate((code_1, code_2)), np.concatenate((doppler_1, doppler_2))


def _satellites(svid: Int64, number: Int64) -> tuple[tuple[str, ...], Int16]:
    """Return the satellites' names and each row's index, -1 for an unknown one or a signal of another system."""
    present = [int(k) for k in np.unique(svid) if int(k) in SATELLITES]
    names = tuple(sorted(SATELLITES[k] for k in present))
    index = np.full(256, _UNKNOWN, np.int16)
    for k in present:
        index[k] = names.index(SATELLITES[k])
    system_of_sv = np.array([SATELLITES.get(k, " ")[0] for k in range(256)])
    system_of_signal = np.array([SIGNALS[k].system if k in SIGNALS else "?" for k in range(64)])
    return names, np.where(system_of_sv[svid] == system_of_signal[number], index[svid], _UNKNOWN).astype(
        np.int16
    )


def _signals(number: Int64, flags: npt.NDArray[np.uint8]) -> tuple[tuple[str, ...], Int16]:
    present = [int(k) for k in np.unique(number) if int(k) in SIGNALS]
    codes = tuple(sorted({SIGNALS[k].code for k in present} | ({"C6B"} if E6_SIGNAL in present else set())))
    index = np.full(64, _UNKNOWN, np.int16)
    for k in present:
        index[k] = codes.index(SIGNALS[k].code)
    signal = index[number]
    e6_b = (number == E6_SIGNAL) & ((flags & E6_B_USED) != 0)
    if e6_b.any():
        signal[e6_b] = codes.index("C6B")
    return codes, signal


def _slips(t_ns: Int64, of_signal: Int64, lock_s: Int64, kind: Int64) -> Int8:
    """Return 1 where the lock (whole seconds, cut at a largest value) is younger than at the signal's row before."""
    order = np.lexsort((t_ns, of_signal))
    before, here = order[:-1], order[1:]
    again = of_signal[before] == of_signal[here]
    elapsed_s = (t_ns[here] - t_ns[before]) / NS_PER_S
    largest = np.minimum(_LOCK_CLIPPED_S[kind[before]], _LOCK_CLIPPED_S[kind[here]])
    shorter = np.minimum(lock_s[here], largest) < np.minimum(lock_s[before], largest)
    began = (lock_s[here] + 1 < elapsed_s) & (lock_s[here] < _LOCK_CLIPPED_S[kind[here]])
    slipped = np.zeros(len(t_ns), np.int8)
    slipped[here[again & (shorter | began)]] = 1
    slipped[lock_s == _LOCK_MISSING_S[kind]] = 1
    return slipped


def _channel_of(names: tuple[str, ...], sv: Int16, channel: Int64) -> dict[str, int]:
    channels = {}
    for k, name in enumerate(names):
        rows = channel[sv == k] if name[0] == "R" else channel[:0]
        if len(rows):
            channels[name] = int(rows[0])
    return channels


def _clock_jumps(t_ns: Int64, jumps_ms: npt.NDArray[np.uint8]) -> list[Event]:
    """Return an event for each change of the count of millisecond jumps, which is kept modulo 256."""
    steps: Int64 = np.mod(np.diff(jumps_ms.astype(np.int64)) + 128, 256) - 128
    return [
        Event(int(t_ns[k + 1]), "receiver_clock_jump", f"the receiver set its clock by {steps[k]} ms")
        for k in np.flatnonzero(steps)
    ]
