"""The third-order phase loop that is optimal for Wiener frequency drift and an acceleration that lasts.

A loop without aiding has to follow the vehicle. Its acceleration along the line of sight is a Gauss-Markov process of
sigma and correlation time; a loop that carries it as a third state follows a turn that a second-order loop can only
widen its band for. Of all linear loops none has a smaller error under this model.

C_A, rms over aperture at loss of lock, is taken for the same as that of the second order. By simulation (IQ, 1.5 g that
last for 5 s, a TCXO) the C/N0 of equal time to slip differ by 2.2 dB where the linear theory has 2.7: it favours the
third order by half a decibel.

States ``phi' = w + n_f``, ``w' = a + n``, ``a' = -m a + n_a``, m = 1 / time. One-sided densities: S_n of the phase
noise, S of n, S_f of n_f; k = 2 pi f0 / c. The intensities of the Riccati equation are r = S_n / 2, q = S / 2,
q_f = S_f / 2 and q_a = 2 m (k sigma)^2.

Its characteristic polynomial p^3 + D1 p^2 + D2 p + D3 is the stable factor of the spectrum of the loop's whole input:

    D1^2 - 2 D2 = m^2 + q_f / r,  D2^2 - 2 D1 D3 = (q + q_f m^2) / r,  D3^2 = (q m^2 + q_a) / r
    K1 = D1 - m,  K2 = D2 - m K1,  K3 = D3 - m K2,  variance of the phase error r K1
                                                        [steady Kalman filter; Kailath, Sayed & Hassibi 2000, ch. 16]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.interference.checks import not_negative, positive
from insgnss.interference.drift import per_mps
from insgnss.interference.optimal_loop import bisected
from insgnss.tables import Float64

_WIDENING: Final = 4.0  # by which the upper bound of a root is widened until it is one
_BISECTIONS: Final = 54  # of a bracket of that width, down to rounding


class ThirdOrderGains(NamedTuple):
    """Of ``phi' = w + K1 u``, ``w' = a + K2 u``, ``a' = -m a + K3 u``."""

    K1: Float64  # [1/s]
    K2: Float64  # [1/s^2]
    K3: Float64  # [1/s^3]


class _Intensities(NamedTuple):
    """The driving noise of the loop, two-sided; all arrays of one shape."""

    m: float  # [1/s]
    q: Float64  # of the frequency [rad^2/s^3]
    q_f: Float64  # of the phase [rad^2/s]
    q_a: Float64  # of the acceleration [rad^2/s^5]


def third_order_gains(
    drift: npt.ArrayLike,
    noise: npt.ArrayLike,
    sigma_mps2: npt.ArrayLike,
    time_s: float,
    carrier_hz: float,
    phase_walk: npt.ArrayLike = 0.0,
) -> ThirdOrderGains:
    """Return the optimal gains; r K1 is the variance of the phase error.

    Equation: D1 is the one root of ((D1^2 - m^2 - q_f / r) / 2)^2 = (q + q_f m^2) / r + 2 D1 D3, by bisection

    Parameters
    ----------
    drift : S, one-sided density of oscillator and white accelerations [rad^2/s^3]
    noise : S_n, one-sided density of the phase noise [rad^2/Hz]
    sigma_mps2, time_s : one sigma and correlation time of the acceleration along the line of sight
    phase_walk : S_f [rad^2/s]
    """
    r = 0.5 * positive("noise", noise, "a one-sided density in rad^2/Hz, about the inverse of C/N0 in Hz")
    m, q, q_f, q_a = _intensities(drift, sigma_mps2, time_s, carrier_hz, phase_walk)
    A, B, C = m * m + q_f / r, (q + q_f * m * m) / r, np.sqrt((q * m * m + q_a) / r)

    def excess(D1: Float64) -> Float64:
        D2 = 0.5 * (D1 * D1 - A)
        return np.where(D2 > 0.0, D2 * D2 - B - 2.0 * D1 * C, -1.0)

    D1 = _root(excess, np.sqrt(A))
    K1 = D1 - m
    K2 = 0.5 * (D1 * D1 - A) - m * K1
    return ThirdOrderGains(K1, K2, C - m * K2)


def third_order_threshold_noise(
    drift: npt.ArrayLike,
    threshold_rms_rad: npt.ArrayLike,
    sigma_mps2: npt.ArrayLike,
    time_s: float,
    carrier_hz: float,
    phase_walk: npt.ArrayLike = 0.0,
) -> Float64:
    """Return the one-sided noise density at which the loop's error reaches a threshold [rad^2/Hz].

    Equation: r K1 = rms^2 =: 1 / g turns the three equations into one for K = K1,
              (K (2 m + K - q_f g) / 2)^2 = K g (q + q_f m^2) + 2 (m + K) sqrt(K g (q m^2 + q_a)),
              whose two sides over K^2 rise and fall: one root, by bisection; S_n = 2 rms^2 / K
    Without acceleration it is (18) of Shatilov (2009): K^3 = 4 q g.

    Parameters
    ----------
    threshold_rms_rad : aperture times threshold ratio
    """
    rms = positive("threshold_rms_rad", threshold_rms_rad, "aperture times threshold ratio, in radians")
    m, q, q_f, q_a = _intensities(drift, sigma_mps2, time_s, carrier_hz, phase_walk)
    g = 1.0 / (rms * rms)

    def excess(K: Float64) -> Float64:
        D2 = 0.5 * K * (2.0 * m + K - q_f * g)
        pushed = K * g * (q + q_f * m * m) + 2.0 * (m + K) * np.sqrt(K * g * (q * m * m + q_a))
        return np.where(D2 > 0.0, D2 * D2 - pushed, -1.0)

    # acceleration and phase walk only make the band wider than that of the drift alone
    return np.asarray(2.0 / g / _root(excess, 0.5 * np.cbrt(4.0 * q * g)))


def _intensities(
    drift: npt.ArrayLike,
    sigma_mps2: npt.ArrayLike,
    time_s: float,
    carrier_hz: float,
    phase_walk: npt.ArrayLike,
) -> _Intensities:
    S = positive("drift", drift, "the oscillator's one-sided density in rad^2/s^3 is above zero")
    S_f = not_negative("phase_walk", phase_walk, "a one-sided density in rad^2/s, zero for none")
    a = per_mps(carrier_hz) * not_negative("sigma_mps2", sigma_mps2, "one sigma in m/s^2")
    m = 1.0 / float(positive("time_s", time_s, "the acceleration's correlation time in seconds"))
    q, q_f, q_a = np.broadcast_arrays(0.5 * S, 0.5 * S_f, 2.0 * m * a * a)
    return _Intensities(m, q, q_f, q_a)


def _root(excess: Callable[[Float64], Float64], low: Float64) -> Float64:
    """Return the one root above ``low`` of functions that are negative below it and positive above."""
    low = np.asarray(low)
    high = _WIDENING * low
    while (short := excess(high) < 0.0).any():
        low, high = np.where(short, high, low), np.where(short, _WIDENING * high, high)
    return bisected(lambda middle: excess(middle) < 0.0, low, high, _BISECTIONS)
