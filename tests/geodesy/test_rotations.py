"""Quaternion, matrix and Euler angles against SciPy's rotations, and there and back, at any attitude."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from insgnss.geodesy.rotations import (
    euler_to_matrix,
    matrix_to_euler,
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_matrices,
    rotation_vector_quaternion,
    to_scipy_quaternion,
    turn_left,
)

ROUNDING = 2e-15  # of a matrix element or quaternion component
RIGHT_ANGLE = math.pi / 2

angles = st.floats(-math.pi, math.pi)
pitches = st.floats(-RIGHT_ANGLE, RIGHT_ANGLE)
# close to straight up and down, where roll and yaw run into one
steep_pitches = st.builds(
    lambda sign, exponent: sign * (RIGHT_ANGLE - 10.0**exponent),
    st.sampled_from([-1.0, 1.0]),
    st.floats(-12.0, -1.0),
)
components = st.floats(-3.0, 3.0)
vectors = st.tuples(components, components, components)


def matrix_of(q: np.ndarray) -> np.ndarray:
    """Return the compiled matrix of a quaternion."""
    C = np.zeros((3, 3))
    quaternion_to_matrix(q, C)
    return C


def quaternion_of(C: np.ndarray) -> np.ndarray:
    """Return the compiled quaternion of a matrix."""
    q = np.zeros(4)
    matrix_to_quaternion(C, q)
    return q


def euler_matrix(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the compiled C_nb."""
    C = np.zeros((3, 3))
    euler_to_matrix(roll, pitch, yaw, C)
    return C


@given(angles, pitches, angles)
def test_matrix_of_euler_angles_equals_scipy(roll: float, pitch: float, yaw: float) -> None:
    oracle = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()

    assert euler_matrix(roll, pitch, yaw) == pytest.approx(oracle, abs=ROUNDING)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_euler_angles_of_a_matrix_are_given_back(roll: float, pitch: float, yaw: float) -> None:
    # 2e-16 / cos(1.5 rad): roll and yaw share their digits near the vertical
    assert matrix_to_euler(euler_matrix(roll, pitch, yaw)) == pytest.approx((roll, pitch, yaw), abs=1e-14)


@given(angles, steep_pitches, angles)
def test_euler_angles_close_to_the_vertical_rebuild_the_attitude(
    roll: float, pitch: float, yaw: float
) -> None:
    # the matrix as a filter has it: out of a quaternion, so each element carries its own rounding
    C = matrix_of(quaternion_of(euler_matrix(roll, pitch, yaw)))

    found = matrix_to_euler(C)

    assert found[1] == pytest.approx(pitch, abs=1e-15)
    # within 1e-9 rad of the vertical roll is zero by convention: so much of the attitude is given up
    beyond = 2.5e-9 if RIGHT_ANGLE - abs(pitch) < 2e-9 else 3e-15
    assert euler_matrix(*found) == pytest.approx(C, abs=beyond)


@pytest.mark.parametrize("pitch", [-RIGHT_ANGLE, RIGHT_ANGLE])
def test_straight_up_or_down_roll_is_zero_and_yaw_takes_it(pitch: float) -> None:
    roll, found, yaw = matrix_to_euler(euler_matrix(0.3, pitch, 1.1))

    assert (roll, found) == (0.0, pytest.approx(pitch, abs=1e-15))
    assert yaw == pytest.approx(1.1 - math.copysign(0.3, pitch), abs=1e-15)


@given(vectors.filter(lambda v: math.hypot(*v) > 1e-3), st.floats(0.0, math.pi))
def test_quaternion_of_any_matrix_is_given_back_with_scalar_not_negative(
    axis: tuple[float, float, float], angle: float
) -> None:
    oracle = Rotation.from_rotvec(angle * np.array(axis) / math.hypot(*axis))
    C = oracle.as_matrix()

    q = quaternion_of(C)

    assert q[0] >= 0.0
    assert math.hypot(*q) == pytest.approx(1.0, abs=ROUNDING)
    assert matrix_of(q) == pytest.approx(C, abs=ROUNDING)
    assert Rotation.from_quat(to_scipy_quaternion(q)).approx_equal(oracle, atol=5e-15)


@pytest.mark.parametrize("axis", range(3))
def test_quaternion_of_a_half_turn_loses_no_digit(axis: int) -> None:
    q = quaternion_of(matrix_of(np.roll([0.0, 1.0, 0.0, 0.0], axis)))

    assert q == pytest.approx(np.roll([0.0, 1.0, 0.0, 0.0], axis), abs=0.0)


@given(st.floats(1e-9, 6.0), vectors.filter(lambda v: math.hypot(*v) > 1e-3))
def test_quaternion_of_a_rotation_vector_equals_scipy(angle: float, axis: tuple[float, float, float]) -> None:
    phi = angle * np.array(axis) / math.hypot(*axis)

    q = np.array(rotation_vector_quaternion(*phi))

    oracle = np.concatenate([[math.cos(angle / 2)], math.sin(angle / 2) * phi / angle])
    assert q == pytest.approx(oracle, abs=ROUNDING)


def test_matrices_of_rotation_vectors_equal_scipy(rng: np.random.Generator) -> None:
    phi = rng.standard_normal((50, 3)) * np.logspace(-9.0, 0.7, 50)[:, None]

    np.testing.assert_allclose(rotation_matrices(phi), Rotation.from_rotvec(phi).as_matrix(), atol=1e-15)


def test_series_and_trigonometry_of_a_rotation_vector_meet_without_a_step() -> None:
    # the series ends at 0.2 rad: its next term is 1e-17
    below, above = (
        np.array(rotation_vector_quaternion(0.0, 0.2 * (1.0 + side), 0.0)) for side in (-1e-15, 1e-15)
    )

    assert below == pytest.approx(above, abs=5e-16)
    assert rotation_vector_quaternion(0.0, 0.0, 0.0) == (1.0, 0.0, 0.0, 0.0)


@given(vectors, vectors)
def test_turn_left_turns_about_axes_of_the_target_frame(
    attitude: tuple[float, float, float], turn: tuple[float, float, float]
) -> None:
    q = np.array(rotation_vector_quaternion(*attitude))

    turn_left(q, *turn)

    oracle = Rotation.from_rotvec(turn) * Rotation.from_rotvec(attitude)
    assert matrix_of(q) == pytest.approx(oracle.as_matrix(), abs=2 * ROUNDING)
    assert math.hypot(*q) == pytest.approx(1.0, abs=ROUNDING)


def test_scipy_order_has_the_scalar_last_whatever_the_shape() -> None:
    assert to_scipy_quaternion([1.0, 2.0, 3.0, 4.0]).tolist() == [2.0, 3.0, 4.0, 1.0]
    assert to_scipy_quaternion(np.ones((5, 2, 4))).shape == (5, 2, 4)
