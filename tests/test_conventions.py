"""A worked example of each convention on the page in ``insgnss/__init__.py``: numbers small enough to check by hand."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.constants import C_MPS, NS_PER_WEEK, WGS84_A_M, WGS84_B_M, WGS84_OMEGA_RADPS
from insgnss.filter import state
from insgnss.filter.output.writing import NAV_COLUMNS
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, StateRecord, new_bank
from insgnss.filter.update.closed_loop import close_loop
from insgnss.filter.update.epoch_space import new_epoch
from insgnss.filter.update.prior_rows import predict_measurements
from insgnss.filter.update.scalar_update import scalar_update
from insgnss.geodesy.directions import angles_of
from insgnss.geodesy.ellipsoid import ecef_to_geodetic, geodetic_to_ecef
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import (
    euler_to_matrix,
    matrix_to_quaternion,
    quaternion_to_matrix,
    to_scipy_quaternion,
)
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.gnss.orbits.satellite_state import range_rates
from insgnss.gpstime import ns_to_week_seconds, week_seconds_to_ns
from insgnss.simulation.imu import gauss_markov
from tests.kernels import filter as short_log
from tests.layouts import layout_with

NORTH, EAST, DOWN = np.eye(3)
FORWARD, RIGHT, BELOW = np.eye(3)


def attitude(roll_deg: float, pitch_deg: float, yaw_deg: float) -> np.ndarray:
    """Return C_nb of roll, pitch, yaw."""
    C_nb = np.zeros((3, 3))
    euler_to_matrix(*np.radians([roll_deg, pitch_deg, yaw_deg]), C_nb)
    return C_nb


# --- frames ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "axis_b", "direction_n"),
    [
        (0, 0, 90, FORWARD, EAST),  # heading east
        (0, 0, 90, RIGHT, -NORTH),
        (0, 90, 0, FORWARD, -DOWN),  # nose up
        (90, 0, 0, RIGHT, DOWN),  # right wing down
        (90, 0, 90, BELOW, NORTH),
    ],
)
def test_target_first_body_axis_turned_by_C_nb_points_where_the_attitude_says(
    roll: float, pitch: float, yaw: float, axis_b: np.ndarray, direction_n: np.ndarray
) -> None:
    np.testing.assert_allclose(attitude(roll, pitch, yaw) @ axis_b, direction_n, atol=1e-15)


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "r_e"),
    [(0, 0, (WGS84_A_M, 0, 0)), (0, 90, (0, WGS84_A_M, 0)), (90, 0, (0, 0, WGS84_B_M))],
)
def test_ecef_axes_pierce_greenwich_ninety_east_and_the_north_pole(
    lat_deg: float, lon_deg: float, r_e: tuple[float, float, float]
) -> None:
    position = np.zeros(3)
    geodetic_to_ecef(math.radians(lat_deg), math.radians(lon_deg), 0.0, position)

    np.testing.assert_allclose(position, r_e, atol=1e-9)
    assert np.degrees(ecef_to_geodetic(position)[0]) == pytest.approx(lat_deg, abs=1e-12)


def test_local_level_is_north_east_down() -> None:
    C_ne = np.zeros((3, 3))
    ecef_to_ned_matrix(0.0, 0.0, C_ne)

    # at latitude 0, longitude 0: north is +z, east is +y, down is -x of ECEF
    np.testing.assert_array_equal(C_ne, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]])


def test_quaternion_has_the_scalar_first_and_turns_as_its_matrix() -> None:
    q_nb, C_nb = np.zeros(4), np.zeros((3, 3))
    matrix_to_quaternion(attitude(0, 0, 90), q_nb)
    quaternion_to_matrix(q_nb, C_nb)

    np.testing.assert_allclose(q_nb, [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)], atol=1e-15)
    np.testing.assert_allclose(C_nb @ FORWARD, EAST, atol=1e-15)


def test_scipy_order_is_converted_in_one_place() -> None:
    q_nb = np.zeros(4)
    C_nb = attitude(10, -20, 130)
    matrix_to_quaternion(C_nb, q_nb)

    np.testing.assert_allclose(Rotation.from_quat(to_scipy_quaternion(q_nb)).as_matrix(), C_nb, atol=1e-15)


def test_azimuth_is_clockwise_from_north_and_elevation_up() -> None:
    C_en = np.eye(3)  # ECEF axes stand in for north, east, down
    azimuth, elevation = angles_of(C_en.T @ np.array([0.0, math.cos(0.5), -math.sin(0.5)]))

    assert azimuth == pytest.approx(math.pi / 2)
    assert elevation == pytest.approx(0.5)


# --- errors and innovations -----------------------------------------------------------------------------------------


def truth_and_estimate(error: np.ndarray) -> tuple[StateRecord, StateRecord]:
    """Return a true state and one whose error, estimate minus truth, is ``error`` in the order of the filter."""
    truth, estimate = new_bank(2, 0).state
    C_eb = attitude(20, -10, 70)
    for m, e in ((truth, np.zeros(OFFSETS)), (estimate, error)):
        m.r_e[:] = np.array([2.8e6, 1.6e6, 5.5e6]) + e[DR : DR + 3]
        m.v_e[:] = np.array([10.0, 20.0, 30.0]) + e[DV : DV + 3]
        m.b_a[:] = 0.01 + e[BA : BA + 3]
        m.b_g[:] = 1e-4 + e[BG : BG + 3]
        m.clock[:] = 1e5 + e[CLOCK], 50.0 + e[DRIFT]
        # C_eb_hat = (I + [psi x]) C_eb, for small psi
        m.C_eb[:] = Rotation.from_rotvec(e[PSI : PSI + 3]).as_matrix() @ C_eb
        matrix_to_quaternion(m.C_eb, m.q_eb)
    return truth, estimate


def test_error_is_estimate_minus_truth_and_the_closed_loop_takes_it_out() -> None:
    error = np.arange(1, OFFSETS + 1) * 1e-3
    truth, estimate = truth_and_estimate(error)
    psi = error[PSI : PSI + 3]
    cross = np.array([[0, -psi[2], psi[1]], [psi[2], 0, -psi[0]], [-psi[1], psi[0], 0]])
    # what is left out of I + [psi x] is second order: |psi|^2 / 2 = 1e-4
    np.testing.assert_allclose(estimate.C_eb, (np.eye(3) + cross) @ truth.C_eb, atol=1.2e-4)

    close_loop(estimate, -error, OFFSETS)

    for name in ("r_e", "v_e", "b_a", "clock"):
        np.testing.assert_allclose(getattr(estimate, name), getattr(truth, name), atol=1e-9, err_msg=name)
    # heading after tilt, and the Earth rate's new components in body axes: second order in psi again
    np.testing.assert_allclose(estimate.C_eb, truth.C_eb, atol=1.2e-4)
    np.testing.assert_allclose(estimate.b_g, truth.b_g, atol=WGS84_OMEGA_RADPS * 1.2e-4)


def test_error_state_has_the_order_of_the_central_paper() -> None:
    assert (DR, DV, PSI, BA, BG, CLOCK, DRIFT, OFFSETS) == (0, 3, 6, 9, 12, 15, 16, 17)
    assert len(state.STATE_NAMES) == 17
    assert state.STATE_NAMES[DV] == "dv_e_x"
    assert state.STATE_NAMES[BG + 2] == "b_g_z"


def test_innovation_is_measured_minus_predicted_and_a_positive_one_raises_the_estimate() -> None:
    P, row, work = np.array([[4.0]]), np.ones(1), np.zeros((4, 1))
    measured, predicted = 12.0, 10.0

    y, S = scalar_update(P, row, np.zeros(1, np.int64), measured - predicted, 4.0, work)

    # P = 4, r = 4: half of the way, half of the variance
    assert (y, S) == (2.0, 8.0)
    assert work[0, 0] == pytest.approx(1.0)
    assert P[0, 0] == pytest.approx(2.0)


def test_receiver_clock_adds_to_the_range_and_the_satellite_clock_subtracts() -> None:
    layout = layout_with(n_offsets=1)
    rows, par = short_log.rows(layout), short_log.parameters(layout)[0]
    par.use_ionosphere, par.use_troposphere = 0.0, 0.0
    r_e, C_ne, _ = short_log.level_state()
    bank, work = new_bank(1, 1), new_epoch(len(short_log.SKY), OFFSETS + 1)
    m = bank.state[0]
    m.r_e[:], m.C_eb[:] = r_e, C_ne.T
    m.clock[:] = short_log.CLOCK_M, short_log.DRIFT_MPS
    w_ib_b = C_ne @ np.array([0.0, 0.0, WGS84_OMEGA_RADPS])  # at rest on the turning Earth
    g_e = np.zeros(3)
    normal_gravity_ecef(r_e, g_e)
    f_b = -C_ne @ g_e

    predict_measurements(m, np.eye(OFFSETS + 1), par, rows, 0, w_ib_b, f_b, work)
    exact = work.lines["innovation"][0, :2].copy()
    m.clock[:] += 30.0, 2.0  # the estimated clock is 30 m and 2 m/s too large
    predict_measurements(m, np.eye(OFFSETS + 1), par, rows, 0, w_ib_b, f_b, work)

    # pseudorange = range + receiver clock - satellite clock, range rate alike; rounding of a 2.2e7 m range is 4e-9 m
    np.testing.assert_allclose(exact, 0.0, atol=2e-8)
    np.testing.assert_allclose(work.lines["innovation"][0, :2] - exact, [-30.0, -2.0], atol=2e-8)


# --- range rate and Doppler -----------------------------------------------------------------------------------------


def test_range_rate_is_positive_when_the_distance_grows() -> None:
    u, g = np.zeros(3), np.zeros(3)
    satellite = np.array([[26e6, 0.0, 0.0, 100.0, 0.0, 0.0]])  # straight above, climbing

    _, rate = line_of_sight(satellite, 0, np.array([6.4e6, 0.0, 0.0]), np.zeros(3), u, g)

    np.testing.assert_allclose(u, [1, 0, 0], atol=1e-5)
    assert rate == pytest.approx(100.0, abs=0.02)


def test_doppler_is_positive_when_the_distance_shrinks() -> None:
    log = short_log.observed(0.0, 0.0)
    log.range_rate_mps[:] = math.nan
    log.doppler_hz[:] = 1000.0

    # range_rate = -wavelength * doppler, 0.19029 m at GPS L1
    assert range_rates(log)[0] == pytest.approx(-1000.0 * C_MPS / 1575.42e6)


# --- units, time, arrays, random numbers ----------------------------------------------------------------------------


UNITS = ("deg", "m", "mps", "mps2", "radps", "s", "mg", "deg_per_h")
WITHOUT_UNIT = {"n_used", "n_hypotheses"}


def test_every_result_column_ends_in_its_unit() -> None:
    ending = re.compile(rf"_({'|'.join(UNITS)})$")

    assert [name for name in NAV_COLUMNS if not ending.search(name) and name not in WITHOUT_UNIT] == []


def test_time_is_integer_nanoseconds_and_exact_to_the_nanosecond() -> None:
    t_ns = week_seconds_to_ns(2268, [0.000000001, 604_799.999999999])

    assert t_ns.dtype == np.int64
    assert (t_ns - 2268 * NS_PER_WEEK).tolist() == [1, 604_799_999_999_999]


def test_seconds_of_the_week_grow_beyond_a_week_crossover() -> None:
    t_ns = week_seconds_to_ns(2269, 2.5)

    assert ns_to_week_seconds(t_ns, 2268) == pytest.approx(604_802.5, abs=1e-9)


def test_arrays_have_time_first_and_component_last() -> None:
    imu = short_log.imu()

    assert imu.w_ib_b.shape == (imu.t_ns.size, 3)
    assert new_bank(4, 2).P.shape == (4, OFFSETS + 2, OFFSETS + 2)


def test_random_numbers_come_from_the_generator_that_the_caller_passes() -> None:
    drawn = [gauss_markov(5, 0.1, 1.0, 10.0, np.random.default_rng(seed)) for seed in (1, 1, 2)]

    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert not np.any(drawn[0] == drawn[2])
