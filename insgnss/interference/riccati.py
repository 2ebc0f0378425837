"""The steady state of a continuous Kalman filter whose observations are alike: Riccati equation, and errors by source.

``A P + P A^T + Q - P G P = 0``, G = H^T H / r, all intensities two-sided. SciPy's Schur method fails where the clock's
intensity is twenty decades below that of the vehicle's acceleration; doubling does not, and needs 6 to 13 steps.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy import linalg

from insgnss.errors import ConfigError
from insgnss.tables import Float64

_SHIFT_PER_S: Final = 10.0  # of the Cayley transform: near the bands of the loops, 1 to 30 1/s
_DOUBLINGS: Final = 40
_CONVERGED: Final = 1e-15
_RESIDUAL: Final = 1e-7  # of the equation over the sigmas of its states [1/s]; 1e-12 is usual


class ErrorSources(NamedTuple):
    """Covariances of one filter's error, (n, n) each, that add up to P."""

    noise: Float64
    motion: Float64
    oscillator: Float64


def steady_covariance(A: Float64, Q: Float64, H: Float64, noise: float) -> Float64:
    """Return P of the optimal filter, (n, n).

    Equation: structure-preserving doubling of the pencil, twice: the second time with states over their sigmas
                                                                    [Chu, Fan & Lin 2005, Linear Algebra Appl. 396]

    Parameters
    ----------
    A, Q : (n, n) dynamics and two-sided intensities
    H : (m, n) rows, each with white noise of the two-sided intensity ``noise``

    Raises
    ------
    ConfigError : there is no steady state: the rows do not bound a state that noise drives
    """
    G = H.T @ H / noise
    with np.errstate(all="ignore"):
        try:
            rough = np.diag(_doubled(A, G, Q))
            sigma = np.sqrt(np.where(rough > 0.0, rough, 1.0))
            scale = np.outer(sigma, sigma)
            P = scale * _doubled(A * (1.0 / sigma)[:, None] * sigma, G * scale, Q / scale)
            left = np.abs(A @ P + P @ A.T + Q - P @ G @ P) / scale
        except np.linalg.LinAlgError:
            left = np.full(A.shape, np.nan)
    if not np.max(left) < _RESIDUAL:
        raise ConfigError(
            "the phase model has no steady state",
            key="H",
            advice="every state that noise drives has to be seen by the phases: add satellites or drop the state",
        )
    return np.asarray(P)


def error_sources(A: Float64, motion: Float64, oscillator: Float64, H: Float64, noise: float) -> ErrorSources:
    """Return what observation noise, motion and oscillator each add to P of the filter that is optimal for all.

    Equation: with K = P H^T / r, A_c = A - K H: A_c X + X A_c^T + W = 0 for W = r K K^T, motion, oscillator [Lyapunov]
    """
    gain = steady_covariance(A, motion + oscillator, H, noise) @ H.T / noise
    closed = A - gain @ H
    driven = (noise * gain @ gain.T, motion, oscillator)
    return ErrorSources(*(np.asarray(linalg.solve_continuous_lyapunov(closed, -W)) for W in driven))


def _doubled(A: Float64, G: Float64, Q: Float64) -> Float64:
    """Return P by doubling, k steps of which are 2^k steps of the filter's transformed recursion; else nan."""
    eye = np.eye(len(A))
    shifted = np.linalg.inv(A.T - _SHIFT_PER_S * eye)
    inner = np.linalg.inv(A.T - _SHIFT_PER_S * eye + G @ shifted.T @ Q)
    E = eye + 2.0 * _SHIFT_PER_S * inner
    g = 2.0 * _SHIFT_PER_S * shifted @ G @ inner.T
    P = 2.0 * _SHIFT_PER_S * inner.T @ Q @ shifted
    for _ in range(_DOUBLINGS):
        both = np.linalg.inv(eye + g @ P)
        added = E.T @ P @ both @ E
        g, E, P = g + E @ both @ g @ E.T, E @ both @ E, P + added
        if np.max(np.abs(added)) <= _CONVERGED * np.max(np.abs(P)):
            return np.asarray(0.5 * (P + P.T))
    return np.full_like(P, np.nan)
