"""The mechanization against motions in closed form and against general integration in the inertial frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from insgnss.constants import STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.geodesy.rotations import matrix_to_quaternion, quaternion_to_matrix
from insgnss.inertial.mechanization import mechanize, rotation_integral, turn_attitude
from tests.geodesy.normal_field import gravitation
from tests.inertial.held_height import place_at_rest
from tests.inertial.inertial_frame import Force, earth_turn, no_force, travel
from tests.inertial.strapdown import EARTH, angle_of, even_edges, fly, means, skew


def landed(
    w_b: np.ndarray, f_b: np.ndarray, dt: float, C_eb: np.ndarray, r_e: np.ndarray, v_e: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position, velocity and attitude after all samples."""
    flown = fly(dt, w_b, f_b, C_eb, r_e, v_e, every=len(w_b))
    return flown.r_e[-1], flown.v_e[-1], flown.C_eb[-1]


# --- circular flight ------------------------------------------------------------------------------------------------


RADIUS_M, SPEED_MPS = 2000.0, 120.0
CENTRE = place_at_rest(45.0, 10.0, 3000.0, np.eye(3))


def circle(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, Rotation]:
    """Return position, velocity and acceleration relative to the Earth (n, 3), and attitude, on a flat circle."""
    angle = SPEED_MPS / RADIUS_M * t
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(t)
    C_en, rate = CENTRE.C_ne.T, SPEED_MPS / RADIUS_M
    r = CENTRE.r_e + RADIUS_M * np.column_stack([s, -c, zero]) @ C_en.T
    v = RADIUS_M * rate * np.column_stack([c, s, zero]) @ C_en.T
    a = RADIUS_M * rate**2 * np.column_stack([-s, c, zero]) @ C_en.T
    bank = Rotation.from_euler("X", 0.6)
    return r, v, a, Rotation.from_matrix(C_en) * Rotation.from_euler("Z", angle[:, None]) * bank


def circle_rate(t: np.ndarray) -> np.ndarray:
    """Return w_ib_b on the circle: a constant turn about down, and the Earth's."""
    attitude = circle(t)[3]
    down = CENTRE.C_ne[2] * SPEED_MPS / RADIUS_M
    return np.asarray(attitude.apply(np.tile(down + EARTH, (len(t), 1)), inverse=True))


def circle_force(t: np.ndarray) -> np.ndarray:
    """Return f_b on the circle: acceleration seen from the inertial frame less gravitation."""
    r, v, a, attitude = circle(t)
    f_e = a + 2.0 * np.cross(EARTH, v) + np.cross(EARTH, np.cross(EARTH, r))
    return np.asarray(attitude.apply(f_e - gravitation(r), inverse=True))


def test_circular_flight_of_ten_minutes_closes_to_the_closed_form() -> None:
    edges = even_edges(600.0, 50.0)  # 5.7 circles
    r, v, _, attitude = circle(edges[[0, -1]])
    C_eb = attitude.as_matrix()

    place, velocity, C = landed(
        means(circle_rate, edges), means(circle_force, edges), 0.02, C_eb[0], r[0], v[0]
    )

    # after 72 km; reached 0.34 mm at 50 Hz, 0.12 mm at 100 Hz
    assert np.linalg.norm(place - r[1]) < 1e-3
    assert np.linalg.norm(velocity - v[1]) < 2e-6
    assert angle_of(C @ C_eb[1].T) < 1e-11


# --- against the inertial frame -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dt", "limit_m"), [(0.01, 1e-3), (0.1, 0.1)])
def test_free_fall_at_2000_km_and_7_km_per_s_for_an_hour_keeps_the_orbit(dt: float, limit_m: float) -> None:
    r_e = 8.378e6 * np.array([math.cos(0.6), 0.0, math.sin(0.6)])
    v_e = 7000.0 * np.array([-0.15, 0.88, 0.45]) / np.linalg.norm([-0.15, 0.88, 0.45])
    nothing = np.zeros((round(3600.0 / dt), 3))

    place, velocity, _ = landed(nothing, nothing, dt, np.eye(3), r_e, v_e)

    r, v = travel(r_e, v_e, no_force, 3600.0)
    # third order of a step: r (n dt)^2 / 24 along the way, 3e-4 m in an hour at 10 ms; reached 0.3 mm and 28 mm
    assert np.linalg.norm(place - r) < limit_m
    assert np.linalg.norm(velocity - v) < limit_m * 1e-3
    assert np.linalg.norm(r - r_e) > 1e6


def test_dropped_body_falls_to_the_east() -> None:
    place = place_at_rest(0.0, 0.0, 5000.0, np.eye(3))
    nothing = np.zeros((1000, 3))

    r, _, _ = landed(nothing, nothing, 0.01, np.eye(3), place.r_e, np.zeros(3))

    # w g t^3 / 3, 0.24 m in 10 s; gravity grows by 1e-4 on the way of 490 m
    gravity = float(np.linalg.norm(place.f_b))
    assert r[1] == pytest.approx(WGS84_OMEGA_RADPS * gravity * 10.0**3 / 3.0, rel=2e-4)


def test_launch_with_100_g_reaches_the_place_of_the_inertial_frame() -> None:
    force = 100.0 * STANDARD_GRAVITY_MPS2 * np.array([0.8, 0.36, 0.48])
    r_e, v_e = np.array([6_378_137.0, 0.0, 0.0]), np.array([0.0, 5.0, -3.0])

    place, velocity, C = landed(np.zeros((1000, 3)), np.tile(force, (1000, 1)), 0.01, np.eye(3), r_e, v_e)

    r, v = travel(r_e, v_e, lambda _: force, 10.0)
    assert np.linalg.norm(place - r) < 1e-4  # after 49 km; reached 0.02 mm
    assert np.linalg.norm(velocity - v) < 1e-6  # at 9.8 km/s
    assert angle_of(C @ earth_turn(10.0)) < 1e-13


SPIN = math.radians(1000.0) * np.array([0.6, -0.48, 0.64])
TUMBLE_FORCE = np.array([20.0, -30.0, 9.0])


def tumbled(force_b: np.ndarray, force_i: Force, rate_hz: float) -> tuple[float, float, float]:
    """Return the errors [m, m/s, rad] after 10 s of tumbling at 1000 deg/s."""
    count = round(10.0 * rate_hz)
    r_e, v_e = np.array([0.0, 4.5e6, 4.6e6]), np.array([100.0, 0.0, 0.0])

    place, velocity, C = landed(np.tile(SPIN, (count, 1)), force_b, 1.0 / rate_hz, np.eye(3), r_e, v_e)

    r, v = travel(r_e, v_e, force_i, 10.0)
    C_ref = earth_turn(10.0).T @ Rotation.from_rotvec(10.0 * SPIN).as_matrix()
    return (
        float(np.linalg.norm(place - r)),
        float(np.linalg.norm(velocity - v)),
        angle_of(C @ C_ref.T),
    )


def test_tumbling_at_1000_deg_per_s_turns_a_body_fixed_force_exactly() -> None:
    errors = tumbled(
        np.tile(TUMBLE_FORCE, (2000, 1)), lambda t: Rotation.from_rotvec(SPIN * t).apply(TUMBLE_FORCE), 200.0
    )

    # velocity and attitude are exact for constant rates; the trapezoid of the position leaves |w x f| dt^2 / 12 * t
    assert errors[0] < 1e-4
    assert errors[1] < 1e-7
    assert errors[2] < 1e-12


@pytest.mark.parametrize("rate_hz", [200.0, 400.0])
def test_tumbling_under_a_force_fixed_in_space_leaves_the_third_order_of_two_samples(rate_hz: float) -> None:
    def force_b(t: np.ndarray) -> np.ndarray:
        return np.asarray(Rotation.from_rotvec(np.outer(t, SPIN)).apply(TUMBLE_FORCE, inverse=True))

    errors = tumbled(means(force_b, even_edges(10.0, rate_hz)), lambda _: TUMBLE_FORCE, rate_hz)

    # 5 and 2.5 deg per sample. Sculling takes the slopes half a sample late: x^3 / 24 of the part across the axis
    x = float(np.linalg.norm(SPIN)) / rate_hz
    across = float(np.linalg.norm(np.cross(SPIN, TUMBLE_FORCE)) / np.linalg.norm(SPIN))
    assert errors[1] == pytest.approx(x**3 / 24.0 * across * 10.0, rel=0.02)  # 5.2 and 0.65 mm/s
    assert errors[2] < 1e-12


# --- one step -------------------------------------------------------------------------------------------------------


rates = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
forces = st.tuples(*[st.floats(-100.0, 100.0)] * 3)


def step(
    pieces: list[float], w: tuple[float, float, float], f: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return attitude, position, velocity and summed velocity increment after steps of the lengths ``pieces``."""
    C, q, total = np.zeros((3, 3)), np.array([0.5, -0.1, 0.7, 0.5]), np.zeros(3)
    r, v = np.array([2.8e6, 1.6e6, 5.5e6]), np.array([-900.0, 5000.0, 3000.0])
    quaternion_to_matrix(q, C)
    for dt in pieces:
        total += mechanize(q, C, r, v, np.array(w), np.array(f), dt, np.zeros(3))
    return C, r, v, total


@given(rates, forces, st.floats(0.0, 1.0))
def test_interval_split_anywhere_ends_in_the_same_state(
    w: tuple[float, float, float], f: tuple[float, float, float], share: float
) -> None:
    whole = step([0.01], w, f)
    split = step([0.01 * share, 0.01 * (1.0 - share)], w, f)

    # for constant rates the turn is exact; so is the force's increment but for the Earth's turn under it, and the
    # position but for its trapezoid: |w x f| dt^3 / 12, 4e-5 m for the wildest motion here
    wild = float(np.linalg.norm(np.cross(w, f))) * 0.01**3 / 12.0
    assert angle_of(whole[0] @ split[0].T) < 1e-14
    assert whole[3] == pytest.approx(split[3], abs=WGS84_OMEGA_RADPS * wild + 1e-12)
    # relative to 6.4e6 m and 6e3 m/s: 4e-11 and 2e-12
    assert whole[1] == pytest.approx(split[1], abs=wild + 3e-9)
    assert whole[2] == pytest.approx(split[2], abs=3.0 * WGS84_OMEGA_RADPS * wild + 1e-10)


def test_step_of_no_length_changes_nothing() -> None:
    before, after = step([], (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)), step([0.0], (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))

    assert before[1].tolist() == after[1].tolist()
    assert before[2].tolist() == after[2].tolist()
    assert before[0] == pytest.approx(after[0], abs=1e-15)


@given(rates, st.floats(1e-4, 1.0))
def test_turned_attitude_is_the_product_of_the_earths_and_the_bodys_rotation(
    w: tuple[float, float, float], dt: float
) -> None:
    C_eb = Rotation.from_euler("ZYX", [2.0, -1.0, 0.3]).as_matrix()
    C, q = C_eb.copy(), np.zeros(4)
    matrix_to_quaternion(C, q)

    turn_attitude(q, C, np.array(w), dt)

    turned = (
        Rotation.from_rotvec(-EARTH * dt).as_matrix()
        @ C_eb
        @ Rotation.from_rotvec(np.array(w) * dt).as_matrix()
    )
    # the series of the Earth's turn ends at (w dt / 2)^3 / 6 = 8e-15 rad for a second
    assert pytest.approx(turned, abs=2e-14) == C


@pytest.mark.parametrize("size", [1e-8, 0.1, 0.19999, 0.20001, 1.0, 3.0])
def test_rotation_integral_turns_a_constant_force_as_its_quadrature_does(size: float) -> None:
    phi = size * np.array([0.6, -0.48, 0.64])
    a, b = rotation_integral(*phi)

    node, weight = np.polynomial.legendre.leggauss(12)
    turns = Rotation.from_rotvec(np.outer(0.5 * (1.0 + node), phi)).as_matrix()
    integral = np.einsum("k,kij->ij", 0.5 * weight, turns)
    # the series ends with 9e-14 at 0.2 rad
    assert np.eye(3) + a * skew(phi) + b * skew(phi) @ skew(phi) == pytest.approx(integral, abs=1e-13)
