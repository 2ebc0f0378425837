"""Bounds for the statistics of a consistent filter: computed, two-sided (too confident fails, too modest fails too)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import stats

# one test in a thousand fails by chance; the seeds are fixed, so a test that passes keeps passing
CONFIDENCE = 0.999


def mean_chi_square_bounds(
    dof: int, count: int, confidence: float = CONFIDENCE, effective_share: float = 1.0
) -> tuple[float, float]:
    """Return lower and upper bound for the mean of ``count`` chi-square values of ``dof`` degrees of freedom each.

    Equation: count * mean ~ chi2(count * dof) for independent values             [Bar-Shalom 2001, 5.4.2]
    It holds for the mean NEES over runs at one time (dof = states) and for the mean NIS over scalar updates (dof = 1).

    Parameters
    ----------
    dof : degrees of freedom of one value
    count : number of values
    confidence : probability that a consistent filter lies inside
    effective_share : share of the values that are independent; below 1 for means over time, whose successive NEES are
        correlated, and the bounds widen. The test states where its number comes from.
    """
    if not 0.0 < effective_share <= 1.0 or dof < 1 or count < 1:
        raise ValueError("dof and count must be at least 1 and effective_share in (0, 1]")
    total = dof * max(1.0, count * effective_share)
    tail = 0.5 * (1.0 - confidence)
    low, high = stats.chi2.ppf([tail, 1.0 - tail], total) / (total / dof)
    return float(low), float(high)


def share_below_bounds(probability: float, count: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return bounds for the share of ``count`` independent values that lie below their quantile ``probability``.

    Equation: the number of them is binomial(count, probability); used for "95 % of the NIS are below 3.84".
    """
    tail = 0.5 * (1.0 - confidence)
    low, high = stats.binom.ppf([tail, 1.0 - tail], count, probability) / count
    return float(low), float(high)


def nees(error: npt.ArrayLike, covariance: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return e^T P^-1 e for errors (..., n) and covariances (..., n, n)."""
    e = np.asarray(error, dtype=np.float64)
    weighted = np.linalg.solve(np.asarray(covariance, dtype=np.float64), e[..., None])[..., 0]
    return np.asarray(np.sum(e * weighted, axis=-1))


def assert_mean_chi_square(
    values: npt.ArrayLike, dof: int, confidence: float = CONFIDENCE, effective_share: float = 1.0
) -> None:
    """Fail unless the mean of ``values`` lies inside its chi-square bounds; say how far out it is."""
    data = np.asarray(values, dtype=np.float64).ravel()
    low, high = mean_chi_square_bounds(dof, data.size, confidence, effective_share)
    mean = float(np.mean(data))
    assert low <= mean <= high, (
        f"mean of {data.size} chi-square values ({dof} degrees of freedom) is {mean:.4g}, outside "
        f"[{low:.4g}, {high:.4g}]: the filter is too {'confident' if mean > high else 'modest'}"
    )
