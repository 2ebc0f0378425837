"""Whole cycles from an attitude of which the heading is not known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.attitude.baselines import attitude_matrices
from insgnss.attitude.cycle_search import DifferenceRows, Prior, find_cycles
from tests.attitude.arrays import eight, four_antennas

SIGMA_M = 0.003
TRUE_RPY = np.radians([1.2, -0.8, 211.0])
LEVEL = attitude_matrices([0.0, 0.0, 0.0])  # what is known: level to a degree and a half, no heading


def rows_of(
    satellites: slice = slice(None),
    antennas: slice = slice(1, None),
    *,
    separate: bool = False,
    seed: int = 1,
) -> tuple[DifferenceRows, np.ndarray]:
    """Return drawn differences against the first of four antennas, and their whole cycles."""
    rng = np.random.default_rng(seed)
    sky, array = eight(), four_antennas()
    u = sky.los_n[satellites]
    l_b = (array.positions_b - array.positions_b[0])[antennas]
    baseline, direction = np.repeat(l_b, len(u), axis=0), np.tile(u, (len(l_b), 1))
    cycles = rng.integers(-1_000_000, 1_000_000, len(direction))
    clock = np.repeat(np.arange(len(l_b)), len(u)) if separate else np.full(len(direction), -1)
    late = np.repeat(rng.normal(0.0, 1e4, len(l_b)), len(u)) if separate else 0.0
    path = -np.sum(direction * (baseline @ attitude_matrices(TRUE_RPY).T), axis=1)
    noise = rng.normal(0.0, SIGMA_M, (len(l_b) + 1, len(u)))
    value = path + late + 0.19 * cycles + (noise[1:] - noise[0]).ravel()
    shared = np.tile(np.eye(len(u)), (len(l_b), len(l_b)))
    covariance = SIGMA_M**2 * (np.eye(len(direction)) + shared)
    return DifferenceRows(
        baseline, direction, value, np.full(len(direction), 0.19), covariance, clock
    ), cycles


@pytest.mark.parametrize("separate", [False, True])
def test_all_cycles_are_found_without_any_heading(separate: bool) -> None:
    for seed in range(5):
        rows, cycles = rows_of(separate=separate, seed=seed)

        found = find_cycles(rows, [Prior(LEVEL, math.radians(1.5), math.pi)])

        wrong = found.cycles - cycles
        assert found.is_valid, found.reason
        # a clock of its own takes up one whole number for each antenna
        assert all(np.ptp(wrong[rows.clock == c]) == 0 for c in np.unique(rows.clock))
        assert separate or not wrong.any()
        angle = math.acos(0.5 * (np.trace(found.C_nb @ attitude_matrices(TRUE_RPY).T) - 1.0))
        assert angle < math.radians(0.6)  # three sigmas of 3 mm and eight satellites over 1.2 m


def test_losses_of_right_cycles_are_chi_square() -> None:
    losses = []
    for seed in range(30):
        rows, _ = rows_of(seed=seed)
        losses.append(find_cycles(rows, [Prior(LEVEL, math.radians(1.5), math.pi)]).loss)

    # 24 rows + 2 levels - 3 angles, of which the levels are one drawn attitude: 0.9 of their two degrees
    assert 20.0 < np.mean(losses) < 26.5


def test_one_baseline_gives_its_cycles_too() -> None:
    rows, cycles = rows_of(antennas=slice(1, 2))

    found = find_cycles(rows, [Prior(LEVEL, math.radians(1.5), math.pi)])

    assert found.is_valid
    assert np.array_equal(found.cycles, cycles)


def test_one_satellite_is_too_few() -> None:
    rows, _ = rows_of(satellites=slice(0, 1))

    found = find_cycles(rows, [Prior(LEVEL, math.radians(1.5), math.pi)])

    assert not found.is_valid
    assert "fewer than two satellites" in found.reason


def test_doubtful_cycles_are_not_believed() -> None:
    valid, right = 0, 0
    for seed in range(20):
        rows, cycles = rows_of(satellites=slice(0, 3), antennas=slice(1, 2), seed=seed)
        found = find_cycles(rows, [Prior(LEVEL, math.radians(1.5), math.pi)])
        valid += found.is_valid
        right += found.is_valid and np.array_equal(found.cycles, cycles)

    assert valid < 5  # three satellites and one baseline leave many headings
    assert right == valid


def test_long_baselines_and_no_attitude_are_refused_at_once() -> None:
    rows, _ = rows_of()
    long = DifferenceRows(100.0 * rows.l_b, *(getattr(rows, n) for n in (
        "u_n", "value_m", "wavelength_m", "covariance", "clock")))  # fmt: skip

    found = find_cycles(long, [Prior(LEVEL, math.radians(1.5), math.pi)])

    assert not found.is_valid
    assert "too uncertain" in found.reason
