"""Klobuchar's model against a published example and an independent implementation."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sidereon
from scipy.integrate import trapezoid

from insgnss.gnss.ionosphere import beidou_delay, ionosphere_above, klobuchar_delay

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
    whole = trapezoid(density, z)
    for h in (1e5, 3e5, 6e5):
        above = z >= (h - 350e3) / 80e3
        assert ionosphere_above(h) == pytest.approx(trapezoid(density[above], z[above]) / whole, abs=1e-4)


def beidou(lat: float, lon: float, azimuth: float, elevation: float, week_s: float, c: np.ndarray) -> float:
    one = [np.array([value]) for value in (lat, lon, azimuth, elevation, week_s)]
    return float(beidou_delay(c, *one)[0])


def beidou_by_hand(lat: float, lon: float, az: float, el: float, t: float, c: np.ndarray) -> float:
    """BDS-SIS-ICD B1I 3.0, 5.2.4.7, step by step in its own angles."""
    psi = math.pi / 2 - el - math.asin(6378.0 / (6378.0 + 375.0) * math.cos(el))
    phi = math.asin(math.sin(lat) * math.cos(psi) + math.cos(lat) * math.sin(psi) * math.cos(az))
    lam = lon + math.asin(math.sin(psi) * math.sin(az) / math.cos(phi))
    local = (t + lam * 43_200.0 / math.pi) % 86_400.0
    amplitude = max(sum(c[k] * abs(phi / math.pi) ** k for k in range(4)), 0.0)
    period = min(max(sum(c[4 + k] * abs(phi / math.pi) ** k for k in range(4)), 72_000.0), 172_800.0)
    vertical = 5e-9
    if abs(local - 50_400.0) < period / 4.0:
        vertical += amplitude * math.cos(2.0 * math.pi * (local - 50_400.0) / period)
    return 299_792_458.0 * vertical / math.sqrt(1.0 - (6378.0 / 6753.0 * math.cos(el)) ** 2)


BEIDOU = np.array([1.2107e-8, 1.3039e-7, -9.5367e-7, 1.6689e-6, 1.2288e5, -2.2938e5, 1.5073e6, 1.9661e6])


def test_beidou_delay_follows_the_steps_of_its_document(rng: np.random.Generator) -> None:
    for _ in range(500):
        lat, lon, az = rng.uniform(-1.2, 1.2), rng.uniform(-3.1, 3.1), rng.uniform(0.0, 6.28)
        el, t = rng.uniform(0.05, 1.57), rng.uniform(0.0, 604_800.0)
        ours = beidou(lat, lon, az, el, t, BEIDOU)
        assert ours == pytest.approx(beidou_by_hand(lat, lon, az, el, t, BEIDOU), rel=1e-9)


def test_beidou_delay_at_night_at_the_zenith_is_five_nanoseconds() -> None:
    assert beidou(0.5, 0.0, 0.0, math.pi / 2, 0.0, BEIDOU) == pytest.approx(5e-9 * 299_792_458.0, rel=1e-12)


def test_beidou_delay_is_finite_over_the_poles_and_below_the_horizon() -> None:
    for lat in (math.pi / 2, -math.pi / 2, 1.55):
        for az in np.arange(0.0, 6.28, 0.5):
            assert 1.0 < beidou(lat, 0.3, az, 0.1, 40_000.0, BEIDOU) < 60.0
    assert beidou(0.5, 0.0, 1.0, -0.4, 4e4, BEIDOU) == beidou(0.5, 0.0, 1.0, 0.0, 4e4, BEIDOU)


def test_beidou_longest_period_bounds_the_day() -> None:
    endless = BEIDOU.copy()
    endless[4:] = [9e5, 0.0, 0.0, 0.0]
    at_edge = [beidou(0.0, 0.0, 0.0, math.pi / 2, 50_400.0 + s, endless) for s in (-43_190.0, 0.0)]
    # at the edge of 172 800 s / 4 the cosine is zero
    assert at_edge[0] == pytest.approx(5e-9 * 299_792_458.0, rel=1e-3)
    assert at_edge[1] > 2.0 * at_edge[0]
