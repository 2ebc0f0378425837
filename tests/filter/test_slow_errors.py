"""The kernels of the slow errors against the joint covariance of the state's error and of the errors themselves."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.filter.rows.lines import GAIN_ROWS, EpochWorkspace
from insgnss.filter.state import (
    CLOCK,
    DR,
    MAX_SLOW,
    N_OF_SATELLITE,
    N_PATTERNS,
    OFFSETS,
    Bank,
    SlowErrors,
    no_slow_errors,
)
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.range_biases import forget_effect
from insgnss.filter.update.satellite_memory import RANGE_S, REFLECTION, REFLECTION_VARIANCE
from insgnss.filter.update.slow_errors import correct_by_row_without, follow_slow_errors, place_slow_variances
from insgnss.gnss.observation_rows import CARRIER, N_KINDS, PSEUDORANGE, GnssRows
from insgnss.status import GATED, USED
from tests.filter.scene import START_NS, new_filter, parameters, perfect_rows, place, sky

N = OFFSETS + 2
HELD = np.array([DR, DR + 1, DR + 2, CLOCK, OFFSETS, OFFSETS + 1])
COLUMNS = np.array([DR, DR + 1, DR + 2, CLOCK, OFFSETS + 1])
NOISE_OF_MEAN = 0.1  # of the variance of a row
N_ERRORS = N_PATTERNS + 2 * N_OF_SATELLITE


def rates(air_s: float, satellite_s: float, reflection_s: float) -> np.ndarray:
    """Return the filter's numbers with correlation times."""
    par = np.zeros(1, PARAMETERS_DTYPE)
    par["air_rate"], par["satellite_rate"] = 1.0 / air_s, 1.0 / satellite_s
    par["reflection_rate"] = 1.0 / reflection_s
    par["n_held"], par["held"][0, : len(HELD)], par["at_clone"] = len(HELD), HELD, -1
    return par


def reflect(bank: Bank, log: GnssRows, s: EpochWorkspace, size_m: np.ndarray) -> np.ndarray:
    """Let the pseudoranges of the first epoch have been off by so much beyond noise and slow error; return what counts.

    Each counts at least as much as the mean square of the followed ones, less two sigmas of that mean.
    """
    k, followed = len(size_m), s.lines["bias"] > 0
    variance = s.lines["variance"][:, PSEUDORANGE] = 4.0 + np.arange(k)
    memory, noise = bank.memory[0], NOISE_OF_MEAN * variance
    memory[log.observation["slot"], RANGE_S] = log.epoch_ns[0] * 1e-9
    stated2 = log.observation["bias_sigma"].astype(np.float64) ** 2
    square = np.where(size_m != 0.0, size_m**2 + stated2 + 4.0 * noise, 0.0)
    memory[log.observation["slot"], REFLECTION] = np.copysign(np.sqrt(square), size_m)
    memory[log.observation["slot"], REFLECTION_VARIANCE] = NOISE_OF_MEAN
    beyond = 1.0 + 2.0 * np.sqrt(2.0 / max(followed.sum() - 4, 1))
    of_all = np.mean((square - stated2 - beyond * noise)[followed]) if followed.any() else 0.0
    return np.copysign(np.sqrt(np.maximum(size_m**2, max(of_all, 0.0))), size_m)


def total(slow: SlowErrors) -> np.ndarray:
    return np.asarray(slow.S.T @ slow.S + slow.R)


def joint_step(joint: np.ndarray, h: np.ndarray, gain: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Return the joint covariance (N + MAX_SLOW) of e and b after e <- e + K (a b - h e)."""
    of_rows, moved = joint[:N].T @ -h + joint[N:].T @ load, np.r_[gain, np.zeros(MAX_SLOW)]
    both = np.outer(moved, of_rows + 0.5 * (of_rows[N:] @ load - of_rows[:N] @ h) * moved)
    return np.asarray(joint + both + both.T)


def joint_fade(joint: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Return it after the errors have changed as Gauss-Markov processes of unit variance."""
    kept = np.r_[np.ones(N), f]
    return np.asarray(kept[:, None] * joint * kept + np.diag(np.r_[np.zeros(N), 1.0 - f**2]))


@pytest.mark.parametrize(
    ("air_s", "satellite_s", "reflection_s"), [(1e9, 1e9, 1e9), (300.0, 20.0, 5.0)], ids=("lasting", "fading")
)
def test_effects_are_those_of_the_joint_covariance(
    air_s: float, satellite_s: float, reflection_s: float
) -> None:
    """Over forty epochs of pseudoranges and carrier differences, used and refused, of any gains and loads."""
    rng = np.random.default_rng(31)
    bank = new_filter(place(), offsets=(0.0, 0.0))
    bank.head["n_slow"] = N_ERRORS
    log = perfect_rows(bank, parameters(), [START_NS], sky(place()))
    log.observation["slot"] = np.arange(len(log.sat))
    s, k, par = new_epoch(len(log.sat), N), len(log.sat), rates(air_s, satellite_s, reflection_s)[0]
    joint = np.diag(np.r_[np.zeros(N), np.ones(MAX_SLOW)])
    time_s = np.r_[np.full(N_PATTERNS, air_s), np.tile([satellite_s, reflection_s], MAX_SLOW // 2)][:MAX_SLOW]
    s.lines["columns"][:, :, :5], s.lines["count"] = COLUMNS, 5
    for _ in range(40):
        dt = rng.uniform(0.1, 5.0)
        joint = joint_fade(joint, np.where(np.arange(MAX_SLOW) < N_ERRORS, np.exp(-dt / time_s), 1.0))
        s.lines["h"], s.lines["load"] = rng.normal(size=s.lines["h"].shape), rng.normal(size=(k, N_PATTERNS))
        s.lines["bias"], s.lines["status"] = rng.integers(0, 3, k), rng.choice([USED, GATED], (k, N_KINDS))
        s.vectors[:] = 0.0
        s.vectors[GAIN_ROWS:, HELD] = 0.1 * rng.normal(size=(2 * k, len(HELD)))
        log.observation["bias_sigma"] = rng.uniform(0.1, 2.0, k)
        reflected = reflect(bank, log, s, rng.choice([0.0, 8.0, -8.0], k))
        for kind, at in ((PSEUDORANGE, 0), (CARRIER, 1)):
            for j in np.flatnonzero(s.lines["status"][:, kind] == USED):
                row, load = np.zeros(N), np.zeros(MAX_SLOW)
                row[COLUMNS] = s.lines["h"][j, kind, :5]
                if kind == PSEUDORANGE:
                    load[:N_PATTERNS] = s.lines["load"][j]
                    if s.lines["bias"][j]:
                        own = N_PATTERNS + N_OF_SATELLITE * (s.lines["bias"][j] - 1)
                        load[own], load[own + 1] = log.observation["bias_sigma"][j], reflected[j]
                joint = joint_step(joint, row, s.vectors[GAIN_ROWS + 2 * j + at], load)
        follow_slow_errors(bank, 0, par, log, 0, dt, s)
        np.testing.assert_allclose(total(bank.slow), joint[:N, :N], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(bank.slow.S, joint[N:, :N], rtol=1e-9, atol=1e-9)


def test_what_the_state_has_taken_is_in_the_variance_of_an_innovation() -> None:
    """Errors of message and air as far as they are not taken; beside them what reflections and the past have done."""
    rng = np.random.default_rng(34)
    bank = new_filter(place(), offsets=(0.0, 0.0))
    bank.head["n_slow"] = N_ERRORS
    log = perfect_rows(bank, parameters(), [START_NS], sky(place()))
    log.observation["slot"], log.observation["bias_sigma"] = np.arange(len(log.sat)), 0.6
    par, s, k = rates(1e9, 1e9, 1e9)[0], new_epoch(len(log.sat), N), len(log.sat)
    bank.slow.S[:N_ERRORS, HELD] = rng.standard_normal((N_ERRORS, len(HELD)))
    bank.slow.R[np.ix_(HELD, HELD)] = np.diag(rng.uniform(1.0, 9.0, len(HELD)))
    s.lines["columns"][:, :, :5], s.lines["count"] = COLUMNS, 5
    s.lines["h"], s.lines["bias"] = rng.normal(size=s.lines["h"].shape), 1 + np.arange(k) % 2
    s.lines["status"] = USED
    s.lines["u_n"] = np.array([0.6, 0.0, -0.8])
    size = reflect(bank, log, s, np.resize([0.0, 1.0, -20.0], k))
    place_slow_variances(bank, 0, par, log, 0, s.lines)
    number = np.arange(N_ERRORS) - N_PATTERNS
    reflected = (number >= 0) & (number % N_OF_SATELLITE == 1)
    for j in range(k):
        row, load = np.zeros(N), np.zeros(N_ERRORS)
        row[COLUMNS] = s.lines["h"][j, PSEUDORANGE, :5]
        at = N_PATTERNS + N_OF_SATELLITE * (s.lines["bias"][j] - 1)
        load[:N_PATTERNS], load[at], load[at + 1] = (
            s.lines["load"][j],
            log.observation["bias_sigma"][j],
            size[j],
        )
        left = (load - bank.slow.S[:N_ERRORS] @ row) ** 2
        of_row = np.minimum(load**2, s.lines["variance"][j, PSEUDORANGE])
        taken = row @ bank.slow.R @ row + np.maximum(left - of_row, 0.0)[reflected].sum()
        assert s.lines["slow"][j] == pytest.approx(left[~reflected].sum())
        assert s.lines["astray"][j] == pytest.approx(taken)
    several = bank._replace(state=np.repeat(bank.state, 2))
    place_slow_variances(several, 0, par, log, 0, s.lines)
    assert not s.lines["astray"].any()


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
