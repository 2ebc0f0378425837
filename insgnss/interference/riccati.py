"""The steady state of a Kalman filter with identical observations: Riccati equations, and errors by source.

Continuous: ``A P + P A^T + Q - P G P = 0``, G = H^T H / r, all intensities two-sided; discrete, before the update:
``P = F P (I + G P)^-1 F^T + Q``, G = H^T H / r, r the variance of one observation. SciPy's Schur method fails
where the clock's intensity is twenty decades below that of the vehicle's acceleration; doubling does not, and needs 6
to 13 steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from scipy import linalg

from insgnss.errors import ConfigError
from insgnss.tables import Float64

# Of the Cayley transform: above the bands of the loops, 1 to 30 1/s, rounding is least. Others are tried if it fails
_SHIFTS_PER_S: Final = (100.0, 1000.0, 10.0, 1.0)
_DOUBLINGS: Final = 40
_CONVERGED: Final = 1e-15
_RESIDUAL: Final = 1e-7  # of the equation over the sigmas of its states [1/s]; 1e-12 is usual


class DiscreteModel(NamedTuple):
    """A continuous model over a step."""

    F: Float64  # (n, n)
    Q: Float64  # (n, n) covariance that a step adds


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
    for shift in _SHIFTS_PER_S:

        def found(scale: Float64, shift: float = shift) -> Float64:
            """Return P over the products of the scales, (n,)."""
            across = np.outer(scale, scale)
            return _transformed(A * (1.0 / scale)[:, None] * scale, G * across, Q / across, shift)

        P, sigma = _solved(found, len(A))
        with np.errstate(all="ignore"):
            left = float(np.max(np.abs(A @ P + P @ A.T + Q - P @ G @ P) / np.outer(sigma, sigma)))
        if left < _RESIDUAL:
            return P
    raise _no_steady_state()


def predicted_covariance(model: DiscreteModel, H: Float64, noise: float) -> Float64:
    """Return P of the optimal discrete filter before the update, (n, n).

    Parameters
    ----------
    H : (m, n) rows, each with white noise of the variance ``noise``

    Raises
    ------
    ConfigError : there is no steady state
    """
    F, Q = model
    G = H.T @ H / noise

    def found(scale: Float64) -> Float64:
        """Return P over the products of the scales, (n,)."""
        across = np.outer(scale, scale)
        return _doubled(F.T * scale[:, None] * (1.0 / scale), G * across, Q / across)

    P, _ = _solved(found, len(F))
    if not np.isfinite(P).all():
        raise _no_steady_state()
    return P


def discretised(A: Float64, Q: Float64, step_s: float) -> DiscreteModel:
    """Return a continuous model over a step, exactly.

    Equation: F = exp(A T), Q_d = int F Q F^T, both from one exponential [Van Loan 1978]
    """
    n = len(A)
    block = linalg.expm(np.block([[-A, Q], [np.zeros((n, n)), A.T]]) * step_s)
    F = block[n:, n:].T
    added = F @ block[:n, n:]
    return DiscreteModel(np.asarray(F), np.asarray(0.5 * (added + added.T)))


def error_sources(A: Float64, motion: Float64, oscillator: Float64, H: Float64, noise: float) -> ErrorSources:
    """Return the parts of observation noise, motion and oscillator in P of the filter that is optimal for all.

    Equation: with K = P H^T / r, A_c = A - K H: A_c X + X A_c^T + W = 0 for W = r K K^T, motion, oscillator [Lyapunov]
    """
    gain = steady_covariance(A, motion + oscillator, H, noise) @ H.T / noise
    closed = A - gain @ H
    driven = (noise * gain @ gain.T, motion, oscillator)
    return ErrorSources(*(np.asarray(linalg.solve_continuous_lyapunov(closed, -W)) for W in driven))


def _solved(found: Callable[[Float64], Float64], size: int) -> tuple[Float64, Float64]:
    """Return P of a solver that takes scales of the states, and the scales: 1, then the sigmas of the first result."""
    with np.errstate(all="ignore"):
        try:
            rough = np.diag(found(np.ones(size)))
            sigma = np.sqrt(np.where(rough > 0.0, rough, 1.0))
            return np.outer(sigma, sigma) * found(sigma), np.asarray(sigma)
        except np.linalg.LinAlgError:
            return np.full((size, size), np.nan), np.ones(size)


def _no_steady_state() -> ConfigError:
    return ConfigError(
        "the phase model has no steady state",
        key="H",
        advice="every state that noise drives has to be seen by the phases: add satellites or drop the state",
    )


def _transformed(A: Float64, G: Float64, Q: Float64, shift: float) -> Float64:
    """Return P of a continuous filter: its Cayley transform is a discrete one."""
    eye = np.eye(len(A))
    shifted = np.linalg.inv(A.T - shift * eye)
    inner = np.linalg.inv(A.T - shift * eye + G @ shifted.T @ Q)
    E = eye + 2.0 * shift * inner
    return _doubled(E, 2.0 * shift * shifted @ G @ inner.T, 2.0 * shift * inner.T @ Q @ shifted)


def _doubled(E: Float64, g: Float64, P: Float64) -> Float64:
    """Return P of a discrete filter by doubling, k steps of which are 2^k steps of its recursion; else nan."""
    eye = np.eye(len(P))
    for _ in range(_DOUBLINGS):
        both = np.linalg.inv(eye + g @ P)
        added = E.T @ P @ both @ E
        g, E, P = g + E @ both @ g @ E.T, E @ both @ E, P + added
        if np.max(np.abs(added)) <= _CONVERGED * np.max(np.abs(P)):
            return np.asarray(0.5 * (P + P.T))
    return np.full_like(P, np.nan)
