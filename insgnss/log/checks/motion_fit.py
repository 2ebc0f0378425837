"""How well inertial samples, turned and integrated under a hypothesis of their axes, explain the GNSS velocities.

A hypothesis says how the gyros' columns go with the accelerometers': H, one of 48 signed permutations, their scale, and
whether the accelerometers' axes are right-handed. With dC/dt = C [H w x] the velocity gained is U(t), the integral of
C f dt in the axes at the stretch's start, and over each second

    ds_e = c Q dU,   Q orthogonal, det Q = +1 or -1, c near 1.

Q follows in closed form from the singular values of sum ds dU^T [Umeyama 1991]; what is left is the cost.
"""

from __future__ import annotations

from itertools import permutations, product
from typing import Final, NamedTuple

import numpy as np

from insgnss.geodesy.vectors import cross_product
from insgnss.log.checks.stretches import STEP_S, GnssStretch, InertialGrid, lag_of
from insgnss.tables import Float64

# Differences over a second overlap, and their errors are correlated: so many of each second count as one
CORRELATED: Final = 2.0
# error of a velocity difference by vibration, lever arm and coarse integration, besides noise [m/s]
MODEL_SIGMA_MPS: Final = 0.05


class Path(NamedTuple):
    """Attitudes and gained velocity at the grid's nodes, in the axes of the first node; h hypotheses, s stretches."""

    q: Float64  # (h, s, n, 4) scalar first, first axes from sensor axes
    gained: Float64  # (h, s, n, 3) [m/s]


class PathReading(NamedTuple):
    """A path under one hypothesis, its tags shifted."""

    path: Path
    start_s: Float64  # (s,) first node of each stretch
    h: int
    handed: int  # det Q
    shift_s: float  # added to the inertial tags

    def at(self, i: int, t_s: Float64) -> tuple[Float64, Float64]:
        """Return gained velocities (k, 3) and unit quaternions (k, 4) of a stretch at the epochs' times."""
        start_s, t_s = float(self.start_s[i]), t_s - self.shift_s
        gained, q = (
            at_times(values[self.h : self.h + 1, i], start_s, t_s)[0]
            for values in (self.path.gained, self.path.q)
        )
        return gained, q / np.linalg.norm(q, axis=1, keepdims=True)


def signed_permutations() -> Float64:
    """Return all 48 matrices that exchange axes and change signs, (48, 3, 3), the unit matrix first."""
    matrices = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            matrices.append(matrix)
    return np.array(matrices)


def integrate(grid: InertialGrid, gyro_maps: Float64) -> Path:
    """Return the paths of a grid with the gyros' columns mapped by each of ``gyro_maps`` (h, 3, 3), scale included."""
    theta = np.einsum("hij,snj->hsni", gyro_maps, grid.theta)
    size = np.linalg.norm(theta, axis=-1, keepdims=True)
    # sin(x / 2) / x, which is 1/2 - x^2 / 48 near zero
    sine = np.where(size > 1e-6, np.sin(0.5 * size) / np.where(size > 1e-6, size, 1.0), 0.5)
    step = np.concatenate((np.cos(0.5 * size), sine * theta), axis=-1)
    q = _running_product(step)
    middle = q[:, :, :-1] + q[:, :, 1:]
    middle /= np.linalg.norm(middle, axis=-1, keepdims=True)
    gained = np.zeros((*q.shape[:3], 3))
    np.cumsum(rotate(middle, grid.dv), axis=2, out=gained[:, :, 1:])
    return Path(q, gained)


def _running_product(step: Float64) -> Float64:
    """Return (h, s, n + 1, 4) products of the first 0, 1, ... n of (h, s, n, 4) quaternions.

    Blocks side by side first, then one block after the other: few long operations in place of many short ones.
    """
    n = step.shape[2]
    size = int(np.ceil(np.sqrt(n)))
    padded = np.zeros((*step.shape[:2], size * size, 4))
    padded[..., 0] = 1.0
    padded[:, :, :n] = step
    blocks = padded.reshape(*step.shape[:2], size, size, 4)
    for k in range(1, size):
        blocks[:, :, :, k] = _times(blocks[:, :, :, k - 1], blocks[:, :, :, k])
    before = np.zeros((*step.shape[:2], size, 1, 4))
    before[:, :, 0, 0, 0] = 1.0
    for k in range(1, size):
        before[:, :, k, 0] = _times(before[:, :, k - 1, 0], blocks[:, :, k - 1, -1])
    q = np.zeros((*step.shape[:2], n + 1, 4))
    q[:, :, 0, 0] = 1.0
    q[:, :, 1:] = _times(before, blocks).reshape(*step.shape[:2], -1, 4)[:, :, :n]
    return q


def _times(p: Float64, q: Float64) -> Float64:
    """Return Hamilton's product, scalar first."""
    a, b, c, d = (p[..., k] for k in range(4))
    e, f, g, h = (q[..., k] for k in range(4))
    product = np.empty(np.broadcast_shapes(p.shape, q.shape))
    product[..., 0] = a * e - b * f - c * g - d * h
    product[..., 1] = a * f + b * e + c * h - d * g
    product[..., 2] = a * g - b * h + c * e + d * f
    product[..., 3] = a * h + b * g - c * f + d * e
    return product


def rotate(q: Float64, v: Float64) -> Float64:
    """Return vectors turned by quaternions: v + 2 q0 (qv x v) + 2 qv x (qv x v)."""
    cross = 2.0 * cross_product(q[..., 1:], v)
    return np.asarray(v + q[..., :1] * cross + cross_product(q[..., 1:], cross))


def at_times(values: Float64, start_s: float, t_s: Float64) -> Float64:
    """Return (h, k, c) values of one stretch's nodes (h, n, c) at times, linear between the nodes."""
    place = (t_s - start_s) / STEP_S
    node = np.clip(place.astype(np.int64), 0, values.shape[1] - 2)
    part = (place - node)[:, None]
    return np.asarray(values[:, node] * (1.0 - part) + values[:, node + 1] * part)


class Fit(NamedTuple):
    """Costs of hypotheses at shifts of the inertial time tags."""

    cost: Float64  # (h, 2, d) -2 log likelihood; axis 1: Q right-handed, left-handed
    rms: Float64  # (h, 2, d) of the residual of each velocity difference component [m/s]


def fit_costs(chosen: list[GnssStretch], grid: InertialGrid, path: Path, shifts_s: Float64) -> Fit:
    """Return the cost of each hypothesis on the stretches, the inertial tags shifted by each of ``shifts_s``.

    cost = sum over stretches of 3 k log(J / 3 k) / (CORRELATED lag) with J the squares that are left: each stretch has
    its own noise, so a gap or a fault does not raise its weight.
    """
    cost = np.zeros((len(path.q), 2, len(shifts_s)))
    left, rows = np.zeros_like(cost), np.zeros(len(shifts_s))
    held = np.zeros(len(shifts_s))
    for i, stretch in enumerate(chosen):
        lag = lag_of(stretch.t_s)
        ds = stretch.s_e[lag:] - stretch.s_e[:-lag]
        floor = 2.0 * stretch.sd_mps**2 + MODEL_SIGMA_MPS**2
        own = np.full_like(cost, np.nan)
        for j, shift in enumerate(shifts_s):
            if stretch.t_s[0] - shift < grid.from_s or stretch.t_s[-1] - shift > grid.until_s:
                continue
            gained = at_times(path.gained[:, i], grid.start_s[i], stretch.t_s - shift)
            J = _left(ds, gained[:, lag:] - gained[:, :-lag])
            own[:, :, j] = ds.size * np.log(J / ds.size + floor)
            left[:, :, j] += J
            rows[j] += ds.size
            held[j] += 1
        if np.isfinite(own).any():  # where the inertial log does not reach, a stretch says nothing
            cost += np.where(np.isnan(own), np.nanmedian(own), own)
    cost[:, :, held < 0.5 * held.max(initial=1.0)] = np.inf
    return Fit(cost / (CORRELATED * lag_of(chosen[0].t_s)), np.sqrt(left / np.maximum(rows, 1.0)))


def _left(ds: Float64, du: Float64) -> Float64:
    """Return (h, 2) squares left by the best right- and left-handed Q and scale."""
    M = np.einsum("ki,hkj->hij", ds, du)
    U, S, Vt = np.linalg.svd(M)
    side = np.sign(np.linalg.det(U @ Vt))
    trace = np.stack((S[:, 0] + S[:, 1] + side * S[:, 2], S[:, 0] + S[:, 1] - side * S[:, 2]), axis=1)
    size = np.sum(du**2, axis=(1, 2))[:, None]
    return np.asarray(np.maximum(np.sum(ds**2) - trace**2 / np.maximum(size, 1e-12), 0.0))


def best_rotation(ds: Float64, du: Float64, handed: int) -> Float64:
    """Return Q (3, 3), det Q = ``handed``, that turns ``du`` (k, 3) nearest to ``ds`` (k, 3)."""
    return nearest_rotation(ds.T @ du, handed)


def nearest_rotation(M: Float64, handed: int) -> Float64:
    """Return the orthogonal Q (3, 3), det Q = ``handed``, with the largest trace of Q^T M."""
    U, _, Vt = np.linalg.svd(M)
    side = handed * np.sign(np.linalg.det(U @ Vt))
    return np.asarray(U @ np.diag([1.0, 1.0, side]) @ Vt)
