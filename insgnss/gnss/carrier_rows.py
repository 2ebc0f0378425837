"""Carrier phases of a log, differenced from epoch to epoch, and which of the differences a cycle slip spoils.

A difference needs the same signal of the same satellite in two epochs that follow each other, tracked without a slip.
These tests are made here, for the whole log at once; the last, against the inertial prediction, is the filter's gate.

| test | finds | source |
|------|-------|--------|
| loss-of-lock indicator, bit 0 | what the receiver itself has noticed | RINEX 4.01, 6.5.2 |
| half-cycle flag, bit 1, differs between the epochs | a half cycle resolved or lost | RINEX 4.01, 6.5.2 |
| carrier against Doppler, less the epoch's median | slips of several cycles | trapezoid of the Dopplers |
| carrier against pseudorange, where there is no Doppler | a wrong unit, slips of 200 cycles | their difference |
| two carriers of one satellite | single cycles, but for pairs that cancel | geometry-free combination |
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.gnss.orbits.satellite_state import WIDEST_SPREAD_S
from insgnss.status import (
    BAD_VALUE,
    HALF_CYCLE,
    MESSAGE_CHANGED,
    NO_EPOCH_BEFORE,
    NO_RANGE,
    SLIP_DOPPLER,
    SLIP_GEOMETRY_FREE,
    SLIP_INDICATED,
    SWITCHED_OFF,
    USED,
)
from insgnss.tables import LLI_HALF_CYCLE, LLI_SLIP, Bool, Float64, GnssTable, Int8, Int64

ABSENT = -1  # the log has no value of this kind in the row: no entry in the ledger
CARRIER_DTYPE: Final = np.dtype(
    (
        np.record,
        np.dtype(
            [
                ("value", np.float64),  # carrier phase less that of the epoch before [m]
                ("status", np.int8),  # USED when the filter may try it, ABSENT, or why not
            ],
            align=True,
        ),
    )
)
Carriers = npt.NDArray[Any]

# Doppler's noise, as large at any rate: 1 m/s, over one second at most; and what the trapezoid of two Dopplers misses,
# jerk dt^3 / 12: 0.8 m at 10 m/s^3 and 1 s; a clock's is common to all
DOPPLER_LIMIT_MPS: Final = 1.0
_DOPPLER_LIMIT_MPS3: Final = 1.0
# where no Doppler is logged: a metre of noise, and what a street's echoes make of a code
_CODE_LIMIT_M: Final = 30.0
# What the ionosphere changes between two carriers of one satellite: 1 cm/s in a scintillating sky, beside 2 cm of noise
_GEOMETRY_FREE_LIMIT_M: Final = 0.05
_GEOMETRY_FREE_LIMIT_MPS: Final = 0.01
_FARTHEST_M: Final = 1.0e12  # a phase counts from anywhere, but beyond a double holds no millimetres
_FASTEST_MPS: Final = 3.0e5  # a difference beyond is none to a satellite, whatever the clock's drift


def no_carriers() -> tuple[Carriers, Float64]:
    """Return the empty result for a log without carrier: no rows, no states of the epoch before."""
    return np.zeros(0, CARRIER_DTYPE), np.zeros((0, 8))


def carrier_rows(
    gnss: GnssTable,
    usable: Int8,
    sat: Float64,
    message: Int64 | None,
    wavelength: Float64,
    range_rate: Float64,
    *,
    epoch_ns: Int64,
    first: Int64,
    max_interval_s: float,
    wanted: bool,
) -> tuple[Carriers, Float64]:
    """Return the carrier differences of a log (n,) and the satellite states (n, 8) of their epochs before.

    Parameters
    ----------
    gnss : the log
    usable : (n,) USED, or why the row is not used at all
    sat : (n, 8) satellite states at transmission
    message : (n,) number of the broadcast message behind each state; None when not known
    wavelength : (n,) of each row's carrier [m]
    range_rate : (n,) [m/s], NaN where not logged
    epoch_ns, first : the epochs, as ``GnssRows`` has them
    max_interval_s : epochs farther apart are not differenced
    wanted : whether the filter uses carriers at all
    """
    carriers = np.zeros(len(gnss.t_ns), CARRIER_DTYPE)
    phase = _phase_m(gnss, wavelength)
    epoch = np.repeat(np.arange(len(epoch_ns)), np.diff(first))
    interval = np.concatenate([[np.inf], np.diff(epoch_ns) / NS_PER_S])
    status = np.where(usable == USED, np.int8(USED if wanted else SWITCHED_OFF), usable)
    _mark(status, ~np.isfinite(wavelength) | (np.abs(phase) > _FARTHEST_M), BAD_VALUE)
    if gnss.sat is None:
        _mark(status, ~_timed(gnss, epoch, len(epoch_ns)), NO_RANGE)
    elif message is not None:  # of rows without a state of their own
        _mark(status, (message >= 0) & ~_timed(gnss, epoch, len(epoch_ns)), NO_RANGE)
    before = _row_before(gnss, epoch, np.isfinite(phase) & (status == USED))
    paired = (before >= 0) & (interval[epoch] <= max_interval_s)
    status[(status == USED) & ~paired] = NO_EPOCH_BEFORE
    paired &= status == USED
    now, then = np.flatnonzero(paired), before[paired]
    value = np.full(len(phase), np.nan)
    value[now] = phase[now] - phase[then]
    dt = interval[epoch[now]]
    marks = _indicated(gnss, now, then)
    if message is not None:
        _mark(marks, message[now] != message[then], MESSAGE_CHANGED)
    rate = 0.5 * (range_rate[now] + range_rate[then])
    limit = DOPPLER_LIMIT_MPS * np.minimum(dt, 1.0) + _DOPPLER_LIMIT_MPS3 * dt**3
    _mark(marks, np.abs(value[now]) > _FASTEST_MPS * dt, BAD_VALUE)
    _mark(marks, _apart(value[now] - rate * dt, limit, epoch[now], len(epoch_ns)), SLIP_DOPPLER)
    way = np.where(np.isfinite(rate), np.nan, gnss.pseudorange_m[now] - gnss.pseudorange_m[then])
    _mark(marks, _apart(value[now] - way, _CODE_LIMIT_M, epoch[now], len(epoch_ns)), SLIP_DOPPLER)
    differ = _against_other_carrier(gnss, value[now], dt, epoch[now], now, wavelength)
    _mark(marks, differ, SLIP_GEOMETRY_FREE)
    status[now] = marks
    status[np.isnan(phase)] = ABSENT
    states = np.full((len(phase), 8), np.nan)
    states[now] = sat[then, :8]
    carriers["value"], carriers["status"] = value, status
    return carriers, states


def _phase_m(gnss: GnssTable, wavelength: Float64) -> Float64:
    """Return the carrier phase [m] of each row, NaN where there is none; a phase of exactly zero is none in RINEX."""
    if gnss.carrier_cycles is None:
        return np.full(len(gnss.t_ns), np.nan)
    cycles = np.where(gnss.carrier_cycles == 0.0, np.nan, gnss.carrier_cycles)
    known = np.where(np.isfinite(wavelength), wavelength, 1.0)  # an unknown one is refused by name, not lost
    return np.asarray(cycles * known, dtype=np.float64)


def _timed(gnss: GnssTable, epoch: Int64, n_epochs: int) -> Bool:
    """Return where the row's own pseudorange gave the time of transmission: a median's is 10 ms, 8 m off."""
    known = np.isfinite(gnss.pseudorange_m)
    middle = _epoch_median(gnss.pseudorange_m[known], epoch[known], n_epochs)
    apart = np.abs(np.where(known, gnss.pseudorange_m, np.nan) - middle[epoch])
    return np.asarray(apart <= WIDEST_SPREAD_S * C_MPS)


def _row_before(gnss: GnssTable, epoch: Int64, present: Bool) -> Int64:
    """Return for each row the row of the same signal in the epoch just before, -1 where it has none."""
    before = np.full(len(epoch), -1, np.int64)
    rows = np.flatnonzero(present)
    key = gnss.sv[rows].astype(np.int64) * (len(gnss.signal_names) + 1) + gnss.signal[rows]
    order = rows[np.lexsort((epoch[rows], key))]
    key = gnss.sv[order].astype(np.int64) * (len(gnss.signal_names) + 1) + gnss.signal[order]
    follows = (np.diff(key) == 0) & (np.diff(epoch[order]) == 1)
    before[order[1:][follows]] = order[:-1][follows]
    return before


def _mark(marks: Int8, where: Bool, status: int) -> None:
    """Write a status where a test fails and none before it has."""
    marks[(marks == USED) & where] = status


def _indicated(gnss: GnssTable, now: Int64, then: Int64) -> Int8:
    """Return the receiver's own flags for each pair."""
    marks = np.zeros(len(now), np.int8)
    if gnss.lli is not None:
        _mark(marks, (gnss.lli[now] & LLI_SLIP) != 0, SLIP_INDICATED)
        _mark(marks, ((gnss.lli[now] ^ gnss.lli[then]) & LLI_HALF_CYCLE) != 0, HALF_CYCLE)
    return marks


def _apart(excess: Float64, limit_m: Float64 | float, epoch: Int64, n_epochs: int) -> Bool:
    """Return where an excess, known or NaN, is far from the median of its epoch (the receiver's clock)."""
    known = np.isfinite(excess)
    middle = _epoch_median(excess[known], epoch[known], n_epochs)
    return np.asarray(known & (np.abs(excess - middle[epoch]) > limit_m))


def _epoch_median(value: Float64, epoch: Int64, n_epochs: int) -> Float64:
    """Return the median of the values of each epoch, zero for an epoch without any."""
    middle = np.zeros(n_epochs)
    if len(value):
        order = np.lexsort((value, epoch))
        sorted_epoch, sorted_value = epoch[order], value[order]
        starts = np.flatnonzero(np.concatenate([[True], np.diff(sorted_epoch) != 0]))
        count = np.diff(np.append(starts, len(order)))
        middle[sorted_epoch[starts]] = 0.5 * (
            sorted_value[starts + (count - 1) // 2] + sorted_value[starts + count // 2]
        )
    return middle


def _against_other_carrier(
    gnss: GnssTable, value: Float64, dt: Float64, epoch: Int64, rows: Int64, wavelength: Float64
) -> Bool:
    """Return where the differences of a satellite's carriers are farther apart than an ionosphere can bring them."""
    spoilt = np.zeros(len(rows), np.bool_)
    order = np.lexsort((wavelength[rows], gnss.sv[rows], epoch))
    a, b = order[:-1], order[1:]
    same = (gnss.sv[rows[a]] == gnss.sv[rows[b]]) & (epoch[a] == epoch[b])
    apart = np.abs(value[a] - value[b]) > _GEOMETRY_FREE_LIMIT_M + _GEOMETRY_FREE_LIMIT_MPS * dt[a]
    spoilt[a[same & apart]] = True
    spoilt[b[same & apart]] = True
    return spoilt
