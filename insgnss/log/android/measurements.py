"""Android's raw measurements ("Raw" lines) become pseudoranges, range rates and carrier phases.

Pseudorange = (t_receiver - t_satellite) c, with the time of reception by ``insgnss.log.android.clock`` and the time of
transmission ReceivedSvTimeNanos, counted in the system's own week (GPS, QZSS, Galileo, NavIC, SBAS; BeiDou 14 s behind)
or day (GLONASS: UTC + 3 h). A receiver that has not decoded the time yet counts in what it has found of the signal, a
subframe, string, page or secondary code: enough where that is longer than a travel time. With the code alone, whole
milliseconds are missing; other epochs of the satellite tell them.
[European GNSS Agency, "Using GNSS raw measurements on Android devices", 2017, 2.4; Android developer reference,
GnssClock and GnssMeasurement]

Every line of a known satellite and signal with a time is a row. Phones also list signals that they only search for,
with predicted numbers and an uncertainty of a second: of these C/N0 alone is kept.
"""

from __future__ import annotations

import math
from collections import Counter
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_DAY, NS_PER_MS, NS_PER_S, NS_PER_WEEK
from insgnss.gpstime import BDT_MINUS_GPST_S, MOSCOW_MINUS_UTC_S, leap_seconds, ns_to_datetime
from insgnss.log.android.clock import (
    ReceiverClock,
    corrected_by_satellites,
    receiver_clock,
    whole_milliseconds,
)
from insgnss.log.android.lines import AndroidCells
from insgnss.log.android.signals import AndroidSignal, on_channel, satellite, signal
from insgnss.log.events import listed
from insgnss.log.satellites import channel_of_name
from insgnss.tables import Bool, Event, Float64, GnssTable, Int8, Int64

# GnssMeasurement.getState
CODE_LOCK, SUBFRAME_SYNC, TOW_DECODED, MSEC_AMBIGUOUS = 0x1, 0x4, 0x8, 0x10
GLO_STRING_SYNC, GLO_TOD_DECODED, BDS_D2_SUBFRAME_SYNC = 0x40, 0x80, 0x200
GAL_E1BC_CODE_LOCK, GAL_E1C_2ND_CODE_LOCK, GAL_E1B_PAGE_SYNC, SBAS_SYNC = 0x400, 0x800, 0x1000, 0x2000
TOW_KNOWN, GLO_TOD_KNOWN, SECOND_CODE_LOCK = 0x4000, 0x8000, 0x10000
_LOCKED: Final = CODE_LOCK | GAL_E1BC_CODE_LOCK | GAL_E1C_2ND_CODE_LOCK | SECOND_CODE_LOCK
# GnssMeasurement.getAccumulatedDeltaRangeState
ADR_VALID, ADR_RESET, ADR_CYCLE_SLIP, ADR_HALF_CYCLE_RESOLVED, ADR_HALF_CYCLE_REPORTED = 1, 2, 4, 8, 16

SHORTEST_NS, LONGEST_NS = 1e6, 5e8  # of a travel time with a clock that is off: 300 km to half a second
# In what the time of transmission counts where only that was found: state, systems, period; the longest first
_PERIODS: Final = (
    (SUBFRAME_SYNC, "GJCI", 6000 * NS_PER_MS),
    (GLO_STRING_SYNC, "R", 2000 * NS_PER_MS),
    (GAL_E1B_PAGE_SYNC, "E", 2000 * NS_PER_MS),
    (SBAS_SYNC, "S", 1000 * NS_PER_MS),
    (BDS_D2_SUBFRAME_SYNC, "C", 600 * NS_PER_MS),
    (GAL_E1C_2ND_CODE_LOCK, "E", 100 * NS_PER_MS),
)
# Stated uncertainties from which on a number is predicted, not measured; phones write 1 s, c and c / 1e6
_UNMEASURED_NS: Final = 1e6
_UNMEASURED_MPS: Final = 100.0
_KNOWN_ROWS: Final = 4096  # kinds of row whose satellite and signal are remembered


def measurements(raw: AndroidCells) -> tuple[GnssTable, ReceiverClock, list[Event]]:
    """Return one row for each line of a known satellite and signal with a time, the clock, and what rows lack."""
    clock = receiver_clock(raw)
    names, signals = _named(raw)
    clock, travel_ns, known = _travel_times(raw, clock, [name or "" for name in names])
    identified = np.array([one is not None for one in signals], np.bool_)
    measured = _measured(raw)
    plausible = (travel_ns > SHORTEST_NS) & (travel_ns < LONGEST_NS)
    kept = clock.known & identified
    rounded = _rounded(raw, "TimeNanos") | _rounded(raw, "FullBiasNanos")
    positive = (raw.integers("FullBiasNanos")[0] > 0) & ~rounded
    sent_rounded = _rounded(raw, "ReceivedSvTimeNanos")
    events = clock.events + _told(
        "android_not_used",
        (
            "measurement(s) left out whose TimeNanos or FullBiasNanos is not written as a whole number: in -1.456e+18"
            " the last digits are missing",
            ~clock.known & rounded,
        ),
        (
            "measurement(s) left out whose FullBiasNanos is positive: it is the clock minus GPS time, as"
            " -1456488152065337057",
            ~clock.known & positive,
        ),
        (
            "measurement(s) before the receiver knew GPS time left out",
            ~clock.known & ~rounded & ~positive,
        ),
        ("measurement(s) of an unknown satellite or signal left out", clock.known & ~identified),
    )
    events += _told(
        "android_range_not_used",
        ("signal(s) that the phone was searching for: C/N0 alone kept", kept & ~measured),
        (
            "pseudorange(s) left out whose ReceivedSvTimeNanos is not written as a whole number: in 3.45e+14 the last"
            " digits are missing; their range rates kept",
            kept & measured & sent_rounded,
        ),
        (
            "pseudorange(s) whose time of transmission is ambiguous left out, their range rates kept",
            kept & measured & ~known & ~sent_rounded,
        ),
        (
            "pseudorange(s) with an impossible travel time left out, their range rates kept",
            kept & measured & known & ~plausible,
        ),
    )
    events += _other_codes(raw, names, signals, kept)
    travel_ns = np.where(measured & known & plausible, travel_ns, np.nan)
    rows = np.flatnonzero(kept)
    rows = rows[np.argsort(clock.t_ns[rows], kind="stable")]
    chosen = [(names[k] or "", signals[k] or AndroidSignal("", np.nan)) for k in rows.tolist()]
    return _table(raw, clock, rows, chosen, travel_ns, measured), clock, events


def _other_codes(
    raw: AndroidCells, names: list[str | None], signals: list[AndroidSignal | None], kept: Bool
) -> list[Event]:
    """Return an event if lines state a code type that RINEX does not have for their signal."""
    stated = [text.strip().upper() for text in raw.texts("CodeType")]
    count = Counter(
        f"{text} of {(name or '')[:1]} {one.code}"
        for name, one, text, keep in zip(names, signals, stated, kept.tolist(), strict=True)
        if keep and one is not None and text not in ("", one.code[-1])
    )
    what = "line(s) with a CodeType that their signal does not have, the usual code taken"
    return listed("android_code_type", what, dict(sorted(count.items())))


def _told(kind: str, *groups: tuple[str, Bool]) -> list[Event]:
    parts = [f"{int(rows.sum())} {what}" for what, rows in groups if rows.any()]
    return [Event(None, kind, "; ".join(parts))] if parts else []


def _rounded(raw: AndroidCells, name: str) -> Bool:
    """Return the lines whose number in a column of integers is not written to its last digit."""
    return np.asarray(np.isfinite(raw.decimals(name)) & ~raw.integers(name)[1], np.bool_)


def _measured(raw: AndroidCells) -> Bool:
    """Return which lines are of signals that the phone tracked: by the stated uncertainty, else by the state.

    State 0 means that nothing of the signal was found, whatever the uncertainty.
    """
    uncertainty_ns = raw.decimals("ReceivedSvTimeUncertaintyNanos")
    state, stated = raw.integers("State")
    tracked = np.where(uncertainty_ns > 0.0, uncertainty_ns < _UNMEASURED_NS, state & _LOCKED != 0)
    return np.asarray(tracked & ~(stated & (state == 0)), np.bool_)


def _named(raw: AndroidCells) -> tuple[list[str | None], list[AndroidSignal | None]]:
    """Return each row's satellite and signal."""
    systems, numbers = (raw.integers(name)[0].tolist() for name in ("ConstellationType", "Svid"))
    carriers = [hz if hz > 0.0 else None for hz in raw.decimals("CarrierFrequencyHz").tolist()]
    names = [_satellite(*row) for row in zip(systems, numbers, strict=True)]
    return names, [_signal(*row) for row in zip(names, carriers, raw.texts("CodeType"), strict=True)]


_satellite: Final = lru_cache(_KNOWN_ROWS)(satellite)  # a log repeats few of them in many rows


@lru_cache(_KNOWN_ROWS)
def _signal(name: str | None, carrier_hz: float | None, code_type: str) -> AndroidSignal | None:
    if name is None:
        return None
    nominal = signal(name[0], math.nan if carrier_hz is None else carrier_hz, code_type)
    channel = channel_of_name(name)
    return nominal if nominal is None or channel is None else on_channel(nominal, channel)


def _travel_times(
    raw: AndroidCells, clock: ReceiverClock, names: list[str]
) -> tuple[ReceiverClock, Float64, Bool]:
    """Return the clock, mended where it must be, the travel times [ns], and where they are known."""
    sent_ns, readable = raw.integers("ReceivedSvTimeNanos")
    system = np.array([name[:1] for name in names], "U1")
    # what is added to GPS time to get the time that the satellite counts in
    shift = np.zeros(raw.n, np.int64)
    shift[system == "C"] = BDT_MINUS_GPST_S * NS_PER_S
    glonass = system == "R"
    if glonass.any() and clock.known.any():
        shift[glonass] = (MOSCOW_MINUS_UTC_S - _leap_seconds(raw, clock)) * NS_PER_S
    period, whole = _periods(raw, system)
    known = readable & (period > 0)
    period = np.maximum(period, 1)
    elapsed_ns = clock.t_ns + shift - sent_ns
    half = period // 2
    signed = np.mod(elapsed_ns + half, period) - half
    clock, moved_ns = corrected_by_satellites(
        clock, signed.astype(np.float64), known & whole & clock.known & _measured(raw)
    )
    travel = np.mod(elapsed_ns + moved_ns, period).astype(np.float64)
    sound = known & clock.known & _measured(raw) & (travel > SHORTEST_NS) & (travel < LONGEST_NS)
    locked = raw.integers("State")[0] & _LOCKED != 0
    travel, completed = whole_milliseconds(
        clock,
        np.array(names, "U3"),
        elapsed_ns + moved_ns,
        travel,
        sound,
        readable & ~known & locked & clock.known & _measured(raw),
    )
    known = known | completed
    offset_ns = np.nan_to_num(raw.decimals("TimeOffsetNanos"))
    rate = np.nan_to_num(_rates(raw))
    # a measurement taken later than its epoch's tag is brought back to the tag with its rate
    return clock, travel + offset_ns - rate / C_MPS * offset_ns, known


def _periods(raw: AndroidCells, system: npt.NDArray[np.str_]) -> tuple[Int64, Bool]:
    """Return the period of each time of transmission [ns], zero where ambiguous; and whether it is a day or a week."""
    state, _ = raw.integers("State")
    whole = np.where(
        system == "R", state & (GLO_TOD_DECODED | GLO_TOD_KNOWN), state & (TOW_DECODED | TOW_KNOWN)
    )
    period = np.where(whole != 0, np.where(system == "R", NS_PER_DAY, NS_PER_WEEK), 0)
    for bit, systems, length in _PERIODS:
        applies = (period == 0) & (state & bit != 0) & np.isin(system, list(systems))
        period[applies] = length
    period[(state & _LOCKED == 0) | (state & MSEC_AMBIGUOUS != 0)] = 0
    return period, (whole != 0) & (period > 0)


def _rates(raw: AndroidCells) -> Float64:
    """Return the range rates [m/s], NaN where the phone does not claim to have measured one."""
    rate = raw.decimals("PseudorangeRateMetersPerSecond")
    uncertainty = raw.decimals("PseudorangeRateUncertaintyMetersPerSecond")
    return np.asarray(np.where(uncertainty > _UNMEASURED_MPS, np.nan, rate))


def _leap_seconds(raw: AndroidCells, clock: ReceiverClock) -> int:
    """Return GPS minus UTC as the log states it, else by the date."""
    stated, given = raw.integers("LeapSecond")
    seconds = stated[given & (stated > 0)]
    if len(seconds):
        return int(seconds[0])
    return leap_seconds(ns_to_datetime(int(clock.t_ns[clock.known][0])))


def _table(
    raw: AndroidCells,
    clock: ReceiverClock,
    rows: npt.NDArray[np.intp],
    chosen: list[tuple[str, AndroidSignal]],
    travel_ns: Float64,
    measured: Bool,
) -> GnssTable:
    sv_names = tuple(sorted({name for name, _ in chosen}))
    codes = tuple(sorted({one.code for _, one in chosen}))
    carrier_hz = np.array([one.carrier_hz for _, one in chosen], dtype=np.float64)
    sv_index = {name: k for k, name in enumerate(sv_names)}
    code_index = {code: k for k, code in enumerate(codes)}
    cycles, lli = _carrier(raw, clock, rows, carrier_hz)
    rate = np.where(measured, _rates(raw), np.nan)[rows]
    # a wavelength that is not known, GLONASS without its channel, makes no Doppler
    channel_missing = np.array([name[0] == "R" and one.channel is None for name, one in chosen], np.bool_)
    with np.errstate(over="ignore"):
        doppler_hz = -rate * carrier_hz / C_MPS
    doppler_hz[np.isinf(doppler_hz)] = np.nan
    return GnssTable(
        clock.t_ns[rows],
        np.array([sv_index[name] for name, _ in chosen], dtype=np.int16),
        np.array([code_index[one.code] for _, one in chosen], dtype=np.int16),
        travel_ns[rows] * (C_MPS / NS_PER_S),
        np.where(channel_missing, np.nan, doppler_hz),
        np.where(channel_missing, rate, np.nan),
        raw.decimals("Cn0DbHz")[rows],
        sv_names,
        codes,
        _satellite_states(raw, rows),
        carrier_cycles=cycles,
        lli=lli,
        glonass_channels={name: one.channel for name, one in chosen if one.channel is not None},
    )


def _satellite_states(raw: AndroidCells, rows: npt.NDArray[np.intp]) -> Float64 | None:
    """Return (n, 8) positions, velocities, clocks and drifts that newer phones state, None where the file has none."""
    for ending in ("Ecef{}", "{}Ecef"):  # of the application, of tables made of its files
        axes = [ending.format(axis) for axis in "XYZ"]
        names = [f"SvPosition{axis}Meters" for axis in axes]
        names += [f"SvVelocity{axis}MetersPerSecond" for axis in axes]
        names += ["SvClockBiasMeters", "SvClockDriftMetersPerSecond"]
        if all(map(raw.has, names)):
            states = np.column_stack([raw.decimals(name)[rows] for name in names])
            return states if np.isfinite(states).all(axis=1).any() else None
    return None


def _carrier(
    raw: AndroidCells, clock: ReceiverClock, rows: npt.NDArray[np.intp], carrier_hz: Float64
) -> tuple[Float64 | None, Int8 | None]:
    """Return carrier phases [cycles] and loss-of-lock indicators; None when the log has none."""
    state = raw.integers("AccumulatedDeltaRangeState")[0][rows]
    metres = raw.decimals("AccumulatedDeltaRangeMeters")[rows]
    valid = (state & ADR_VALID != 0) & ~np.isnan(metres)
    if not valid.any():
        return None, None
    half = (state & ADR_HALF_CYCLE_REPORTED != 0) & (state & ADR_HALF_CYCLE_RESOLVED == 0)
    epoch_after = np.isin(clock.t_ns[rows], [event.t_ns for event in clock.events if event.t_ns is not None])
    slipped = (state & (ADR_RESET | ADR_CYCLE_SLIP) != 0) | epoch_after
    lli = np.where(valid, slipped + 2 * half, 0).astype(np.int8)
    return np.where(valid, metres * carrier_hz / C_MPS, np.nan), lli
