"""Android's raw measurements ("Raw" lines) become pseudoranges, Dopplers and carrier phases.

Pseudorange = (t_receiver - t_satellite) c, with the receiver's time of reception

    t_receiver = TimeNanos + TimeOffsetNanos - (FullBiasNanos + BiasNanos)       [GPS time]

and the satellite's time of transmission ReceivedSvTimeNanos, counted in the system's own week (GPS, QZSS, Galileo,
NavIC, SBAS; BeiDou 14 s behind) or day (GLONASS: UTC + 3 h), or, for a Galileo signal whose secondary code alone is
known, in its 100 ms.   [European GNSS Agency, "Using GNSS raw measurements on Android devices", 2017, 2.4; Android
developer reference, GnssClock and GnssMeasurement]

The bias of the first epoch is kept as long as the hardware clock runs without a discontinuity, so that pseudorange,
its rate and the carrier phase see one clock; the filter estimates what it drifts. The rate that Android gives is not
corrected for that drift and grows with the distance.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_S, NS_PER_WEEK, S_PER_DAY
from insgnss.gpstime import BDT_MINUS_GPST_S, leap_seconds, ns_to_datetime
from insgnss.log.android_lines import Cells
from insgnss.log.android_signals import SYSTEMS, Signal, satellite, signal
from insgnss.tables import Event, Float64, GnssTable, Int8, Int64

Bool = npt.NDArray[np.bool_]

# GnssMeasurement.getState
CODE_LOCK, TOW_DECODED, MSEC_AMBIGUOUS = 0x1, 0x8, 0x10
GLO_TOD_DECODED, GAL_E1BC_CODE_LOCK, GAL_E1C_2ND_CODE_LOCK = 0x80, 0x400, 0x800
TOW_KNOWN, GLO_TOD_KNOWN = 0x4000, 0x8000
# GnssMeasurement.getAccumulatedDeltaRangeState
ADR_VALID, ADR_RESET, ADR_CYCLE_SLIP, ADR_HALF_CYCLE_RESOLVED, ADR_HALF_CYCLE_REPORTED = 1, 2, 4, 8, 16

MOSCOW_MINUS_UTC_S: Final = 3 * 3600
SECONDARY_CODE_NS: Final = 100_000_000
SHORTEST_NS, LONGEST_NS = 1e6, 5e8  # of a travel time with a clock that is off: 300 km to half a second
_LATEST_NS: Final = 4 * 10**18  # the year 2106: later is a damaged cell
_DAY_NS: Final = S_PER_DAY * NS_PER_S


def measurements(raw: Cells) -> tuple[GnssTable, list[Event]]:
    """Return one row for each measurement whose time of transmission is known without ambiguity."""
    clock = _Clock(raw)
    names, signals = _named(raw)
    travel_ns, known = _travel_times(raw, clock, [name or "" for name in names])
    identified = np.array(
        [n is not None and s is not None for n, s in zip(names, signals, strict=True)], np.bool_
    )
    plausible = (travel_ns > SHORTEST_NS) & (travel_ns < LONGEST_NS)
    kept = np.flatnonzero(clock.known & identified & known & plausible)
    told = (
        (~clock.known, "before the receiver knew GPS time"),
        (clock.known & ~identified, "of an unknown satellite or signal"),
        (clock.known & identified & ~known, "whose time of transmission is ambiguous"),
        (clock.known & identified & known & ~plausible, "with an impossible travel time"),
    )
    events = clock.events + [
        Event(None, "android_not_used", f"{int(rows.sum())} measurement(s) {why} left out")
        for rows, why in told
        if rows.any()
    ]
    kept = kept[np.argsort(clock.t_ns[kept], kind="stable")]
    chosen = [(names[k] or "", signals[k] or Signal("", np.nan)) for k in kept.tolist()]
    return _table(raw, clock, kept, chosen, travel_ns), events


class _Clock:
    """The receiver's clock: GPS time of each row, and where its hardware clock was set anew."""

    def __init__(self, raw: Cells) -> None:
        time_ns, timed = raw.integers("TimeNanos")
        full_ns, biased = raw.integers("FullBiasNanos")
        self.known: Bool = timed & biased & (full_ns != 0)
        count, _ = raw.integers("HardwareClockDiscontinuityCount")
        fraction_ns = np.nan_to_num(raw.decimals("BiasNanos"))
        self.known &= np.abs(fraction_ns) < NS_PER_S
        bias_ns = full_ns + np.rint(np.where(self.known, fraction_ns, 0.0)).astype(np.int64)
        rows = np.flatnonzero(self.known)
        change = np.flatnonzero(np.diff(count[rows]) != 0) + 1
        starts = np.concatenate(([0], change)).astype(np.int64) if len(rows) else np.zeros(0, np.int64)
        stretch = np.zeros(raw.n, np.int64)
        stretch[rows[change]] = 1
        self.stretch: Int64 = np.cumsum(stretch)
        first = bias_ns[rows[starts]] if len(rows) else np.zeros(1, np.int64)
        t_ns = time_ns - first[self.stretch]
        self.known &= (t_ns > 0) & (t_ns < _LATEST_NS)
        self.t_ns: Int64 = np.where(self.known, t_ns, 0)
        self.events = [
            Event(
                int(self.t_ns[rows[k]]),
                "receiver_clock_discontinuity",
                f"hardware clock set anew (count {count[rows[k]]}): phases start again",
            )
            for k in change.tolist()
        ]


def _named(raw: Cells) -> tuple[list[str | None], list[Signal | None]]:
    """Return each row's satellite and signal."""
    constellation, _ = raw.integers("ConstellationType")
    svid, _ = raw.integers("Svid")
    carriers = raw.decimals("CarrierFrequencyHz")
    carriers = np.where(carriers > 0.0, carriers, np.nan)
    satellites: dict[tuple[int, int], str | None] = {}
    signals: dict[tuple[int, float | None, str], Signal | None] = {}
    names_of_rows, signals_of_rows = [], []
    rows = zip(constellation.tolist(), svid.tolist(), carriers.tolist(), raw.texts("CodeType"), strict=True)
    for system, number, carrier, code in rows:
        if (system, number) not in satellites:
            satellites[system, number] = satellite(system, number)
        key = (system, carrier if carrier == carrier else None, code)
        if key not in signals:
            signals[key] = signal(SYSTEMS[system], carrier, code) if system in SYSTEMS else None
        names_of_rows.append(satellites[system, number])
        signals_of_rows.append(signals[key])
    return names_of_rows, signals_of_rows


def _travel_times(raw: Cells, clock: _Clock, names: list[str]) -> tuple[Float64, Bool]:
    """Return the time from transmission to reception [ns] and where it is known."""
    sent_ns, readable = raw.integers("ReceivedSvTimeNanos")
    state, _ = raw.integers("State")
    system = np.array([name[:1] for name in names])
    period = np.full(raw.n, NS_PER_WEEK)
    shift = np.zeros(
        raw.n, np.int64
    )  # what is added to GPS time to get the time that the satellite counts in
    shift[system == "C"] = BDT_MINUS_GPST_S * NS_PER_S
    glonass = system == "R"
    period[glonass] = _DAY_NS
    if glonass.any() and clock.known.any():
        shift[glonass] = (MOSCOW_MINUS_UTC_S - _leap_seconds(raw, clock)) * NS_PER_S
    week_known = (state & (TOW_DECODED | TOW_KNOWN) != 0) & (state & (CODE_LOCK | GAL_E1BC_CODE_LOCK) != 0)
    day_known = (state & (GLO_TOD_DECODED | GLO_TOD_KNOWN) != 0) & (state & CODE_LOCK != 0)
    secondary = (system == "E") & ~week_known & (state & GAL_E1C_2ND_CODE_LOCK != 0)
    period[secondary] = SECONDARY_CODE_NS
    known = readable & (np.where(glonass, day_known, week_known) | secondary) & (state & MSEC_AMBIGUOUS == 0)
    travel = np.mod(clock.t_ns + shift - sent_ns, period)
    offset_ns = np.nan_to_num(raw.decimals("TimeOffsetNanos"))
    rate = np.nan_to_num(raw.decimals("PseudorangeRateMetersPerSecond"))
    # a measurement taken later than its epoch's tag is brought back to the tag with its rate
    return travel + offset_ns - rate / C_MPS * offset_ns, known


def _leap_seconds(raw: Cells, clock: _Clock) -> int:
    """Return GPS minus UTC as the log states it, else by the date."""
    stated, given = raw.integers("LeapSecond")
    seconds = stated[given & (stated > 0)]
    if len(seconds):
        return int(seconds[0])
    return leap_seconds(ns_to_datetime(int(clock.t_ns[clock.known][0])))


def _table(
    raw: Cells,
    clock: _Clock,
    kept: npt.NDArray[np.intp],
    chosen: list[tuple[str, Signal]],
    travel_ns: Float64,
) -> GnssTable:
    sv_names = tuple(sorted({name for name, _ in chosen}))
    codes = tuple(sorted({found.code for _, found in chosen}))
    carrier_hz = np.array([found.carrier_hz for _, found in chosen], dtype=np.float64)
    sv_index = {name: k for k, name in enumerate(sv_names)}
    code_index = {code: k for k, code in enumerate(codes)}
    cycles, lli = _carrier(raw, clock, kept, carrier_hz)
    with np.errstate(over="ignore"):
        doppler_hz = -raw.decimals("PseudorangeRateMetersPerSecond")[kept] * carrier_hz / C_MPS
    return GnssTable(
        clock.t_ns[kept],
        np.array([sv_index[name] for name, _ in chosen], dtype=np.int16),
        np.array([code_index[found.code] for _, found in chosen], dtype=np.int16),
        travel_ns[kept] * (C_MPS / NS_PER_S),
        np.where(np.isinf(doppler_hz), np.nan, doppler_hz),
        np.full(len(kept), np.nan),
        raw.decimals("Cn0DbHz")[kept],
        sv_names,
        codes,
        carrier_cycles=cycles,
        lli=lli,
        glonass_channels={name: found.channel for name, found in chosen if found.channel is not None},
    )


def _carrier(
    raw: Cells, clock: _Clock, kept: npt.NDArray[np.intp], carrier_hz: Float64
) -> tuple[Float64 | None, Int8 | None]:
    """Return carrier phases [cycles] and loss-of-lock indicators; None when the log has none."""
    state = raw.integers("AccumulatedDeltaRangeState")[0][kept]
    metres = raw.decimals("AccumulatedDeltaRangeMeters")[kept]
    valid = (state & ADR_VALID != 0) & ~np.isnan(metres)
    if not valid.any():
        return None, None
    half = (state & ADR_HALF_CYCLE_REPORTED != 0) & (state & ADR_HALF_CYCLE_RESOLVED == 0)
    epoch_after = np.isin(clock.t_ns[kept], [event.t_ns for event in clock.events if event.t_ns is not None])
    slipped = (state & (ADR_RESET | ADR_CYCLE_SLIP) != 0) | epoch_after
    lli = np.where(valid, slipped + 2 * half, 0).astype(np.int8)
    return np.where(valid, metres * carrier_hz / C_MPS, np.nan), lli
