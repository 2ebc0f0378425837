"""The covariance a filter starts with: the IMU hangs on the antenna, and gravity reads a share of a scale factor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from insgnss.config.flight import GivenStart, ImuGrade
from insgnss.config.library import filter_config
from insgnss.constants import STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.filter.start.start import (
    Kinematics,
    StartAttitude,
    StartHeading,
    attitudes_at_start,
    given_attitudes,
    given_kinematics,
    open_bank,
)
from insgnss.filter.state import BA, BG, DR, DV, PSI, Bank
from insgnss.inertial.alignment import AlignmentWindow
from insgnss.inertial.sensor_model import sensor_model
from insgnss.tables import Float64
from tests.filter.scene import START_NS, TACTICAL, attitude, parameters, place
from tests.layouts import layout_with

LEVER_B = np.array([2.0, -1.5, -3.0])
RATE = np.array([0.1, -0.3, 0.5])
T_NS = START_NS + np.arange(3) * 10_000_000
W_IE = WGS84_OMEGA_RADPS * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def skew(v: Float64) -> Float64:
    return np.cross(np.eye(3), v)


def kinematics(P_r: Float64, P_v: Float64) -> Kinematics:
    at = place()
    return Kinematics(START_NS, at.r_e, np.zeros(3), P_r, P_v, np.zeros(1), 0.0, 10.0, 1.0)


def opened(kin: Kinematics, how: StartAttitude, grade: ImuGrade = TACTICAL) -> Bank:
    """Return the bank of one attitude, 2 to 3 m below the antenna, turning at 34 deg/s."""
    par = parameters(LEVER_B)[0]
    return open_bank(kin, [how], RATE, par, filter_config("tight17"), grade, T_NS, layout_with())


def one_attitude(**changes: float) -> StartAttitude:
    base = StartAttitude(0.1, -0.2, 1.0, 0.02, 0.26, 1.0, np.array([1e-3, 0.0, -2e-3]), 1e-4, False)
    return replace(base, **changes)


def antenna_of(bank: Bank) -> Float64:
    """Return J (6, n): antenna position and velocity by the error state, as the measurement rows have them."""
    m = bank.state[0]
    C, w = m.C_eb, RATE - m.b_g
    l_e = C @ LEVER_B
    J = np.zeros((6, bank.P.shape[1]))
    J[:3, DR : DR + 3] = J[3:, DV : DV + 3] = np.eye(3)
    J[:3, PSI : PSI + 3] = -skew(l_e)
    J[3:, PSI : PSI + 3] = -skew(C @ np.cross(w, LEVER_B)) + W_IE @ skew(l_e)
    J[3:, BG : BG + 3] = C @ skew(LEVER_B)
    return J


def test_antenna_is_known_as_the_fix_says_whatever_the_heading(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=(3, 3)), 0.1 * rng.normal(size=(3, 3))
    kin = kinematics(a @ a.T, b @ b.T)
    bank = opened(kin, one_attitude())
    P, J = bank.P[0], antenna_of(bank)

    found = J @ P @ J.T

    np.testing.assert_allclose(found[:3, :3], kin.P_r, atol=1e-9)
    np.testing.assert_allclose(found[3:, 3:], kin.P_v, atol=1e-9)
    assert np.max(np.abs((J @ P)[:, PSI : PSI + 3])) < 1e-9
    assert np.max(np.abs((J @ P)[:, BG : BG + 3])) < 1e-12
    # and the IMU less well: 15 deg of heading at the end of a lever arm
    assert np.trace(P[DR : DR + 3, DR : DR + 3]) > np.trace(kin.P_r) + 0.26**2
    assert np.all(np.linalg.eigvalsh(P) > -1e-9)


def test_given_start_is_the_imus_own_and_knows_of_no_lever_arm() -> None:
    start = GivenStart.model_validate(
        {
            "lat_deg": 59.97, "lon_deg": 30.32, "h_m": 120.0, "v_ned_mps": (0.0, 0.0, 0.0),
            "rpy_deg": (0.0, 0.0, 40.0), "sd_position_m": 2.0, "sd_velocity_mps": 0.1, "sd_yaw_deg": 20.0,
        }
    )  # fmt: skip
    par, config = parameters(LEVER_B)[0], filter_config("tight17")
    kin = given_kinematics(start, START_NS, np.zeros(1), 0.0, RATE, par)

    bank = open_bank(kin, given_attitudes(start, config), RATE, par, config, TACTICAL, T_NS, layout_with())

    P = bank.P[0]
    np.testing.assert_allclose(P[DR : DR + 3, DR : DR + 3], 4.0 * np.eye(3), atol=1e-12)
    assert not P[DR : DR + 6, PSI : BG + 3].any()


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0.0, 0.0), (90.0, 0.0), (20.0, 60.0)])
def test_scale_factor_times_gravity_is_a_bias_along_gravity(roll_deg: float, pitch_deg: float) -> None:
    scaled = TACTICAL.model_copy(update={"accel_scale_factor_ppm": 3000.0})
    how = one_attitude(roll=np.radians(roll_deg), pitch=np.radians(pitch_deg))
    kin = kinematics(np.eye(3), np.eye(3))
    at = place()
    down_b = attitude(at, roll_deg, pitch_deg, 0.0).T @ at.C_ne[2]

    added = np.diag(opened(kin, how, scaled).P[0])[BA : BA + 3] - sensor_model(TACTICAL).accel_bias.sigma ** 2

    np.testing.assert_allclose(added, (3e-3 * STANDARD_GRAVITY_MPS2 * down_b) ** 2, atol=1e-9)


def test_levelling_is_as_good_as_the_level_accelerometers_scale_factor_or_not() -> None:
    """At rest and level the scale factor of the vertical axis tilts nothing."""
    scaled = TACTICAL.model_copy(update={"accel_scale_factor_ppm": 3000.0})
    how = one_attitude(roll=0.0, pitch=0.0, level_from_bias=True)
    kin = kinematics(np.eye(3), np.eye(3))

    P, plain = opened(kin, how, scaled).P[0], opened(kin, how).P[0]

    np.testing.assert_allclose(P[PSI : PSI + 3], plain[PSI : PSI + 3], atol=1e-9)
    assert P[BA + 2, BA + 2] > 4.0 * plain[BA + 2, BA + 2]


@pytest.mark.parametrize(
    ("felt_g", "least_deg", "most_deg"), [(1.0, 3.0, 4.0), (0.3, 10.0, 12.0), (0.002, 59.9, 60.1)]
)
def test_force_near_free_fall_does_not_say_which_way_is_up(
    felt_g: float, least_deg: float, most_deg: float
) -> None:
    """A tilt is the force's error over the force: in orbit the accelerometers feel their own bias."""
    at = place()
    f_b = np.array([0.0, 0.0, -felt_g * STANDARD_GRAVITY_MPS2])
    window = AlignmentWindow(1.0, f_b, f_b, np.zeros(3), np.zeros(3), 0.01, 1e-3, 1e-5)
    down_e = at.C_ne[2] * (1.0 - felt_g) * STANDARD_GRAVITY_MPS2
    config = filter_config("tight17")
    heading = [StartHeading(0.0, 1.0, 1.0)]
    (start,) = attitudes_at_start(window, at.r_e, np.zeros(3), down_e, 0.1, config, TACTICAL, heading)
    assert least_deg < np.degrees(start.sd_level) < most_deg
