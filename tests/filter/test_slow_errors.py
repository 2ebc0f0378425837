"""The kernels of the slow errors against the joint covariance of the state's error and of the errors themselves."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.filter.state import CLOCK, DR, MAX_SLOW, N_PATTERNS, OFFSETS, SlowErrors, no_slow_errors
from insgnss.filter.update.range_biases import forget_effect
from insgnss.filter.update.slow_errors import correct_by_row_without, correct_effect, correct_remainder, fade

N = OFFSETS + 2
HELD = np.array([DR, DR + 1, DR + 2, CLOCK, OFFSETS, OFFSETS + 1])
COLUMNS = np.array([DR, DR + 1, DR + 2, CLOCK, OFFSETS + 1])
N_ERRORS = 6


def rates(air_s: float, satellite_s: float) -> np.ndarray:
    """Return the filter's numbers with correlation times."""
    par = np.zeros(1, PARAMETERS_DTYPE)
    par["air_rate"], par["satellite_rate"] = 1.0 / air_s, 1.0 / satellite_s
    return par


def total(slow: SlowErrors) -> np.ndarray:
    return np.asarray(slow.S.T @ slow.S + slow.R)


def joint_step(joint: np.ndarray, h: np.ndarray, gain: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Return the joint covariance (N + MAX_SLOW) of e and b after e <- e + K (a b - h e)."""
    A = np.eye(N + MAX_SLOW)
    A[:N, :N] -= np.outer(gain, h)
    A[:N, N:] += np.outer(gain, load)
    return np.asarray(A @ joint @ A.T)


def joint_fade(joint: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Return it after the errors have changed as Gauss-Markov processes of unit variance."""
    A = np.diag(np.r_[np.ones(N), f])
    return np.asarray(A @ joint @ A.T + np.diag(np.r_[np.zeros(N), 1.0 - f**2]))


@pytest.mark.parametrize(("air_s", "satellite_s"), [(1e9, 1e9), (300.0, 20.0)])
def test_effects_are_those_of_the_joint_covariance(air_s: float, satellite_s: float) -> None:
    rng = np.random.default_rng(31)
    slow, par = no_slow_errors(N), rates(air_s, satellite_s)[0]
    joint = np.diag(np.r_[np.zeros(N), np.ones(MAX_SLOW)])
    time_s = np.where(np.arange(MAX_SLOW) < N_PATTERNS, air_s, satellite_s)
    for _ in range(40):
        dt = rng.uniform(0.1, 5.0)
        fade(slow, N_ERRORS, HELD, par, dt)
        joint = joint_fade(joint, np.where(np.arange(MAX_SLOW) < N_ERRORS, np.exp(-dt / time_s), 1.0))
        for _ in range(3):
            h, gain, load = rng.standard_normal(5), np.zeros(N), np.zeros(MAX_SLOW)
            gain[HELD] = 0.2 * rng.standard_normal(len(HELD))
            load[:N_ERRORS] = rng.standard_normal(N_ERRORS)
            row = np.zeros(N)
            row[COLUMNS] = h
            joint = joint_step(joint, row, gain, load)
            for i in range(N_ERRORS):
                correct_effect(slow.S[i], h, COLUMNS, HELD, gain, load[i])
            correct_remainder(slow.R, h, COLUMNS, HELD, gain, np.zeros(N))
        np.testing.assert_allclose(total(slow), joint[:N, :N], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(slow.S, joint[N:, :N], rtol=1e-9, atol=1e-9)


def test_own_row_corrects_as_a_row_without_errors() -> None:
    rng = np.random.default_rng(32)
    slow, other = no_slow_errors(N), no_slow_errors(N)
    slow.S[:N_ERRORS, HELD] = rng.standard_normal((N_ERRORS, len(HELD)))
    B = np.zeros((N, N))
    B[HELD] = rng.standard_normal((len(HELD), N))
    slow.R[:] = B @ B.T
    other.S[:], other.R[:] = slow.S, slow.R
    h, gain = rng.standard_normal(5), rng.standard_normal(N)
    correct_by_row_without(slow, N_ERRORS, h, COLUMNS, HELD, gain, np.zeros(N))
    A = np.eye(N)
    A[np.ix_(HELD, COLUMNS)] -= np.outer(gain[HELD], h)
    other.S[:], other.R[:] = other.S @ A.T, A @ other.R @ A.T
    np.testing.assert_allclose(slow.S, other.S, atol=1e-12)
    np.testing.assert_allclose(slow.R, other.R, atol=1e-12)


def test_forgotten_error_leaves_its_variance() -> None:
    rng = np.random.default_rng(33)
    slow = no_slow_errors(N)
    slow.S[:N_ERRORS, HELD] = rng.standard_normal((N_ERRORS, len(HELD)))
    before = total(slow)
    forget_effect(slow, 5, HELD)
    np.testing.assert_allclose(total(slow), before, atol=1e-12)
    assert not slow.S[5].any()
