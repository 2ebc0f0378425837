"""Epochs before a start that agree on no place: what they say of noise and time tags."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.filter.start.start_noise import Misfit, StartNoise
from insgnss.filter.update.tag_jumps import late_apart

NAN = math.nan


def noise_of(*epochs: tuple[float, float, float]) -> StartNoise:
    """Return what epochs have left: mean square of ranges and rates, how late the tag is (NaN: not shown)."""
    noise = StartNoise()
    for ranges, rates, late_s in epochs:
        noise.note(Misfit(np.array([ranges, rates]), None if math.isnan(late_s) else tagged(11, late_s)))
    return noise


def tagged(n: int, late_s: float, seed: int = 1) -> np.ndarray:
    """Return the pseudoranges of an epoch with a late tag, from a wrong place and a wrong clock."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(n, 3))
    u /= np.linalg.norm(u, axis=1)[:, None]
    growth = rng.uniform(-800.0, 800.0, n)
    residual = u @ [40.0, -20.0, 60.0] + 300.0 + late_s * growth + rng.normal(0.0, 2.0, n)
    return np.column_stack([u, np.ones(n), growth, residual]) / 2.0


@pytest.mark.parametrize(
    ("epochs", "factor"),
    [
        ([], (1.0, 1.0)),
        ([(400.0, 25.0, NAN)] * 9, (1.0, 1.0)),  # too few
        ([(400.0, 25.0, NAN)] * 10, (400.0, 25.0)),
        ([(400.0, NAN, NAN)] * 10, (400.0, 1.0)),  # the rates agree
        ([(400.0, 0.5, NAN)] * 6 + [(NAN, NAN, NAN)] * 4, (400.0, 1.0)),
        ([(400.0, 25.0, NAN)] * 5 + [(NAN, NAN, NAN)] * 5, (1.0, 1.0)),  # half of the epochs have a place
        ([(1e6, 25.0, NAN)] * 20, (1.0, 25.0)),  # no noise is that large
        ([(math.inf, 25.0, NAN)] * 20, (1.0, 25.0)),  # no common place at all
        ([(4.0, 4.0, NAN)] * 400 + [(16.0, 9.0, NAN)] * 200, (16.0, 9.0)),  # the latest 300
    ],
)
def test_factor_is_the_median_misfit_where_most_epochs_fail(
    epochs: list[tuple[float, float, float]], factor: tuple[float, float]
) -> None:
    assert noise_of(*epochs).factor().tolist() == list(factor)


def test_tags_are_late_where_most_failed_epochs_say_so() -> None:
    late_s = noise_of(*[(30.0, 1.0, 0.05)] * 6, *[(30.0, 1.0, NAN)] * 5).late_s()
    assert abs(late_s - 0.05) < 0.02
    assert math.isnan(noise_of(*[(30.0, 1.0, 0.05)] * 5, *[(30.0, 1.0, NAN)] * 5).late_s())
    assert math.isnan(StartNoise().late_s())


def test_copy_does_not_change_with_what_it_was_copied_from() -> None:
    noise = noise_of(*[(4.0, 4.0, NAN)] * 10)
    copy = noise.snapshot()
    noise.note(Misfit(np.array([100.0, 100.0]), None))
    assert len(copy.misfits) == 10


@pytest.mark.parametrize(("n", "late_s", "found"), [(11, 0.05, True), (11, 0.0, False), (7, 0.05, False)])
def test_late_tag_moves_each_satellite_by_its_own_velocity(n: int, late_s: float, found: bool) -> None:
    late = late_apart(tagged(n, late_s, seed=5))
    assert (abs(late.late_s - late_s) < 4.0 * late.sigma_s) if found else math.isnan(late.late_s)
