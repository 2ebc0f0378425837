"""Klobuchar's model against a published example and an independent implementation."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sidereon

from insgnss.gnss.ionosphere import ionosphere_above, klobuchar_delay

ALPHA = np.array([1.4901e-8, 2.2352e-8, -1.1921e-7, -1.1921e-7])
BETA = np.array([1.1469e5, 1.6384e5, -6.5536e4, -4.5875e5])
COEFFICIENTS = np.concatenate([ALPHA, BETA])


def test_published_example_at_40_north_260_east() -> None:
    """A worked example that goes round with the algorithm: 7.93e-8 s at 20:45 GPS time, elevation 20 deg."""
    coefficients = np.array([3.82e-8, 1.49e-8, -1.79e-7, 0.0, 1.43e5, 0.0, -3.28e5, 1.13e5])
    delay = klobuchar_delay(
        coefficients, math.radians(40), math.radians(260), math.radians(210), math.radians(20), 593_100.0
    )
    assert delay == pytest.approx(23.784, abs=1e-3)


def test_delay_agrees_with_an_independent_implementation(rng: np.random.Generator) -> None:
    for _ in range(500):
        lat, lon = rng.uniform(-90, 90), rng.uniform(-180, 180)
        az, el, t = rng.uniform(0, 360), rng.uniform(0.0, 90), rng.uniform(0, 86_399)
        theirs = sidereon.klobuchar_native(ALPHA, BETA, lat, lon, az, el, t, 1575.42e6)
        ours = klobuchar_delay(COEFFICIENTS, *np.radians([lat, lon, az, el]), t + 4 * 86_400.0)
        assert ours == pytest.approx(theirs, abs=1e-9)


def test_delay_below_the_horizon_stays_at_its_value_there() -> None:
    at = [
        klobuchar_delay(COEFFICIENTS, 0.8, 0.1, 1.0, el, 50_000.0)
        for el in (0.0, -0.01, -0.346, -math.pi / 2)
    ]
    assert len(set(at)) == 1
    assert 5.0 < at[0] < 100.0


def test_delay_at_night_at_the_zenith_is_five_nanoseconds() -> None:
    delay = klobuchar_delay(COEFFICIENTS, 0.8, 0.0, 0.0, math.pi / 2, 0.0)
    assert delay == pytest.approx(5e-9 * 299_792_458.0 * (1 + 16 * 0.03**3), rel=1e-12)


def test_share_above_falls_from_one_to_nothing_without_a_step() -> None:
    heights = np.concatenate([[-500.0], np.linspace(0.0, 2.0e6, 2001), [1e7, 4.2e7, 1e12]])
    share = np.array([ionosphere_above(h) for h in heights])
    assert np.all(np.isfinite(share)) and np.all(np.diff(share) <= 0.0)
    assert share[0] == 1.0 and share[-1] == 0.0
    assert ionosphere_above(80_000.0) == pytest.approx(1.0, abs=1e-6)
    assert ionosphere_above(350_000.0) == pytest.approx(math.erf(math.sqrt(0.5)))
    assert np.abs(np.diff(share[1:-3])).max() < 0.01


def test_share_above_is_the_integral_of_a_chapman_layer() -> None:
    z = np.linspace(-4.375, 30.0, 200_001)
    density = np.exp(0.5 * (1.0 - z - np.exp(-z)))
    whole = np.trapezoid(density, z)
    for h in (1e5, 3e5, 6e5):
        above = z >= (h - 350e3) / 80e3
        assert ionosphere_above(h) == pytest.approx(np.trapezoid(density[above], z[above]) / whole, abs=1e-4)
