"""The size of a satellite's reflection, and which slow errors it and a second band of the satellite have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.state import CLOCK, DR, N_MEMORY, N_OF_SATELLITE, N_PATTERNS
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.range_biases import place_range_biases
from insgnss.filter.update.reflections import write_reflections
from insgnss.filter.update.satellite_memory import FORGOTTEN_S, RANGE_S, REFLECTION, REFLECTION_VARIANCE
from insgnss.gnss.observation_rows import N_BANDS, PSEUDORANGE, GnssRows
from insgnss.tables import Float64
from tests.filter.scene import START_NS, new_filter, parameters, perfect_rows, place, sky


def remembered(log: GnssRows, mean_m: Sequence[float], variance: float, since_s: float) -> Float64:
    """Return the memory of satellites whose ranges had these means so long ago; none of one without a number."""
    memory = np.full((log.observation["slot"].max() + 1, N_MEMORY), -np.inf)
    for slot, mean in zip(log.observation["slot"], mean_m, strict=True):
        if np.isfinite(mean):
            memory[slot, RANGE_S], memory[slot, REFLECTION] = START_NS * 1e-9 - since_s, mean
            memory[slot, REFLECTION_VARIANCE] = variance
    return memory


NOISE_OF_MEAN, VARIANCE = 0.1, 9.0


def found_m(
    mean_m: Sequence[float], since_s: float = 1.0, time_s: float = 30.0, places: bool = True
) -> Float64:
    """Return the sizes (n,) of n satellites' reflections [m] whose residuals had these means so long ago."""
    par = parameters(reflection_rate=1.0 / time_s if time_s else 0.0)[0]
    log = perfect_rows(new_filter(place(), offsets=()), parameters(), [START_NS], sky(place())[: len(mean_m)])
    log.observation["slot"] = np.arange(len(mean_m)) * N_BANDS
    lines = new_epoch(len(log.sat), 20).lines
    lines["variance"][:, PSEUDORANGE], lines["bias"] = VARIANCE, places * (1 + np.arange(len(lines)))
    lines["reflection"] = 7.0  # of an epoch before
    write_reflections(remembered(log, mean_m, NOISE_OF_MEAN, since_s), par, log, 0, lines)
    return np.array(lines["reflection"])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_size_is_what_the_residuals_have_beyond_chance(sign: float) -> None:
    noise = NOISE_OF_MEAN * VARIANCE
    sizes = found_m([3.0 * sign, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    np.testing.assert_allclose(sizes, [sign * np.sqrt(9.0 - 4.0 * noise), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_satellites_that_show_little_are_taken_for_as_bad_as_all_are_on_average() -> None:
    """Of few satellites the residuals of one that is off are small, and those of the others are not."""
    mean_m = np.array([6.0, -5.0, 0.5, 4.0, -0.5, 1.0])
    of_all = np.mean(mean_m**2) - NOISE_OF_MEAN * VARIANCE * (1.0 + 2.0 * np.sqrt(2.0 / 2.0))
    own = mean_m**2 - 4.0 * NOISE_OF_MEAN * VARIANCE
    expected = np.copysign(np.sqrt(np.maximum(own, of_all)), mean_m)
    assert (own < of_all).sum() == 3
    np.testing.assert_allclose(found_m(mean_m), expected)


def test_chance_makes_no_reflections() -> None:
    """Of means of noise alone, whose common part the residuals have lost, less than a third of the variance is left."""
    rng, n = np.random.default_rng(8801), 8
    design = np.column_stack([rng.normal(size=(n, 3)), np.ones(n)])
    residual = np.eye(n) - design @ np.linalg.pinv(design)
    sigma = np.sqrt(NOISE_OF_MEAN * VARIANCE)
    shown = (rng.normal(0.0, sigma, (300, n)) @ residual) / np.sqrt(np.diag(residual))
    squares = np.mean([np.mean(found_m(mean_m) ** 2) for mean_m in shown])
    assert squares < sigma**2 / 3.0


@pytest.mark.parametrize(
    ("mean_m", "since_s", "time_s", "places"),
    [
        (5.0, FORGOTTEN_S + 0.1, 30.0, True),
        (-np.inf, 1.0, 30.0, True),
        (5.0, 1.0, 0.0, True),
        (5.0, 1.0, 30.0, False),
    ],
    ids=("unseen", "new", "switched off", "more satellites than places"),
)
def test_what_is_not_followed_has_no_reflection(
    mean_m: float, since_s: float, time_s: float, places: bool
) -> None:
    assert not found_m([mean_m] * 6, since_s, time_s, places).any()


def test_bands_of_a_satellite_have_its_errors_and_each_the_size_of_its_own() -> None:
    par = parameters(reflection_rate=1.0 / 30.0, n_slow=4)[0]
    bank = new_filter(place())
    log = perfect_rows(bank, parameters(), [START_NS], sky(place())[:3])
    log.observation["slot"] = np.array([5, 9, 5]) * N_BANDS + [0, 0, 1]
    lines = new_epoch(3, 20).lines
    place_range_biases(bank, par, log, 0, lines)
    assert lines["bias"].tolist() == [1, 2, 1]
    lines["variance"][:, PSEUDORANGE] = 1.0
    write_reflections(remembered(log, [3.0, 4.0, -5.0], 0.0, 1.0), par, log, 0, lines)
    of_all = np.sqrt((9.0 + 16.0 + 25.0) / 3.0)  # without noise nothing is taken off
    np.testing.assert_allclose(lines["reflection"], [of_all, of_all, -5.0])


def test_satellite_that_takes_a_place_leaves_both_errors_of_the_one_before_in_the_remainder() -> None:
    held = np.array([DR, DR + 1, DR + 2, CLOCK])
    par = parameters(reflection_rate=1.0 / 30.0, n_slow=1, n_held=len(held))[0]
    par["held"][: len(held)] = held
    bank = new_filter(place())
    log = perfect_rows(bank, parameters(), START_NS + np.array([0, NS_PER_S]), sky(place())[:1])
    log.observation["slot"] = np.array([5, 9]) * N_BANDS
    lines = new_epoch(1, 20).lines
    place_range_biases(bank, par, log, 0, lines)
    of_satellite = slice(N_PATTERNS, N_PATTERNS + N_OF_SATELLITE)
    bank.slow.S[of_satellite, held] = np.random.default_rng(34).standard_normal((N_OF_SATELLITE, len(held)))
    effect = bank.slow.S.copy()
    place_range_biases(bank, par, log, 1, lines)
    assert lines["bias"][0] == 1 and bank.head["biased"][0, 0] == 10
    assert not bank.slow.S.any()
    np.testing.assert_allclose(bank.slow.R, effect.T @ effect, atol=1e-12)
