"""Range rates that a receiver repeats are no measurements; those that its resolution keeps the same are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.rows.lines import Lines
from insgnss.filter.state import Bank
from insgnss.filter.update.wrong_rates import refuse_repeated
from insgnss.gnss.observation_rows import N_BANDS, RANGE_RATE, GnssRows
from insgnss.status import STUCK, USED
from insgnss.tables import Float64
from tests.filter.scene import START_NS, new_filter, observed, parameters, place, rows_of, sky

AT = place(47.0, 11.0, 500.0)
ACCELERATION_MPS2 = 0.1  # of each satellite along the line of sight
EPOCHS = 40
RATE_HZ = 2.0


def log(rates: Float64) -> GnssRows:
    """Return a log of range rates (m, k) of satellites that accelerate away."""
    still = sky(AT)
    u = still[:, :3] - AT.r_e
    u /= np.linalg.norm(u, axis=1)[:, None]
    moving = np.repeat(still[None], EPOCHS, axis=0)
    moving[:, :, 3:6] += ACCELERATION_MPS2 * (np.arange(EPOCHS) / RATE_HZ)[:, None, None] * u
    value = np.stack([np.zeros_like(rates), rates], axis=2)
    rows = rows_of(START_NS + np.arange(EPOCHS) * int(NS_PER_S / RATE_HZ), moving, value)
    rows.observation["slot"] = np.tile(np.arange(rates.shape[1]) * N_BANDS, EPOCHS)
    return rows


def statuses(rows: GnssRows, bank: Bank) -> list[Float64]:
    """Return the range rates' status of each epoch, told in the order of time."""
    par, found = parameters(), []
    for epoch in range(EPOCHS):
        lines: Lines = observed(bank, par, rows, epoch).lines
        refuse_repeated(bank.state[0], bank.memory[0], rows, epoch, lines)
        found.append(lines["status"][:, RANGE_RATE].copy())
    return found


def sigma_mps() -> float:
    """Return the noise of a range rate in the scene."""
    lines = observed(new_filter(AT), parameters(), log(np.zeros((EPOCHS, len(sky(AT))))), 0).lines
    return float(np.sqrt(lines["variance"][:, RANGE_RATE]).max())


def true_rates() -> Float64:
    """Return what the satellites' acceleration makes of range rates, each from a value of its own (m, k)."""
    grown = ACCELERATION_MPS2 * np.arange(EPOCHS) / RATE_HZ
    return np.asarray(grown[:, None] + 100.0 * np.arange(len(sky(AT))))


def test_rates_that_stay_the_same_are_refused_once_the_motion_is_four_sigmas() -> None:
    bank = new_filter(AT)
    found = statuses(log(np.broadcast_to(true_rates()[0], true_rates().shape).copy()), bank)
    first = next(k for k, status in enumerate(found) if np.any(status == STUCK))
    assert all(np.all(status == USED) for status in found[:first])
    assert all(np.all(status == STUCK) for status in found[first:])
    assert first / RATE_HZ == pytest.approx(4.0 * sigma_mps() / ACCELERATION_MPS2, abs=1.0 / RATE_HZ + 0.1)
    assert int(bank.state[0].stuck_since_ns) == START_NS + first * int(NS_PER_S / RATE_HZ)
    assert int(bank.state[0].stuck_ns) == START_NS + (EPOCHS - 1) * int(NS_PER_S / RATE_HZ)


def test_column_of_zeros_is_refused() -> None:
    assert np.all(statuses(log(np.zeros_like(true_rates())), new_filter(AT))[-1] == STUCK)


def test_one_satellite_that_repeats_is_refused_alone_and_comes_back() -> None:
    rates, bank = true_rates(), new_filter(AT)
    rates[5:30, 2] = rates[5, 2]
    found = np.array(statuses(log(rates), bank))
    assert np.all(np.delete(found, 2, axis=1) == USED)
    assert found[29, 2] == STUCK and np.all(found[30:, 2] == USED)
    assert int(bank.state[0].stuck_since_ns) == 0


def test_coarse_resolution_and_noise_are_no_repetition() -> None:
    """A receiver whose resolution makes its noise repeats most numbers, each for as long as it is right."""
    step_mps = math.sqrt(12.0) * sigma_mps()
    noise = 0.1 * step_mps * np.random.default_rng(31).standard_normal(true_rates().shape)
    coarse = step_mps * np.round((true_rates() + noise) / step_mps)
    assert np.mean(np.diff(coarse, axis=0) == 0.0) > 0.5
    for rates in (coarse, true_rates() + noise):
        assert np.all(np.array(statuses(log(rates), new_filter(AT))) == USED)
