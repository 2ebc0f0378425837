"""The filter's trace for the aiding: its state at the output times and, less often, its covariance.

The aiding is computed from this after the loop (or sample by sample, live): the filter itself runs the same to the last
bit whether it is asked for or not. A row at the time of an epoch is from before its update.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.filter.output.trace_rows import TraceRoom
from insgnss.tables import Float64, Int64


class Trace(NamedTuple):
    """The leader's state at the output times, each the time of an inertial sample."""

    t_ns: Int64  # (n,) strictly increasing
    sample: Int64  # (n,) index of the inertial sample that ends at ``t_ns``
    r_e: Float64  # (n, 3) position of the IMU, ECEF [m]
    v_e: Float64  # (n, 3) [m/s]
    C_eb: Float64  # (n, 3, 3)
    b_a: Float64  # (n, 3) accelerometer bias [m/s^2]
    b_g: Float64  # (n, 3) gyro bias [rad/s]
    clock: Float64  # (n, 2) receiver clock bias [m] and drift [m/s]
    offset: Float64  # (n, k) clock offsets of the further groups [m]


class Covariances(NamedTuple):
    """The filter's covariance at some times; a trace row reads the newest that is not later than itself."""

    t_ns: Int64  # (m,) increasing
    P: Float64  # (m, q, q), the 17 states of ``filter.state`` first


class TraceSamples(NamedTuple):
    """The inertial samples behind a trace, as logged."""

    t_ns: Int64  # (k,)
    w_ib_b: Float64  # (k, 3) [rad/s]
    f_b: Float64  # (k, 3) [m/s^2]


class FilterTrace(NamedTuple):
    """The complete trace of a filter's run."""

    trace: Trace
    covariances: Covariances
    samples: TraceSamples


def traced(room: TraceRoom, samples: TraceSamples) -> FilterTrace:
    """Return the loop's rows, joined to the inertial samples that it ran on."""
    count = room.counts[0]
    row, m = room.row[: count.rows], int(count.covariances)
    columns = {name: np.ascontiguousarray(row[name]) for name in row.dtype.names or ()}
    trace = Trace(
        sample=np.searchsorted(samples.t_ns, columns["t_ns"]).astype(np.int64),
        offset=room.offset[: len(row)],
        **columns,
    )
    return FilterTrace(trace, Covariances(room.covariance_ns[:m], room.P[:m]), samples)


def at_times(found: FilterTrace, t_ns: Int64) -> FilterTrace:
    """Return the rows of a trace at some of its times, with all covariances."""
    return found._replace(trace=trace_rows(found.trace, np.flatnonzero(np.isin(found.trace.t_ns, t_ns))))


def trace_rows(trace: Trace, rows: slice | Int64) -> Trace:
    """Return part of a trace, in one kind of array whatever it was cut from."""
    cut: list[npt.NDArray[Any]] = [np.ascontiguousarray(column[rows]) for column in trace]
    return Trace(*cut)


def joined(*traces: Trace) -> Trace:
    """Return traces one after another, in arrays of their own."""
    columns: list[npt.NDArray[Any]] = [np.concatenate(column) for column in zip(*traces, strict=True)]
    return Trace(*columns)
