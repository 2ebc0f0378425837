"""Carrier phases that a loop has to follow: an oscillator's wandering frequency, steady motion, Gauss-Markov motion."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS
from insgnss.tables import Float64
from insgnss.tracking.admissible import require_not_negative, require_positive


def wander_covariance(order: int, density: float, step_s: float) -> Float64:
    """Return the covariance that a step adds to a chain of integrators driven at its end.

    Equation: Q_ij = S/2 int g_i g_j, g_i = u^(order-1-i) / (order-1-i)!, over a step; S one-sided

    Parameters
    ----------
    order : number of states: 2 for a random walk of the frequency, 3 for one of its derivative
    density : one-sided, of the derivative of the last state
    """
    powers = order - 1 - np.arange(order)
    factorial = np.array([math.factorial(p) for p in powers], float)
    total = powers[:, None] + powers[None, :] + 1
    return np.asarray(0.5 * density * step_s**total / (total * factorial[:, None] * factorial[None, :]))


def wandering_phase(
    density: float, count: int, channels: int, step_s: float, rng: np.random.Generator
) -> Float64:
    """Return phases (count + 1, channels) [rad] whose frequency walks at random, beginning with none.

    Equation: dphi/dt = dw, d(dw)/dt = xi of the one-sided density S [rad^2/s^3]; exact at the steps
                                                                            [(4), (5) of Shatilov 2009]
    """
    require_not_negative(density=density)
    require_positive(step_s=step_s)
    factor = np.linalg.cholesky(wander_covariance(2, 1.0, step_s))
    driven = math.sqrt(density) * rng.standard_normal((count, channels, 2)) @ factor.T
    rate = np.cumsum(driven[..., 1], axis=0)
    before = np.concatenate([np.zeros((1, channels)), rate[:-1]])
    phase = np.cumsum(step_s * before + driven[..., 0], axis=0)
    return np.concatenate([np.zeros((1, channels)), phase])


def steady_phase(
    t_s: Float64, carrier_hz: float, acceleration_mps2: float = 0.0, jerk_mps3: float = 0.0
) -> Float64:
    """Return the phase of a distance that grows with an acceleration and a jerk from time zero on [rad].

    Equation: phi = -2 pi f0 / c (a t^2 / 2 + j t^3 / 6)
    """
    require_positive(carrier_hz=carrier_hz)
    distance = acceleration_mps2 * t_s**2 / 2.0 + jerk_mps3 * t_s**3 / 6.0
    return np.asarray(phase_of_range(distance, carrier_hz))


def phase_of_range(range_m: npt.ArrayLike, carrier_hz: float) -> Float64:
    """Return the carrier phase of a distance [rad]: it falls while the distance grows.

    Equation: phi = -2 pi f0 / c R
    """
    return np.asarray(-2.0 * math.pi * carrier_hz / C_MPS * np.asarray(range_m, float))
