"""The second-order phase loop that is optimal for Wiener frequency drift: gains, noise bandwidth, error, threshold.

The loop follows ``phi' = y + w``, w' = white noise, from phase measurements in white noise; y is the aiding (INS). What
it does not know, w, is the drift of the oscillator less the error of the aiding [Shatilov 2009, (6), (7)].

One-sided densities throughout: S of w' [rad^2/s^3], S_n of the phase noise [rad^2/Hz]. The intensities of the Kalman
filter's model are half of them: q = S / 2, r = S_n / 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.errors import ConfigError
from insgnss.interference.checks import not_negative, positive
from insgnss.tables import Bool, Float64

_S_ADVICE: Final = "a one-sided density in rad^2/s^3: 0.1 of an oven oscillator, 3000 of a poor crystal"
_NOISE_ADVICE: Final = "a one-sided density in rad^2/Hz, about the inverse of C/N0 in Hz"
_BANDWIDTH: Final = 3.0 / (4.0 * math.sqrt(2.0))
_BISECTIONS: Final = 90  # of a bracket of at most 30 decades, down to rounding
MAX_BANDWIDTH_TIME: Final = 0.5  # B T beyond which a loop of T has no continuous likeness


class SecondOrderGains(NamedTuple):
    """Of ``phi' = y + w + K1 u``, ``w' = K2 u``."""

    K1: Float64  # [1/s]
    K2: Float64  # [1/s^2]


class DiscreteGains(NamedTuple):
    """Of ``phi+ = phi- + alpha u``, ``w+ = w- + (beta / T) u``, then ``phi- = phi+ + T (y + w+)``."""

    alpha: Float64  # [-]
    beta: Float64  # [-]


def one_sided(two_sided: npt.ArrayLike) -> Float64:
    """Return the one-sided density (f >= 0 alone) of a two-sided one: twice as much."""
    return 2.0 * np.asarray(two_sided, np.float64)


def two_sided(one_sided: npt.ArrayLike) -> Float64:
    """Return the two-sided density (all f) of a one-sided one: half of it."""
    return 0.5 * np.asarray(one_sided, np.float64)


def gains(drift: npt.ArrayLike, noise: npt.ArrayLike) -> SecondOrderGains:
    """Return the optimal gains of the continuous loop.

    Equation: K2 = sqrt(S / S_n), K1 = sqrt(2 K2)                   [Shatilov 2009, (10); steady state of the Riccati
    equation with q = S / 2, r = S_n / 2, K = P h / r]

    Parameters
    ----------
    drift : S, one-sided density of w' [rad^2/s^3]
    noise : S_n, one-sided density of the phase noise [rad^2/Hz]
    """
    K2 = np.sqrt(positive("drift", drift, _S_ADVICE) / positive("noise", noise, _NOISE_ADVICE))
    return SecondOrderGains(np.sqrt(2.0 * K2), np.asarray(K2))


def discrete_gains(drift: npt.ArrayLike, noise: npt.ArrayLike, step_s: npt.ArrayLike) -> DiscreteGains:
    """Return the optimal gains of the loop that closes every T, with phase measurements of variance S_n / (2 T).

    Equation: with lambda = S T^4 / S_n: w = (sqrt(lambda) + sqrt(lambda / 3 + 16)) / 2, s + 1/s = w, s <= 1,
              alpha = 1 - s^2, beta = sqrt(lambda) s
    The steady Kalman filter for drift integrated exactly over T; its quartic in s reads the same from both ends, which
    is why it has a closed solution. For T -> 0, alpha / T -> K1, beta / T^2 -> K2.
    """
    S, S_n = positive("drift", drift, _S_ADVICE), positive("noise", noise, _NOISE_ADVICE)
    T = positive("step_s", step_s, "give the loop's period in seconds")
    root = np.sqrt(S / S_n) * T * T
    w = 0.5 * (root + np.sqrt(root * root / 3.0 + 16.0))
    gap = np.sqrt(root * w - root * root / 6.0)  # sqrt(w^2 - 4) = 1/s - s, by the quadratic that w solves
    s = 2.0 / (w + gap)
    return DiscreteGains(s * gap, root * s)


def noise_bandwidth_of_gains(K1: npt.ArrayLike, K2: npt.ArrayLike) -> Float64:
    """Return the one-sided noise bandwidth of any second-order loop [Hz].

    Equation: DF = 1 / (2 pi) int_0^inf |K(i w)|^2 dw = (K1^2 + K2) / (4 K1), K(p) = (K1 p + K2) / (p^2 + K1 p + K2)
                                                                    [Shatilov 2009, (11), (12)]
    """
    first = positive("K1", K1, "a stable loop has positive gains")
    return np.asarray(
        (first * first + positive("K2", K2, "a stable loop has positive gains")) / (4.0 * first)
    )


def noise_bandwidth(drift: npt.ArrayLike, noise: npt.ArrayLike) -> Float64:
    """Return the one-sided noise bandwidth of the optimal loop [Hz].

    Equation: DF = 3 / (4 sqrt 2) (S / S_n)^(1/4)   [Shatilov 2009, (13), printed with a square root for the fourth]
    """
    return np.asarray(_BANDWIDTH * np.sqrt(gains(drift, noise).K2))


def discrete_noise_bandwidth(found: DiscreteGains, step_s: npt.ArrayLike) -> Float64:
    """Return the one-sided noise bandwidth of the discrete loop's filtered phase [Hz].

    Equation: B = (2 alpha^2 + 2 beta - 3 alpha beta) / (2 T alpha (4 - 2 alpha - beta))
                                                                    [Bar-Shalom 2001, 6.5: variance of alpha-beta]
    """
    a, b = found
    T = positive("step_s", step_s, "give the loop's period in seconds")
    return np.asarray((2.0 * a * a + 2.0 * b - 3.0 * a * b) / (2.0 * T * a * (4.0 - 2.0 * a - b)))


def noise_variance(drift: npt.ArrayLike, noise: npt.ArrayLike) -> Float64:
    """Return the part of the phase error's variance due to the measurement noise [rad^2].

    Equation: DF S_n = 3 / (4 sqrt 2) (S S_n^3)^(1/4)               [Shatilov 2009, (15), (16)]
    """
    return np.asarray(3.0 / 4.0 * error_variance(drift, noise))


def drift_variance(drift: npt.ArrayLike, noise: npt.ArrayLike) -> Float64:
    """Return the part of the phase error's variance due to the drift [rad^2].

    Equation: S / (4 K1 K2) = 1 / (4 sqrt 2) (S S_n^3)^(1/4)        [Shatilov 2009, (17)]
    """
    return np.asarray(1.0 / 4.0 * error_variance(drift, noise))


def error_variance(drift: npt.ArrayLike, noise: npt.ArrayLike, phase_walk: npt.ArrayLike = 0.0) -> Float64:
    """Return the variance of the optimal loop's phase error, by linear theory [rad^2].

    Equation: (S S_n^3)^(1/4) / sqrt 2; with white frequency noise of one-sided density S_f besides the drift:
              sqrt(S_n / 2 (S_f / 2 + sqrt(S S_n)))                 [P_11 of the Riccati equation]

    Parameters
    ----------
    phase_walk : S_f, one-sided density of the frequency's white part [rad^2/s]; the paper's model has none
    """
    S, S_n = positive("drift", drift, _S_ADVICE), positive("noise", noise, _NOISE_ADVICE)
    S_f = not_negative("phase_walk", phase_walk, "a one-sided density in rad^2/s, zero for none")
    return np.asarray(np.sqrt(0.5 * S_n * (0.5 * S_f + np.sqrt(S * S_n))))


def threshold_noise(
    drift: npt.ArrayLike, threshold_rms_rad: npt.ArrayLike, phase_walk: npt.ArrayLike = 0.0
) -> Float64:
    """Return the one-sided noise density at which the optimal loop's error reaches a threshold [rad^2/Hz].

    Equation: S_n = (A_d C_A)^(8/3) (4 / S)^(1/3)                   [Shatilov 2009, (18)]
    With a phase walk the root of ``error_variance`` = (A_d C_A)^2, which has no closed form, by bisection.
    """
    S = positive("drift", drift, _S_ADVICE)
    rms = positive("threshold_rms_rad", threshold_rms_rad, "aperture times threshold ratio, in radians")
    S_f = not_negative("phase_walk", phase_walk, "a one-sided density in rad^2/s, zero for none")
    without = np.asarray(rms ** (8.0 / 3.0) * np.cbrt(4.0 / S))
    if not S_f.any():
        return np.broadcast_to(without, np.broadcast_shapes(without.shape, S_f.shape)).copy()
    # either kind of drift alone gives an upper bound; half of the error each, a lower one
    high = np.minimum(without, 4.0 * rms**4 / np.maximum(S_f, 1e-300))
    low = high / 16.0
    return bisected(lambda noise: error_variance(S, noise, S_f) < rms * rms, low, high, _BISECTIONS)


def bisected(is_below: Callable[[Float64], Bool], low: Float64, high: Float64, halvings: int) -> Float64:
    """Return the root in each bracket of positive numbers, halved by its logarithm.

    Parameters
    ----------
    is_below : whether a number is below its root
    """
    for _ in range(halvings):
        middle = np.sqrt(low * high)
        below = is_below(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(np.sqrt(low * high))


def check_bandwidth_time(bandwidth_hz: npt.ArrayLike, accumulation_s: npt.ArrayLike) -> None:
    """Refuse a loop that is closed too rarely for its bandwidth.

    Raises
    ------
    ConfigError : B T is above ``MAX_BANDWIDTH_TIME``, where the continuous theory says nothing of the loop any more
    """
    product = np.max(np.asarray(bandwidth_hz) * np.asarray(accumulation_s))
    if not product <= MAX_BANDWIDTH_TIME:
        raise ConfigError(
            f"bandwidth times accumulation is {product:.2g}, above the limit of {MAX_BANDWIDTH_TIME}",
            key="accumulation_s",
            advice="accumulate for a shorter time, or take a better oscillator: the loop needs less bandwidth",
        )
