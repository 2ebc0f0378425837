"""What the filter leaves behind for the aiding: its state at the output times and, less often, its covariance.

The aiding is computed from this after the loop (or sample by sample, live): the filter itself runs the same to the last
bit whether it is asked for or not.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

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
    P: Float64  # (m, q, q), the 17 states of ``fusion.state`` first


class Samples(NamedTuple):
    """The inertial samples behind a trace, as logged."""

    t_ns: Int64  # (k,)
    w_ib_b: Float64  # (k, 3) [rad/s]
    f_b: Float64  # (k, 3) [m/s^2]


def output_samples(t_ns: Int64, rate_hz: float) -> Int64:
    """Return the samples (their indices) at which aiding of a rate is put out: the first in each period.

    Where the samples come more slowly than the rate every one is an output.
    """
    if len(t_ns) == 0:
        return np.zeros(0, np.int64)
    # a microsecond of slack: a time tag that was rounded still falls in its own period
    period = np.floor(((t_ns - t_ns[0]) / 1e9 + 1e-6) * rate_hz).astype(np.int64)
    return np.flatnonzero(np.diff(period, prepend=-1) > 0).astype(np.int64)


def trace_rows(trace: Trace, rows: slice) -> Trace:
    """Return part of a trace, in one kind of array whatever it was cut from."""
    cut: list[npt.NDArray[Any]] = [np.ascontiguousarray(column[rows]) for column in trace]
    return Trace(*cut)
