"""The point solution of one epoch: exactness, faults of every size, geometry, covariance, velocity."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pymap3d
import pytest

from insgnss.gnss.least_squares import RANGE, RANGE_RATE, FitRows, Ties, free_clocks, workspace
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.gnss.point.integrity import (
    BAD_GEOMETRY,
    EXCLUDED,
    NOT_IDENTIFIED,
    OK,
    TOO_FEW,
    UNTESTED,
    Fits,
    agree,
    redundancy_room,
)
from insgnss.runs.point import chi_square_limits
from insgnss.tables import Float64

LAT_DEG, LON_DEG, H_M = 59.97, 30.32, 1000.0
R_E = np.array(pymap3d.geodetic2ecef(LAT_DEG, LON_DEG, H_M))
V_E = np.array([31.0, -75.0, 12.0])
CLOCK_M, DRIFT_MPS = 83_211.7, -212.4
# The eleven satellites of the paper's scenario at 90 s, azimuth and elevation [deg]
SKY = [
    (75, 23),
    (319, 20),
    (281, 42),
    (294, 20),
    (240, 51),
    (106, 14),
    (144, 49),
    (168, 82),
    (87, 22),
    (46, 23),
    (126, 26),
]


@dataclass
class Epoch:
    """One epoch's rows with truth, and what a solution made of it."""

    sat: Float64
    ranges: Float64
    rates: Float64
    group: npt.NDArray[np.int64]
    use: npt.NDArray[np.bool_]
    n_groups: int = 1
    x: Float64 = field(default_factory=lambda: np.zeros(0))
    P: Float64 = field(default_factory=lambda: np.zeros((0, 0)))

    def position(
        self, sigma: float = 3.0, guess: npt.ArrayLike = (0.0, 0.0, 0.0), ties: Ties | None = None
    ) -> int:
        ties = free_clocks(self.n_groups) if ties is None else ties
        start = np.append(np.array(guess, dtype=np.float64), np.zeros(self.n_groups))
        sigmas = np.full(len(self.use), sigma)
        return self._solve(FitRows(RANGE, self.sat, self.ranges, sigmas, self.group, ties, start), start)

    def velocity(self, sigma: float = 0.1, r_e: Float64 = R_E) -> int:
        n = len(self.use)
        one_clock, sigmas = np.zeros(n, np.int64), np.full(n, sigma)
        rows = FitRows(RANGE_RATE, self.sat, self.rates, sigmas, one_clock, free_clocks(1), r_e)
        return self._solve(rows, np.zeros(4))

    def _solve(self, rows: FitRows, start: Float64) -> int:
        """Return the verdict, OK with and without an exclusion."""
        p, n = len(start), len(self.use)
        self.x, self.P = np.zeros(p), np.zeros((p, p))
        fits = Fits(chi_square_limits(n, 1e-4), workspace(p), redundancy_room(n))
        verdict, _, _ = agree(rows, self.use, start, self.x, self.P, fits)
        return OK if verdict == EXCLUDED else verdict


def epoch_of(
    sky: list[tuple[float, float]], rng: np.random.Generator, groups: list[int] | None = None
) -> Epoch:
    """Return an epoch without noise: satellites of the sky, ranges and rates with the receiver's clock."""
    n = len(sky)
    places = [pymap3d.aer2ecef(az, el, 2.2e7 + 3e6 * (1 - el / 90), LAT_DEG, LON_DEG, H_M) for az, el in sky]
    sat = np.hstack([np.array(places), rng.normal(size=(n, 3)) * 1800.0, np.zeros((n, 3))])
    group = np.array(groups or [0] * n, np.int64)
    both = np.array([line_of_sight(sat, k, R_E, V_E, np.zeros(3), np.zeros(3)) for k in range(n)])
    clocks = CLOCK_M + 25.0 * group
    return Epoch(
        sat, both[:, 0] + clocks, both[:, 1] + DRIFT_MPS, group, np.ones(n, np.bool_), int(group.max()) + 1
    )


def error_m(epoch: Epoch) -> float:
    return float(np.linalg.norm(epoch.x[:3] - R_E))


@pytest.mark.parametrize("n", [4, 5, 11])
@pytest.mark.parametrize("guess", [(0.0, 0.0, 0.0), tuple(R_E + 1e6)])
def test_position_without_noise_is_exact_from_any_guess(
    rng: np.random.Generator, n: int, guess: tuple[float, float, float]
) -> None:
    epoch = epoch_of(SKY[:n], rng)
    assert epoch.position(guess=guess) == (UNTESTED if n == 4 else OK)
    # rounding of 2e7 m times the dilution
    assert error_m(epoch) < 1e-6
    assert epoch.x[3] == pytest.approx(CLOCK_M, abs=1e-6)
    assert epoch.use.all()


def tied(sigma_m: float) -> Ties:
    """Return two clocks that differ by so much, one sigma."""
    return Ties(np.array([-1, 0]), 1.0 / sigma_m**2)


def dense_solution(epoch: Epoch, sigma: float, tie_m: float) -> tuple[Float64, Float64]:
    """Return solution and covariance with the tie as a row of its own, linear at the truth."""
    n = len(epoch.ranges)
    H = np.zeros((n + 1, 5))
    at = np.array([line_of_sight(epoch.sat, k, R_E, V_E, np.zeros(3), np.zeros(3))[0] for k in range(n)])
    to = epoch.sat[:, :3] - R_E
    H[:n, :3] = -to / np.linalg.norm(to, axis=1)[:, None]
    H[np.arange(n), 3 + epoch.group] = 1.0
    H[n, 3:] = -1.0, 1.0
    W = np.diag([1.0 / sigma**2] * n + [1.0 / tie_m**2])
    P = np.linalg.inv(H.T @ W @ H)
    return np.append(R_E, [0.0, 0.0]) + P @ H.T @ W @ np.append(epoch.ranges - at, 0.0), P


@pytest.mark.parametrize("tie_m", [0.1, 3.0, 1e4])
def test_tied_clocks_are_the_solution_with_a_row_that_says_they_are_alike(
    rng: np.random.Generator, tie_m: float
) -> None:
    epoch = epoch_of(SKY, rng, groups=[0] * 7 + [1] * 4)
    epoch.ranges += np.where(epoch.group == 1, 2.0 - 25.0, 0.0) + rng.normal(size=11)
    assert epoch.position(ties=tied(tie_m)) == OK
    x, P = dense_solution(epoch, 3.0, tie_m)
    # the lines of sight of the dense rows leave the Earth's turn out: 1e-5 of the sensitivity
    np.testing.assert_allclose(epoch.x, x, rtol=0, atol=1e-3)
    np.testing.assert_allclose(epoch.P, P, rtol=1e-3, atol=1e-3)


def test_one_satellite_of_a_tied_clock_fixes_a_position_with_three_others(rng: np.random.Generator) -> None:
    epoch = epoch_of(SKY[2:6], rng, groups=[0, 0, 0, 1])
    assert epoch.position() == TOO_FEW
    epoch.use[:], epoch.ranges[3] = True, epoch.ranges[3] - 25.0
    assert epoch.position(ties=tied(3.0)) == UNTESTED
    assert error_m(epoch) < 1e-6
    assert epoch.x[4] == pytest.approx(epoch.x[3], abs=1e-6)


def test_tied_clock_without_its_home_is_a_clock_of_its_own(rng: np.random.Generator) -> None:
    epoch = epoch_of(SKY[:6], rng, groups=[1] * 6)
    assert epoch.position(ties=tied(3.0)) == OK
    assert error_m(epoch) < 1e-6 and epoch.x[4] == pytest.approx(CLOCK_M + 25.0, abs=1e-6)


def test_false_ranges_among_tied_clocks_are_found_by_the_search(rng: np.random.Generator) -> None:
    epoch = epoch_of(SKY, rng, groups=[0] * 7 + [1] * 4)
    epoch.ranges += np.where(epoch.group == 1, 2.0 - 25.0, 0.0)
    epoch.ranges[[1, 5, 8]] += (90.0, 400.0, -300.0)
    assert epoch.position(sigma=1.0, ties=tied(3.0)) == OK
    assert np.flatnonzero(~epoch.use).tolist() == [1, 5, 8]
    assert error_m(epoch) < 1.0 and epoch.x[4] - epoch.x[3] == pytest.approx(2.0, abs=1.0)


def test_velocity_without_noise_is_exact(rng: np.random.Generator) -> None:
    epoch = epoch_of(SKY, rng)
    assert epoch.velocity() == OK
    np.testing.assert_allclose(epoch.x, [*V_E, DRIFT_MPS], rtol=0, atol=1e-9)


def test_velocity_for_a_position_one_kilometre_off_is_as_wrong_as_stated(rng: np.random.Generator) -> None:
    epoch = epoch_of(SKY, rng)
    assert epoch.velocity(r_e=R_E + np.array([600.0, 600.0, -500.0])) == OK
    assert 0.0 < np.linalg.norm(epoch.x[:3] - V_E) < 0.5


def test_sagnac_and_light_time_must_matter(rng: np.random.Generator) -> None:
    """Straight distances in place of true ones move the fix by tens of metres."""
    epoch = epoch_of(SKY, rng)
    epoch.ranges = np.linalg.norm(epoch.sat[:, :3] - R_E, axis=1)
    assert epoch.position() in (OK, NOT_IDENTIFIED)
    assert 10.0 < error_m(epoch) < 100.0


@pytest.mark.parametrize("size_m", [50.0, -50.0, 5e3, -3e5])
@pytest.mark.parametrize("k", [0, 3, 5, 9])
def test_single_fault_is_found_and_excluded(rng: np.random.Generator, size_m: float, k: int) -> None:
    epoch = epoch_of(SKY[:10], rng)
    epoch.ranges += rng.normal(size=10) * 3.0
    epoch.ranges[k] += size_m
    assert epoch.position() == OK
    assert list(np.flatnonzero(~epoch.use)) == [k]
    assert error_m(epoch) < 30.0


@pytest.mark.parametrize("sizes_m", [(50.0, 5e3), (3e5, 3e5), (60.0, 60.0), (-5e3, 3e5)])
def test_double_fault_is_found_and_excluded(rng: np.random.Generator, sizes_m: tuple[float, float]) -> None:
    doubtful = 0
    for pair in itertools.combinations(range(0, 10, 2), 2):
        epoch = epoch_of(SKY[:10], rng)
        epoch.ranges += rng.normal(size=10) * 2.0
        epoch.ranges[list(pair)] += sizes_m
        verdict = epoch.position(sigma=2.0)
        doubtful += verdict == NOT_IDENTIFIED
        if verdict != NOT_IDENTIFIED:
            assert verdict == OK and tuple(np.flatnonzero(~epoch.use)) == pair
            assert error_m(epoch) < 30.0
    # of ten pairs; of two equal faults another pair may explain the ranges nearly as well
    assert doubtful <= 1


@pytest.mark.parametrize("sizes_m", [(50.0, 5e3, 3e5), (-3e5, 3e5, 3e5), (100.0, 100.0, 100.0)])
def test_triple_fault_among_ten_is_found_and_excluded(
    rng: np.random.Generator, sizes_m: tuple[float, float, float]
) -> None:
    for three in ((0, 1, 2), (1, 4, 7), (0, 5, 9), (2, 6, 8)):
        epoch = epoch_of(SKY[:10], rng)
        epoch.ranges += rng.normal(size=10) * 2.0
        epoch.ranges[list(three)] += sizes_m
        assert epoch.position(sigma=2.0) == OK
        assert tuple(np.flatnonzero(~epoch.use)) == three
        assert error_m(epoch) < 30.0


def test_faults_of_a_third_of_thirty_satellites_of_three_constellations_are_excluded(
    rng: np.random.Generator,
) -> None:
    sky = [
        (float(az), float(el)) for az, el in zip(rng.uniform(0, 360, 30), rng.uniform(8, 85, 30), strict=True)
    ]
    epoch = epoch_of(sky, rng, groups=[k % 3 for k in range(30)])
    epoch.ranges += rng.normal(size=30) * 2.0
    false = rng.choice(30, 10, replace=False)
    epoch.ranges[false] += rng.choice([-1.0, 1.0], 10) * rng.uniform(50.0, 1e4, 10)
    assert epoch.position(sigma=2.0) == OK
    assert sorted(np.flatnonzero(~epoch.use)) == sorted(false)
    np.testing.assert_allclose(epoch.x[3:], CLOCK_M + 25.0 * np.arange(3), rtol=0, atol=15.0)


def test_one_fault_among_five_is_detected_and_not_guessed(rng: np.random.Generator) -> None:
    epoch = epoch_of([SKY[k] for k in (0, 2, 4, 6, 7)], rng)
    epoch.ranges += rng.normal(size=5)
    epoch.ranges[2] += 5e3
    assert epoch.position(sigma=1.0) == NOT_IDENTIFIED


def test_more_faults_than_may_be_given_up_are_inconsistent(rng: np.random.Generator) -> None:
    """Five of eight agree, but (8 - 4) / 2 = 2 is the most that is given up."""
    epoch = epoch_of(SKY[:8], rng)
    epoch.ranges[[0, 2, 4]] += [500.0, -900.0, 4e3]
    assert epoch.position() == NOT_IDENTIFIED
    assert list(np.flatnonzero(~epoch.use)) == [0, 2, 4]


def test_faulty_range_rate_is_found_and_excluded(rng: np.random.Generator) -> None:
    epoch = epoch_of(SKY[:10], rng)
    epoch.rates += rng.normal(size=10) * 0.05
    epoch.rates[[1, 8]] += [3.0, -190.0]
    assert epoch.velocity(sigma=0.05) == OK
    assert list(np.flatnonzero(~epoch.use)) == [1, 8]
    assert np.linalg.norm(epoch.x[:3] - V_E) < 0.5


def test_noise_alone_seldom_excludes_a_row(rng: np.random.Generator) -> None:
    excluded = 0
    for _ in range(300):
        epoch = epoch_of(SKY, rng)
        epoch.ranges += rng.normal(size=11) * 3.0
        assert epoch.position() == OK
        excluded += int((~epoch.use).sum())
    # false alarm 1e-4 per epoch
    assert excluded <= 1


def test_covariance_is_that_of_the_errors(rng: np.random.Generator) -> None:
    """Normalised squared error of four unknowns over 300 runs: chi-square of 1200, 99.9 % between 1044 and 1366."""
    total = 0.0
    for _ in range(300):
        epoch = epoch_of(SKY, rng)
        epoch.ranges += rng.normal(size=11) * 3.0
        epoch.position()
        d = epoch.x - np.array([*R_E, CLOCK_M])
        total += float(d @ np.linalg.solve(epoch.P, d))
    assert 1044.0 < total < 1366.0


@pytest.mark.parametrize("n", [0, 1, 3])
def test_fewer_than_four_rows_are_too_few(rng: np.random.Generator, n: int) -> None:
    epoch = epoch_of(SKY[: max(n, 1)], rng)
    epoch.use[n:] = False
    assert epoch.position() == TOO_FEW


def test_every_further_constellation_needs_a_row_more(rng: np.random.Generator) -> None:
    assert epoch_of(SKY[:4], rng, groups=[0, 0, 0, 1]).position() == TOO_FEW
    epoch = epoch_of([SKY[k] for k in (0, 1, 6, 7, 2)], rng, groups=[0, 0, 0, 0, 1])
    assert epoch.position() == UNTESTED
    assert epoch.x[4] - epoch.x[3] == pytest.approx(25.0, abs=1e-5)


def test_constellation_without_rows_does_not_disturb_the_others(rng: np.random.Generator) -> None:
    epoch = epoch_of(SKY, rng, groups=[1] * 11)
    assert epoch.position() == OK
    assert epoch.x[4] == pytest.approx(CLOCK_M + 25.0, abs=1e-5)
    assert error_m(epoch) < 1e-5


def test_only_row_of_a_constellation_is_kept_beside_a_fault(rng: np.random.Generator) -> None:
    epoch = epoch_of(SKY, rng, groups=[0] * 10 + [1])
    epoch.ranges[4] += 5e3
    assert epoch.position() == OK
    assert list(np.flatnonzero(~epoch.use)) == [4]
    assert epoch.x[4] == pytest.approx(CLOCK_M + 25.0, abs=1e-4)


def test_satellites_in_one_direction_are_bad_geometry(rng: np.random.Generator) -> None:
    assert epoch_of([(80, 30)] * 6, rng).position() == BAD_GEOMETRY


def test_receiver_in_low_orbit_is_found_from_the_earth_centre() -> None:
    r_e = R_E * (8.4e6 / np.linalg.norm(R_E))
    lat, lon, h = pymap3d.ecef2geodetic(*r_e)
    places = [pymap3d.aer2ecef(az, el - 10, 2.1e7, lat, lon, h) for az, el in SKY]
    sat = np.hstack([np.array(places), np.zeros((11, 6))])
    ranges = np.array([line_of_sight(sat, k, r_e, V_E, np.zeros(3), np.zeros(3))[0] for k in range(11)])
    epoch = Epoch(sat, ranges, np.zeros(11), np.zeros(11, np.int64), np.ones(11, np.bool_))
    assert epoch.position() == OK
    np.testing.assert_allclose(epoch.x[:3], r_e, rtol=0, atol=1e-5)


def test_same_epoch_gives_the_same_bits_and_order_matters_by_rounding_only(rng: np.random.Generator) -> None:
    first = epoch_of(SKY, rng)
    first.ranges += rng.normal(size=11) * 3.0
    first.ranges[[2, 7]] += [900.0, -4e4]
    turned = Epoch(
        first.sat[::-1].copy(), first.ranges[::-1].copy(), first.rates, first.group, first.use.copy()
    )
    again = Epoch(first.sat, first.ranges, first.rates, first.group, first.use.copy())
    assert first.position() == again.position() == turned.position() == OK
    np.testing.assert_array_equal(first.x, again.x)
    np.testing.assert_allclose(first.x, turned.x, rtol=0, atol=1e-5)
    assert list(first.use) == list(turned.use[::-1])
