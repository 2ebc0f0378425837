"""A satellite whose range rates are noisier than the others' has a level of its own; what all share raises none."""

from __future__ import annotations

import numpy as np
import pytest

from insgnss.constants import NS_PER_S
from insgnss.filter.parameters import PARAMETERS_DTYPE
from insgnss.filter.state import DRIFT, DV, N_MEMORY, OFFSETS
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.satellite_memory import SQUARE, SQUARE_S
from insgnss.filter.update.satellite_noise import widen_noisy_rates
from insgnss.gnss.observation_rows import N_BANDS, OBSERVATION_DTYPE, RANGE_RATE
from insgnss.status import INCONSISTENT, USED
from insgnss.tables import Float64
from tests.filter.scene import geometry

SIGMA = 0.05
MEMORY_S = 8.0
FREEDOM = 3.0
CALM = 1.0


class Sky:
    """Satellites around the horizon and above, and the filter's velocity sigma of 1 m/s."""

    def __init__(self, n: int = 10, memory_s: float = MEMORY_S) -> None:
        self.par = np.zeros(1, PARAMETERS_DTYPE)[0]
        self.par["rate_memory_s"], self.par["adapt_most"] = memory_s, 1000.0
        self.P = np.eye(OFFSETS)
        self.memory = np.full((n * N_BANDS, N_MEMORY), -np.inf)
        self.work = new_epoch(n, OFFSETS)
        self.observation = np.zeros(n, OBSERVATION_DTYPE)
        self.observation["slot"] = np.arange(n) * N_BANDS
        self.G = geometry(2.4 * np.arange(n), np.radians(15.0 + 65.0 * (np.arange(n) % 4) / 3.0))

    def levels(self, innovation: Float64, t_s: float) -> Float64:
        """Return each satellite's level after an epoch, and check that its variance is so much larger."""
        lines = self.work.lines
        lines["status"][:, RANGE_RATE] = USED
        lines["innovation"][:, RANGE_RATE] = innovation
        lines["variance"][:, RANGE_RATE], lines["extra"] = SIGMA**2, 0.0
        lines["h"][:, RANGE_RATE, 3:6] = self.G[:, :3]
        widen_noisy_rates(
            self.P,
            self.memory,
            lines,
            self.observation,
            int(t_s * NS_PER_S),
            self.work.fit,
            np.zeros(len(lines)),
            self.par,
        )
        variance = lines["variance"][:, RANGE_RATE]
        np.testing.assert_allclose(variance - lines["extra"], SIGMA**2)
        return np.array(variance / SIGMA**2)


def test_the_reflected_satellite_alone_is_widened() -> None:
    sky, wrong = Sky(), np.zeros(10)
    wrong[4] = 2.0
    levels = sky.levels(wrong, 1.0)
    assert np.sqrt(levels[4]) * SIGMA == pytest.approx(2.0 / np.sqrt(FREEDOM + 1.0), rel=0.1)
    assert np.delete(levels, 4).max() < 2.0


def test_two_of_ten_are_told_from_the_others() -> None:
    sky, wrong = Sky(), np.zeros(10)
    wrong[[2, 7]] = 1.5, -1.0
    for t_s in (1.0, 2.0, 3.0):
        levels = sky.levels(wrong, t_s)
    assert np.delete(levels, [2, 7]).max() < 2.0
    assert np.all(np.sqrt(levels[[2, 7]]) * SIGMA > 0.7 * np.abs(wrong[[2, 7]]))


def test_a_level_is_kept_and_falls_back() -> None:
    sky, wrong = Sky(), np.zeros(10)
    wrong[4] = 2.0
    first = sky.levels(wrong, 1.0)[4] + CALM
    after = sky.levels(np.zeros(10), 1.0 + MEMORY_S)[4] + CALM
    kept = 1.0 + (first - 1.0) * np.exp(-1.0)
    assert after == pytest.approx(FREEDOM * kept / (FREEDOM + 1.0), rel=0.05)
    assert sky.levels(np.zeros(10), 100.0)[4] == 1.0


def test_a_wrong_velocity_or_clock_raises_no_level() -> None:
    """What position, velocity or clock explain is the filter's or the receiver's, and no satellite's."""
    sky = Sky()
    assert sky.P[DV, DV] == sky.P[DRIFT, DRIFT] == 1.0
    assert sky.levels(sky.G @ np.array([3.0, -2.0, 1.0, 30.0]), 1.0).max() < 1.01


def test_few_satellites_show_no_level_and_keep_what_is_known() -> None:
    sky, wrong = Sky(4), np.array([5.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(sky.levels(wrong, 1.0), 1.0)
    sky.memory[::N_BANDS, SQUARE], sky.memory[::N_BANDS, SQUARE_S] = 9.0, 1.0
    np.testing.assert_allclose(sky.levels(wrong, 1.0), 9.0 - CALM)


def test_without_memory_nothing_is_widened() -> None:
    wrong = np.zeros(10)
    wrong[4] = 2.0
    np.testing.assert_array_equal(Sky(memory_s=0.0).levels(wrong, 1.0), 1.0)


def test_ordinary_noise_stays_at_the_common_level() -> None:
    """The mean of 1 / L is 0.99 for normal errors."""
    sky, rng = Sky(), np.random.default_rng(11)
    found = [sky.levels(SIGMA * rng.standard_normal(10), float(t_s)) for t_s in range(1, 400)]
    assert 0.97 < np.mean(1.0 / np.array(found)) < 1.0


def test_noise_that_has_risen_for_all_is_no_satellites() -> None:
    """Three times the sigma: the common level is to follow, and most rows keep theirs until it has."""
    sky, rng = Sky(), np.random.default_rng(12)
    found = [sky.levels(3.0 * SIGMA * rng.standard_normal(10), float(t_s)) for t_s in range(1, 400)]
    assert np.mean(1.0 / np.array(found)) > 0.5


def test_few_that_contradict_all_others_are_refused() -> None:
    """A level hides no fault: the rows that the search would find among ordinary ones are found before it."""
    sky, wrong = Sky(), np.zeros(10)
    sky.par["residual_gate2"] = 25.0
    wrong[[2, 7]] = 1.5, -1.0
    sky.levels(wrong, 1.0)
    status = sky.work.lines["status"][:, RANGE_RATE]
    np.testing.assert_array_equal(np.flatnonzero(status == INCONSISTENT), [2, 7])
    assert np.all(np.delete(status, [2, 7]) == USED)
