"""The optimal loop against the Riccati equation, quadrature of its frequency response, and Lyapunov's equation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, linalg

from insgnss.errors import ConfigError
from insgnss.interference.optimal_loop import (
    check_bandwidth_time,
    discrete_gains,
    discrete_noise_bandwidth,
    drift_variance,
    error_variance,
    gains,
    noise_bandwidth,
    noise_bandwidth_of_gains,
    noise_variance,
    one_sided,
    threshold_noise,
    two_sided,
)

DRIFTS = (0.1, 7.1144, 3167.0, 1e5)  # one-sided, rad^2/s^3: an oven oscillator to a very poor crystal
NOISE = 2.4e-3  # one-sided, rad^2/Hz: C/N0 of 26 dBHz


def riccati(S: float, S_n: float, S_f: float = 0.0) -> np.ndarray:
    """Return the steady covariance of (phase, frequency) by SciPy, from two-sided intensities."""
    F = np.array([[0.0, 1.0], [0.0, 0.0]])
    H = np.array([[1.0, 0.0]])
    return linalg.solve_continuous_are(F.T, H.T, np.diag([S_f / 2.0, S / 2.0]), np.array([[S_n / 2.0]]))


def response(f: float, K1: float, K2: float) -> complex:
    """Return phase estimate over phase measurement at a frequency in hertz."""
    p = 2j * math.pi * f
    return (K1 * p + K2) / (p * p + K1 * p + K2)


@pytest.mark.parametrize("S", DRIFTS)
def test_gains_are_those_of_the_riccati_equation(S: float) -> None:
    P = riccati(S, NOISE)
    K = P[:, 0] / (NOISE / 2.0)

    assert [float(k) for k in gains(S, NOISE)] == pytest.approx(K, rel=1e-9)
    assert float(error_variance(S, NOISE)) == pytest.approx(P[0, 0], rel=1e-9)


@pytest.mark.parametrize("S_f", [1e-3, 0.3, 20.0])
def test_error_with_white_frequency_noise_is_that_of_the_riccati_equation(S_f: float) -> None:
    assert float(error_variance(77.0, NOISE, S_f)) == pytest.approx(riccati(77.0, NOISE, S_f)[0, 0], rel=1e-9)


@pytest.mark.parametrize("S", DRIFTS)
def test_parts_of_the_error_are_the_integrals_of_the_response(S: float) -> None:
    K1, K2 = (float(k) for k in gains(S, NOISE))
    corner = math.sqrt(K2) / (2.0 * math.pi)

    def power(f: float) -> float:
        return abs(response(f, K1, K2)) ** 2

    def of_drift(f: float) -> float:
        # drift of one-sided density S, integrated twice, less what the loop follows
        return abs(S**0.5 * (1.0 - response(f, K1, K2)) / (2j * math.pi * f) ** 2) ** 2

    pieces = [(1e-9, corner), (corner, 30.0 * corner), (30.0 * corner, math.inf)]
    bandwidth = sum(integrate.quad(power, *piece, limit=200)[0] for piece in pieces)
    drift = sum(integrate.quad(of_drift, *piece, limit=200)[0] for piece in pieces)

    # the integral from 1e-9 Hz leaves out less than 1e-6 of either
    assert float(noise_bandwidth(S, NOISE)) == pytest.approx(bandwidth, rel=1e-6)
    assert float(noise_bandwidth_of_gains(K1, K2)) == pytest.approx(bandwidth, rel=1e-6)
    assert float(noise_variance(S, NOISE)) == pytest.approx(bandwidth * NOISE, rel=1e-6)
    assert float(drift_variance(S, NOISE)) == pytest.approx(drift, rel=1e-6)


def test_bandwidth_takes_the_fourth_root_not_the_printed_square_root() -> None:
    # 16 times the drift: twice the bandwidth
    assert float(noise_bandwidth(16.0, 1e-3) / noise_bandwidth(1.0, 1e-3)) == pytest.approx(2.0)


@pytest.mark.parametrize("T", [1e-3, 0.02, 0.3])
@pytest.mark.parametrize("S", DRIFTS)
def test_discrete_gains_are_those_of_the_discrete_riccati_equation(S: float, T: float) -> None:
    q, r = S / 2.0, NOISE / (2.0 * T)
    F, H = np.array([[1.0, T], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    Q = q * np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
    P = linalg.solve_discrete_are(F.T, H.T, Q, np.array([[r]]))
    K = P[:, 0] / (P[0, 0] + r)

    found = discrete_gains(S, NOISE, T)

    assert [float(found.alpha), float(found.beta) / T] == pytest.approx(K, rel=1e-7)


def test_discrete_gains_become_the_continuous_ones() -> None:
    T = 1e-5
    K1, K2 = gains(3167.0, NOISE)
    found = discrete_gains(3167.0, NOISE, T)

    # the first correction is of the order K1 T = 5e-4
    assert float(found.alpha) / T == pytest.approx(float(K1), rel=1e-3)
    assert float(found.beta) / T**2 == pytest.approx(float(K2), rel=1e-3)


@pytest.mark.parametrize("T", [1e-3, 0.02, 0.1])
def test_discrete_bandwidth_is_what_lyapunov_gives(T: float) -> None:
    found = discrete_gains(3167.0, NOISE, T)
    a, b = float(found.alpha), float(found.beta)
    K = np.array([[a], [b / T]])
    F, H = np.array([[1.0, T], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    A = (np.eye(2) - K @ H) @ F
    P = linalg.solve_discrete_lyapunov(A, K @ K.T)  # measurement noise of variance one

    # one-sided density of white samples of variance one: 2 T
    assert float(discrete_noise_bandwidth(found, T)) == pytest.approx(P[0, 0] / (2.0 * T), rel=1e-9)


@pytest.mark.parametrize("S_f", [0.0, 1e-4, 0.5, 500.0])
def test_threshold_is_where_the_error_reaches_it(S_f: float) -> None:
    rms = 0.2388  # 0.076 of 180 deg
    S = np.array(DRIFTS)
    noise = threshold_noise(S, rms, S_f)

    assert noise.shape == S.shape
    assert np.sqrt([riccati(s, n, S_f)[0, 0] for s, n in zip(S, noise, strict=True)]) == pytest.approx(
        rms, rel=1e-7
    )


def test_one_and_two_sided_densities_are_each_others_inverse() -> None:
    assert float(one_sided(two_sided(3.0))) == 3.0
    assert float(one_sided(1.0)) == 2.0


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
def test_impossible_densities_are_refused_with_advice(wrong: float) -> None:
    with pytest.raises(ConfigError) as caught:
        gains(wrong, NOISE)
    assert caught.value.key == "drift" and "one-sided" in caught.value.advice
    with pytest.raises(ConfigError, match="noise"):
        noise_bandwidth(1.0, wrong)


def test_loop_closed_too_rarely_is_refused_with_the_limit() -> None:
    check_bandwidth_time(18.0, 0.02)
    with pytest.raises(ConfigError, match=r"limit of 0\.5"):
        check_bandwidth_time(56.98, 0.02)
