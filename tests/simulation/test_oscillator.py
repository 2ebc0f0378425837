"""The simulated clock has the Allan deviation of its h-parameters, at any averaging time."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.config.flight import Oscillator
from insgnss.constants import C_MPS
from insgnss.simulation.oscillator import (
    MILLISECOND_M,
    ClockTruth,
    simulate_clock,
    with_clock_jump,
    with_millisecond_jumps,
)
from tests.statistics_bounds import assert_mean_chi_square

TCXO = Oscillator(h0_s=2e-19, h_minus2_per_s=2e-20)
STEADY = Oscillator(h0_s=0.0, h_minus2_per_s=0.0)


@pytest.mark.parametrize("h", [(2e-19, 0.0), (0.0, 2e-20), (2e-19, 2e-20)])
@pytest.mark.parametrize("tau_s", [0.1, 1.0, 30.0])
def test_allan_deviation_follows_from_the_h_parameters(
    tau_s: float, h: tuple[float, float], rng: np.random.Generator
) -> None:
    oscillator = Oscillator(h0_s=h[0], h_minus2_per_s=h[1])
    tags = np.array([0.0, tau_s, 2.0 * tau_s])
    runs = np.array([simulate_clock(oscillator, tags, rng, drift_mps=50.0).bias_m for _ in range(2000)])
    second = (runs[:, 2] - 2.0 * runs[:, 1] + runs[:, 0]) / C_MPS
    allan = h[0] / (2.0 * tau_s) + 2.0 * np.pi**2 / 3.0 * h[1] * tau_s  # sigma_y^2, IEEE 1139, table B.2
    assert_mean_chi_square(second**2 / (2.0 * tau_s**2 * allan), 1)


def test_one_step_and_many_steps_have_the_same_spread(rng: np.random.Generator) -> None:
    coarse, fine = np.array([0.0, 10.0]), np.linspace(0.0, 10.0, 21)
    one = np.array([_end(simulate_clock(TCXO, coarse, rng)) for _ in range(2000)])
    many = np.array([_end(simulate_clock(TCXO, fine, rng)) for _ in range(2000)])
    # drift: S T; bias: S_b T + S_d T^3 / 3
    s_b, s_d = C_MPS**2 * 2e-19 / 2.0, C_MPS**2 * 2.0 * np.pi**2 * 2e-20
    covariance = np.array([[s_b * 10.0 + s_d * 1000.0 / 3.0, s_d * 50.0], [s_d * 50.0, s_d * 10.0]])
    for ends in (one, many):
        assert_mean_chi_square(np.einsum("ki,ij,kj->k", ends, np.linalg.inv(covariance), ends), 2)


def _end(clock: ClockTruth) -> tuple[float, float]:
    return clock.bias_m[-1], clock.drift_mps[-1]


def test_a_steady_clock_runs_straight_on(rng: np.random.Generator) -> None:
    clock = simulate_clock(STEADY, np.arange(100.0), rng, bias_m=1000.0, drift_mps=50.0)
    assert clock.bias_m == pytest.approx(1000.0 + 50.0 * np.arange(100.0))
    assert clock.true_s == pytest.approx(np.arange(100.0) - clock.bias_m / C_MPS, abs=1e-15)


def test_the_receiver_realigns_its_clock_by_whole_milliseconds(rng: np.random.Generator) -> None:
    tags = np.arange(0.0, 5000.0, 10.0)
    free = simulate_clock(STEADY, tags, rng, drift_mps=300.0)
    held = with_millisecond_jumps(free, 0.5 * MILLISECOND_M)
    assert np.max(np.abs(held.bias_m)) <= 0.5 * MILLISECOND_M
    steps = np.diff(held.bias_m - free.bias_m) / MILLISECOND_M
    assert steps == pytest.approx(np.rint(steps), abs=1e-9)
    assert np.count_nonzero(np.rint(steps)) == 5  # 1500 km of drift, the first step after half a millisecond
    assert np.array_equal(held.drift_mps, free.drift_mps)


def test_a_single_jump_stays(rng: np.random.Generator) -> None:
    clock = with_clock_jump(simulate_clock(STEADY, np.arange(10.0), rng), 4.0, 123.0)
    assert np.array_equal(clock.bias_m, np.where(np.arange(10) >= 4, 123.0, 0.0))
