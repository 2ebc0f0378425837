"""Columns of the IMU's time in the rows of further sensors and antennas, against the truth at shifted tags."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation

from insgnss.errors import MeasurementError
from insgnss.filter.antennas.rows import attitude_rows, rows_by_states
from insgnss.filter.headings.heading_bank import set_attitude
from insgnss.filter.layout import Layout, StateBlock
from insgnss.filter.layout_names import StateLayout, state_layout
from insgnss.filter.own_rows.checked_rows import CheckedRow
from insgnss.filter.own_rows.declared import own_measurements
from insgnss.filter.own_rows.rows import Measurement, Row
from insgnss.filter.own_rows.state_estimate import StateEstimate, state_estimate
from insgnss.filter.receiver_time import rows_at_their_time, turn_to_gps_time
from insgnss.filter.rows.lines import ANTENNA_DTYPE
from insgnss.filter.state import OFFSETS, Bank, new_bank
from insgnss.filter.states.imu_time import IMU_TIME
from insgnss.filter.update.prior_rows import place_antenna
from insgnss.tables import Float64
from tests.filter.scene import parameters
from tests.filter.test_antenna_rows import differences
from tests.runs.scenes import turns
from tests.sensors.test_sensor_rows import T_NS, VALUES, measurement, sensor

AT_S, STEP_S, OFFSET_S = 14.0, 1e-3, 0.03  # in a turn of 35 deg of bank
LEVER_B = np.array([1.0, -0.5, -1.5])
BLOCKS = (
    StateBlock(IMU_TIME, ("imu_time_offset_s",), "s", 0.02),
    StateBlock("heading_offset", ("heading_offset_deg",), "deg", 0.5),
)
LAYOUT = state_layout(Layout(BLOCKS))
PAR = parameters((2.5, -1.2, -4.0), at_imu_time=OFFSETS, motion_gate2=0.0)[0]


def truth(what: str, t_s: float) -> Any:
    """Return one quantity of the trajectory at one time."""
    return getattr(turns().scenario.trajectory, what)(np.array([t_s]))[0]


def point(t_s: float) -> Float64:
    return np.asarray(truth("position_e", t_s) + truth("rotation_eb", t_s).apply(LEVER_B))


def velocity_n(t_s: float) -> Float64:
    v_e = (point(t_s + 1e-3) - point(t_s - 1e-3)) / 2e-3
    lat, lon, _ = pymap3d.ecef2geodetic(*point(AT_S))
    east, north, up = pymap3d.ecef2enuv(*v_e, lat, lon)
    return np.array([north, east, -up])


def place_n(t_s: float) -> Float64:
    """North, east, down from where the point is at ``AT_S``."""
    lat, lon, h = pymap3d.ecef2geodetic(*point(AT_S))
    east, north, up = pymap3d.ecef2enu(*point(t_s), lat, lon, h)
    return np.array([north, east, -up])


def angles(t_s: float) -> Float64:
    lat, lon, _ = pymap3d.ecef2geodetic(*truth("position_e", t_s))
    axes = np.array(pymap3d.ecef2enuv(*truth("rotation_eb", t_s).as_matrix(), lat, lon))
    C_nb = np.vstack([axes[1], axes[0], -axes[2]])
    return np.asarray(Rotation.from_matrix(C_nb).as_euler("ZYX")[::-1])


def heading(t_s: float) -> Float64:
    return angles(t_s)[2:]


def filter_at(t_s: float) -> Bank:
    """Return a filter whose state is the truth at a time, in a motion that has been going on."""
    bank = new_bank(1, len(BLOCKS))
    m = bank.state[0]
    m.r_e[:] = truth("position_e", t_s)
    set_attitude(m, truth("rotation_eb", t_s).as_matrix())
    m.v_e[:] = m.v_shown[:] = truth("velocity_e", t_s)
    m.w_near[:] = m.w_last[:] = m.w_smooth[:] = truth("angular_rate_b", t_s)
    m.f_last[:] = truth("specific_force_b", t_s)
    m.f_near[:] = m.C_eb @ m.f_last
    return bank


def estimate_of(bank: Bank) -> StateEstimate:
    m = bank.state[0]
    return state_estimate(m, T_NS, m.w_last.copy(), m.f_last.copy(), LAYOUT)


def rows_of(source: Measurement, bank: Bank) -> list[CheckedRow]:
    m, P, own = bank.state[0], bank.P[0], own_measurements([source])
    assert own is not None
    antenna = np.zeros(1, ANTENNA_DTYPE)[0]
    place_antenna(m, PAR, m.w_last, m.f_last, antenna)
    antenna.turning_e[:] = antenna.a_e
    (rows,) = rows_at_their_time(own.kinds, estimate_of(bank), LAYOUT, m, P, PAR, antenna)
    return rows


def column_of(row: CheckedRow) -> float:
    return float(np.sum(row.h[row.columns == OFFSETS]))


@pytest.mark.parametrize(
    ("kind", "measured"),
    [("position", place_n), ("velocity", velocity_n), ("attitude", angles), ("heading", heading)],
)
def test_column_is_the_change_of_the_truth_where_the_tags_are_shifted(
    kind: str, measured: Callable[[float], Float64]
) -> None:
    """The state is the vehicle's at the tag: with s seconds added, the measurement is from s earlier."""
    rows = rows_of(measurement(kind, VALUES[kind]), filter_at(AT_S))
    change = -(measured(AT_S + STEP_S) - measured(AT_S - STEP_S)) / (2.0 * STEP_S)
    # what the neglected change of the rate adds to a velocity
    atol = {"position": 2e-3, "velocity": 0.02}.get(kind, 1e-4)
    np.testing.assert_allclose([column_of(row) for row in rows], change, atol=atol)
    assert np.abs(change).max() > {"position": 20.0, "velocity": 2.0}.get(kind, 0.05)


@pytest.mark.parametrize("kind", ["position", "velocity", "attitude", "heading"])
def test_offset_that_is_known_leaves_no_error(kind: str) -> None:
    """Tags 30 ms early: the state is from 30 ms after the measurement, and the prediction is the true state's."""
    late = filter_at(AT_S + OFFSET_S)
    late.state[0].optional[0] = OFFSET_S
    one = measurement(kind, VALUES[kind])
    found, wanted, off = (
        np.array([row.innovation for row in rows_of(one, bank)])
        for bank in (late, filter_at(AT_S), filter_at(AT_S + OFFSET_S))
    )
    atol = {"position": 1e-3, "velocity": 5e-3}.get(kind, 2e-5)
    np.testing.assert_allclose(found, wanted, atol=atol)
    assert np.abs(off - wanted).max() > 30.0 * atol


class OwnHeight:
    """A height of a user's own, at GPS time or at the IMU's tags."""

    name = "height"
    times_ns = np.array([T_NS])

    def __init__(self, clock: Any) -> None:
        self.clock = clock

    def rows(self, state: StateEstimate, _: StateLayout) -> Row:
        return Row(-state.h_m, {"position": state.up_e}, 1.0)


def test_rows_on_the_imus_clock_do_not_depend_on_its_time() -> None:
    bank = filter_at(AT_S)
    bank.state[0].v_e[:] = 10.0 * estimate_of(bank).up_e
    bank.state[0].v_shown[:] = bank.state[0].v_e
    bank.state[0].optional[0] = OFFSET_S
    (own,), (of_gps,) = rows_of(OwnHeight("imu"), bank), rows_of(OwnHeight("gps"), bank)
    assert OFFSETS not in own.columns
    assert column_of(of_gps) == pytest.approx(-10.0, abs=1e-6)
    assert of_gps.innovation - own.innovation == pytest.approx(10.0 * OFFSET_S, abs=0.01)
    with pytest.raises(MeasurementError, match="clock"):
        own_measurements([OwnHeight("utc")])


def test_sensors_of_receivers_are_at_gps_time_and_those_beside_the_imu_at_its_tags() -> None:
    clocks = {kind: sensor(kind).clock for kind in VALUES}
    beside = dict.fromkeys(("odometer", "barometer", "magnetometer"), "imu")
    assert clocks == dict.fromkeys(VALUES, "gps") | beside
    assert measurement("position", VALUES["position"], clock="imu").clock == "imu"


def test_column_of_a_phase_difference_is_its_change_where_the_tags_are_shifted() -> None:
    """Differences are -u . C l: of the truth a millisecond before and after, and the baseline 30 ms earlier."""
    d, bank = differences(), filter_at(AT_S)
    m, l_b = bank.state[0], np.array([[1.0, 0.0, 0.0], [0.5, 0.9, 0.1], [0.0, 1.0, 0.0]])[[0, 0, 1, 2, 1]]
    H, columns, P_h = rows_by_states(attitude_rows(d, l_b, m.C_eb), m, bank.P[0], PAR)

    def value(t_s: float) -> Float64:
        return np.asarray(-np.sum(d.u_e * truth("rotation_eb", t_s).apply(l_b), axis=1))

    change = -(value(AT_S + STEP_S) - value(AT_S - STEP_S)) / (2.0 * STEP_S)
    assert columns[-1] == OFFSETS and P_h.shape == (4, 4)
    np.testing.assert_allclose(H[:, 3], change, atol=2e-4)
    assert np.abs(change).max() > 0.03
    late = filter_at(AT_S + OFFSET_S).state[0]
    late.optional[0] = OFFSET_S
    turned = -np.sum(d.u_e * (l_b @ turn_to_gps_time(late, PAR).T @ late.C_eb.T), axis=1)
    np.testing.assert_allclose(turned, value(AT_S), atol=5e-5)
