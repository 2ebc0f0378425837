"""The two-stage way: integer search against brute force, Wahba against another solver, wrong cycles never used."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.attitude.attitude_fit import wahba
from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    attitude_matrices,
    phase_differences,
    triangle,
    wrapped,
)
from insgnss.attitude.integer_search import nearest_integers
from insgnss.attitude.two_stage import Epoch, equivalent_orders, is_turned_over, solve
from insgnss.errors import ConfigError, GeometryError
from insgnss.geodesy.rotations import rotation_matrix, rotation_vector
from tests.attitude.arrays import eight, four_antennas, mixed
from tests.statistics_bounds import assert_mean_chi_square, nees


def epoch(
    array: AntennaArray,
    sky: Sky,
    rng: np.random.Generator,
    range_sd_m: float = 0.3,
    phase_sd_m: float = 0.003,
    clocks: str = "common",
    order: tuple[int, ...] | None = None,
) -> tuple[np.ndarray, Epoch]:
    """Return a random attitude and what the receivers measure; ``order``: how the cables really are."""
    C = attitude_matrices(rng.uniform([-0.3, -0.3, -3.0], [0.3, 0.3, 3.0]))
    real = array if order is None else array.reordered(order)
    shape = (len(array.positions_b), len(sky.los_n))
    sd = 2.0 * np.pi * phase_sd_m / sky.wavelength_m
    phase_noise, range_noise = rng.standard_normal(shape) * sd, rng.standard_normal(shape) * range_sd_m
    clock = rng.uniform(-30.0, 30.0, (shape[0] - 1, 1)) if clocks == "separate" else 0.0
    phase = phase_differences(C, real, sky) + phase_noise[1:] - phase_noise[:1]
    ranges = -(real.baselines_b @ C.T) @ sky.los_n.T + range_noise[1:] - range_noise[:1] + clock
    measured = wrapped(phase - clock * 2.0 * np.pi / sky.wavelength_m)
    variance = np.broadcast_to(sd**2, shape)
    return C, Epoch(array, sky, measured, variance, ranges, np.full(shape, range_sd_m**2), clocks)


def test_integer_search_equals_brute_force() -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        n = int(rng.integers(1, 5))
        root = rng.standard_normal((n, n))
        Q, a = 0.5 * root @ root.T + 0.01 * np.eye(n), rng.uniform(-3.0, 3.0, n)
        grid = np.array(list(itertools.product(range(-7, 8), repeat=n)))
        distance = np.einsum("ki,ij,kj->k", grid - a, np.linalg.inv(Q), grid - a)
        nearest = np.argsort(distance)[:3]
        found = nearest_integers(a, Q, 3)

        assert np.array_equal(found.integers, grid[nearest])
        assert np.allclose(found.distance, distance[nearest], rtol=1e-9)


def test_integer_search_keeps_large_ambiguities_exact() -> None:
    Q = np.array([[4.0, 3.9, 0.1], [3.9, 4.0, 0.0], [0.1, 0.0, 0.3]])
    a, far = np.array([0.3, -0.2, 0.4]), np.array([1e8, -3e7, 12.0])

    assert np.array_equal(
        nearest_integers(a + far, Q, 4).integers - far.astype(int), nearest_integers(a, Q, 4).integers
    )
    with pytest.raises(ConfigError, match="positive definite"):
        nearest_integers([0.1, 0.2], np.ones((2, 2)), 2)


def test_wahba_equals_another_solver() -> None:
    rng = np.random.default_rng(2)
    for count in (2, 3, 6):
        v_b, sd = rng.standard_normal((count, 3)), rng.uniform(0.01, 0.1, count)
        C = attitude_matrices(rng.uniform(-1.5, 1.5, 3))
        v_n = v_b @ C.T + sd[:, None] * rng.standard_normal((count, 3))
        other = Rotation.align_vectors(v_n, v_b, weights=1.0 / sd**2)[0].as_matrix()

        assert np.abs(wahba(v_n, v_b, sd).C_nb - other).max() < 1e-9


def test_wahba_covariance_and_loss_are_those_of_its_errors() -> None:
    rng, runs, sd = np.random.default_rng(3), 300, np.array([0.01, 0.02, 0.015])
    v_b, C = four_antennas().baselines_b, attitude_matrices([0.2, -0.1, 2.0])
    errors, covariances, losses = [], [], []
    for _ in range(runs):
        found = wahba(v_b @ C.T + sd[:, None] * rng.standard_normal((3, 3)), v_b, sd)
        errors.append(rotation_vector(found.C_nb @ C.T))
        covariances.append(found.covariance_n)
        losses.append(found.loss)

    assert_mean_chi_square(nees(errors, covariances), 3)
    assert_mean_chi_square(losses, 3 * 3 - 3)


def test_wahba_of_one_line_is_refused() -> None:
    with pytest.raises(GeometryError, match="line"):
        wahba(np.outer([1.0, 2.0], [1.0, 0.0, 0.0]), np.outer([1.0, 2.0], [0.0, 1.0, 0.0]), 0.01)


@pytest.mark.parametrize(
    ("array", "sky", "clocks"),
    [
        (triangle(1.0), eight(), "common"),
        (four_antennas(), mixed(), "common"),
        (four_antennas(), eight(), "separate"),
    ],
)
def test_whole_cycles_are_found_and_the_attitude_is_consistent(
    array: AntennaArray, sky: Sky, clocks: str
) -> None:
    rng, errors, covariances, losses = np.random.default_rng(4), [], [], []
    for _ in range(60):
        C, one = epoch(array, sky, rng, clocks=clocks)
        found = solve(one)
        assert found.is_valid, found.reason
        errors.append(rotation_vector(found.C_nb @ C.T))
        covariances.append(found.covariance_n)
        losses.append(found.loss)

    rows = len(array.baselines_b) * (len(sky.los_n) - (clocks == "separate"))
    assert_mean_chi_square(nees(errors, covariances), 3)
    assert_mean_chi_square(losses, rows + 3 * len(array.baselines_b) - 3)


def test_wrong_cycles_are_never_used_where_signals_are_poor() -> None:
    used, wrong, wrong_used = 0, 0, 0
    for satellites, range_sd_m, phase_sd_m in ((4, 0.7, 0.003), (8, 2.0, 0.010)):
        rng, sky = np.random.default_rng(5), eight().only(np.arange(8) % (8 // satellites) == 0)
        for _ in range(30):
            C, one = epoch(triangle(1.0), sky, rng, range_sd_m, phase_sd_m)
            found = solve(one)
            assert found.is_valid or found.reason
            is_wrong = found.C_nb is None or np.linalg.norm(rotation_vector(found.C_nb @ C.T)) > 0.1
            used += found.is_valid
            wrong += is_wrong
            wrong_used += found.is_valid and is_wrong

    assert wrong >= 1  # the best fit alone would have been wrong: the case is hard enough to tell something
    assert wrong_used == 0
    assert 20 <= used <= 55


def test_too_many_possible_cycles_are_said_and_nothing_is_drawn_from_a_part_of_them() -> None:
    rng, sky = np.random.default_rng(5), eight().only(np.arange(8) % 2 == 0)
    found = solve(epoch(triangle(1.0), sky, rng, 2.0, 0.012)[1])

    assert not found.is_valid and found.C_nb is None
    assert "too many" in found.reason


def test_cycles_pushed_off_by_a_faulty_phase_are_reported() -> None:
    rng = np.random.default_rng(6)
    _, one = epoch(four_antennas(), eight(), rng)
    shifted = one.phase.copy()
    shifted[:, 3] += [1.5, -1.2, 2.0]  # a quarter of a cycle on one satellite
    found = solve(Epoch(one.array, one.sky, shifted, one.phase_variance, one.range_m, one.range_variance))

    assert not found.is_valid
    assert found.reason


def test_swapped_antennas_are_named() -> None:
    array = four_antennas()
    _, one = epoch(array, eight(), np.random.default_rng(7), order=(0, 2, 1, 3))
    found = solve(one)

    assert not found.is_valid and found.C_nb is None
    assert found.swapped == (0, 2, 1, 3)
    assert "antenna 1, antenna 3, antenna 2, antenna 4" in found.reason


def test_swap_that_no_length_shows_turns_the_vehicle_over() -> None:
    array = triangle(1.0)
    _, one = epoch(array, eight(), np.random.default_rng(8), order=(0, 2, 1))
    found = solve(one)

    assert (0, 2, 1) in equivalent_orders(array) and equivalent_orders(four_antennas()) == []
    assert found.is_valid and is_turned_over(found.C_nb, eight())
    right = solve(epoch(array, eight(), np.random.default_rng(8))[1])
    assert not is_turned_over(right.C_nb, eight())


def test_guess_of_the_attitude_serves_in_the_place_of_ranges() -> None:
    rng = np.random.default_rng(9)
    C, one = epoch(triangle(1.0), eight(), rng)
    bare = Epoch(one.array, one.sky, one.phase, one.phase_variance)
    guess = rotation_matrix([0.03, -0.05, 0.04]) @ C
    found = solve(bare, guess, 0.05)

    assert found.is_valid
    assert np.linalg.norm(rotation_vector(found.C_nb @ C.T)) < 5.0 * math.sqrt(np.trace(found.covariance_n))
    with pytest.raises(ConfigError, match="pseudoranges"):
        solve(bare)


def test_separate_clocks_on_channels_of_their_own_are_refused() -> None:
    with pytest.raises(ConfigError, match="GLONASS"):
        epoch(triangle(1.0), mixed(), np.random.default_rng(10), clocks="separate")
    with pytest.raises(GeometryError, match="line"):
        line = AntennaArray(np.outer([0.0, 1.0, 2.0], [1.0, 0.0, 0.0]))
        epoch(line, eight(), np.random.default_rng(10))
