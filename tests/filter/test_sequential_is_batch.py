"""One scalar at a time gives what all rows at once give, in any order, with any number of satellites."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.filter.loop import DONE
from insgnss.filter.state import OFFSETS, Bank, copy_bank
from insgnss.gnss.observation_rows import ABSENT, GnssRows
from insgnss.status import GATED, USED
from insgnss.tables import Float64
from tests.filter.scene import (
    START_NS,
    Result,
    attitude,
    dense_rows,
    new_filter,
    observed,
    parameters,
    perfect_rows,
    place,
    sky,
    update,
)

N = OFFSETS + 1
LEVER_B = (1.5, -0.5, -2.0)
W_IB_B = np.array([0.2, -0.1, 0.4])
GROUP = [0, 1] * 6


def prior(rng: np.random.Generator) -> Bank:
    """Return a filter one sigma or so beside the truth of ``log_of``, all states correlated."""
    at = place()
    bank = new_filter(at, v_n=(30.0, -20.0, 1.0), C_eb=attitude(at, 10.0, 5.0, 70.0), offsets=(15.0,))
    sigma = np.sqrt(np.diag(bank.P[0]))
    mixed = rng.normal(size=(N, 3 * N))
    shape = mixed @ mixed.T
    unit = np.sqrt(np.diag(shape))
    bank.P[0] = shape / np.outer(unit, unit) * np.outer(sigma, sigma)
    bank.P[0] = 0.5 * (bank.P[0] + bank.P[0].T)
    return bank


def log_of(bank: Bank, rng: np.random.Generator, n_satellites: int = 12) -> GnssRows:
    """Return one epoch of rows about a truth beside the filter."""
    at, truth = place(), copy_bank(bank)
    truth.state["r_e"] += rng.normal(size=3)
    truth.state["v_e"] += 0.1 * rng.normal(size=3)
    group = GROUP[:n_satellites]
    par = parameters(LEVER_B)
    log = perfect_rows(truth, par, [START_NS], sky(at)[:n_satellites], w_ib_b=W_IB_B, group=group)
    log.observation["value"] += rng.normal(size=(n_satellites, 2)) * [1.0, 0.05]
    return log


def batch(bank: Bank, par: npt.NDArray[Any], log: GnssRows) -> tuple[Float64, Float64]:
    """Return correction and covariance of the textbook update with all rows at once.

    Equation: K = P H^T (H P H^T + R)^-1, x = K y, P = (I - K H) P (I - K H)^T + K R K^T      [Groves 2013, 3.2]
    """
    work = observed(bank, par, log, w_ib_b=W_IB_B)
    used = (work.lines["status"][:, :2] == USED).T.ravel()
    H = dense_rows(work, N).reshape(-1, N)[used]
    y, R = (
        work.lines["innovation"][:, :2].T.ravel()[used],
        np.diag(work.lines["variance"][:, :2].T.ravel()[used]),
    )
    P = bank.P[0]
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(N) - K @ H
    return K @ y, left @ P @ left.T + K @ R @ K.T


def correction(result: Result) -> Float64:
    """Return what the epoch added to the state, before it was fed back."""
    return result.work.epoch.vectors[0][:N].copy()


def apart(result: Result, bank: Bank, x: Float64, P: Float64) -> tuple[float, float]:
    """Return the largest difference of the correction [sigma] and of the covariance [sqrt(Pii Pjj)]."""
    sigma = np.sqrt(np.diag(P))
    of_P = np.abs(bank.P[0] - P) / np.outer(sigma, sigma)
    return float(np.max(np.abs(correction(result) - x) / sigma)), float(np.max(of_P))


@pytest.mark.parametrize("n_satellites", [12, 4, 3, 2, 1])
def test_sequential_update_equals_the_batch_update(rng: np.random.Generator, n_satellites: int) -> None:
    par = parameters(LEVER_B)
    for _ in range(10):
        bank = prior(rng)
        log = log_of(bank, rng, n_satellites)
        x, P = batch(bank, par, log)

        result = update(bank, log, par, W_IB_B)

        assert result.code == DONE
        assert np.all(result.out.ledger["status"] == USED)
        # the clock's variance falls from 1e4 to 0.1 m^2, which costs five digits of sixteen: reached 8e-12 and 5e-13
        of_x, of_P = apart(result, bank, x, P)
        assert of_x < 1e-10
        assert of_P < 1e-11


def test_order_of_the_rows_matters_by_rounding_only(rng: np.random.Generator) -> None:
    """Two satellites are wrong: by the same prior the same ones are refused, wherever they stand."""
    par, first = parameters(LEVER_B), prior(rng)
    log = log_of(first, rng)
    log.observation["value"][3, 0] += 5000.0
    log.observation["value"][8, 1] -= 30.0
    second = copy_bank(first)
    one = update(first, log, par, W_IB_B)
    sigma = np.sqrt(np.diag(first.P[0]))
    for _ in range(10):
        order, bank = rng.permutation(12), copy_bank(second)
        other = update(
            bank, log._replace(observation=log.observation[order], sat=log.sat[order]), par, W_IB_B
        )

        assert np.array_equal(other.out.ledger["status"], one.out.ledger["status"][order])
        # reached 1e-12 sigma
        assert np.max(np.abs(correction(other) - correction(one)) / sigma) < 1e-10
        assert np.max(np.abs(bank.P[0] - first.P[0]) / np.outer(sigma, sigma)) < 1e-10
    assert one.out.ledger["status"][3].tolist() == [GATED, USED]
    assert one.out.ledger["status"][8].tolist() == [USED, GATED]


def test_absent_and_refused_rows_are_skipped_as_if_the_log_had_none(rng: np.random.Generator) -> None:
    """Bit for bit: an absent range, an absent rate and a wrong range leave no trace in the filter."""
    par, bank = parameters(LEVER_B), prior(rng)
    log = log_of(bank, rng)
    log.observation["status"][2, 0] = ABSENT
    log.observation["status"][5, 1] = ABSENT
    log.observation["value"][7, 0] += 5000.0
    log.observation["value"][7, 1] += 50.0
    without, other = log._replace(first=np.array([0, 11])), copy_bank(bank)
    kept = np.delete(np.arange(12), 7)
    without = without._replace(observation=log.observation[kept], sat=log.sat[kept])

    one, two = update(bank, log, par, W_IB_B), update(other, without, par, W_IB_B)

    assert one.out.ledger["status"][7].tolist() == [GATED, GATED]
    assert np.array_equal(correction(one), correction(two))
    assert np.array_equal(bank.P, other.P)


@pytest.mark.parametrize("kind", [0, 1], ids=["ranges absent", "rates absent"])
def test_an_epoch_of_one_kind_equals_its_batch(rng: np.random.Generator, kind: int) -> None:
    par, bank = parameters(LEVER_B), prior(rng)
    log = log_of(bank, rng)
    log.observation["status"][:, kind] = ABSENT
    x, P = batch(bank, par, log)

    assert max(apart(update(bank, log, par, W_IB_B), bank, x, P)) < 1e-10


def test_an_epoch_without_satellites_changes_nothing(rng: np.random.Generator) -> None:
    par, bank = parameters(LEVER_B), prior(rng)
    log, before = log_of(bank, rng, 0), copy_bank(bank)

    assert update(bank, log, par, W_IB_B).code == DONE
    assert np.array_equal(bank.P, before.P)
    for name in ("r_e", "v_e", "b_a", "b_g", "clock", "optional"):
        assert np.array_equal(bank.state[name], before.state[name]), name
    np.testing.assert_allclose(bank.state["q_eb"], before.state["q_eb"], rtol=0, atol=3e-16)
