"""An inertial log in windows of about a second, in which vibration averages out: the input of the checks of a log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.tables import Bool, Float64, ImuTable, Int64

WINDOW_S: Final = 1.0
MIN_SAMPLES: Final = 4  # of a window: a log at 2 Hz gets windows of two seconds
MIN_WINDOWS: Final = 4
QUIET_CHANGE: Final = 0.05  # share by which |f| changes from one quiet window to the next
STEADY_SHARE: Final = 0.8  # |mean f| / rms f: less means that f turns within the window, as in a spin
CONTIGUOUS: Final = 1.2  # a window may last so many times its nominal length


@dataclass(frozen=True)
class ImuWindows:
    """Means over m windows, body axes."""

    t_ns: Int64  # (m,) end of the first sample
    f_b: Float64  # (m, 3) [m/s^2]
    w_ib_b: Float64  # (m, 3) [rad/s]
    steady: Float64  # (m,) |mean f| / rms f
    pairs: Bool  # (m-1,) window k + 1 follows window k without a gap
    length_s: float

    def quiet(self) -> Bool:
        """Return (m,) which windows have a neighbour with nearly the same size of specific force, and do not spin."""
        size = np.linalg.norm(self.f_b, axis=1)
        change = np.abs(np.diff(size))
        steady = self.steady > STEADY_SHARE
        same = self.pairs & (change < QUIET_CHANGE * size[:-1]) & steady[:-1] & steady[1:]
        return np.concatenate((same, [False])) | np.concatenate(([False], same))

    def direction(self) -> Float64:
        """Return (m, 3) unit vectors along the mean specific force, zero in exact free fall."""
        size = np.linalg.norm(self.f_b, axis=1, keepdims=True)
        unit = np.zeros_like(self.f_b)
        np.divide(self.f_b, size, out=unit, where=size > 0.0)
        return unit

    def mid_rate(self) -> Float64:
        """Return (m-1, 3) mean angular rate from the middle of each window to that of the next [rad/s]."""
        return 0.5 * (self.w_ib_b[:-1] + self.w_ib_b[1:])

    def turns(self) -> tuple[Float64, Float64]:
        """Return how f's direction turned from window to window, seen and by the gyros, (m-1, 3) each [rad].

        Equation: u(k) x u(k+1) = -(w - u (u . w)) dt for a direction fixed in space, small angles; ``du/dt = -w x u``.
        """
        u = self.direction()
        w = self.mid_rate()
        along = np.sum(u[:-1] * w, axis=1, keepdims=True) * u[:-1]
        return np.cross(u[:-1], u[1:]), -(w - along) * self.length_s

    def same_side(self) -> Bool:
        """Return (m-1,) whether f's direction turned by less than 90 deg."""
        u = self.direction()
        return np.asarray(np.sum(u[:-1] * u[1:], axis=1) > 0.0)

    def span(self, which: Bool) -> float:
        """Return the largest angle between f's direction and its mean over the given windows [rad]."""
        u = self.direction()[which]
        if not len(u):
            return 0.0
        mean = u.mean(axis=0)
        size = float(np.linalg.norm(mean))
        if size == 0.0:
            return float(np.pi)
        return float(np.arccos(np.clip(u @ (mean / size), -1.0, 1.0).min()))


def imu_windows(imu: ImuTable, median_ns: float) -> ImuWindows | None:
    """Return a log's windows, None when it is shorter than four of them.

    Parameters
    ----------
    imu : the log
    median_ns : nominal step [ns]
    """
    each = max(MIN_SAMPLES, round(WINDOW_S * NS_PER_S / median_ns))
    count = len(imu.t_ns) // each
    if count < MIN_WINDOWS:
        return None
    used = count * each
    f = imu.f_b[:used].reshape(count, each * 3)
    w = imu.w_ib_b[:used].reshape(count, each * 3)
    # a matrix product is many times faster than ``mean`` over an axis
    mean = np.tile(np.eye(3) / each, (each, 1))
    mean_f = f @ mean
    rms = np.sqrt(np.einsum("mk,mk->m", f, f) / each)
    steady = np.divide(np.linalg.norm(mean_f, axis=1), rms, out=np.zeros(count), where=rms > 0.0)
    starts, ends = imu.t_ns[:used:each], imu.t_ns[each - 1 : used : each]
    limit = CONTIGUOUS * each * median_ns
    whole = ends - starts < limit
    pairs = whole[:-1] & whole[1:] & (np.diff(starts) < limit)
    return ImuWindows(starts, mean_f, w @ mean, steady, pairs, each * median_ns / NS_PER_S)
