"""What the IMU's tags are off by as a state: its columns, the clone, the rows at GPS time, a state set by a fix."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.config.library import filter_config, imu_grade
from insgnss.filter.layout import Layout
from insgnss.filter.output.gps_time import covariance_at_gps_time, place_at_gps_time
from insgnss.filter.state import DR, DV, N_CLONE, OFFSETS, PSI, Bank, StateRecord, new_bank
from insgnss.filter.states.imu_time import IMU_TIME, imu_time, to_imu_time
from insgnss.filter.states.wanted import StateInputs
from insgnss.filter.update.clone import clone_epoch
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import place_antenna, predict_measurements
from insgnss.filter.update.shown_motion import follow_motion
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.gnss.observation_rows import CARRIER, PSEUDORANGE, RANGE_RATE
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64
from tests.filter.scene import START_NS, attitude, new_filter, parameters, place
from tests.filter.test_carrier import STEP_NS, carrier_log
from tests.jacobian import finite_difference_jacobian

LEVER_B, TIME_S = (2.5, -1.2, -4.0), -0.03
N = OFFSETS + 1 + N_CLONE
RATE, PULL = np.array([0.5, -0.3, 1.0]), np.array([3.0, -8.0, -14.0])


def numbers(**changes: Any) -> npt.NDArray[Any]:
    return parameters(LEVER_B, at_imu_time=OFFSETS, at_clone=OFFSETS + 1, **changes)


def manoeuvring_filter() -> Bank:
    """Return a filter in a manoeuvre that has been going on, with a clone half a second old and a full covariance."""
    at, rng = place(-33.0, 151.0, 9000.0), np.random.default_rng(3)
    small = new_filter(at, v_n=(100.0, -60.0, 5.0), C_eb=attitude(at, 40.0, -10.0, 120.0), clock=(0.0, -20.0))
    bank = new_bank(1, 1 + N_CLONE)
    bank.state[0], bank.head[0] = small.state[0], small.head[0]
    m = bank.state[0]
    root = rng.normal(size=(N, N))
    bank.P[0] = root @ root.T
    m.optional[0] = TIME_S
    m.r_clone[:] = m.r_e - 0.5 * m.v_e
    m.clone_ns = START_NS - STEP_NS
    m.w_near[:] = m.w_smooth[:] = m.w_last[:] = RATE
    m.f_near[:] = m.f_smooth[:] = m.C_eb @ PULL
    m.v_shown[:] = m.v_e
    return bank


def lines_of(bank: Bank) -> npt.NDArray[Any]:
    work = new_epoch(12, N, OFFSETS + 1)
    predict_measurements(
        bank.state[0], bank.P[0], numbers(motion_gate2=0.0)[0], carrier_log(), 0, RATE, PULL, work
    )
    return work.lines


@pytest.mark.parametrize("kind", [PSEUDORANGE, RANGE_RATE, CARRIER])
def test_columns_equal_finite_differences(kind: int) -> None:
    """Second order in the time: 60 m/s^2 of turning antenna over 30 ms are a hundredth of the velocity."""

    def predicted(d: Float64) -> Float64:
        moved = manoeuvring_filter()
        moved.state[0].optional[0] = d[0]
        return -np.asarray(lines_of(moved)["innovation"][:, kind])

    lines = lines_of(manoeuvring_filter())
    H = [line["h"][kind][list(line["columns"][kind][: line["count"][kind]]).index(OFFSETS)] for line in lines]
    found = finite_difference_jacobian(predicted, np.zeros(1), np.full(1, 1e-4))[:, 0]
    np.testing.assert_allclose(H, found, atol=0.02 if kind == RANGE_RATE else 0.01)
    assert np.abs(found).max() > (3.0 if kind == RANGE_RATE else 50.0)


def test_clone_is_the_antenna_at_its_reception() -> None:
    """Its covariance with all states is that of dr + psi x l - v ds."""
    bank, work = manoeuvring_filter(), new_epoch(12, N, OFFSETS + 1)
    m, P, par = bank.state[0], bank.P[0], numbers(motion_gate2=0.0)[0]
    predict_measurements(m, P, par, carrier_log(), 0, RATE, PULL, work)
    a = work.antenna[0]
    J = np.zeros((3, N))
    J[:, DR : DR + 3], J[:, OFFSETS] = np.eye(3), -a["shown_v_e"]
    for i in range(3):
        J[:, PSI + i] = np.cross(np.eye(3)[i], a["l_e"])
    before = P.copy()
    place_antenna(m, par, RATE, PULL, a)
    clone_epoch(m, P, par, a, work.air[0], START_NS)
    c, n = OFFSETS + 1, OFFSETS + 1
    np.testing.assert_allclose(P[c : c + 3, :n], (J @ before)[:, :n], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(P[c : c + 3, c : c + 3], J @ before @ J.T, rtol=1e-9, atol=1e-6)


def test_velocity_counts_as_motion_once_it_has_changed_beyond_its_error() -> None:
    bank, par = manoeuvring_filter(), numbers(motion_gate2=25.0)[0]
    m, P = bank.state[0], bank.P[0]
    P[DV : DV + 3, DV : DV + 3] = 0.01 * np.eye(3)
    m.v_shown[:] = m.v_e + np.array([0.5, -0.3, 0.2])  # five sigmas of three axes are 0.87 m/s
    held = m.v_shown.copy()
    follow_motion(m, P, par)
    np.testing.assert_array_equal(m.v_shown, held)
    m.v_shown[:] = m.v_e - np.array([30.0, 0.0, 0.0])
    follow_motion(m, P, par)
    assert 0.0 < np.linalg.norm(m.v_shown - m.v_e) < 0.1


@kernel
def moved(m: StateRecord, par: Any, P: Float64, r_e: Float64, v_e: Float64, q: Float64, C: Float64) -> None:
    place_at_gps_time(m, par, r_e, v_e, q, C)
    covariance_at_gps_time(m, par, P)


def at_gps_time(bank: Bank) -> tuple[Float64, Float64, Float64, Float64]:
    r_e, v_e, C, P = np.zeros(3), np.zeros(3), np.zeros((3, 3)), bank.P[0].copy()
    moved(bank.state[0], numbers()[0], P, r_e, v_e, np.zeros(4), C)
    return r_e, v_e, C, P


def test_row_stands_at_gps_time() -> None:
    """The state is the vehicle's at t + s: at t it was v s - a s^2 / 2 behind, and turned back by w s."""
    bank = manoeuvring_filter()
    m, gravity = bank.state[0], np.zeros(3)
    normal_gravity_ecef(m.r_e, gravity)
    r_e, v_e, C, P = at_gps_time(bank)
    a = m.C_eb @ PULL + gravity
    np.testing.assert_allclose(r_e, m.r_e - TIME_S * m.v_e + 0.5 * TIME_S**2 * a, atol=2e-3)
    np.testing.assert_allclose(v_e, m.v_e - TIME_S * a, atol=0.02)  # the force turns by 2 deg
    turned = m.C_eb.T @ C
    vector = 0.5 * np.array(
        [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
    )
    np.testing.assert_allclose(vector, -TIME_S * RATE, atol=2e-5)
    T = np.eye(N)
    T[DR : DR + 3, OFFSETS], T[DV : DV + 3, OFFSETS] = -m.v_e, -a
    T[PSI : PSI + 3, OFFSETS] = -m.C_eb @ RATE
    np.testing.assert_allclose(P, T @ bank.P[0] @ T.T, rtol=1e-9, atol=1e-6)


def test_state_set_by_a_fix_is_carried_to_the_imus_time_and_back() -> None:
    """What a fix says of position and velocity at its time is what a row says there, whatever the IMU's time."""
    bank = manoeuvring_filter()
    m, P = bank.state[0], bank.P[0]
    P[OFFSETS], P[:, OFFSETS] = 0.0, 0.0
    P[OFFSETS, OFFSETS] = 0.02**2
    fixed, r_fix, v_fix = P.copy(), m.r_e.copy(), m.v_e.copy()
    block = imu_time(settings(0.02))
    assert block is not None
    m.w_near[:] = m.w_last[:] = m.w_smooth[:] = 0.0
    to_imu_time(m, P, Layout((block,), clone=True))
    assert np.linalg.norm(m.r_e - r_fix) > 3.0
    r_e, v_e, _, at = at_gps_time(bank)
    np.testing.assert_allclose(r_e, r_fix, atol=0.02)
    np.testing.assert_allclose(v_e, v_fix, atol=0.02)
    np.testing.assert_allclose(
        at[DR : DR + 6, DR : DR + 6], fixed[DR : DR + 6, DR : DR + 6], rtol=1e-2, atol=1e-3
    )


def settings(sigma_s: float) -> StateInputs:
    config = filter_config("tight", {"process.imu_time_sigma_s": sigma_s})
    return StateInputs(config, ("G",), True, imu_grade("tactical"))


def test_no_state_without_a_doubt() -> None:
    assert imu_time(settings(0.0)) is None
    block = imu_time(settings(0.01))
    assert block is not None and block.name == IMU_TIME and block.variance == pytest.approx(1e-4)
