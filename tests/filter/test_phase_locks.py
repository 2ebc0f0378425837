"""Whether a phase is locked, from its differences' tests alone, and how far a gate's passes may be wrong."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.filter.rows.lines import LINE_DTYPE, Lines
from insgnss.filter.state import N_MEMORY, STATE_DTYPE, StateArray
from insgnss.filter.update.carrier_doubt import doubt_carriers
from insgnss.filter.update.phase_locks import PASSES_UNLOCKED, follow_lock
from insgnss.filter.update.satellite_memory import UNLOCKED
from insgnss.gnss.observation_rows import CARRIER
from insgnss.status import GATED, USED
from insgnss.tables import Bool, Float64

MOST = 0.05


def believed(passes: Bool, interval_s: float) -> Bool:
    """Return at which of the differences that pass the tests the phase counts as locked."""
    seen = np.full(N_MEMORY, -np.inf)
    locked = np.zeros(len(passes), np.bool_)
    for i, one in enumerate(passes):
        follow_lock(seen, bool(one), 100.0 + i * interval_s)
        locked[i] = one and seen[UNLOCKED] <= MOST
    return locked


@pytest.mark.parametrize("interval_s", [0.1, 0.2, 1.0, 2.0])
def test_phase_that_never_fails_is_used_from_the_first_difference(interval_s: float) -> None:
    assert believed(np.ones(500, np.bool_), interval_s).all()


@pytest.mark.parametrize("interval_s", [0.1, 0.2, 1.0])
def test_slip_costs_at_most_two_more_differences_and_several_more(interval_s: float) -> None:
    passes = np.ones(300, np.bool_)
    passes[[40, 120, 121, 122]] = False
    locked = believed(passes, interval_s)

    assert locked[:40].all() and locked[43:120].all()
    assert not locked[123:125].any()  # after three in a row
    assert locked[130:].all()


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("interval_s", [0.1, 0.2, 1.0])
def test_unlocked_phase_that_passes_by_chance_is_seldom_used(interval_s: float, seed: int) -> None:
    passes = np.random.default_rng(seed).random(5000) < 0.15
    locked = believed(passes, interval_s)

    assert passes.sum() > 600
    assert locked.sum() < 0.03 * passes.sum()


def test_phase_that_is_found_again_is_used_again_within_seconds() -> None:
    passes = np.concatenate([np.random.default_rng(5).random(200) < 0.15, np.ones(200, np.bool_)])
    assert believed(passes, 0.2)[206:].all()


def carriers(S: Float64, statuses: list[int]) -> tuple[StateArray, Lines]:
    """Return a state without history and lines with the given carrier statuses and variances of 1e-6."""
    lines = np.zeros(len(S), LINE_DTYPE)
    lines["status"][:, CARRIER] = statuses
    lines["variance"][:, CARRIER] = 1e-6
    return np.zeros(1, STATE_DTYPE), lines


def test_doubt_is_that_of_a_mixture_of_right_rows_and_rows_anywhere_in_the_gate() -> None:
    """A share of wrong rows is drawn within 1 m/s; what passes the gate has the variance that the formula says."""
    S, gate2, wrong, interval_s = 0.02**2, 4.5**2, 0.15, 0.2
    random = np.random.default_rng(21)
    n = 400_000
    far, near = random.uniform(-interval_s, interval_s, n), 0.001 * random.normal(size=n)
    error = np.where(random.random(n) < wrong, far, near)
    passed = error[np.abs(error) < np.sqrt(gate2 * S)]

    state, lines = carriers(np.full(1, S), [USED])
    state["carriers_tested"], state["carriers_failed"] = 1e8, wrong / PASSES_UNLOCKED * 1e8
    doubt_carriers(state[0], lines, np.full(1, S), gate2, interval_s)

    assert lines["variance"][0, CARRIER] == pytest.approx(np.var(passed), rel=0.03)


def test_failed_tests_raise_the_doubt_and_a_known_velocity_has_none() -> None:
    S = np.full(8, 0.02**2)
    state, lines = carriers(S, [USED] * 6 + [GATED] * 2)
    first, later, narrow = lines.copy(), lines.copy(), lines.copy()
    doubt_carriers(state[0], first, S, 20.0, 0.2)
    state["carriers_tested"], state["carriers_failed"] = 500.0, 300.0
    doubt_carriers(state[0], later, S, 20.0, 0.2)
    doubt_carriers(state[0], narrow, 1e-6 * np.ones(8), 20.0, 0.2)

    assert np.all(later["variance"][:6, CARRIER] > 5.0 * first["variance"][:6, CARRIER])
    assert np.all(later["variance"][6:, CARRIER] == 1e-6)
    assert np.all(narrow["variance"][:6, CARRIER] < 1.2e-6)
