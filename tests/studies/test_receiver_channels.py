"""Channels of hidden satellites, with and without supervision: who searches, who locks falsely, who comes back when."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from insgnss.config.library import scenario_config
from insgnss.config.scenario import FalseLockModel, ScenarioConfig
from insgnss.studies.masking.banked_flight import Spell
from insgnss.studies.masking.receiver_channels import (
    ChannelSpell,
    presence_of,
    unsupervised_channels,
    within_aperture,
)

SCENARIO = scenario_config("sokolov_2015")
PULL_IN_S = SCENARIO.search.guards.pull_in_s
SWEEP_S = 3.163  # 1000 cells, 100 correlators, 316 ms: the paper's example
SPELL = Spell("G16", 80.0, 100.0)
DRAWS = 200


def channels(locks: Sequence[FalseLockModel], count: int = DRAWS) -> list[ChannelSpell]:
    """Return the channel of one hidden satellite with these false locks in the scenario, many times."""
    scenario: ScenarioConfig = SCENARIO.model_copy(update={"false_locks": tuple(locks)})
    return [unsupervised_channels(scenario, [SPELL], np.random.default_rng([1, k]))[0] for k in range(count)]


def lock(**changes: object) -> FalseLockModel:
    """Return a steady false lock 30 m off, found in the search."""
    values = {"name": "steady", "offset_m": (30.0, 30.0), "cn0_dbhz": (35.0, 35.0), **changes}
    return FalseLockModel.model_validate(values)


def test_channel_that_finds_nothing_searches_on_and_sees_its_satellite_within_a_sweep() -> None:
    found = channels([])
    delays = np.array([c.delay_s for c in found])

    assert {c.how for c in found} == {"searched"}
    assert delays.min() >= PULL_IN_S
    assert delays.max() <= PULL_IN_S + SWEEP_S + 1e-3
    # uniform over the sweep: its half on average, within four sigma of the mean of 200
    spread = SWEEP_S / np.sqrt(12.0 * DRAWS)
    assert delays.mean() == pytest.approx(PULL_IN_S + 0.5 * SWEEP_S, abs=4.0 * spread)
    for c in found:
        assert c.in_vain_s == 20.0
        assert c.search_s == pytest.approx(c.tracked_s - PULL_IN_S - 80.0)
        assert len(c.faults()) == 1


def test_false_lock_near_the_signal_is_taken_over_when_that_returns() -> None:
    found = channels([lock()])

    assert {c.how for c in found} == {"captured"}
    assert {c.delay_s for c in found} == {PULL_IN_S}
    # it begins where the first sweep comes upon it
    begins = np.array([c.false_from_s for c in found]) - 80.0
    assert 0.0 <= begins.min() and begins.max() <= SWEEP_S + 1e-3
    assert all(c.false_until_s == 100.0 for c in found)


@pytest.mark.parametrize(
    "changes",
    [
        {"offset_m": (200.0, 200.0)},
        {"growth_mps": (8.0, 8.0)},  # 30 m, and 135 m more or less by the end of 17 s and more
        {"rate_follows": False, "rate_error_mps": (6.0, 6.0)},
    ],
)
def test_false_lock_beyond_the_aperture_is_given_up_and_searched_anew(changes: dict[str, object]) -> None:
    found = channels([lock(**changes)])
    delays = np.array([c.delay_s for c in found])

    assert {c.how for c in found} == {"released"}
    # half a second on the false lock, then a sweep
    assert delays.min() >= 0.5 + PULL_IN_S
    assert delays.max() <= 0.5 + SWEEP_S + PULL_IN_S + 1e-3
    assert all(c.false_until_s == 100.5 for c in found)


def test_lock_that_begins_with_the_loss_needs_no_search() -> None:
    for c in channels([lock(begins="at_loss")], 20):
        assert (c.false_from_s, c.search_s, c.in_vain_s) == (80.0, 0.0, 0.0)


def test_aperture_is_half_a_chip_and_25_hertz() -> None:
    # 146.5 m and 4.76 m/s on GPS L1 C/A
    assert within_aperture(146.0, 4.7, SCENARIO.search)
    assert not within_aperture(147.0, 0.0, SCENARIO.search)
    assert not within_aperture(-147.0, 0.0, SCENARIO.search)
    assert not within_aperture(0.0, -4.8, SCENARIO.search)


def test_locks_are_dealt_out_once_each_and_differ_between_flights() -> None:
    spells = [Spell(sv, 80.0, 100.0) for sv in SCENARIO.outage.sv]
    deals = [
        [c.lock for c in unsupervised_channels(SCENARIO, spells, np.random.default_rng([2, k]))]
        for k in range(20)
    ]

    wanted = sorted([*(entry.name for entry in SCENARIO.false_locks), "searched"])
    assert all(sorted(deal) == wanted for deal in deals)
    assert len({tuple(deal) for deal in deals}) > 5


def test_presence_is_what_the_airframe_lets_through() -> None:
    present = presence_of([SPELL], np.array([79.99, 80.0, 99.99, 100.0]), ("G01", "G16"))

    assert present.tolist() == [[1, 1], [1, 0], [1, 0], [1, 1]]
