"""The error of the antenna's lever arm as a state: its columns, what position and clone share of it, what it finds."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from insgnss.config.library import filter_config, imu_grade
from insgnss.filter.diagnosis.resetting import reinitialise_position
from insgnss.filter.headings.heading_bank import turn_member
from insgnss.filter.layout import Layout, StateBlock
from insgnss.filter.start.start import StartAttitude, open_bank
from insgnss.filter.state import ABSENT_STATE, BG, CLOCK, DR, DV, N_CLONE, OFFSETS, PSI, Bank, new_bank
from insgnss.filter.states.lever_arm import LEVER_ARM, lever_arm
from insgnss.filter.states.wanted import StateInputs
from insgnss.filter.update.clone import clone_epoch
from insgnss.filter.update.closed_loop import close_loop, turn_attitude_errors
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.lever_swing import swing_lever_arm
from insgnss.filter.update.prior_rows import place_antenna, predict_measurements
from insgnss.geodesy.local_level import up_direction
from insgnss.geodesy.rotations import cross_matrix
from insgnss.gnss.observation_rows import CARRIER, N_KINDS, PSEUDORANGE, RANGE_RATE
from insgnss.tables import Float64
from tests.filter.scene import START_NS, attitude, new_filter, parameters, place, steady_force
from tests.filter.test_carrier import STEP_NS, carrier_log
from tests.filter.test_integrity import fix_of
from tests.filter.test_start_covariance import T_NS, kinematics
from tests.jacobian import finite_difference_jacobian

GIVEN, FOUND = (2.5, -1.2, -4.0), np.array([0.3, -0.2, 0.5])
N = OFFSETS + 3 + N_CLONE
BLOCK = StateBlock(LEVER_ARM, ("lever_arm_x_m", "lever_arm_y_m", "lever_arm_z_m"), "m", 1.0)


def numbers(**changes: Any) -> npt.NDArray[Any]:
    return parameters(GIVEN, at_lever_arm=OFFSETS, at_clone=OFFSETS + 3, **changes)


def turning_filter() -> Bank:
    """Return a filter in a turn with a clone half a second old, in another attitude, and a full covariance."""
    at, rng = place(-33.0, 151.0, 9000.0), np.random.default_rng(3)
    small = new_filter(at, v_n=(100.0, -60.0, 5.0), C_eb=attitude(at, 40.0, -10.0, 120.0), clock=(0.0, -20.0))
    bank = new_bank(1, 3 + N_CLONE)
    bank.state[0], bank.head[0] = small.state[0], small.head[0]
    m = bank.state[0]
    root = rng.normal(size=(N, N))
    bank.P[0] = root @ root.T
    m.optional[:3] = FOUND
    m.C_swung[:] = Rotation.from_rotvec([0.1, -0.25, 0.12]).as_matrix() @ m.C_eb
    m.r_clone[:] = m.r_e - 0.5 * m.v_e
    m.clone_ns = m.swung_ns = START_NS - STEP_NS
    m.w_smooth[:] = 0.5, -0.3, 1.0
    return bank


def lines_of(bank: Bank, par: npt.NDArray[Any], w_ib_b: Float64) -> npt.NDArray[Any]:
    work, log = new_epoch(12, N, OFFSETS + 3), carrier_log()
    predict_measurements(bank.state[0], bank.P[0], par[0], log, 0, w_ib_b, steady_force(bank.state[0]), work)
    return work.lines


def columns(lines: npt.NDArray[Any], kind: int) -> Float64:
    """Return the rows of H over the lever arm's error (12, 3)."""
    H = np.zeros((len(lines), N))
    for h, line in zip(H, lines, strict=True):
        count = line["count"][kind]
        h[line["columns"][kind, :count]] = line["h"][kind, :count]
    return H[:, OFFSETS : OFFSETS + 3]


@pytest.mark.parametrize("kind", [PSEUDORANGE, RANGE_RATE, CARRIER])
def test_columns_equal_finite_differences(kind: int) -> None:
    """Of the carrier the way of the antenna that the lever arm tells now; what it told then is the clone's."""
    bank, par, rate = turning_filter(), numbers(), np.array([0.5, -0.3, 1.0])

    def predicted(d: Float64) -> Float64:
        moved = turning_filter()
        moved.state[0].optional[:3] += d
        return -np.asarray(lines_of(moved, par, rate)["innovation"][:, kind])

    found = finite_difference_jacobian(predicted, np.zeros(3), np.full(3, 0.5))
    np.testing.assert_allclose(columns(lines_of(bank, par, rate), kind), found, atol=1e-5)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize(("doubt", "kept"), [(1e6, 0), (0.0, 1)], ids=["within the noise", "shown"])
def test_rotation_within_the_gyros_noise_leaves_the_antenna_where_it_is(
    doubt: float, kept: int, known: bool
) -> None:
    """The attitude has turned by 17 deg: within the noise the IMU's error changes, shown it moves the antenna."""
    bank, par = turning_filter(), numbers(motion_gate2=25.0, gyro_density=0.0)
    m, P, work = bank.state[0], bank.P[0], new_epoch(1, N, OFFSETS + 3)
    P[BG : BG + 3], P[:, BG : BG + 3] = 0.0, 0.0
    P[range(BG, BG + 3), range(BG, BG + 3)] = doubt  # variance of the gyro biases
    if known:
        par["at_lever_arm"], m.optional[:3] = ABSENT_STATE, 0.0
    then, lever_b = m.C_swung.copy(), np.array(GIVEN) + (0.0 if known else FOUND)
    H = np.zeros((2, 3, N))
    for h, C in zip(H, (then, m.C_eb), strict=True):
        h[:, DR : DR + 3], h[:, PSI : PSI + 3] = np.eye(3), -cross_matrix(C @ lever_b)
        h[:, OFFSETS : OFFSETS + 3] = 0.0 if known else C
    before = H @ P @ H.swapaxes(1, 2)
    swing_lever_arm(m, P, par[0], work.antenna[0], START_NS)
    np.testing.assert_allclose(H[1] @ P @ H[1].T, before[kept], atol=1e-9)
    np.testing.assert_allclose(P, P.T, atol=1e-9)
    np.testing.assert_array_equal(m.C_swung, m.C_eb)


def test_correction_of_the_heading_leaves_the_antenna_where_it_is() -> None:
    bank, par = turning_filter(), numbers()
    m, P, work = bank.state[0], bank.P[0], new_epoch(1, N, OFFSETS + 3)
    place_antenna(m, par[0], np.zeros(3), np.zeros(3), work.antenna[0])
    correction, up = np.zeros(N), np.array(up_direction(m.r_e))
    correction[PSI : PSI + 3] = 0.3 * up

    def antenna() -> Float64:
        H = np.zeros((3, N))
        H[:, DR : DR + 3], H[:, OFFSETS : OFFSETS + 3] = np.eye(3), m.C_eb
        H[:, PSI : PSI + 3] = -cross_matrix(m.C_eb @ (np.array(GIVEN) + FOUND))
        return np.asarray(H @ P @ H.T)

    before, C_before = antenna(), m.C_eb.copy()
    turn_attitude_errors(m, P, par[0], correction, work.antenna[0])
    close_loop(m, correction, N - N_CLONE)
    np.testing.assert_allclose(antenna(), before, atol=1e-9)
    # the axes of the last epoch follow: a correction does not rotate the vehicle
    then = turning_filter().state[0].C_swung
    np.testing.assert_allclose(m.C_eb.T @ m.C_swung, C_before.T @ then, atol=1e-12)


def test_clone_shares_the_lever_arms_error() -> None:
    bank, par = turning_filter(), numbers()
    m, P = bank.state[0], bank.P[0]
    work = new_epoch(1, N, OFFSETS + 3)
    place_antenna(m, par[0], np.zeros(3), np.zeros(3), work.antenna[0])
    J = np.zeros((N_CLONE, N))
    J[:3, DR : DR + 3], J[3, CLOCK] = np.eye(3), 1.0
    J[:3, PSI : PSI + 3] = -cross_matrix(m.C_eb @ (np.array(GIVEN) + FOUND))
    J[:3, OFFSETS : OFFSETS + 3] = m.C_eb
    whole = np.vstack([np.eye(N)[: OFFSETS + 3], J])
    expected = whole @ P @ whole.T

    clone_epoch(m, P, par[0], work.antenna[0], work.air[0], START_NS)

    np.testing.assert_allclose(P, expected, atol=1e-12 * np.abs(expected).max())


def test_start_knows_the_antenna_as_well_as_the_fix_does_however_long_the_lever_arm() -> None:
    layout, par = Layout((BLOCK,)), numbers()[0]
    how = StartAttitude(0.1, -0.2, 1.0, 0.02, 0.26, 1.0, np.zeros(3), None, False)
    P_r, P_v, rate = np.diag([4.0, 9.0, 1.0]), np.diag([0.1, 0.2, 0.3]), np.array([0.2, -0.1, 0.4])
    kin = replace(kinematics(P_r, P_v), clocks=np.zeros(1))
    grade = imu_grade("tactical")
    bank = open_bank(kin, [how], rate, par, filter_config("tight17"), grade, T_NS, layout)
    m, P = bank.state[0], bank.P[0]
    H = np.zeros((3, len(P)))
    H[:, DR : DR + 3], H[:, OFFSETS:] = np.eye(3), m.C_eb
    H[:, PSI : PSI + 3] = -cross_matrix(m.C_eb @ np.array(GIVEN))
    np.testing.assert_allclose(H @ P @ H.T, P_r, atol=1e-9)
    # of the IMU itself a metre is not known
    assert np.all(P[range(DR, DR + 3), range(DR, DR + 3)] > np.diag(P_r) + 0.9)
    assert P[DV, DV] > P_v[0, 0] + 0.01


def test_reset_leaves_the_position_as_uncertain_as_the_lever_arm_is() -> None:
    lever_b, rate = np.array(GIVEN), np.array([0.0, 0.0, 0.5])
    small = new_filter(place(), v_n=(20.0, -5.0, 1.0))
    bank = new_bank(1, 3)
    bank.state[0] = small.state[0]
    m, P = bank.state[0], bank.P[0]
    m.optional[:3] = FOUND
    P[:] = 1e-6 * np.eye(len(P))
    P[OFFSETS:, OFFSETS:] = 0.25 * np.eye(3)
    fix = fix_of(bank, lever_b + FOUND, rate, 0)
    truth = m.r_e.copy()
    m.r_e[:] += 30.0
    reinitialise_position(m, P, fix, lever_b, Layout((BLOCK,)), rate, 40.0)
    np.testing.assert_allclose(m.r_e, truth, atol=1e-6)
    np.testing.assert_allclose(P[DR : DR + 3, OFFSETS:], -0.25 * m.C_eb, atol=1e-12)


def test_split_heading_keeps_the_antenna_and_what_is_known_of_it() -> None:
    layout, lever_b = Layout((BLOCK,), clone=True), np.array(GIVEN)
    bank = turning_filter()
    m, P = bank.state[0], bank.P[0]

    def antenna() -> tuple[Float64, Float64]:
        H, whole = np.zeros((3, N)), lever_b + m.optional[:3]
        H[:, DR : DR + 3], H[:, OFFSETS : OFFSETS + 3] = np.eye(3), m.C_eb
        H[:, PSI : PSI + 3] = -cross_matrix(m.C_eb @ whole)
        return m.r_e + m.C_eb @ whole, H

    hangs = np.eye(N)
    # the antenna's errors in the place of the IMU's
    hangs[DR : DR + 3] = 2.0 * hangs[DR : DR + 3] - antenna()[1]
    P[:] = np.diag(np.repeat([0.01, 1e-4, 0.05, 1e-8, 1e-12, 1.0, 0.25, 1.0], [3, 3, 3, 3, 3, 2, 3, 4]))
    P[:] = hangs @ P @ hangs.T
    where, _ = antenna()
    turn_member(m, P, 0.4, math.radians(30.0), lever_b, layout)
    there, H = antenna()
    np.testing.assert_allclose(there, where, atol=1e-6)
    np.testing.assert_allclose(H @ P @ H.T, 0.01 * np.eye(3), atol=1e-9)


def test_states_are_there_where_the_settings_doubt_the_lever_arm() -> None:
    for sigma in (0.0, 0.2):
        config = filter_config("tight", {"process.lever_arm_sigma_m": sigma})
        block = lever_arm(StateInputs(config, ("G",), True, imu_grade("tactical")))
        assert (
            (block is None) if sigma == 0.0 else (block is not None and block.variance == pytest.approx(0.04))
        )
    assert N_KINDS == 3  # each kind has its columns above
