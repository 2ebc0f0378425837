"""One scalar update against the dense textbook Joseph form, and where numbers are at their worst."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.state import BA, CLOCK, DR, DRIFT, OFFSETS
from insgnss.filter.update.predictions import RANGE_COLUMNS, RATE_COLUMNS
from insgnss.filter.update.scalar_update import predicted_variance, scalar_update
from insgnss.tables import Float64, Int64
from tests.filter.scene import SIGMAS

N = OFFSETS + 1


def random_covariance(rng: np.random.Generator, n: int = N) -> Float64:
    """Return a full covariance with the sigmas of a filter at its start and every state correlated with every other."""
    mixed = rng.normal(size=(n, 2 * n))
    shape = mixed @ mixed.T
    sigma = np.concatenate([np.full(3 if first < CLOCK else 1, s) for first, s in SIGMAS.items()])[:n]
    scale = sigma / np.sqrt(np.diag(shape))
    P = shape * np.outer(scale, scale)
    return 0.5 * (P + P.T)


def dense_row(h: Float64, columns: Int64, n: int = N) -> Float64:
    """Return the row of H over all states."""
    row = np.zeros((1, n))
    row[0, columns] = h
    return row


def joseph(
    P: Float64, H: Float64, innovation: float, variance: float, x: Float64
) -> tuple[Float64, Float64, float, float]:
    """Return covariance, correction, innovation and its variance, every matrix dense.

    Equation: P = (I - K H) P (I - K H)^T + K r K^T, K = P H^T / S                       [Bar-Shalom 2001, 5.2.3-18]
    """
    S = float((H @ P @ H.T)[0, 0]) + variance
    K = P @ H.T / S
    y = innovation - float((H @ x)[0])
    left = np.eye(len(P)) - K @ H
    return left @ P @ left.T + K @ K.T * variance, x + K[:, 0] * y, y, S


def relative(difference: Float64, P: Float64) -> float:
    """Return the largest entry of a difference of covariances, in units of sqrt(Pii Pjj)."""
    sigma = np.sqrt(np.diag(P))
    return float(np.max(np.abs(difference) / np.outer(sigma, sigma)))


@pytest.mark.parametrize(
    ("columns", "sigma"),
    [(RANGE_COLUMNS, 1.0), (np.append(RANGE_COLUMNS, OFFSETS), 1.0), (RATE_COLUMNS, 0.05)],
    ids=["range", "range of a further constellation", "rate"],
)
def test_scalar_update_equals_the_dense_joseph_form(
    rng: np.random.Generator, columns: Int64, sigma: float
) -> None:
    for _ in range(20):
        P, x, h = random_covariance(rng), rng.normal(size=N), rng.normal(size=len(columns))
        innovation = float(rng.normal())
        H = dense_row(h, columns)
        v = np.vstack([x, rng.normal(size=(2, N))])
        P_expected, x_expected, y_expected, S_expected = joseph(P, H, innovation, sigma**2, x)
        x_sigma = np.sqrt(np.diag(P))

        y, S = scalar_update(P, h, columns, innovation, sigma**2, v)

        # rounding of sums of 17 products: reached 2e-14
        assert relative(P - P_expected, P_expected) < 1e-12
        assert np.max(np.abs(v[0] - x_expected) / x_sigma) < 1e-12
        assert (y, S) == pytest.approx((y_expected, S_expected), rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("columns", [RANGE_COLUMNS, RATE_COLUMNS], ids=["range", "rate"])
def test_predicted_variance_is_h_P_h_transposed(rng: np.random.Generator, columns: Int64) -> None:
    P, h = random_covariance(rng), rng.normal(size=len(columns))
    H = dense_row(h, columns)

    assert predicted_variance(P, h, columns) == pytest.approx(float((H @ P @ H.T)[0, 0]), rel=1e-13)


def test_covariance_stays_symmetric_bit_for_bit(rng: np.random.Generator) -> None:
    P, v = random_covariance(rng), np.zeros((3, N))
    for _ in range(200):
        h = rng.normal(size=len(RATE_COLUMNS))
        scalar_update(P, h, RATE_COLUMNS, float(rng.normal()), 0.0025, v)
        assert np.array_equal(P, P.T)


def test_covariance_is_at_the_minimum_over_all_gains(rng: np.random.Generator) -> None:
    """An error dK of the gain enters a Joseph covariance squared: P(K + dK) = P(K) + S dK dK^T, no first-order term."""
    P, h = random_covariance(rng), rng.normal(size=len(RANGE_COLUMNS))
    H, prior, v = dense_row(h, RANGE_COLUMNS), P.copy(), np.zeros((3, N))
    _, S = scalar_update(P, h, RANGE_COLUMNS, 0.0, 1.0, v)
    K = (prior @ H.T)[:, 0] / S
    dK = 0.01 * np.sqrt(np.diag(P)) * rng.normal(size=N)
    left = np.eye(N) - np.outer(K + dK, H)

    with_error = left @ prior @ left.T + np.outer(K + dK, K + dK)
    assert relative(with_error - P - S * np.outer(dK, dK), with_error) < 1e-12


def test_repeated_identical_measurements_average_down_and_stay_positive(rng: np.random.Generator) -> None:
    """A million rows of one satellite: the sigma along the row falls as 1/sqrt(n), nothing turns negative."""
    P, v, h = random_covariance(rng), np.zeros((3, N)), rng.normal(size=len(RANGE_COLUMNS))
    H = dense_row(h, RANGE_COLUMNS)
    n = 1_000_000
    expected = 1.0 / (1.0 / float((H @ P @ H.T)[0, 0]) + n)
    for _ in range(n):
        scalar_update(P, h, RANGE_COLUMNS, 0.0, 1.0, v)

    # 1 mm is left of 100 m; the prior's rounding, 1e4 m^2 * 1e-16, walks over a million updates: reached 1e-9 m^2
    assert float((H @ P @ H.T)[0, 0]) == pytest.approx(expected, abs=1e-8)
    assert np.min(np.linalg.eigvalsh(correlation(P))) > 0.0
    assert np.array_equal(P, P.T)


def correlation(P: Float64) -> Float64:
    """Return the correlation matrix of a covariance: its eigenvalues do not depend on units."""
    sigma = np.sqrt(np.diag(P))
    return P / np.outer(sigma, sigma)


@pytest.mark.parametrize("variance", [1e-6, 1e-12])
def test_a_measurement_far_better_than_the_state_leaves_a_positive_covariance(
    rng: np.random.Generator, variance: float
) -> None:
    """S and P differ by 1e10 to 1e16: what is left along the row is the rounding of P, and never negative beyond it."""
    P, v, h = random_covariance(rng), np.zeros((3, N)), rng.normal(size=len(RANGE_COLUMNS))
    H = dense_row(h, RANGE_COLUMNS)
    before = P.copy()
    D = float((H @ P @ H.T)[0, 0])
    scalar_update(P, h, RANGE_COLUMNS, 1.0, variance, v)

    left = float((H @ P @ H.T)[0, 0])
    assert left == pytest.approx(variance, abs=1e-13 * D)
    assert np.all(np.diag(P) > 0.0)
    assert np.all(np.diag(P) <= np.diag(before))
    # cancellation leaves eigenvalues down to minus a few units of rounding of the prior, not more
    assert np.min(np.linalg.eigvalsh(P / np.sqrt(np.outer(np.diag(before), np.diag(before))))) > -1e-15
    assert float((H @ v[0])[0]) == pytest.approx(D / (D + variance), abs=1e-13)


def test_nearly_singular_innovation_of_a_perfectly_known_state_changes_nothing() -> None:
    """Nothing is uncertain and the row is nearly free of noise: S = 1e-300, the gain is zero and not NaN."""
    P, v, h = np.zeros((N, N)), np.zeros((3, N)), np.ones(len(RANGE_COLUMNS))
    y, S = scalar_update(P, h, RANGE_COLUMNS, 5.0, 1e-300, v)

    assert (y, S) == (5.0, 1e-300)
    assert not P.any()
    assert not v[0].any()


def test_state_with_zero_variance_is_never_corrected(rng: np.random.Generator) -> None:
    P, v = random_covariance(rng), np.zeros((3, N))
    known = [DR + 2, BA + 1, DRIFT]
    P[known, :] = 0.0
    P[:, known] = 0.0
    for columns in (RANGE_COLUMNS, RATE_COLUMNS) * 50:
        scalar_update(P, rng.normal(size=len(columns)), columns, float(rng.normal()), 1.0, v)

    assert not v[0][known].any()
    assert not P[known].any()
    others = np.setdiff1d(np.arange(N), known)
    assert np.min(np.linalg.eigvalsh(correlation(P[np.ix_(others, others)]))) > 0.0
