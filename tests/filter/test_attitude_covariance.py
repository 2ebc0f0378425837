"""What the errors of attitude and bias do together: the unseen force, and the turn of their axes with the heading."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import insgnss
from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.filter.headings.heading_bank import turned_axes
from insgnss.filter.headings.motion import unknown_force
from insgnss.filter.rows.lines import ANTENNA_DTYPE
from insgnss.filter.state import BA, BG, DR, DV, OFFSETS, PSI, new_bank
from insgnss.filter.update.closed_loop import close_loop, turn_attitude_errors
from insgnss.geodesy.local_level import up_direction
from insgnss.geodesy.rotations import cross_matrix, matrix_to_quaternion
from tests.benchmarks.trust.flying import drawn
from tests.benchmarks.trust.motions import scenario, straight
from tests.benchmarks.trust.rows import Row
from tests.filter.scene import parameters

GRAVITY_E = np.array([-4.1, 3.2, -8.3])
PLACE_E = np.array([2.7e6, -2.1e6, 5.4e6])


def covariance(n: int, seed: int) -> np.ndarray:
    """Return a covariance (n, n) in which everything is correlated with everything."""
    root = np.random.default_rng(seed).standard_normal((n, n))
    return root @ root.T


@pytest.mark.parametrize("load", [1.0, 0.0, -0.4, 2.5])
def test_unknown_force_is_the_horizontal_trace_of_its_covariance(load: float) -> None:
    C_eb = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    P = covariance(OFFSETS, 1)
    g2 = float(GRAVITY_E @ GRAVITY_E)

    found = unknown_force(C_eb, P, P[BA : BA + 3], GRAVITY_E, g2, load, np.zeros(OFFSETS))

    M = np.hstack([load * cross_matrix(GRAVITY_E), -C_eb])  # df = n g x psi - C b_a
    both = [*range(PSI, PSI + 3), *range(BA, BA + 3)]
    horizontal = np.eye(3) - np.outer(GRAVITY_E, GRAVITY_E) / g2
    np.testing.assert_allclose(found, np.trace(horizontal @ M @ P[np.ix_(both, both)] @ M.T), rtol=1e-12)


def test_attitude_errors_turn_about_the_vertical_with_the_correction_of_the_heading() -> None:
    """With them turn the lever arm, by which the antenna is known, and the Earth rate, by which the gyro bias is."""
    n = OFFSETS + 2
    P, m, antenna = covariance(n, 2), new_bank(1, 0).state[0], np.zeros(1, ANTENNA_DTYPE)[0]
    m.r_e[:] = PLACE_E
    m.C_eb[:] = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    antenna.l_e[:], antenna.turning_e[:] = [0.8, -0.3, 1.1], [0.2, 0.1, -0.4]
    correction = np.zeros(n)
    correction[PSI : PSI + 3] = [0.4, 0.2, -0.5]
    up = np.array(up_direction(PLACE_E))
    R = Rotation.from_rotvec(up * (up @ correction[PSI : PSI + 3])).as_matrix()
    T = turned_axes(n, R, m.C_eb, antenna.l_e)
    T[DV : DV + 3, PSI : PSI + 3] = (R - np.eye(3)) @ cross_matrix(antenna.turning_e)
    expected = T @ P @ T.T

    turn_attitude_errors(m, P, parameters()[0], correction, antenna)

    np.testing.assert_allclose(P, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
    assert (P.T == P).all()
    correction[PSI : PSI + 3] = np.cross(up, [1.0, 2.0, 3.0])  # a tilt turns nothing
    before = P.copy()
    turn_attitude_errors(m, P, parameters()[0], correction, antenna)
    np.testing.assert_allclose(P, before, rtol=0.0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("yaw_rad", [0.4, -1.2])
def test_a_new_heading_changes_nothing_of_what_was_measured(yaw_rad: float) -> None:
    """Antenna and apparent gyro bias keep their covariance, and have none with the heading if they had none."""
    n = OFFSETS
    P, m, antenna = np.zeros((n, n)), new_bank(1, 0).state[0], np.zeros(1, ANTENNA_DTYPE)[0]
    m.r_e[:] = PLACE_E
    m.C_eb[:] = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    matrix_to_quaternion(m.C_eb, m.q_eb)
    lever_b = np.array([0.5, 0.1, -0.8])
    antenna.l_e[:] = m.C_eb @ lever_b
    up = np.array(up_direction(PLACE_E))
    rate = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
    # dr = -psi x l, db = -C^T (w x psi): known but for the heading
    P[PSI : PSI + 3, PSI : PSI + 3] = np.outer(up, up)
    J = np.eye(n)
    J[DR : DR + 3, PSI : PSI + 3] = cross_matrix(antenna.l_e)
    J[BG : BG + 3, PSI : PSI + 3] = -m.C_eb.T @ cross_matrix(rate)
    P[:] = J @ P @ J.T
    correction = np.zeros(n)
    correction[PSI : PSI + 3] = yaw_rad * up

    turn_attitude_errors(m, P, parameters()[0], correction, antenna)
    close_loop(m, correction, n)

    measured = np.zeros((6, n))
    measured[:3, DR : DR + 3], measured[3:, BG : BG + 3] = np.eye(3), np.eye(3)
    measured[:3, PSI : PSI + 3] = -cross_matrix(m.C_eb @ lever_b)
    measured[3:, PSI : PSI + 3] = m.C_eb.T @ cross_matrix(rate)
    np.testing.assert_allclose(measured @ P, 0.0, atol=1e-12)


@pytest.mark.parametrize("psi", [(0.0, 0.0, 0.3), (0.02, -0.01, 0.6)])
def test_heading_corrected_alone_leaves_what_the_gyros_show(psi: tuple[float, float, float]) -> None:
    """The filter moves the gyro bias to first order, db = -C^T (w x psi); the rest of C^T w + b follows."""
    m = new_bank(1, 0).state[0]
    m.r_e[:] = PLACE_E
    m.C_eb[:] = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    matrix_to_quaternion(m.C_eb, m.q_eb)
    rate = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])
    shown = m.b_g + m.C_eb.T @ rate
    correction = np.zeros(OFFSETS)
    correction[PSI : PSI + 3] = psi
    correction[BG : BG + 3] = -m.C_eb.T @ np.cross(rate, psi)

    close_loop(m, correction, OFFSETS)

    np.testing.assert_allclose(m.b_g + m.C_eb.T @ rate, shown, atol=1e-12)


@pytest.mark.parametrize("seed", [6, 7])
def test_rest_shows_nothing_of_the_tilt_that_an_accelerometer_bias_has_made(seed: int) -> None:
    """Tilt and bias are one to a vehicle at rest. Narrow headings and carriers make the most of an inconsistency."""
    text = scenario("rest", straight(312.0), grade="mems_consumer", rate_hz=25.0, carrier=True)
    _, _, flown = drawn(Row("rest", "rest", text, (), "mems_consumer"), seed)
    nav = insgnss.replay(flown, settings={"heading.hypotheses": 24}).nav
    for name in ("sd_roll_deg", "sd_pitch_deg", "sd_accel_bias_x_mps2", "sd_accel_bias_y_mps2"):
        began, ended = nav[name].iloc[10], nav[name].iloc[300]
        assert ended > 0.92 * began, (name, began, ended)
