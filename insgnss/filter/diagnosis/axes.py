"""How likely a sensor's fault is that has moved one axis, from a filter to which the biases of all three are unknown.

A prior on three axes, as wide as the largest fault, is charged for what it does not use: a small jump of one axis would
be explained better by the other sensor. The filter beside the one without a fault tells what the measurements say of the
jump d: m = x_with - x_without, S = P_with - P_without, as if d were a state of its own. With W its prior covariance,
J = S^-1 - W^-1 and h = S^-1 m, any other prior Q gives the likelihood ratio against d = 0

    ln B(Q) = h^T (J + Q^-1)^-1 h / 2 - ln det(1 + Q J) / 2

Neglects: that the filter without a fault takes part of d into its own bias, that a bias wanders within a minute, and
what d changes in the gates.                                                   [Friedland 1969; Dickey 1971]
"""  # noqa: E501

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.tables import Float64

_SIZES: Final = (2.0, 6.0, 20.0)  # sigmas of the grade's bias by which one axis may have jumped
_LEAST: Final = 1e-6  # eigenvalue of S over its largest: rounding must not make it negative


def of_one_axis(moved: Float64, covariance: Float64, sigma: float, widest: float) -> tuple[float, int]:
    """Return by how much the log-likelihood rises where only one axis or all three may have moved, and the axis.

    Parameters
    ----------
    moved : (3,) m, the difference of the two filters' biases
    covariance : (3, 3) S, the difference of their covariances
    sigma : of the grade's bias
    widest : sigma of each axis in the filter's prior

    Returns
    -------
    gain : logarithm of the mean over x, y, z and all three, each a quarter, against all three
    axis : 0, 1 or 2; -1 where all three together explain more than any alone
    """
    size, turn = np.linalg.eigh(0.5 * (covariance + covariance.T))
    information = (turn / np.maximum(size, _LEAST * size[-1])) @ turn.T
    h = information @ moved
    J = np.maximum(np.diag(information) - widest**-2, 0.0)
    Q = (np.array(_SIZES)[:, None] * sigma) ** 2
    every = 0.5 * h**2 / (J + 1.0 / Q) - 0.5 * np.log1p(Q * J)
    alone = np.logaddexp.reduce(every) - math.log(len(_SIZES))
    all_three = 0.5 * float(moved @ h) - 0.5 * float(np.linalg.slogdet(widest**2 * information)[1])
    gain = float(np.logaddexp.reduce([*alone, all_three])) - math.log(4.0) - all_three
    axis = int(np.argmax(alone))
    return gain, axis if alone[axis] > all_three else -1
