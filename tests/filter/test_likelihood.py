"""Rows that share their errors with those of the epochs before: what their likelihood says of their noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.filter.state import OFFSETS
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.epoch_update import use_rows
from insgnss.gnss.observation_rows import PSEUDORANGE
from insgnss.status import USED
from insgnss.tables import Float64

GATE2 = 25.0
SIGMA2 = 2.3**2


def likelihood(y: Float64, P: Float64, r: float, spread: float) -> float:
    """Return what rows with innovations ``y``, which show the first state of ``P``, add to the likelihood."""
    s = new_epoch(len(y), OFFSETS)
    s.lines["status"][:, PSEUDORANGE] = USED
    s.lines["innovation"][:, PSEUDORANGE] = y
    s.lines["variance"][:, PSEUDORANGE] = r
    s.lines["count"][:, PSEUDORANGE] = 1
    s.lines["h"][:, PSEUDORANGE, 0] = 1.0
    s.lines["columns"][:, PSEUDORANGE, 0] = 0
    return use_rows(P.copy(), s.lines, s.vectors, PSEUDORANGE, GATE2, spread, np.zeros(0))[0]


@pytest.mark.parametrize("spread", [1.0, 4.0, 25.0])
def test_no_other_noise_is_likelier_than_the_one_that_the_rows_have(spread: float) -> None:
    """However much epochs share: a noise level that is a little off must not pass for a fault or hide one.

    Of n rows whose mean square is r exactly the likelihood falls by n / (2 s) (1 / c - 1 + ln c) at the noise c r.
    """
    y = np.random.default_rng(8).standard_normal(400)
    y *= math.sqrt(SIGMA2 / np.mean(y**2))
    nothing = np.zeros((OFFSETS, OFFSETS))
    right = likelihood(y, nothing, SIGMA2, spread)
    for c in (0.5, 0.9, 1.1, 2.0):
        lost = len(y) / (2.0 * spread) * (1.0 / c - 1.0 + math.log(c))
        assert right - likelihood(y, nothing, c * SIGMA2, spread) == pytest.approx(lost, rel=1e-9)


@pytest.mark.parametrize("spread", [1.0, 4.0, 25.0])
def test_unknown_that_the_rows_find_costs_as_much_as_they_narrow_it(spread: float) -> None:
    """Integrated over x ~ N(0, p), the rows' likelihood loses ln(1 + p n / (s r)) / 2, where they show x = 0."""
    y = np.tile([1.0, -1.0], 20)
    P = np.zeros((OFFSETS, OFFSETS))
    known = likelihood(y, P, SIGMA2, spread)
    P[0, 0] = 30.0**2
    cost = 0.5 * math.log(1.0 + P[0, 0] * len(y) / (spread * SIGMA2))
    assert known - likelihood(y, P, SIGMA2, spread) == pytest.approx(cost, rel=1e-9)


def test_single_rows_have_their_gaussian_likelihood() -> None:
    y, P = np.array([0.4, -2.0, 3.3]), np.zeros((OFFSETS, OFFSETS))
    P[0, 0] = 4.0
    S = SIGMA2 * np.eye(3) + P[0, 0]
    expected = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
    assert likelihood(y, P, SIGMA2, 1.0) == pytest.approx(expected, rel=1e-12)
