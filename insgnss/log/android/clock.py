"""The GPS time of Android's raw measurements: TimeNanos - (FullBiasNanos + BiasNanos), with one bias for each stretch.

One bias holds as long as the hardware clock runs without a discontinuity, so that pseudorange, its rate and the carrier
phase see one clock; the filter estimates what it drifts. Before a phone has solved for GPS time its bias wanders by
seconds, and BiasUncertaintyNanos says so: the first bias that is certain dates the whole stretch, what came before it
included. A stretch without one takes its least uncertain bias, and ``corrected_by_satellites`` mends it.

[Android developer reference, GnssClock]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_MS, NS_PER_S
from insgnss.gpstime import nearest
from insgnss.log.android.lines import AndroidCells
from insgnss.tables import Bool, Event, Float64, Int64

CERTAIN_NS: Final = 1e6  # a bias known to a millisecond: satellites move 4 m in it
# The range of GPS times that a phone can mean: raw measurements began with Android 7 in 2016; 2106 is a damaged cell
_EARLIEST_NS: Final = 11 * 10**17
_LATEST_NS: Final = 4 * 10**18
_JUMP_NS: Final = 10_000_000  # between certain biases: the clock was set although the count stayed
# Signals of satellites in view take 64 to 140 ms; a median outside of it, geostationary satellites alone or not, is the
# clock's error, and the usual median its best estimate
_SHORTEST_NS, _LONGEST_NS, _USUAL_NS = 5e7, 1.5e8, 7.8e7
_LARGEST_ERROR_NS: Final = 3e9  # of a bias before the phone knows the time


@dataclass(frozen=True)
class ReceiverClock:
    """GPS time of each row, where it is known, and which rows share a bias."""

    t_ns: Int64  # (n,) zero where not known
    known: Bool  # (n,)
    stretch: Int64  # (n,) number of the stretch without a discontinuity
    events: list[Event]


def receiver_clock(raw: AndroidCells) -> ReceiverClock:
    """Return the GPS time of the "Raw" lines."""
    time_ns, timed = raw.integers("TimeNanos")
    full_ns, biased, cut = raw.rounded("FullBiasNanos")
    fraction_ns = np.nan_to_num(raw.decimals("BiasNanos"))
    biased &= timed & (full_ns != 0) & (np.abs(fraction_ns) < NS_PER_S)
    bias_ns = full_ns + np.rint(np.where(biased, fraction_ns, 0.0)).astype(np.int64)
    biased &= (time_ns - bias_ns > _EARLIEST_NS) & (time_ns - bias_ns < _LATEST_NS)
    uncertainty_ns = raw.decimals("BiasUncertaintyNanos")
    certain = biased & ~(uncertainty_ns > CERTAIN_NS)  # older files leave it empty
    count, _ = raw.integers("HardwareClockDiscontinuityCount")
    stretch = _stretches(count, timed, bias_ns, certain)
    first = _bias_rows(stretch, biased, certain, uncertainty_ns)
    known = timed & (first[stretch] >= 0)
    t_ns = time_ns - bias_ns[np.maximum(first[stretch], 0)]
    known &= (t_ns > _EARLIEST_NS) & (t_ns < _LATEST_NS)
    t_ns = np.where(known, t_ns, 0)
    events = _discontinuities(stretch, known, t_ns, count)
    if (cut & known).any():
        detail = (
            f"{int((cut & known).sum())} measurement(s) whose FullBiasNanos has lost its last digits: the receiver"
            " clock may be off by 5 microseconds, and jump by as much where the phone sets its clock"
        )
        events.append(Event(None, "android_bias_cut", detail))
    return ReceiverClock(t_ns, known, stretch, events)


def _stretches(count: Int64, timed: Bool, bias_ns: Int64, certain: Bool) -> Int64:
    """Return the number of each row's stretch: a new one with the count, or where a certain bias jumps."""
    begins = np.zeros(len(count), np.int64)
    rows = np.flatnonzero(timed)
    begins[rows[1:]] = np.diff(count[rows]) != 0
    rows = np.flatnonzero(certain)
    jumps = np.abs(np.diff(bias_ns[rows])) > _JUMP_NS
    begins[rows[1:][jumps]] = 1
    return np.asarray(np.cumsum(begins), np.int64)


def _bias_rows(stretch: Int64, biased: Bool, certain: Bool, uncertainty_ns: Float64) -> Int64:
    """Return the row whose bias each stretch takes, -1 where none has one."""
    chosen = np.full(int(stretch.max(initial=0)) + 1, -1, np.int64)
    # the last assignment stands: certain rows after uncertain ones, and of each kind the best one last
    uncertain = np.flatnonzero(biased & ~certain)
    uncertain = uncertain[np.argsort(-uncertainty_ns[uncertain], kind="stable")]
    for rows in (uncertain, np.flatnonzero(certain)[::-1]):
        chosen[stretch[rows]] = rows
    return chosen


def _discontinuities(stretch: Int64, known: Bool, t_ns: Int64, count: Int64) -> list[Event]:
    """Return an event for each stretch but the first, at its first row with a time."""
    rows = np.flatnonzero(known)
    starts = rows[1:][np.diff(stretch[rows]) != 0]
    return [
        Event(
            int(t_ns[k]),
            "receiver_clock_discontinuity",
            f"hardware clock reset (count {count[k]}): phases start again",
        )
        for k in starts.tolist()
    ]


def corrected_by_satellites(
    clock: ReceiverClock, travel_ns: Float64, is_known: Bool
) -> tuple[ReceiverClock, Int64]:
    """Return the clock with the tags of stretches moved whose signals would take an impossible time.

    Parameters
    ----------
    clock : as logged by the phone
    travel_ns : (n,) from transmission to reception with that clock, negative where it is early
    is_known : (n,) rows whose time of transmission is known by the day or the week

    Returns
    -------
    The clock, and by how much each row was moved [ns].
    """
    shift = np.zeros(len(travel_ns), np.int64)
    events = list(clock.events)
    for number in np.unique(clock.stretch[is_known]).tolist():
        inside = clock.stretch == number
        median = float(np.median(travel_ns[inside & is_known]))
        mended = travel_ns[inside & is_known] - median + _USUAL_NS
        agree = float(np.mean((mended > _SHORTEST_NS) & (mended < _LONGEST_NS)))
        if _SHORTEST_NS < median < _LONGEST_NS or abs(median) > _LARGEST_ERROR_NS or agree < 0.5:
            continue
        shift[inside & clock.known] = round(_USUAL_NS - median)
        first = int(np.flatnonzero(inside & clock.known)[0])
        detail = (
            f"the phone did not know GPS time well: tags moved by {shift[first] / NS_PER_S:+.3f} s,"
            " so that signals take their usual 78 ms"
        )
        events.append(Event(int(clock.t_ns[first] + shift[first]), "receiver_time_mended", detail))
    return replace(clock, t_ns=clock.t_ns + shift, events=events), shift


_COMPLETED_WITHIN_NS: Final = 60 * NS_PER_S  # 1.1 km/s, of satellite, phone and clock, in it: 66 of 150 km


def whole_milliseconds(
    clock: ReceiverClock,
    satellites: npt.NDArray[np.str_],
    elapsed_ns: Int64,
    travel_ns: Float64,
    known: Bool,
    ambiguous: Bool,
) -> tuple[Float64, Bool]:
    """Return the travel times with those of ``ambiguous`` rows completed, and which were.

    Parameters
    ----------
    clock : of the receiver; a row takes another of the same stretch alone
    satellites : (n,) names
    elapsed_ns : (n,) reception minus stated transmission, right up to whole milliseconds
    travel_ns, known : (n,) travel times, and where they are sound
    ambiguous : (n,) rows to complete
    """
    travel_ns, completed = travel_ns.copy(), np.zeros(len(known), np.bool_)
    for name in np.unique(satellites[ambiguous]):
        of_satellite = satellites == name
        for stretch in np.unique(clock.stretch[of_satellite & ambiguous]):
            inside = of_satellite & (clock.stretch == stretch)
            others, rows = np.flatnonzero(inside & known), np.flatnonzero(inside & ambiguous)
            if not len(others):
                continue
            others = others[np.argsort(clock.t_ns[others], kind="stable")]
            other = others[nearest(clock.t_ns[others], clock.t_ns[rows])]
            near = np.abs(clock.t_ns[rows] - clock.t_ns[other]) <= _COMPLETED_WITHIN_NS
            rows, guess_ns = rows[near], np.rint(travel_ns[other[near]]).astype(np.int64)
            half = NS_PER_MS // 2
            travel_ns[rows] = guess_ns + np.mod(elapsed_ns[rows] - guess_ns + half, NS_PER_MS) - half
            completed[rows] = True
    return travel_ns, completed
