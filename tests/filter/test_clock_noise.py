"""The noise of the clock's drift is learnt where the measurements are far noisier than the drift itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.filter.state import DRIFT_FACTOR, StateRecord, new_bank
from insgnss.filter.update.adaptation import follow_drift
from tests.filter.scene import parameters

DENSITY = 7e-7  # of an oven-controlled crystal's drift [m^2/s^3]
NOISE_MPS = 0.03  # of an epoch's range rates together
STEP_S = 0.1
INTERVAL = 10  # epochs between two judgements
GAIN = 1.0 / 30.0
END_EFFECTS = 0.25  # of a sum over four memories: the share that the estimate lags behind the drift


def follow(
    rng: np.random.Generator, declared: float, hours: float, noise_mps: float = NOISE_MPS
) -> tuple[StateRecord, float]:
    """Track a drift of ``DENSITY`` with an adapting Kalman filter; return its state and mean error over sigma squared.

    The filter is written out here for its one state: the factor is the package's.
    """
    m = new_bank(1, 0).state[0]
    par = parameters(clock_drift_density=declared, adapt_gain=GAIN, adapt_least=0.02, adapt_most=1e3)[0]
    drift = estimate = 0.0
    variance, r = 1.0, noise_mps**2
    squares = []
    for k in range(round(hours * 3600.0 / STEP_S)):
        drift += math.sqrt(DENSITY * STEP_S) * rng.standard_normal()
        prior = variance + m.noise_factor[DRIFT_FACTOR] * declared * STEP_S
        gain = prior / (prior + r)
        correction = gain * (drift + noise_mps * rng.standard_normal() - estimate)
        estimate += correction
        variance = (1.0 - gain) * prior
        m.drift_moved[0] += correction
        m.drift_moved[1] += prior - variance
        if k % INTERVAL == 0 and k > 100:
            follow_drift(m, par, variance, GAIN)
        if k * STEP_S > 600.0:
            squares.append((estimate - drift) ** 2 / variance)
    return m, float(np.mean(squares))


@pytest.mark.parametrize("declared_over_true", [0.1, 1.0, 10.0])
def test_factor_is_the_ratio_of_true_and_declared_noise(declared_over_true: float) -> None:
    """The mean over seeds of the factor's logarithm is that of true over declared noise."""
    found = [
        follow(np.random.default_rng(seed), declared_over_true * DENSITY, 1.5)[0] for seed in range(30, 34)
    ]
    ratios = [math.log(m.noise_factor[DRIFT_FACTOR] * declared_over_true) for m in found]
    # a factor forgets with GAIN a sum: the logarithm's sigma is sqrt(GAIN / 2 * Var(chi^2_1)) at most
    sigma = math.sqrt(0.5 * GAIN * 2.0)
    assert abs(np.mean(ratios)) < 3.3 * sigma / math.sqrt(len(ratios)) + END_EFFECTS
    assert np.std(ratios) < 2.0 * sigma


@pytest.mark.parametrize("declared_over_true", [1e-2, 1.0, 10.0])
def test_sigma_of_the_drift_is_honest(declared_over_true: float) -> None:
    """After ten minutes the squared error over variance is near one, whatever oscillator was declared.

    The median over seeds: an oscillator declared ten times too quiet in sigma may be found out later than that.
    """
    squares = [
        follow(np.random.default_rng(seed), declared_over_true * DENSITY, 0.5)[1] for seed in range(40, 45)
    ]
    assert 0.5 < np.median(squares) < 2.0
