"""Drives the mechanization over a whole log, and makes logs in closed form, for these tests alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.geodesy.rotations import matrix_to_quaternion, quaternion_to_matrix
from insgnss.inertial.increments import effective_rates
from insgnss.inertial.mechanization import mechanize
from insgnss.kernels.jit import kernel

EARTH = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
Function = Callable[[np.ndarray], np.ndarray]  # times (n,) [s] -> vectors (n, 3)


def even_edges(duration_s: float, rate_hz: float) -> np.ndarray:
    """Return the ends of equal sampling intervals from zero on."""
    return np.arange(round(duration_s * rate_hz) + 1) / rate_hz


def means(function: Function, edges_s: np.ndarray) -> np.ndarray:
    """Return what an ideal integrating sensor reports: means between edges, by Gauss quadrature of degree 11."""
    node, weight = np.polynomial.legendre.leggauss(6)
    half = 0.5 * np.diff(edges_s)
    t = edges_s[:-1, None] + half[:, None] * (1.0 + node)
    return np.asarray(np.einsum("j,kjc->kc", 0.5 * weight, function(t.ravel()).reshape(len(half), 6, 3)))


def skew(x: np.ndarray) -> np.ndarray:
    """Return [x x], the matrix of the cross product."""
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def angle_of(R: np.ndarray) -> float:
    """Return the angle of a rotation matrix near unity [rad]: arc cosine of its trace would see nothing below 1e-8."""
    return float(np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0)


@kernel
def _fly(
    dt: np.ndarray,
    w: np.ndarray,
    f: np.ndarray,
    corrected: bool,
    q: np.ndarray,
    C: np.ndarray,
    r: np.ndarray,
    v: np.ndarray,
    every: int,
    r_out: np.ndarray,
    v_out: np.ndarray,
    C_out: np.ndarray,
) -> None:
    w_c, f_c, g = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(len(dt)):
        before = max(k - 1, 0)
        if corrected:
            effective_rates(w[k], f[k], w[before], f[before], dt[k], dt[before], w_c, f_c)
        else:
            w_c[:] = w[k]
            f_c[:] = f[k]
        mechanize(q, C, r, v, w_c, f_c, dt[k], g)
        if (k + 1) % every == 0:
            place = (k + 1) // every - 1
            r_out[place] = r
            v_out[place] = v
            C_out[place] = C


@dataclass(frozen=True)
class Flown:
    """Where the mechanization came to, at every n-th sample."""

    r_e: np.ndarray  # (n, 3) [m]
    v_e: np.ndarray  # (n, 3) [m/s]
    C_eb: np.ndarray  # (n, 3, 3)


def fly(
    dt: np.ndarray | float,
    w: np.ndarray,
    f: np.ndarray,
    C_eb: np.ndarray,
    r_e: np.ndarray,
    v_e: np.ndarray,
    *,
    corrected: bool = True,
    every: int = 1,
) -> Flown:
    """Return the states after every n-th sample of mean rates ``w`` and specific forces ``f`` (n, 3) from a start.

    ``corrected=False`` leaves coning and sculling out.
    """
    count = len(w) // every
    C, q, r, v = C_eb.copy(), np.zeros(4), np.array(r_e, dtype=float), np.array(v_e, dtype=float)
    matrix_to_quaternion(C, q)
    quaternion_to_matrix(q, C)
    out = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3, 3))
    steps = np.array(np.broadcast_to(dt, len(w)), dtype=float)
    _fly(steps, w, f, corrected, q, C, r, v, every, *out)
    return Flown(*out)
