"""The loop's trace, on request: the leader's state at inertial samples and, less often, its covariance.

A row is its sample's state before the update of an epoch of the same time: the filter's prediction for it, as a
receiver has it at that instant. Its covariance is the one of a navigation row, carried to the row's time.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.output.gps_time import place_at_gps_time
from insgnss.filter.parameters import Parameters
from insgnss.filter.sensor_errors import whole_errors
from insgnss.filter.state import OFFSETS, HeadRecord, StateRecord
from insgnss.kernels.jit import kernel
from insgnss.tables import Bool, Float64, Int64

TRACE_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("t_ns", np.int64),
            ("r_e", np.float64, (3,)),  # as in ``state.STATE_DTYPE``
            ("v_e", np.float64, (3,)),
            ("C_eb", np.float64, (3, 3)),
            ("b_a", np.float64, (3,)),
            ("b_g", np.float64, (3,)),
            ("clock", np.float64, (2,)),
        ],
    )
)
TRACE_COUNT_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("next", np.int64),  # the first of the times not passed yet
            ("rows", np.int64),  # written: times before the start are left out
            ("covariances", np.int64),
            ("newest_ns", np.int64),  # time of the newest covariance; 0 before the first
        ],
    )
)
_OTHER_REASONS: Final = 16  # covariances for starts after gaps, beside those of ticks and epochs


class TraceRoom(NamedTuple):
    """Where the trace is written, and for which times; no times: nothing is written."""

    times_ns: Int64  # (k,) increasing, each the time of an inertial sample
    is_epoch: Bool  # (k,) times that bring their covariance whatever the tick
    interval_ns: int  # GPS time is cut into such ticks: the first row in each brings its covariance
    row: npt.NDArray[Any]  # (k,) of TRACE_DTYPE, filled from the front
    offset: Float64  # (k, n_offsets) inter-system clock offsets [m], beside ``row``
    covariance_ns: Int64  # (m,) filled from the front
    P: Float64  # (m, q, q) of the 17 states and the clock offsets
    counts: npt.NDArray[Any]  # (1,) of TRACE_COUNT_DTYPE


def new_trace_room(
    times_ns: Int64,
    sigma_interval_s: float,
    n_epochs: int,
    n_offsets: int,
    epoch_samples_ns: Int64 | None = None,
) -> TraceRoom:
    """Return room for a trace at inertial samples.

    Parameters
    ----------
    times_ns : (k,) times of samples, increasing; empty for no trace
    sigma_interval_s : length of a tick [s]; an epoch brings a covariance too where epochs are at least as far apart
    n_epochs : of the log
    n_offsets : inter-system clock offsets of the filter
    epoch_samples_ns : those of the times that each bring a covariance, such as the last ones before the epochs
    """
    interval_ns = max(round(sigma_interval_s * NS_PER_S), 1)
    ticks = len(np.unique(times_ns // interval_ns))
    is_epoch = np.isin(times_ns, np.zeros(0, np.int64) if epoch_samples_ns is None else epoch_samples_ns)
    m = min(len(times_ns), ticks + n_epochs + _OTHER_REASONS + int(np.count_nonzero(is_epoch)))
    q = OFFSETS + n_offsets
    return TraceRoom(
        times_ns=times_ns,
        is_epoch=is_epoch,
        interval_ns=interval_ns,
        row=np.zeros(len(times_ns), TRACE_DTYPE),
        offset=np.zeros((len(times_ns), n_offsets)),
        covariance_ns=np.zeros(m, np.int64),
        P=np.zeros((m, q, q)),
        counts=np.zeros(1, TRACE_COUNT_DTYPE),
    )


@cache
def no_trace(n_offsets: int = 0) -> TraceRoom:
    """Return room for nothing, which all share."""
    return new_trace_room(np.zeros(0, np.int64), 1.0, 0, n_offsets)


def output_samples(t_ns: Int64, rate_hz: float) -> Int64:
    """Return the samples (their indices) at which aiding of a rate is put out: the first in each period.

    Where the samples come more slowly than the rate every one is an output.
    """
    if len(t_ns) == 0:
        return np.zeros(0, np.int64)
    period = output_period(t_ns - t_ns[0], rate_hz)
    return np.flatnonzero(np.diff(period, prepend=-1) > 0).astype(np.int64)


def output_period(since_ns: npt.ArrayLike, rate_hz: float) -> Int64:
    """Return the period that each sample falls in, counted from a log's first sample ``since_ns`` ago."""
    # a microsecond of slack: a time tag that was rounded still falls in its own period
    return np.floor((np.asarray(since_ns) / 1e9 + 1e-6) * rate_hz).astype(np.int64)


@kernel(inline=True)
def write_state(room: TraceRoom, t_ns: int, m: StateRecord, par: Parameters) -> None:
    """Write a row of the trace; its biases are the whole errors of the sensors as they are then."""
    count = room.counts[0]
    i = count.rows
    row = room.row[i]
    row.t_ns = t_ns
    place_at_gps_time(m, par, row.r_e, row.v_e, np.empty(4), row.C_eb)
    whole_errors(m, par, row.b_a, row.b_g)
    row.clock[0], row.clock[1] = m.clock[0], m.clock[1]
    for a in range(room.offset.shape[1]):
        room.offset[i, a] = m.optional[a]
    count.rows = i + 1


@kernel(inline=True)
def covariance_due(head: HeadRecord, newest_ns: int, t_ns: int, interval_ns: int) -> bool:
    """Return whether a row at ``t_ns`` needs a covariance of its own.

    It does in a new tick, after the state was reset, and after an epoch where epochs are a tick or more apart: an
    update of a slow receiver changes the covariance much, one of many within a tick changes it little.
    """
    if t_ns // interval_ns != newest_ns // interval_ns or head.renewed_ns >= newest_ns:
        return True
    updated: bool = head.epoch_ns >= newest_ns and head.epoch_step_ns >= interval_ns
    return updated


@kernel(inline=True)
def write_covariance(room: TraceRoom, t_ns: int, P: Float64) -> None:
    """Write the part of a covariance that the trace keeps."""
    count = room.counts[0]
    i = count.covariances
    if i < room.P.shape[0]:
        for a in range(room.P.shape[1]):
            for b in range(room.P.shape[2]):
                room.P[i, a, b] = P[a, b]
        room.covariance_ns[i] = t_ns
        count.covariances = i + 1
        count.newest_ns = t_ns
