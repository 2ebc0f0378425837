"""Rows that share their errors with those of the epochs before: what their likelihood says of their noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.filter.rows.lines import EpochWorkspace
from insgnss.filter.state import OFFSETS
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.epoch_update import use_rows
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE
from insgnss.status import GATED, USED
from insgnss.tables import Float64

GATE2 = 25.0
SIGMA2 = 2.3**2


def likelihood(y: Float64, P: Float64, r: float, spread: float) -> float:
    """Return what pseudoranges with innovations ``y``, which show the first state of ``P``, add to the likelihood."""
    return likelihood_of(rows(y, r, PSEUDORANGE), P, PSEUDORANGE, spread)


def rows(y: Float64, r: float, kind: int) -> EpochWorkspace:
    """Return an epoch of rows of one kind with innovations ``y``, variance ``r``, that show the first state."""
    s = new_epoch(len(y), OFFSETS)
    s.lines["status"][:, kind] = USED
    s.lines["innovation"][:, kind] = y
    s.lines["variance"][:, kind] = r
    s.lines["count"][:, kind] = 1
    s.lines["h"][:, kind, 0] = 1.0
    s.lines["columns"][:, kind, 0] = 0
    return s


def likelihood_of(s: EpochWorkspace, P: Float64, kind: int, spread: float) -> float:
    """Return what the rows of an epoch add to the likelihood."""
    return use_rows(P.copy(), s.lines, s.vectors, kind, GATE2, spread, np.zeros(0))[0]


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


def at_level(y: float, r: float, level: float) -> EpochWorkspace:
    """Return an epoch of one range rate whose own level has risen in it."""
    s = rows(np.array([y]), level * r, RANGE_RATE)
    s.lines["extra"] = (level - 1.0) * r
    return s


def test_range_rate_that_stands_out_costs_no_more_than_a_reflection() -> None:
    """However far off, it may be a reflection: one that is 10 m/s off says as little as one that is 2 m/s off."""
    nothing, r = np.zeros((OFFSETS, OFFSETS)), 0.1**2
    near, far, farther = (
        likelihood_of(at_level(y, r, 0.25 * (3.0 + y**2 / r)), nothing, RANGE_RATE, 1.0)
        for y in (0.25, 2.0, 10.0)
    )
    assert near > far
    assert far == farther
    density = math.exp(far) / math.sqrt(2.0 * math.pi)
    assert 0.1 / density == pytest.approx(18.5, abs=0.3)  # one in ten is a reflection, flat over so many m/s


def test_refused_range_rate_costs_what_a_reflection_does() -> None:
    nothing, r = np.zeros((OFFSETS, OFFSETS)), 0.1**2
    refused = rows(np.array([8.0]), r, RANGE_RATE)
    refused.lines["status"][:, RANGE_RATE] = GATED
    taken = likelihood_of(at_level(8.0, r, 1600.0), nothing, RANGE_RATE, 1.0)
    assert likelihood_of(refused, nothing, RANGE_RATE, 1.0) == taken


def test_nothing_is_gained_by_refusing_what_a_wide_prediction_allows() -> None:
    P = np.zeros((OFFSETS, OFFSETS))
    P[0, 0] = 60.0**2
    used = rows(np.array([0.0]), 0.1**2, RANGE_RATE)
    refused = rows(np.array([0.0]), 0.1**2, RANGE_RATE)
    refused.lines["status"][:, RANGE_RATE] = GATED
    refused.lines["predicted"][:, RANGE_RATE] = P[0, 0]
    assert likelihood_of(refused, P, RANGE_RATE, 1.0) <= likelihood_of(used, P, RANGE_RATE, 1.0)
