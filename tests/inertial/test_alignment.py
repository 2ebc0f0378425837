"""Levelling against gravity in any attitude, and the window of samples it is made from, at rest and turning."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.inertial.alignment import earth_rate_in_body, inertial_window, level
from tests.inertial.strapdown import EARTH, even_edges, means

UP_MPS2 = np.array([0.0, 0.0, -9.81])  # specific force at rest, north-east-down
angles = st.floats(-math.pi, math.pi)
pitches = st.floats(-1.57, 1.57)
pushes = st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), st.floats(-5.0, 5.0))


def matrix(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return C_nb."""
    C_nb = np.zeros((3, 3))
    euler_to_matrix(roll, pitch, yaw, C_nb)
    return C_nb


# --- levelling ------------------------------------------------------------------------------------------------------


@given(angles, pitches, angles)
def test_level_gives_back_roll_and_pitch_at_rest_in_any_attitude(
    roll: float, pitch: float, yaw: float
) -> None:
    f_b = matrix(roll, pitch, yaw).T @ UP_MPS2

    found = level(f_b, UP_MPS2, yaw)

    # roll is as good as what of gravity lies across: 1e-15 / cos(pitch), 1e-12 at 1.57 rad
    assert math.remainder(found[0] - roll, 2.0 * math.pi) == pytest.approx(0.0, abs=2e-12)
    assert found[1] == pytest.approx(pitch, abs=1e-14)


@given(angles, pitches, angles, pushes)
def test_level_turns_the_measured_force_into_the_known_one_while_accelerating(
    roll: float, pitch: float, yaw: float, push: tuple[float, float, float]
) -> None:
    f_n = UP_MPS2 + np.array(push)
    f_b = matrix(roll, pitch, yaw).T @ f_n

    found = level(f_b, f_n, yaw)

    # two attitudes may do that at a given yaw; either way the force ends where it belongs (1e-7: arc sine of 1)
    assert matrix(*found, yaw) @ f_b == pytest.approx(f_n, abs=1e-6)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), angles, pushes)
def test_level_finds_the_attitude_of_an_ordinary_vehicle_while_accelerating(
    roll: float, pitch: float, yaw: float, push: tuple[float, float, float]
) -> None:
    f_n = UP_MPS2 + 0.3 * np.array(push)

    found = level(matrix(roll, pitch, yaw).T @ f_n, f_n, yaw)

    assert found == pytest.approx((roll, pitch), abs=1e-12)


@given(angles, pitches, angles, st.floats(0.95, 1.05))
def test_level_does_not_ask_for_the_accelerometers_scale(
    roll: float, pitch: float, yaw: float, scale: float
) -> None:
    f_b = matrix(roll, pitch, yaw).T @ UP_MPS2

    assert level(scale * f_b, UP_MPS2, yaw) == pytest.approx(level(f_b, UP_MPS2, yaw), abs=1e-11)


@pytest.mark.parametrize("pitch", [-math.pi / 2, math.pi / 2])
def test_level_straight_up_or_down_gives_the_pitch(pitch: float) -> None:
    f_b = np.array([math.copysign(9.81, pitch), 0.0, 0.0])

    found = level(f_b, UP_MPS2, 0.7)

    assert math.isfinite(found[0])
    assert matrix(*found, 0.7) @ f_b == pytest.approx(UP_MPS2, abs=1e-12)


@given(angles, pitches, angles, st.floats(-math.pi / 2, math.pi / 2))
def test_earth_rate_in_body_is_turned_back_by_the_attitude(
    roll: float, pitch: float, yaw: float, lat: float
) -> None:
    w_n = matrix(roll, pitch, yaw) @ earth_rate_in_body(lat, roll, pitch, yaw)

    assert w_n == pytest.approx(WGS84_OMEGA_RADPS * np.array([math.cos(lat), 0.0, -math.sin(lat)]), abs=1e-19)


# --- windows --------------------------------------------------------------------------------------------------------


SPACE_FORCE = np.array([2.0, -3.0, -9.0])  # what is felt, fixed in space


def turning_log(w_b: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return tags, mean rates and mean specific forces of 2 s of a body that turns under a force fixed in space."""
    edges = even_edges(2.0, rate_hz)

    def force_b(t: np.ndarray) -> np.ndarray:
        return np.asarray(Rotation.from_rotvec(np.outer(t, w_b)).apply(SPACE_FORCE, inverse=True))

    t_ns = np.rint(edges[1:] * 1e9).astype(np.int64)
    return t_ns, np.tile(w_b, (len(t_ns), 1)), means(force_b, edges)


@pytest.mark.parametrize(
    ("rate_hz", "tolerance"),
    [
        (
            100.0,
            1e-4,
        ),  # (w dt)^2 / 12 of 10 m/s^2 in a turn of 0.7 rad/s; forgetting half a sample's turn: 0.03
        (400.0, 1e-5),
    ],
)
def test_window_of_a_turning_body_gives_the_force_in_the_axes_of_its_end(
    rate_hz: float, tolerance: float
) -> None:
    w_b = np.array([0.3, -0.4, 0.5])
    window = inertial_window(*turning_log(w_b, rate_hz), 500_000_000, 1_500_000_000)

    assert window is not None
    at_end = Rotation.from_rotvec(1.5 * w_b).apply(SPACE_FORCE, inverse=True)
    assert window.f_b == pytest.approx(at_end, abs=tolerance)
    assert window.w_ib_b == pytest.approx(w_b, abs=1e-14)
    assert window.length_s == pytest.approx(1.0, abs=1e-9)
    assert window.spread_w == pytest.approx(0.0, abs=1e-14)
    # it turns by 0.7 rad, so the force in body axes does not stand still: rest must not be concluded from it
    assert window.spread_f > 0.5


def test_window_shows_by_gravity_how_a_body_tilts_whatever_its_gyros_read() -> None:
    w_b, error = np.array([0.03, -0.04, 0.05]), np.array([0.1, 0.2, -0.3])
    t_ns, rates, forces = turning_log(w_b, 100.0)
    window = inertial_window(t_ns, rates + error, forces, 500_000_000, 1_500_000_000)

    assert window is not None
    at_middle = Rotation.from_rotvec(w_b).apply(SPACE_FORCE, inverse=True)
    up = at_middle / np.linalg.norm(at_middle)
    assert window.tilting_b == pytest.approx(w_b - (w_b @ up) * up, abs=1e-4)
    assert window.still_f_b == pytest.approx(at_middle, abs=2e-3)  # (w T)^2 / 24 of 10 m/s^2


def test_window_without_errors_has_none_in_any_mean() -> None:
    t_ns = np.arange(30) * 10_000_000
    accel, gyro = np.array([0.1, -0.2, 0.3]), np.array([0.01, 0.02, -0.03])
    spoilt = inertial_window(
        t_ns, np.zeros((30, 3)) + gyro, np.tile(UP_MPS2 + accel, (30, 1)), 0, 200_000_000
    )

    assert spoilt is not None
    window = spoilt.without(accel, gyro)
    assert window.still_f_b == pytest.approx(UP_MPS2, abs=1e-12)
    assert window.w_ib_b == pytest.approx(np.zeros(3), abs=1e-15)
    assert window.f_b == pytest.approx(spoilt.f_b - accel, abs=1e-15)


def test_window_weighs_each_sample_by_its_length() -> None:
    t_ns = np.array([0, 1, 2, 3, 7, 8]) * 10_000_000
    f_b = np.zeros((6, 3))
    f_b[4, 0] = 1.0  # 40 ms of the 80

    window = inertial_window(t_ns, np.zeros((6, 3)), f_b, 0, 80_000_000)

    assert window is not None
    assert window.f_b == pytest.approx([0.5, 0.0, 0.0])


def test_window_of_rest_gives_the_mean_and_how_far_it_scatters(rng: np.random.Generator) -> None:
    t_ns = np.arange(400) * 10_000_000
    w = EARTH + 1e-3 * rng.standard_normal((400, 3))
    f = UP_MPS2 + 0.05 * rng.standard_normal((400, 3))

    window = inertial_window(t_ns, w, f, 1_000_000_000, 3_000_000_000)

    assert window is not None
    assert window.f_b == pytest.approx(UP_MPS2, abs=5.0 * 0.05 / math.sqrt(200))
    assert window.w_ib_b == pytest.approx(w[101:301].mean(axis=0), abs=1e-15)
    # the largest of three, each known to 5 %
    assert window.spread_f == pytest.approx(0.05, rel=0.2)
    assert window.spread_w == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize(
    ("from_ns", "to_ns"),
    [
        (-10_000_000, 100_000_000),  # before the log
        (50_000_000, 80_000_000),  # three samples
        (500_000_000, 600_000_000),  # after it
    ],
)
def test_window_that_the_log_does_not_cover_is_none(from_ns: int, to_ns: int) -> None:
    t_ns = np.arange(30) * 10_000_000

    assert inertial_window(t_ns, np.zeros((30, 3)), np.zeros((30, 3)), from_ns, to_ns) is None
