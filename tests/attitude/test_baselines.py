"""Geometry of antennas and satellites: derivatives against differences, covariance against simulation, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy import cos, sin

from insgnss.attitude.array_observability import observability, require_attitude, require_two_satellites
from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    attitude_matrices,
    baselines_by_euler,
    difference_covariance,
    phase_differences,
    phases_by_euler,
    phases_by_euler_twice,
    phases_by_rotation,
    sky_of_angles,
    triangle,
    wavelength,
    wrapped,
)
from insgnss.attitude.wind_up import wind_up_differences
from insgnss.errors import ConfigError, GeometryError
from insgnss.gnss.signals import G1_HZ, G1_STEP_HZ
from tests.attitude.arrays import eight, four_antennas, mixed
from tests.jacobian import finite_difference_jacobian

ATTITUDES = np.radians([[0.0, 0.0, 0.0], [10.0, -5.0, 30.0], [-20.0, 35.0, 200.0], [170.0, 89.0, -60.0]])


def turned(phi: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return exp([phi x]) C by Rodrigues' formula, independently of the package."""
    angle = np.linalg.norm(phi)
    X = np.cross(np.eye(3), phi)
    X = -X if np.allclose(X @ [1.0, 2.0, 3.0], -np.cross(phi, [1.0, 2.0, 3.0])) else X
    share = 1.0 if angle < 1e-12 else math.sin(angle) / angle
    half = 0.5 if angle < 1e-12 else (1.0 - math.cos(angle)) / angle**2
    return (np.eye(3) + share * X + half * X @ X) @ C


@pytest.mark.parametrize("rpy", ATTITUDES)
def test_derivatives_by_euler_angles_equal_differences(rpy: np.ndarray) -> None:
    array, sky = four_antennas(), mixed()
    J = phases_by_euler(rpy, array, sky)
    numeric = finite_difference_jacobian(
        lambda x: phase_differences(attitude_matrices(x), array, sky), rpy, 1e-3
    )

    # relative to the largest derivative, 52 rad/rad; the differences' own rounding is 1e-11 of it
    assert np.abs(J.reshape(-1, 3) - numeric).max() < 1e-9 * np.abs(J).max()


@pytest.mark.parametrize("rpy", ATTITUDES)
def test_derivatives_by_rotation_vector_equal_differences(rpy: np.ndarray) -> None:
    array, sky, C = four_antennas(), mixed(), attitude_matrices(rpy)
    J = phases_by_rotation(C, array, sky)
    numeric = finite_difference_jacobian(
        lambda phi: phase_differences(turned(phi, C), array, sky), np.zeros(3), 1e-3
    )

    assert np.abs(J.reshape(-1, 3) - numeric).max() < 1e-9 * np.abs(J).max()


def test_second_derivatives_equal_differences_of_the_first() -> None:
    array, sky, rpy = four_antennas(), mixed(), ATTITUDES[1]
    second = phases_by_euler_twice(rpy, array, sky)
    for angle in range(3):

        def first(x: np.ndarray, angle: int = angle) -> np.ndarray:
            return phases_by_euler(rpy + x[0] * np.eye(3)[angle], array, sky)[..., angle]

        numeric = finite_difference_jacobian(first, np.zeros(1), 1e-3)
        assert np.abs(second[..., angle].ravel() - numeric[:, 0]).max() < 1e-9 * np.abs(second).max()


def test_baseline_derivatives_equal_the_corrected_closed_form_and_not_the_printed_one() -> None:
    (r, p, y), (lx, ly, lz) = ATTITUDES[2], (0.7, -1.1, 0.4)
    sy, cy, sp, cp, sr, cr = sin(y), cos(y), sin(p), cos(p), sin(r), cos(r)
    L_r = [
        (sy * sr + cy * sp * cr) * ly + (sy * cr - cy * sp * sr) * lz,
        (sy * sp * cr - cy * sr) * ly - (cy * cr + sy * sp * sr) * lz,
        cp * cr * ly - cp * sr * lz,
    ]
    L_p = [
        -cy * sp * lx + cy * cp * sr * ly + cy * cp * cr * lz,
        -sy * sp * lx + sy * cp * sr * ly + sy * cp * cr * lz,
        -cp * lx - sp * sr * ly - sp * cr * lz,
    ]
    L_y = [
        -sy * cp * lx - (cy * cr + sy * sp * sr) * ly + (cy * sr - sy * sp * cr) * lz,
        cy * cp * lx - (sy * cr - cy * sp * sr) * ly + (sy * sr + cy * sp * cr) * lz,
        0.0,
    ]
    L = baselines_by_euler(ATTITUDES[2], [[lx, ly, lz]])[0]

    assert np.allclose(L, [L_r, L_p, L_y], rtol=0.0, atol=1e-15 * 8)
    assert np.abs(L[0] + np.array(L_r)).max() > 1.0  # the printed roll column is the negative


def test_glonass_phase_differences_scale_with_each_satellites_carrier() -> None:
    hz = G1_HZ + np.array([-7, 6]) * G1_STEP_HZ
    sky = sky_of_angles([40.0, 40.0], [30.0, 30.0], wavelength(hz))
    psi = phase_differences(np.eye(3), triangle(1.0), sky)

    assert np.allclose(psi[:, 1] / psi[:, 0], hz[1] / hz[0], rtol=1e-14)
    assert np.all(np.abs(psi[:, 1] - psi[:, 0]) > 0.05)  # 0.5 % of 4 cycles: must matter


def test_covariance_of_differences_equals_that_of_simulated_phases() -> None:
    rng = np.random.default_rng(1)
    variance = rng.uniform(0.5, 2.0, (4, 2))
    count = 40_000
    phase = rng.standard_normal((count, 4, 2)) * np.sqrt(variance)
    found = np.einsum("tmn,tkn->nmk", phase[:, 1:] - phase[:, :1], phase[:, 1:] - phase[:, :1]) / count
    R = difference_covariance(variance)
    own = np.einsum("nmm->nm", R)
    sd = np.sqrt((own[:, :, None] * own[:, None, :] + R**2) / count)  # Wishart

    assert np.all(np.abs(found - R) < 4.0 * sd)
    assert np.allclose(difference_covariance(np.ones((3, 1)))[0], [[2.0, 1.0], [1.0, 2.0]])


def test_wrapped_phases_lie_in_half_open_turn_and_keep_their_direction() -> None:
    phase = np.array([-math.pi, math.pi, 3.5, -3.5, 12.0, 0.0])

    assert np.allclose(np.exp(1j * wrapped(phase)), np.exp(1j * phase))
    assert np.all((wrapped(phase) > -math.pi) & (wrapped(phase) <= math.pi))


@pytest.mark.parametrize(
    ("line", "angle"), [((1.0, 0.0, 0.0), "roll"), ((0.0, 1.0, 0.0), "pitch"), ((0.0, 0.0, 1.0), "yaw")]
)
def test_collinear_antennas_name_the_angle_they_lose(line: tuple[float, ...], angle: str) -> None:
    array = AntennaArray(np.outer([0.0, 1.0, 2.5], line))
    found = observability(np.eye(3), array, eight(), difference_covariance(np.full((3, 8), 1e-4)))

    assert not found.is_complete
    assert np.allclose(np.abs(found.lost_b), [line], atol=1e-6)
    assert np.isinf(found.sd_rad).sum() == 1
    assert angle in found.reason
    with pytest.raises(GeometryError, match=angle):
        require_attitude(array, eight())
    with pytest.raises(GeometryError, match="line"):
        found.covariance_n()


def test_one_satellite_is_refused_with_advice_and_two_are_enough() -> None:
    one, two = sky_of_angles([30.0], [40.0], 0.19), sky_of_angles([30.0, 120.0], [40.0, 20.0], 0.19)
    same = sky_of_angles([30.0, 30.0], [40.0, 40.0], [0.19, 0.24])  # two signals of one satellite

    for sky in (one, same):
        with pytest.raises(GeometryError, match="second satellite"):
            require_two_satellites(sky)
    require_attitude(triangle(1.0), two)
    lost = observability(np.eye(3), triangle(1.0), one, difference_covariance(np.full((3, 1), 1e-4)))
    # two baselines and one satellite: two numbers for three angles
    assert len(lost.lost_n) == 1
    assert np.allclose(np.abs(lost.lost_n @ one.los_n.T), 1.0, atol=1e-6)
    assert observability(
        np.eye(3), triangle(1.0), two, difference_covariance(np.full((3, 2), 1e-4))
    ).is_complete


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: AntennaArray(np.zeros((1, 3))), GeometryError),
        (lambda: AntennaArray(np.zeros((2, 3))), GeometryError),
        (lambda: AntennaArray(np.array([[0.0, 0, 0], [math.nan, 0, 0]])), ConfigError),
        (lambda: AntennaArray(np.eye(3), ("a", "a", "b")), ConfigError),
        (lambda: Sky(np.array([[1.0, 1.0, 0.0]]), np.array([0.19])), ConfigError),
        (lambda: Sky(np.array([[1.0, 0.0, 0.0]]), np.array([-0.19])), ConfigError),
    ],
)
def test_bad_arrays_and_skies_are_refused(make: object, error: type[Exception]) -> None:
    with pytest.raises(error, match="->"):
        make()  # type: ignore[operator]


def test_wind_up_of_an_antenna_turned_about_the_line_of_sight_is_the_angle_itself() -> None:
    C_ba = attitude_matrices([[0.0, 0.0, 0.0], [0.0, 0.0, 0.3]])

    # a wave from the zenith turns right-handed about down; a +0.3 rad turn about down delays its phase by 0.3 rad
    assert np.allclose(wind_up_differences(C_ba, np.eye(3), [[0.0, 0.0, -1.0]]), -0.3, atol=1e-12)


def test_wind_up_cancels_between_parallel_antennas_and_not_between_tilted_ones() -> None:
    C_nb, sky = attitude_matrices(ATTITUDES[1]), eight()
    parallel = wind_up_differences(np.stack([np.eye(3)] * 3), C_nb, sky.los_n)
    tilted = wind_up_differences(
        attitude_matrices([[0.0, 0.0, 0.0], [math.radians(20.0), 0.0, 0.0]]), C_nb, sky.los_n
    )

    assert np.abs(parallel).max() < 1e-12
    assert np.abs(tilted).max() > 0.05
