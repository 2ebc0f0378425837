"""Accelerations that last, against the integral of their spectrum over the loop's response."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import integrate

from insgnss.errors import ConfigError
from insgnss.gnss.signals import L1_HZ
from insgnss.interference.drift import per_mps
from insgnss.interference.optimal_loop import drift_variance, gains, noise_variance, threshold_noise
from insgnss.interference.steady_acceleration import density_at_threshold, equivalent_density

RMS = 0.067 * math.pi


def variance_by_integral(sigma: float, time_s: float, K1: float, K2: float) -> float:
    """Return the variance of the phase error, one-sided integral over f."""
    m = 1.0 / time_s

    def density(f: float) -> float:
        w = 2.0 * math.pi * f
        acceleration = 4.0 * sigma**2 * m / (m * m + w * w) * per_mps(L1_HZ) ** 2
        return acceleration / abs(K2 - w * w + 1j * K1 * w) ** 2

    corner = math.sqrt(K2) / (2.0 * math.pi)
    edges = sorted({0.0, m / 2.0 / math.pi, 10.0 * m / 2.0 / math.pi, corner, 10.0 * corner})
    pieces = [*itertools.pairwise(edges), (edges[-1], math.inf)]
    return sum(integrate.quad(density, a, b, limit=200)[0] for a, b in pieces)


@pytest.mark.parametrize("time_s", [1e-3, 0.1, 5.0, 300.0])
def test_equivalent_density_makes_the_variance_of_the_integral(time_s: float) -> None:
    loop = gains(100.0, 2e-3)
    K1, K2 = (float(k) for k in loop)
    S = float(equivalent_density(0.7, time_s, L1_HZ, loop))

    assert S / (4.0 * K1 * K2) == pytest.approx(variance_by_integral(0.7, time_s, K1, K2), rel=1e-6)


def test_constant_acceleration_is_the_ramp_error_of_the_loop() -> None:
    loop = gains(100.0, 2e-3)
    K1, K2 = (float(k) for k in loop)
    S = float(equivalent_density(1.0, 1e9, L1_HZ, loop))
    assert math.sqrt(S / (4.0 * K1 * K2)) == pytest.approx(per_mps(L1_HZ) / K2, rel=1e-6)


def test_noise_and_all_drift_make_the_threshold_together() -> None:
    sigma = np.array([0.0, 0.01, 1.0, 30.0])
    S = density_at_threshold(77.0, sigma, 5.0, L1_HZ, RMS)
    assert float(S[0]) == pytest.approx(77.0, rel=1e-9)
    for one, found in zip(sigma, S, strict=True):
        noise = threshold_noise(found, RMS)
        K1, K2 = (float(k) for k in gains(found, noise))
        accelerated = variance_by_integral(float(one), 5.0, K1, K2) if one else 0.0
        total = float(noise_variance(found, noise)) + 77.0 / (4.0 * K1 * K2) + accelerated
        assert total == pytest.approx(RMS**2, rel=1e-6)
        assert float(drift_variance(found, noise)) == pytest.approx(
            77.0 / (4.0 * K1 * K2) + accelerated, rel=1e-6
        )


def test_perfect_oscillator_without_any_drift_is_refused() -> None:
    with pytest.raises(ConfigError, match="base"):
        density_at_threshold(0.0, 1.0, 5.0, L1_HZ, RMS)
