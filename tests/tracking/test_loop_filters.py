"""Loop filters: bandwidths by formula, by integration of the response and by simulated noise; limits of B T."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, linalg

from insgnss.errors import ConfigError
from insgnss.tracking.loop_filters import (
    LARGEST_BT,
    LoopFilter,
    assisted_filter,
    continuous_bandwidth_hz,
    continuous_gains,
    digital_filter,
    filter_from_continuous,
    transition,
)

T = 1e-3


@pytest.mark.parametrize("order", [1, 2, 3])
def test_continuous_bandwidth_equals_the_integral_of_the_response(order: int) -> None:
    K = continuous_gains(order, 12.0)

    def power(w: float) -> float:
        s = 1j * w
        denominator = np.polyval([1.0, *K], s)
        return float(abs(1.0 - s**order / denominator) ** 2)

    area = integrate.quad(power, 0.0, 2e3, limit=500)[0] + integrate.quad(power, 2e3, np.inf, limit=500)[0]
    assert area / (2.0 * math.pi) == pytest.approx(12.0, rel=1e-6)  # (11) of Shatilov 2009


def test_second_order_optimum_has_the_bandwidth_of_the_paper() -> None:
    K1, K2 = continuous_gains(2, 1.0)
    assert K1**2 == pytest.approx(2.0 * K2)  # (10)
    assert 3.0 * math.sqrt(K2) / (4.0 * math.sqrt(2.0)) == pytest.approx(1.0)  # (12)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_continuous_optimum_is_the_steady_filter_of_its_riccati_equation(order: int) -> None:
    F = np.diag(np.ones(order - 1), 1)
    H = np.zeros((1, order))
    H[0, 0] = 1.0
    Q = np.zeros((order, order))
    Q[-1, -1] = 7.0
    P = linalg.solve_continuous_are(F.T, H.T, Q, np.eye(1))
    K = continuous_gains(order, continuous_bandwidth_hz(P[:, 0]))
    assert P[:, 0] == pytest.approx(K, rel=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("bandwidth", [0.05, 5.0, 80.0, 400.0])
def test_digital_loop_has_the_bandwidth_asked_for(order: int, bandwidth: float) -> None:
    loop = digital_filter(order, bandwidth, T)
    f = np.fft.fftfreq(2**18, T)  # the response is periodic: its mean square over all frequencies, one-sided
    two_sided = np.mean(np.abs(loop.response(f)) ** 2) / T
    assert loop.noise_bandwidth_hz() == pytest.approx(bandwidth, rel=1e-8)
    # lines of 4 mHz across a loop of 50 mHz: 0.05 % there
    assert two_sided / 2.0 == pytest.approx(bandwidth, rel=2e-3 if bandwidth < 1.0 else 1e-8)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_digital_loop_becomes_the_continuous_one_for_small_steps(order: int) -> None:
    loop, K = digital_filter(order, 0.2, T), continuous_gains(order, 0.2)
    assert loop.gains / T == pytest.approx(K, rel=2e-3)  # of the order B T


@pytest.mark.parametrize("order", [1, 2, 3])
def test_digital_loop_at_its_limit_is_deadbeat(order: int) -> None:
    loop = digital_filter(order, 0.9989 * LARGEST_BT[order] / T, T)
    assert loop.closed_loop() @ loop.closed_loop() @ loop.closed_loop() == pytest.approx(
        np.zeros((order, order)), abs=3e-3 / T ** (order - 1)
    )
    # of the extrapolation through the last values
    coefficients = {1: [1.0], 2: [2.0, -1.0], 3: [3.0, -3.0, 1.0]}[order]
    assert np.sum(np.square(coefficients)) / 2.0 == LARGEST_BT[order]


def test_noise_bandwidth_is_what_simulated_noise_gives(rng: np.random.Generator) -> None:
    loop = digital_filter(3, 40.0, T)
    F, x, n = transition(3, T), np.zeros((3, 400)), 4000
    found = np.empty((n, 400))
    for k in range(n):
        found[k] = x[0]
        x = F @ (x + loop.gains[:, None] * (rng.standard_normal(400) - x[0]))
    # 400 runs of 3.9 s, values correlated over 1 / (2 B): 400 3.9 80 = 125 000 independent ones: 4 sigma of a variance
    assert found[100:].var() / (2.0 * T) == pytest.approx(40.0, rel=4.0 * math.sqrt(2.0 / 125_000))


def test_held_continuous_gains_have_a_larger_bandwidth_than_they_say() -> None:
    loop = filter_from_continuous(continuous_gains(2, 100.0), T)
    assert loop.noise_bandwidth_hz() == pytest.approx(121.76, abs=0.01)


@pytest.mark.parametrize(("order", "limit"), [(1, 0.5), (2, 0.549), (3, 0.610)])
def test_held_gains_that_are_unstable_are_refused_with_the_limit(order: int, limit: float) -> None:
    with pytest.raises(ConfigError, match=f"unstable above {limit}"):
        filter_from_continuous(continuous_gains(order, 1000.0), T)
    filter_from_continuous(continuous_gains(order, 0.99 * limit / T), T)
    with pytest.raises(ConfigError, match="unstable"):
        filter_from_continuous(continuous_gains(order, 1.01 * limit / T), T)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_bandwidth_beyond_any_digital_loop_is_refused_with_the_limit(order: int) -> None:
    with pytest.raises(
        ConfigError, match=f"B T = 10 is too large: the limit for order {order} is {LARGEST_BT[order]}"
    ):
        digital_filter(order, 1e4, T)
    with pytest.raises(ConfigError, match="too small"):
        digital_filter(order, 1e-6, T)


@pytest.mark.parametrize(
    "make",
    [
        lambda: digital_filter(4, 10.0, T),
        lambda: digital_filter(2, -1.0, T),
        lambda: digital_filter(2, math.nan, T),
        lambda: continuous_gains(3, 10.0, damping=0.7),
        lambda: continuous_gains(2, 10.0, damping=0.0),
        lambda: continuous_bandwidth_hz([1.0, 1.0, 2.0]),
        lambda: assisted_filter(1, 10.0, 2.0, T),
        lambda: assisted_filter(2, 10.0, -2.0, T),
    ],
)
def test_senseless_loops_are_refused(make: object) -> None:
    with pytest.raises(ConfigError) as caught:
        make()  # type: ignore[operator]
    assert caught.value.key and caught.value.advice


def test_damping_changes_the_shape_and_keeps_the_bandwidth() -> None:
    K = continuous_gains(2, 10.0, damping=1.0)
    assert K[0] ** 2 == pytest.approx(4.0 * K[1])
    assert continuous_bandwidth_hz(K) == pytest.approx(10.0)


def test_assistance_of_no_bandwidth_is_none() -> None:
    assert np.array_equal(assisted_filter(3, 15.0, 0.0, T).gains, digital_filter(3, 15.0, T).gains)


def test_assisted_loop_answers_a_phase_as_its_recursion_does() -> None:
    loop, F = assisted_filter(3, 15.0, 10.0, T), transition(3, T)
    t = T * np.arange(4000)
    for frequency in (2.0, 11.0, 60.0):
        phase = np.exp(2j * np.pi * frequency * t)
        x, found = np.zeros(3, complex), np.empty(len(t), complex)
        before = phase[0]
        for k, y in enumerate(phase):
            found[k] = x[0]
            innovation = y - x[0]
            rate = (y - before) / T - x[1]
            x, before = F @ (x + loop.gains * innovation + loop.rate_gains * rate), y
        assert found[-1] / phase[-1] == pytest.approx(complex(loop.response(frequency)), abs=1e-9)
    assert loop.noise_bandwidth_hz() > digital_filter(3, 15.0, T).noise_bandwidth_hz()


def test_unstable_gains_are_seen() -> None:
    assert not LoopFilter(np.array([2.1]), np.zeros(1), T).is_stable()
