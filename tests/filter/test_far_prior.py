"""The first epoch after a long outage: the range's curvature over tens of kilometres is no error of the satellites."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.state import CLOCK, DR, Bank, copy_bank
from insgnss.status import USED
from insgnss.tables import Float64
from tests.filter.scene import START_NS, new_filter, parameters, perfect_rows, place, sky, update
from tests.statistics_bounds import mean_chi_square_bounds

FAR_M = 40e3


def drifted(rng: np.random.Generator, offset_m: float, clock_m: float = 0.0) -> tuple[Bank, Bank]:
    """Return a filter that an outage has carried away horizontally, and the truth."""
    at = place()
    truth = new_filter(at, v_n=(100.0, -20.0, 0.0), sigmas={DR: offset_m, CLOCK: 3e3})
    bank = copy_bank(truth)
    direction = rng.normal(size=2)
    away_n = np.array([*(direction / np.linalg.norm(direction) * offset_m), 0.0])
    bank.state["r_e"][0] += at.C_ne.T @ away_n
    truth.state["clock"][0, 0] += clock_m
    return bank, truth


def position_error(bank: Bank, truth: Bank) -> Float64:
    """Return estimate minus truth, ECEF [m]."""
    return np.asarray(bank.state["r_e"][0] - truth.state["r_e"][0])


@pytest.mark.parametrize("clock_m", [0.0, 299_792.458])
def test_first_epoch_after_an_outage_is_as_exact_as_any(rng: np.random.Generator, clock_m: float) -> None:
    """Noise-free rows, 40 km away, also with a clock that stepped by a millisecond: no row refused, no metre left.

    Linearised at the prior the curvature of the ranges leaves tens of metres.
    """
    par = parameters(range_least_step=1e4)
    bank, truth = drifted(rng, FAR_M, clock_m)
    log = perfect_rows(truth, par, [START_NS], sky(place()))

    result = update(bank, log, par)

    assert np.all(result.out.ledger["status"] == USED)
    # what the prior of the clock and of the velocity pulls: 1 mm; the nearer place's own curvature: below 1 mm
    assert np.linalg.norm(position_error(bank, truth)) < 0.02


def test_position_after_an_outage_is_as_good_as_its_sigma_says(rng: np.random.Generator) -> None:
    par, nees = parameters(), []
    for _ in range(60):
        bank, truth = drifted(rng, FAR_M)
        log = perfect_rows(truth, par, [START_NS], sky(place())[:8])
        log.observation["value"] += rng.normal(size=(8, 2)) * [1.0, 0.05]
        update(bank, log, par)
        error = position_error(bank, truth)
        nees.append(error @ np.linalg.solve(bank.P[0][DR : DR + 3, DR : DR + 3], error))
    low, high = mean_chi_square_bounds(3, len(nees), 0.9999)
    assert low < np.mean(nees) < high


def test_a_wrong_range_is_found_from_far_away_too(rng: np.random.Generator) -> None:
    """100 m on one of twelve: the curvature must not hide it, nor accuse another."""
    par = parameters(residual_gate2=16.0)
    bank, truth = drifted(rng, FAR_M)
    log = perfect_rows(truth, par, [START_NS], sky(place()))
    log.observation["value"][4, 0] += 100.0

    result = update(bank, log, par)

    refused = np.flatnonzero(result.out.ledger["status"][:, 0] != USED)
    assert refused.tolist() == [4]
    assert np.linalg.norm(position_error(bank, truth)) < 0.1


def test_near_priors_are_untouched(rng: np.random.Generator) -> None:
    """Below a kilometre of sigma the rows are those of the prior, to the bit."""
    par = parameters()
    bank, truth = drifted(rng, 900.0)
    log = perfect_rows(truth, par, [START_NS], sky(place()))
    update(bank, log, par)
    assert 1e-6 < np.linalg.norm(position_error(bank, truth)) < 0.1  # 4 cm of curvature at most
