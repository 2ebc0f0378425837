"""Increments after long steps: the whole step where a rate is uneven, a usual one where samples were lost."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.log.imu.increment_steps import increment_intervals
from tests.log.writing import G_MPS2, Float64

MS = 1_000_000
BY_TAGS = "imu_increment_over_long_step"
LOST = "imu_increment_after_gap"


def steps_of(pattern: list[int], n: int) -> Float64:
    """Return n steps [ms], the pattern over and over."""
    return np.resize(np.array(pattern, float), n)


def force(rng: np.random.Generator, n: int, size: float = G_MPS2, noise: float = 0.05) -> Float64:
    """Return (n, 3) specific force [m/s^2] with a slow motion and white noise."""
    t = np.arange(n) / 100.0
    slow = np.column_stack([0.1 * np.sin(t), 0.1 * np.cos(0.7 * t), -np.ones(n)]) * size
    return np.asarray(slow + rng.normal(0.0, noise, (n, 3)))


def taken(step_ms: Float64, gathered_ms: Float64, f: Float64) -> tuple[Float64, list[str]]:
    """Return the intervals [ms] that are found for increments of ``f`` gathered over the given times, and the kinds."""
    t_ns = np.rint(np.cumsum(step_ms) * MS).astype(np.int64)
    dv = f * gathered_ms[:, None] * 1e-3
    found, events = increment_intervals(t_ns, np.diff(t_ns), (dv[:, 0], dv[:, 1], dv[:, 2]), "imu.csv")
    return found / MS, [event.kind for event in events]


@pytest.mark.parametrize("at", [1000, 1003, 1020, 1024, 1040, 1085])
@pytest.mark.parametrize(("before", "after"), [(10, 20), (20, 10), (5, 40)])
@pytest.mark.parametrize("size", [G_MPS2, 0.0])
def test_steps_of_a_changed_rate_are_what_the_tags_say(
    rng: np.random.Generator, before: int, after: int, at: int, size: float
) -> None:
    """Half a second of free fall shows nothing; there the steps around tell."""
    step = np.concatenate([np.full(at, float(before)), np.full(3000 - at, float(after))])
    found, kinds = taken(step, step, force(rng, 3000, size))
    assert np.array_equal(found[1:], step[1:])
    assert LOST not in kinds


@pytest.mark.parametrize("pattern", [[10, 10, 20], [10, 20], [10, 10, 10, 20], [5, 5, 30]])
@pytest.mark.parametrize(("size", "noise"), [(G_MPS2, 0.05), (0.0, 0.05), (G_MPS2, 20.0)])
def test_steps_of_a_steady_uneven_rate_are_what_the_tags_say(
    rng: np.random.Generator, pattern: list[int], size: float, noise: float
) -> None:
    """At rest the force tells; in free fall and in hard vibration the pattern does."""
    step = steps_of(pattern, 2000)
    found, kinds = taken(step, step, force(rng, 2000, size, noise))
    wrong = np.mean(found[1:] != step[1:])
    assert wrong == 0.0 if noise < 1.0 else wrong < 0.002  # two of a thousand pass for quiet by chance
    assert noise > 1.0 or LOST not in kinds


@pytest.mark.parametrize(("share", "size"), [(0.05, G_MPS2), (0.3, G_MPS2), (0.02, 0.3)])
def test_increments_after_lost_samples_cover_one_usual_step(
    rng: np.random.Generator, share: float, size: float
) -> None:
    kept = rng.random(4000) > share
    t_ms = 10.0 * np.arange(4000)[kept]
    step = np.diff(t_ms, prepend=t_ms[0] - 10.0)
    found, kinds = taken(step, np.full(len(step), 10.0), force(rng, len(step), size))
    assert np.array_equal(found[1:], np.full(len(step) - 1, 10.0))
    assert kinds == [LOST]


def test_losses_in_free_fall_cover_one_usual_step_where_they_are_rare(rng: np.random.Generator) -> None:
    step = np.full(3000, 10.0)
    step[[500, 1200, 1900, 2600]] = [20.0, 30.0, 1000.0, 20.0]
    found, kinds = taken(step, np.full(3000, 10.0), force(rng, 3000, 0.0))
    assert np.array_equal(found, np.full(3000, 10.0)) and kinds == [LOST]


def test_long_step_whose_increment_holds_all_of_it_is_told_from_a_loss(rng: np.random.Generator) -> None:
    """One recorder adds up what it could not write, another loses it: the numbers say which, step by step."""
    step = np.full(3000, 10.0)
    step[[500, 900, 1300, 1700]] = [20.0, 500.0, 20.0, 500.0]
    gathered = step.copy()
    gathered[[1300, 1700]] = 10.0
    found, kinds = taken(step, gathered, force(rng, 3000))
    assert np.array_equal(found[1:], gathered[1:])
    assert sorted(kinds) == [LOST, BY_TAGS]


def test_loss_inside_a_changed_rate_covers_that_rates_step(rng: np.random.Generator) -> None:
    step = np.concatenate([np.full(1500, 20.0), np.full(1500, 10.0)])
    gathered = step.copy()
    step[[700, 2200]] = [40.0, 20.0]
    found, kinds = taken(step, gathered, force(rng, 3000))
    assert np.array_equal(found[1:], gathered[1:]) and LOST in kinds
