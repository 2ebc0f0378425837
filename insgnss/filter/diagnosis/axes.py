"""How likely a sensor's fault is that has moved some of its axes, from a filter to which all three biases are unknown.

A prior on three axes, as wide as the largest fault, is charged for what it does not use: a small jump of one axis would
be explained better by the other sensor. The filter with the fault and the one without give the measurements' estimate of
the jump d: m = x_with - x_without, S = P_with - P_without, as if d were a state of its own. With W its prior covariance,
J = S^-1 - W^-1 and h = S^-1 m, any other prior Q gives the likelihood ratio against d = 0

    ln B(Q) = h^T (J + Q^-1)^-1 h / 2 - ln det(1 + Q J) / 2

Neglects: that the filter without a fault takes part of d into its own bias, that a bias wanders within a minute, and
what d changes in the gates.                                                   [Friedland 1969; Dickey 1971]
"""  # noqa: E501

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from insgnss.tables import Float64

# sigmas of a jump, in those of the grade's bias; one that fails jumps by more, up to the widest
_SIZES: Final = (2.0, 6.0, 20.0)
_STEP: Final = 10.0**0.5  # from each size of a failure to the next
_RARER: Final = math.log(1e-4)  # than a jump is a failure
# smallest eigenvalue of S over its largest, far above rounding
_LEAST: Final = 1e-10
_SETS: Final = tuple(axes for size in (1, 2, 3) for axes in itertools.combinations(range(3), size))


def of_axes(moved: Float64, covariance: Float64, sigma: float, widest: float) -> dict[tuple[int, ...], float]:
    """Return by how much the log-likelihood rises where nothing but some axes may have jumped, for each set of axes.

    Where the difference of the filters says nothing of the axes, the set of all three stands alone.

    Parameters
    ----------
    moved : (3,) m, the difference of the two filters' biases
    covariance : (3, 3) S, the difference of their covariances
    sigma : of the grade's bias
    widest : sigma of each axis in the filter's prior
    """
    size, turn = np.linalg.eigh(0.5 * (covariance + covariance.T))
    if not size[0] > _LEAST * abs(size[-1]):
        # the sound filter has refused rows that the other one uses: their difference shows no axis
        return {_SETS[-1]: 0.0}
    information = (turn / size) @ turn.T
    h = information @ moved
    J = information - np.eye(3) / widest**2
    wide = 0.5 * float(moved @ h) - 0.5 * float(np.linalg.slogdet(widest**2 * information)[1])
    jumps = [size * sigma for size in _SIZES]
    n_failed = int(math.log(widest / jumps[-1]) / math.log(_STEP) + 1e-6)
    failed = [jumps[-1] * _STEP ** (k + 1) for k in range(n_failed)]
    log_ratios = {}
    for axes in _SETS:
        J_of, h_of = J[np.ix_(axes, axes)], h[list(axes)]
        log_ratios[axes] = _log_ratio(J_of, h_of, jumps) - wide
        if failed:
            log_ratios[axes] = float(
                np.logaddexp(log_ratios[axes], _RARER + _log_ratio(J_of, h_of, failed) - wide)
            )
    return log_ratios


def _log_ratio(J: Float64, h: Float64, sizes: Sequence[float]) -> float:
    """Return ln B of some axes, the mean over the sigmas of their jump."""
    size2 = np.square(sizes)
    A = np.eye(len(h)) + size2[:, None, None] * J
    every_h = np.broadcast_to(h[:, None], (len(size2), len(h), 1))
    gain = size2 * (np.linalg.solve(A, every_h)[..., 0] @ h)
    log_ratios = 0.5 * gain - 0.5 * np.maximum(np.linalg.slogdet(A)[1], 0.0)
    return float(np.logaddexp.reduce(log_ratios)) - math.log(len(sizes))
