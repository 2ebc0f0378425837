"""Acceleration that lasts: a loop at its threshold in a manoeuvre, or under a constant aiding error.

A Wiener frequency gets an independent push at every instant. A turn, a tilt or an accelerometer's bias push the same
way for seconds, longer than a loop remembers. For a loop of second order its equivalent is the density S that makes
the same error in the same loop; a loop of third order (``third_order``) follows it. ``threshold_in_motion`` computes
both and takes the better.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.interference.checks import not_negative, positive
from insgnss.interference.drift import per_mps
from insgnss.interference.optimal_loop import SecondOrderGains, bisected, gains, threshold_noise
from insgnss.interference.third_order import third_order_threshold_noise
from insgnss.tables import Float64, Int64

_BISECTIONS: Final = 50  # of a bracket of at most 15 decades: to 1e-12
# by which the third order has to be better to be taken: below it is rounding, without acceleration both are one loop
_BETTER: Final = 1e-9


class MotionThreshold(NamedTuple):
    """Where the better of the loops of second and third order loses lock."""

    noise: Float64  # S_n,thr [rad^2/Hz]
    density: Float64  # S of the Wiener drift that has this threshold by (18), one-sided [rad^2/s^3]
    order: Int64  # 2 or 3


def threshold_in_motion(
    base: npt.ArrayLike,
    sigma_mps2: npt.ArrayLike,
    time_s: float,
    carrier_hz: float,
    threshold_rms_rad: float,
    phase_walk: npt.ArrayLike = 0.0,
) -> MotionThreshold:
    """Return the noise at which the phase loop loses lock under a lasting acceleration, and of which order it is.

    Equation: second order: (18) at ``density_at_threshold``; third order: ``third_order_threshold_noise``; the larger.
    S of equal threshold: (2 rms^4 / S_n - S_f / 2)^2 / S_n         [``error_variance`` solved for S]

    Parameters
    ----------
    base : S_0 of oscillator and white accelerations, one-sided [rad^2/s^3]
    sigma_mps2, time_s : one sigma and correlation time of the acceleration along the line of sight; arrays broadcast
    phase_walk : S_f, one-sided density of white frequency noise [rad^2/s]
    """
    S = density_at_threshold(base, sigma_mps2, time_s, carrier_hz, threshold_rms_rad)
    second = threshold_noise(S, threshold_rms_rad, phase_walk)
    third = third_order_threshold_noise(base, threshold_rms_rad, sigma_mps2, time_s, carrier_hz, phase_walk)
    better = third > second * (1.0 + _BETTER)
    noise = np.where(better, third, second)
    root = 2.0 * threshold_rms_rad**4 / noise - 0.5 * np.asarray(phase_walk)
    return MotionThreshold(noise, np.where(better, root * root / noise, S), np.where(better, 3, 2))


def equivalent_density(
    sigma_mps2: npt.ArrayLike, time_s: npt.ArrayLike, carrier_hz: float, loop: SecondOrderGains
) -> Float64:
    """Return the one-sided S that disturbs a given loop as much as a Gauss-Markov acceleration [rad^2/s^3].

    Equation: S = 4 (2 pi f0 / c)^2 sigma^2 (K1 + m) / (K2 + K1 m + m^2), m = 1 / time, from the variance
    sigma^2 (K1 + m) / (K1 K2 (K2 + K1 m + m^2)) of the error of p^2 + K1 p + K2 = 0 against S / (4 K1 K2)
    A short one counts 4 k^2 sigma^2 time, its density at zero; a constant one 4 k^2 sigma^2 K1 / K2.

    Parameters
    ----------
    sigma_mps2 : one sigma of the acceleration along the line of sight [m/s^2]
    time_s : its correlation time
    """
    m = 1.0 / positive("time_s", time_s, "the acceleration's correlation time in seconds")
    a = per_mps(carrier_hz) * not_negative("sigma_mps2", sigma_mps2, "one sigma in m/s^2")
    K1, K2 = loop
    return np.asarray(4.0 * a * a * (K1 + m) / (K2 + K1 * m + m * m))


def density_at_threshold(
    base: npt.ArrayLike,
    sigma_mps2: npt.ArrayLike,
    time_s: float,
    carrier_hz: float,
    threshold_rms_rad: float,
) -> Float64:
    """Return S of Wiener drift and a lasting acceleration together, in the loop that is optimal for S at its threshold.

    Equation: S = S_0 + ``equivalent_density`` with K1, K2 of S and S_n,thr(S) (18); its one root, by bisection: what
    is added falls with S. Noise and drift then make the error of the threshold exactly.

    Parameters
    ----------
    base : S_0 of oscillator and white accelerations, one-sided [rad^2/s^3]
    sigma_mps2 : of the acceleration along the line of sight; arrays broadcast
    """
    S_0 = positive("base", base, "the oscillator's one-sided density in rad^2/s^3 is above zero")

    def sum_at(S: Float64) -> Float64:
        loop = gains(S, threshold_noise(S, threshold_rms_rad))
        return np.asarray(S_0 + equivalent_density(sigma_mps2, time_s, carrier_hz, loop))

    high = sum_at(S_0)
    low = np.broadcast_to(S_0, high.shape)
    return bisected(lambda S: sum_at(S) > S, low, high, _BISECTIONS)
