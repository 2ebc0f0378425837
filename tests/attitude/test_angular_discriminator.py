"""The angular discriminator against the reference numbers, its noise against simulation, its aperture statistics."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy import stats

from insgnss.attitude.angular_discriminators import (
    angular_discriminator,
    angular_noise,
    discriminator_curve,
    likelihood_discriminator,
    likelihood_weights,
    pair_covariance,
    pair_discriminator,
    pair_slopes,
    partial_discriminators,
    partial_slopes,
    partial_variances,
    slopes,
)
from insgnss.attitude.aperture import apertures, random_attitudes
from insgnss.attitude.baselines import (
    attitude_matrices,
    difference_covariance,
    phase_differences,
    phases_by_euler,
    sky_of_angles,
    triangle,
)
from insgnss.attitude.correlator_bank import draw_correlators, signal_ratios
from insgnss.attitude.figures import planar_case
from insgnss.errors import ConfigError
from tests.attitude.arrays import eight, four_antennas, mixed
from tests.jacobian import finite_difference_jacobian

RPY = np.radians([10.0, -5.0, 30.0])


@pytest.mark.parametrize(
    ("rpy_deg", "expected"),
    [
        ((0.0, 0.0, 0.0), (2487.1625, 4145.2709, 5290.6226)),
        ((10.0, -5.0, 30.0), (2459.7910, 4145.7756, 5086.4461)),
        ((-20.0, 35.0, 200.0), (2280.0090, 3932.6721, 3686.2371)),
    ],
)
def test_slopes_equal_reference_numbers(rpy_deg: tuple[float, ...], expected: tuple[float, ...]) -> None:
    found = slopes(np.radians(rpy_deg), triangle(1.0), eight())

    # the reference has four decimals: half of the last one is 2e-8 of the smallest slope
    assert np.allclose(found, expected, rtol=1e-6, atol=0.0)
    assert np.allclose(found, expected, rtol=0.0, atol=5.1e-5)


@pytest.mark.parametrize("angle", ["roll", "pitch", "yaw"])
def test_slope_equals_the_derivative_of_the_curve_at_zero(angle: str) -> None:
    array, sky = four_antennas(), mixed()
    axis = ("roll", "pitch", "yaw").index(angle)
    numeric = finite_difference_jacobian(
        lambda x: discriminator_curve(angle, x, RPY, array, sky), np.zeros(1), 1e-4
    )

    assert numeric[0, 0] == pytest.approx(slopes(RPY, array, sky)[axis], rel=1e-8)
    assert numeric[0, 0] > 0.0


def test_curve_by_two_derivatives_equals_the_curve_by_rotation() -> None:
    array, sky, x = four_antennas(), mixed(), np.linspace(-3.0, 3.0, 41)
    for axis, angle in enumerate(("roll", "pitch", "yaw")):
        found = apertures(RPY, array, sky, angle).curves(x)[0] * slopes(RPY, array, sky)[axis]

        assert np.allclose(found, discriminator_curve(angle, x, RPY, array, sky), rtol=0.0, atol=1e-9)


def test_planar_apertures_equal_reference_numbers() -> None:
    array, sky = planar_case(1.5, 0.19)
    angles = np.radians([[0.0, a, 0.0] for a in (90.0, 60.0, 45.0, 30.0, 10.0)])

    found = np.degrees(apertures(angles, array, sky).width)

    assert np.allclose(found, [7.262, 8.395, 10.320, 14.947, 32.857], rtol=0.0, atol=5.1e-4)


@pytest.mark.parametrize(
    ("edge_m", "smallest", "median", "q95"), [(1.0, 14.1, 17.2, 32.3), (2.0, 7.05, 8.60, 16.2)]
)
def test_aperture_statistics_equal_reference_and_the_papers_intervals(
    edge_m: float, smallest: float, median: float, q95: float
) -> None:
    rpy = random_attitudes(10_000, np.random.default_rng(4))
    apertures(rpy[:1], triangle(edge_m), eight())  # compiled
    started = time.process_time()
    sample = apertures(rpy, triangle(edge_m), eight())
    low, high = np.degrees(sample.interval())

    assert time.process_time() - started < 30.0
    # the smallest of 10 000 is on a flat minimum; median and quantile vary by their own sampling errors,
    # sqrt(p (1 - p) / n) / density: 0.3 % and 1.5 %, taken three times for two independent samples
    assert low == pytest.approx(smallest, rel=0.005)
    assert np.degrees(np.median(sample.width)) == pytest.approx(median, rel=0.01)
    assert high == pytest.approx(q95, rel=0.045)
    # Dneprov and Korogodin: 13...32 and 7...16 deg, of a constellation that they do not name
    paper = (13.0, 32.0) if edge_m == 1.0 else (7.0, 16.0)
    assert abs(low - paper[0]) < 1.5 / edge_m and abs(high - paper[1]) < 1.5 / edge_m
    assert -0.92 < stats.spearmanr(sample.slope, sample.width)[0] < -0.85


@pytest.mark.parametrize(("length_m", "widest"), [(1.0, 21.1), (2.0, 10.2)])
def test_single_baseline_aperture_is_never_below_wavelength_over_length(
    length_m: float, widest: float
) -> None:
    rpy = random_attitudes(4_000, np.random.default_rng(5), "rotations")
    array = planar_case(length_m, 0.19)[0]
    sample = apertures(rpy, array, sky_of_angles([75.0], [55.0], 0.19))
    steep = sample.slope > np.median(sample.slope)

    assert np.degrees(np.min(sample.width)) == pytest.approx(np.degrees(0.19) / length_m, rel=0.01)
    # the paper's "10...30 deg" and "5...15 deg" for large slopes; lower satellites reach further
    assert np.degrees(np.max(sample.width[steep])) < widest
    assert stats.spearmanr(sample.slope, sample.width)[0] < -0.94


def test_zeros_found_are_crossings_and_none_lies_nearer() -> None:
    array, sky = triangle(1.0), eight()
    sample = apertures(random_attitudes(200, np.random.default_rng(6)), array, sky)
    for k in range(200):
        inside = np.linspace(sample.below[k], sample.above[k], 2001)[1:-1]
        curve = discriminator_curve("pitch", inside, sample.rpy[k], array, sky)
        assert np.all(curve * inside >= -1e-9)
        beyond = np.array([sample.below[k] - 1e-4, sample.above[k] + 1e-4])
        if np.all(np.abs(beyond) < np.pi):
            assert np.all(discriminator_curve("pitch", beyond, sample.rpy[k], array, sky) * beyond < 0.0)


def test_pair_discriminator_has_the_mean_noise_and_correlation_of_the_formulas() -> None:
    rng, count = np.random.default_rng(7), 40_000
    a = np.array([[8.0, 30.0], [12.0, 20.0], [6.0, 50.0]])
    u = pair_discriminator(draw_correlators(np.zeros((count, 2, 2)), a, rng), np.zeros((2, 2)))
    u /= pair_slopes(a)
    R = pair_covariance(a)
    found = np.einsum("tmn,tkn->nmk", u, u) / count

    own = np.einsum("nmm->nm", R)
    # products of normals have heavier tails than normals: at most 9 / 2 of the variance of a normal's square
    sd = np.sqrt(4.5 * (own[:, :, None] * own[:, None, :] + R**2) / count)
    assert np.all(np.abs(found - R) < 4.0 * sd)
    like = float(pair_covariance(np.full((2, 1), 2.0 * 37.0)).item())  # q T = 37
    assert like == pytest.approx(1.0 / 37.0 * (1.0 + 1.0 / 74.0), rel=1e-12)


def test_likelihood_gradient_equals_the_derivative_of_the_log_likelihood() -> None:
    rng = np.random.default_rng(8)
    psi = rng.uniform(-1.0, 1.0, (2, 3))
    Z = draw_correlators(psi, np.full((3, 3), 5.0), rng)

    def log_likelihood(x: np.ndarray) -> np.ndarray:
        turn = np.exp(-1j * np.r_[np.zeros((1, 3)), x.reshape(2, 3)])
        return np.log(np.i0(np.abs(np.sum(Z * turn, axis=0)))).sum()

    predicted = psi + rng.uniform(-0.5, 0.5, psi.shape)
    numeric = finite_difference_jacobian(log_likelihood, predicted.ravel(), 1e-3)
    assert np.allclose(likelihood_discriminator(Z, predicted).ravel(), numeric[0], rtol=0.0, atol=1e-7)


def test_likelihood_weights_are_the_inverse_of_the_shared_noise() -> None:
    a = np.random.default_rng(9).uniform(5.0, 50.0, (4, 6))

    assert np.allclose(np.linalg.inv(likelihood_weights(a)), difference_covariance(1.0 / a), rtol=1e-12)


def test_noise_of_the_sum_needs_the_shared_antenna() -> None:
    array, sky = triangle(1.0), eight()
    a = np.full((3, 8), float(signal_ratios(40.0, 0.01)))
    rng, count = np.random.default_rng(10), 20_000
    psi, J = phase_differences(attitude_matrices(RPY), array, sky), phases_by_euler(RPY, array, sky)
    u = angular_discriminator(
        pair_discriminator(draw_correlators(np.broadcast_to(psi, (count, 2, 8)), a, rng), psi), J
    )
    share = np.var(u, axis=0) / np.diag(angular_noise(RPY, array, sky, a))
    S, D = partial_slopes(RPY, array, sky, pair_slopes(a)), partial_variances(RPY, array, sky, a)
    # a baseline along the body's x axis does not see roll: no slope, and an infinite equivalent noise
    assert np.array_equal(S == 0.0, np.isinf(D)) and np.any(S == 0.0)
    alone = np.sum(S**2 * np.where(np.isinf(D), 0.0, D), axis=(0, 1))

    assert np.all(np.abs(share - 1.0) < 4.0 * np.sqrt(2.0 / count))
    assert np.max(np.abs(np.var(u, axis=0) / alone - 1.0)) > 0.2  # the sum of (37) is another number
    assert np.allclose(partial_discriminators(np.ones((2, 8)), J).sum(axis=(0, 1)), J.sum(axis=(0, 1)))


def test_unknown_angle_is_refused_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match="pitch"):
        discriminator_curve("pich", [0.0], RPY, triangle(1.0), eight())
    with pytest.raises(ConfigError, match="rotations"):
        random_attitudes(10, np.random.default_rng(0), "uniform")
