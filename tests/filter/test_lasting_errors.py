"""The filter finds for how many epochs the errors of range rates and carrier differences last."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.supposed_faults import with_errors_that_last
from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.filter.state import OFFSETS, new_bank
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.epoch_update import spread_of
from insgnss.filter.update.lasting_errors import epochs_of_an_error, follow_lasting_errors
from insgnss.gnss.observation_rows import CARRIER, N_BANDS, OBSERVATION_DTYPE, PSEUDORANGE, RANGE_RATE
from insgnss.status import USED
from insgnss.tables import Float64
from tests.filter.scene import geometry

SIGMA, ASSUMED_S, MEAN_S = 0.05, 3.0, 5.0


class Receiver:
    """``n`` satellites all over the sky and a prior of 10 m/s, which leaves all but four numbers an epoch to see."""

    def __init__(self, n: int = 12, assumed_s: float = ASSUMED_S) -> None:
        self.par = np.zeros(1, PARAMETERS_DTYPE)[0]
        self.par["rate_error_s"] = assumed_s
        self.bank = new_bank(1, 0)
        self.P = 100.0 * np.eye(OFFSETS)
        self.work = new_epoch(n, OFFSETS)
        self.observation = np.zeros(n, OBSERVATION_DTYPE)
        self.observation["slot"] = np.arange(n) * N_BANDS
        self.G = geometry(2.4 * np.arange(n), np.arcsin(0.1 + 0.85 * (np.arange(n) % 5) / 4.0))

    def see(self, error: Float64, t_s: float, kind: int = RANGE_RATE) -> None:
        """Take an epoch with the errors (n,) in m/s of its rows."""
        lines = self.work.lines
        lines["status"][:, kind] = USED
        lines["innovation"][:, kind], lines["variance"][:, kind] = error, SIGMA**2
        lines["h"][:, kind, 3:6] = self.G[:, :3]
        lines["h"][:, kind, :3] = self.G[:, :3]
        follow_lasting_errors(
            self.bank.state[0],
            self.P,
            self.bank.memory[0],
            self.work,
            self.observation,
            kind,
            round(t_s * NS_PER_S),
            self.par,
        )

    def epochs(self, interval_s: float, kind: int = RANGE_RATE) -> float:
        """Return for how many epochs an error is taken to last."""
        return float(epochs_of_an_error(self.bank.state[0], self.par, kind, interval_s))


def found(correlation_s: float, interval_s: float, seeds: range, kind: int = RANGE_RATE) -> float:
    """Return the mean over seeds of what three minutes of errors with that correlation time show."""
    values, keep = [], math.exp(-interval_s / correlation_s) if correlation_s > 0.0 else 0.0
    for seed in seeds:
        receiver, rng = Receiver(), np.random.default_rng(seed)
        error = rng.normal(0.0, SIGMA, 12)
        for k in range(round(180.0 / interval_s)):
            receiver.see(error, 1000.0 + k * interval_s, kind)
            error = keep * error + rng.normal(0.0, SIGMA * math.sqrt(1.0 - keep**2), 12)
        values.append(receiver.epochs(interval_s, kind))
    return float(np.mean(values))


def of_a_mean(correlation_s: float, interval_s: float) -> float:
    """Return how many times as large as for new errors the variance of a five-second mean is, for Gauss-Markov errors.

    Equation: (1 + a b) / (1 - a b), a = exp(-T / correlation time), b = exp(-T / 5 s)
    """
    ab = math.exp(-interval_s / correlation_s - interval_s / MEAN_S)
    return (1.0 + ab) / (1.0 - ab)


@pytest.mark.parametrize("kind", [RANGE_RATE, CARRIER])
@pytest.mark.parametrize(("correlation_s", "interval_s"), [(1.0, 1.0), (3.0, 1.0), (3.0, 0.5)])
def test_errors_that_last_are_found(kind: int, correlation_s: float, interval_s: float) -> None:
    expected = of_a_mean(correlation_s, interval_s)
    assert found(correlation_s, interval_s, range(8100, 8116), kind) == pytest.approx(expected, rel=0.12)


@pytest.mark.parametrize("interval_s", [1.0, 0.2])
def test_errors_that_are_new_in_each_epoch_keep_their_weight(interval_s: float) -> None:
    """After three minutes; what was assumed has faded, the noise of the estimate cannot fall below one."""
    assert 1.0 <= found(0.0, interval_s, range(8200, 8208)) < 1.15


def test_until_residuals_show_it_errors_last_for_three_seconds() -> None:
    receiver = Receiver()
    assert receiver.epochs(1.0) == 3.0
    assert receiver.epochs(0.1) == pytest.approx(30.0)
    assert receiver.epochs(10.0) == 1.0
    rng = np.random.default_rng(8300)
    values = []
    for k in range(60):
        receiver.see(rng.normal(0.0, SIGMA, 12), 1000.0 + k)
        values.append(receiver.epochs(1.0))
    assert values[0] == 3.0
    assert values[4] > 1.2
    assert values[-1] < 1.5


def test_three_satellites_show_nothing() -> None:
    receiver = Receiver(3)
    for k in range(30):
        receiver.see(np.zeros(3), 1000.0 + k, CARRIER)
    assert receiver.epochs(1.0, CARRIER) == 3.0


def test_error_common_to_all_shows_nothing() -> None:
    """It is the velocity's or the clock's, whatever it is."""
    receiver, rng = Receiver(), np.random.default_rng(8400)
    for k in range(120):
        receiver.see(rng.normal(0.0, SIGMA, 12) + receiver.G @ [3.0, -2.0, 1.0, 5.0], 1000.0 + k)
    assert receiver.epochs(1.0) < 1.4


def test_error_of_any_size_counts_three_sigmas() -> None:
    """One reflection of four seconds is learnt, and another minute of the others makes up for most of it."""
    receiver, rng = Receiver(), np.random.default_rng(8500)
    values = []
    for k in range(120):
        error = rng.normal(0.0, SIGMA, 12)
        error[3] += 1e6 * (60 <= k < 64)
        receiver.see(error, 1000.0 + k)
        values.append(receiver.epochs(1.0))
    assert 2.0 < max(values[60:]) < 3.5
    assert values[-1] < 1.8


def test_switched_off_each_error_is_new() -> None:
    receiver = Receiver(assumed_s=0.0)
    for k in range(20):
        receiver.see(np.full(12, 0.2) * (-1.0) ** np.arange(12), 1000.0 + k)
    assert receiver.epochs(1.0) == 1.0
    assert Receiver().epochs(0.1, PSEUDORANGE) == 1.0


def test_look_back_counts_errors_as_the_filter_has_found_them_and_learns_nothing_more() -> None:
    """Whatever an explanation leaves out: only so do the likelihoods of two of them compare."""
    receiver, rng = Receiver(), np.random.default_rng(8600)
    error = np.zeros(12)
    for k in range(60):
        error = rng.normal(0.0, SIGMA, 12) if k % 4 == 0 else error
        receiver.see(error, 1000.0 + k)
    shown = receiver.epochs(1.0)
    assert shown > 1.3
    receiver.bank.head["epoch_step_ns"] = NS_PER_S
    parameters = np.array([receiver.par], PARAMETERS_DTYPE)
    parameters["kind"]["correlation"][0, PSEUDORANGE] = 2.5
    fixed = with_errors_that_last(parameters, receiver.bank)[0]

    state = receiver.bank.state[0]
    assert spread_of(state, fixed, RANGE_RATE, 1.0) == shown
    assert spread_of(state, fixed, CARRIER, 1.0) == ASSUMED_S
    assert spread_of(state, fixed, PSEUDORANGE, 1.0) == 2.5
    assert receiver.par["rate_error_s"] == ASSUMED_S  # the filter's own go on
    receiver.par = fixed
    receiver.see(np.full(12, 0.1) * (-1.0) ** np.arange(12), 1060.0)
    assert spread_of(state, fixed, RANGE_RATE, 1.0) == shown
