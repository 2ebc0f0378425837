"""Time offset, lever arm and sensor biases by least squares over the stretches, once the axes are known.

Per stretch, with Q C the attitude and U the gained velocity of ``motion_fit``, the velocity freed from gravity is

    s = s_0 + Q U + [theta x]^T Q U - tau Q C f - Q B b_a + Q D b_g + Q C (w x l),
    B = integral of C dt,   D = integral of [(C f) x] B dt

linear in the start s_0, the small turn theta, the shift tau of the inertial tags, the biases (measured minus true) and
the lever arm l in sensor axes. Scale factors and misalignments, M_a and M_g, are biases M_a f and M_g w; they have the
sigmas of the grade. A gyro scale of 1 % turns a car's velocity after a corner by 0.9 deg, 0.2 m/s at 12 m/s: without
them a wrong map of the gyros explained a telephone's log better than the right one. Velocities from range rates that
lag are at their times to the first order alone: k Q d(C f)/dt is the next, k a quarter to a half of the lag squared. In
a roll it looks like a lever arm: k = 0.08 s^2 like 0.8 m. s_0 and theta belong to a stretch and are projected out of
it; the rest is common. Rows are weighed by Huber's weights. Neglects: motion of the biases.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import SIGMA_PER_MEDIAN
from insgnss.geodesy.rotations import cross_matrix
from insgnss.log.checks.motion_fit import MODEL_SIGMA_MPS, Path, at_times, best_rotation, integrate, rotate
from insgnss.log.checks.stretches import SPACING_S, STEP_S, GnssStretch, InertialGrid
from insgnss.tables import Float64

N_COMMON: Final = 29
TAU: Final = 0
BIAS_A: Final = slice(1, 4)
BIAS_G: Final = slice(4, 7)
LEVER: Final = slice(7, 10)
SCALE_A: Final = slice(10, 19)  # M_a by rows
SCALE_G: Final = slice(19, 28)
SMOOTHED: Final = 28
# Velocities of a receiver nearer in time than this share a good part of their errors [s]
CORRELATION_S: Final = 2.0
HUBER: Final = 1.5
JERK_OVER_S: Final = 1.0  # shorter changes are vibration
RATE_OVER_S: Final = 0.2  # the rate that moves the antenna is the mean over this
# What is known before the fit: more would have been seen already; no antenna is farther away
ANY_LEVER_M: Final = 30.0
PRIOR: Final = np.array([*[0.5] * 3, *[0.02] * 3])  # biases [m/s^2, rad/s]
_EXACT: Final = 1e-6  # sigma of a scale factor or a misalignment that the grade has not


NO_SCALE: Final = np.zeros((2, 3, 3))


class Uncertainty(NamedTuple):
    """One sigma of what is known before the fit."""

    lever_m: float = ANY_LEVER_M
    time_s: float = 2.0  # next to nothing holds the offset at zero
    scale: Float64 = NO_SCALE  # (2, 3, 3) of M_a and M_g
    smoothed_s2: float = 0.0


UNKNOWN: Final = Uncertainty()


class RefinedEstimate(NamedTuple):
    """Estimates in sensor axes with their sigmas, which count correlated epochs once."""

    x: Float64  # (29,) tau [s], b_a [m/s^2], b_g [rad/s], lever arm [m], M_a, M_g, k [s^2]
    P: Float64  # (29, 29)
    rms_mps: float  # of the residual of a velocity component
    cost: float  # -2 log likelihood, for comparing hypotheses on the same stretches

    @property
    def sd(self) -> Float64:
        """One sigma of each."""
        return np.sqrt(np.diag(self.P))


def refine(
    chosen: list[GnssStretch],
    grid: InertialGrid,
    gyro_map: Float64,
    handed: int,
    lever_s: Float64,
    known: Uncertainty = UNKNOWN,
) -> RefinedEstimate:
    """Return the estimates from stretches, the gyros' columns mapped by ``gyro_map`` (3, 3).

    Parameters
    ----------
    chosen, grid : with motion; the margin of the grid must hold the offset
    handed : det Q, +1 for right-handed accelerometers
    lever_s, known : what is known of the lever arm, sensor axes, and how well all is: in a flat turn the lever arm's
        forward part looks like an offset of time
    """
    path = integrate(grid, gyro_map[None])
    exact = np.maximum([*known.scale.ravel(), known.smoothed_s2], _EXACT)
    prior = np.concatenate(([known.time_s], PRIOR, np.full(3, known.lever_m), exact))
    before = np.concatenate((np.zeros(7), lever_s, np.zeros(19)))
    x, P, rms = before.copy(), np.diag(prior**2), float("nan")
    nodes = [_node_values(grid, path, gyro_map, i) for i in range(len(chosen))]
    spacing_s = _spacing(chosen)
    for _ in range(4):
        parts = [
            _rows(stretch, nodes[i], float(grid.start_s[i]), gyro_map, handed, x)
            for i, stretch in enumerate(chosen)
        ]
        scale = SIGMA_PER_MEDIAN * float(np.median(np.abs(np.concatenate([r for _, r in parts]))))
        N, rhs, squares, count = _normal(parts, max(scale, 1e-3))
        variance = max(squares / max(count, 1.0), 1e-6) * max(1.0, CORRELATION_S / spacing_s)
        P = np.linalg.inv(N / variance + np.diag(1.0 / prior**2))
        x = x + P @ (rhs / variance - (x - before) / prior**2)
        rms = float(np.sqrt(squares / max(count, 1.0)))
    rows = sum(len(r) for _, r in parts) / max(1.0, CORRELATION_S / spacing_s)
    return RefinedEstimate(x, P, rms, rows * float(np.log(rms**2 + MODEL_SIGMA_MPS**2)))


def _spacing(chosen: list[GnssStretch]) -> float:
    return max(SPACING_S, float(np.median(np.diff(chosen[0].t_s))))


def _normal(parts: list[tuple[Float64, Float64]], scale: float) -> tuple[Float64, Float64, float, float]:
    """Return the normal matrix, its right side, the weighted squares and their number of redundant rows."""
    N, rhs = np.zeros((N_COMMON, N_COMMON)), np.zeros(N_COMMON)
    squares = count = 0.0
    for rows, residual in parts:
        weight = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-12))
        root = np.sqrt(weight)[:, None]
        local, _ = np.linalg.qr(rows[:, N_COMMON:] * root)
        common, left = rows[:, :N_COMMON] * root, residual * root[:, 0]
        common = common - local @ (local.T @ common)
        left = left - local @ (local.T @ left)
        N += common.T @ common
        rhs += common.T @ left
        squares += float(left @ left)
        count += len(left) - 6.0
    return N, rhs, squares, count


def _rows(
    stretch: GnssStretch, nodes: Float64, start_s: float, gyro_map: Float64, handed: int, x: Float64
) -> tuple[Float64, Float64]:
    """Return (3 k, 35) derivatives and (3 k,) residuals of a stretch at the present estimate."""
    now = at_times(nodes[None], start_s, stretch.t_s - x[TAU])[0]
    gained, force, jerk, C, w, B, D = np.split(now, [3, 6, 9, 18, 21, 57], axis=1)
    k = len(now)
    B, D, C = (part.reshape(k, 3, -1) for part in (B, D, C))
    rate = w @ gyro_map.T - x[BIAS_G]
    arm = np.cross(rate, x[LEVER])
    b_a, b_g = np.concatenate((x[BIAS_A], x[SCALE_A])), np.concatenate((x[BIAS_G], x[SCALE_G]))
    model = gained - B @ b_a + D @ b_g + x[SMOOTHED] * jerk + np.einsum("kij,kj->ki", C, arm)
    centred, seen = model - model.mean(axis=0), stretch.s_e - stretch.s_e.mean(axis=0)
    Q = best_rotation(seen, centred, handed)
    rows = np.zeros((k, 3, N_COMMON + 6))
    rows[:, :, TAU] = -force @ Q.T
    rows[:, :, BIAS_A], rows[:, :, SCALE_A] = np.split(-Q @ B, [3], axis=2)
    rows[:, :, BIAS_G], rows[:, :, SCALE_G] = np.split(Q @ D, [3], axis=2)
    rows[:, :, LEVER] = Q @ C @ cross_matrix(rate)
    rows[:, :, SMOOTHED] = jerk @ Q.T
    rows[:, :, N_COMMON : N_COMMON + 3] = -cross_matrix(centred @ Q.T)
    rows[:, :, N_COMMON + 3 :] = np.eye(3)
    residual = seen - centred @ Q.T
    return rows.reshape(3 * k, -1), residual.ravel()


def _node_values(grid: InertialGrid, path: Path, gyro_map: Float64, i: int) -> Float64:
    """Return (n, 93) of one stretch at its nodes: U, C f, d(C f)/dt, C, the gyros' own rate about them, and B and D.

    B and D (3, 12) are those of the biases and, by rows, of the scale factors and misalignments.
    """
    q, gained = path.q[0, i], path.gained[0, i]
    n = len(q)
    C = np.stack([rotate(q, np.broadcast_to(unit, (n, 3))) for unit in np.eye(3)], axis=-1)
    force = np.gradient(gained, STEP_S, axis=0)
    dv, theta = (np.concatenate((steps[i], steps[i, -1:])) for steps in (grid.dv, grid.theta))
    B = _integral(C * STEP_S, C, dv)
    D = np.cumsum(cross_matrix(force) @ _integral(C * STEP_S, C, theta @ gyro_map.T), axis=0) * STEP_S
    D -= D[n // 2]
    over = max(1, round(RATE_OVER_S / STEP_S))
    kernel = np.ones(over) / over
    w = np.stack([np.convolve(theta[:, axis] / STEP_S, kernel, mode="same") for axis in range(3)], axis=1)
    half = round(0.5 * JERK_OVER_S / STEP_S)
    at = np.clip(np.arange(n)[:, None] + np.array([-half, 0, half]), 0, n - 1)
    jerk = (gained[at[:, 2]] - 2.0 * gained[at[:, 1]] + gained[at[:, 0]]) / (half * STEP_S) ** 2
    flat = [part.reshape(n, -1) for part in (C, w, B, D)]
    return np.concatenate((gained, force, jerk, *flat), axis=1)


def _integral(turned: Float64, C: Float64, steps: Float64) -> Float64:
    """Return (n, 3, 12) integrals from the middle on: of biases, ``turned``, and of M times the increments.

    Biases turn and push from the middle on: better conditioned, and s_0 takes the rest.
    """
    scaled = np.einsum("nki,nj->nkij", C, steps).reshape(len(C), 3, 9)
    total = np.cumsum(np.concatenate((turned, scaled), axis=2), axis=0)
    return np.asarray(total - total[len(C) // 2])
