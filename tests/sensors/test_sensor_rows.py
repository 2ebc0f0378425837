"""Rows of every kind of sensor: partials by differences, readings without a number, correlated noise."""

from __future__ import annotations

import dataclasses
import math
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy.spatial.transform import Rotation

from insgnss.config.sensors import Sensor
from insgnss.filter.layout import StateBlock
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.sensors.fitting import KINDS
from insgnss.sensors.readings import LiveReadings, Readings, readings_of
from insgnss.sensors.sensor_measurement import SensorMeasurement
from insgnss.sensors.vehicle_motion import MOUNTING, VehicleMounting, vehicle_axes
from insgnss.sensors.vehicle_rows import vehicle_states
from insgnss.tables import Float64, SensorTable
from tests.jacobian import finite_difference_jacobian
from tests.sensors.test_vehicle_motion import vehicle

T_NS = 1_400_000_000_000_000_000
LAT, LON, H = 0.71, -1.29, 300.0
DECLARED: dict[str, dict[str, Any]] = {
    "odometer": {"lever_arm_m": [-1.2, 0.7, 0.5]},
    "barometer": {"lever_arm_m": [2.0, 0.3, -0.4]},
    "magnetometer": {"declination_deg": -12.0, "horizontal_ut": 20.0},
    "heading": {},
    "attitude": {},
    "position": {"lever_arm_m": [1.0, -0.5, -1.5], "sigma_m": [1.0, 1.0, 2.0]},
    "velocity": {"lever_arm_m": [1.0, -0.5, -1.5], "sigma_mps": [0.1, 0.1, 0.2]},
}
VALUES = {
    "odometer": [14.0],
    "barometer": [380.0],
    "magnetometer": [15.0, -9.0, 40.0],
    "heading": [0.5],
    "attitude": [0.1, -0.2, 0.6],
    "position": [LAT + 1e-6, LON - 1e-6, H + 3.0],
    "velocity": [10.0, 9.0, -1.0],
}


def sensor(kind: str, **more: Any) -> Any:
    return TypeAdapter(Sensor).validate_python({"kind": kind, **DECLARED[kind], **more})


def measurement(kind: str, values: list[float], **more: Any) -> SensorMeasurement[Any]:
    config = sensor(kind, **more)
    table = SensorTable(kind, np.array([T_NS]), np.array([values]), np.full((1, len(values)), np.nan))
    return KINDS[type(config)](config, readings_of(config, table))


def estimate(blocks: tuple[StateBlock, ...]) -> StateEstimate:
    r_e = np.zeros(3)
    geodetic_to_ecef(LAT, LON, H, r_e)
    optional: dict[str, Any] = {}
    for k, block in enumerate(blocks):
        value = 0.01 * (k + 1) * (np.arange(block.size) + 1.0)
        optional[block.name] = float(value[0]) if block.size == 1 else value
    return StateEstimate(
        T_NS,
        r_e,
        np.array([3.0, -11.0, 7.0]),
        Rotation.from_euler("ZYX", [0.4, -0.3, 0.9]).as_matrix(),
        *(np.zeros(3), np.zeros(3), 0.0, 0.0),
        np.array([0.2, -0.3, 0.5]),
        np.array([0.1, 0.2, -9.7]),
        MappingProxyType(optional),
    )


def moved(state: StateEstimate, name: str, d: Float64) -> StateEstimate:
    """Return a state with one block grown by ``d``."""
    if name == "position":
        return dataclasses.replace(state, r_e=state.r_e + d)
    if name == "velocity":
        return dataclasses.replace(state, v_e=state.v_e + d)
    if name == "attitude":
        return dataclasses.replace(state, C_eb=Rotation.from_rotvec(d).as_matrix() @ state.C_eb)
    if name == "gyro_bias":
        return dataclasses.replace(state, b_g=state.b_g + d, w_ib_b=state.w_ib_b - d)
    value = state.optional[name] + (d if np.ndim(state.optional[name]) else d[0])
    return dataclasses.replace(state, optional=MappingProxyType({**state.optional, name: value}))


def rows(one: SensorMeasurement[Any], state: StateEstimate) -> Any:
    return one.rows(state, StateLayout({}))


STEPS = {"position": 10.0, "velocity": 0.1, "attitude": 1e-4, "gyro_bias": 1e-3}


@pytest.mark.parametrize("kind", VALUES)
def test_partials_are_the_differences_of_the_prediction(kind: str) -> None:
    one = measurement(kind, VALUES[kind])
    state = estimate(one.states())
    for k, row in enumerate(rows(one, state)):
        for name, given in row.partials.items():
            size = np.size(given)

            def predicted(d: Float64, name: str = name, k: int = k) -> float:
                return -float(rows(one, moved(state, name, d))[k].innovation)

            found = finite_difference_jacobian(predicted, np.zeros(size), STEPS.get(name, 1e-3))
            scale = max(1.0, float(np.abs(found).max()))
            # the Earth's rate, 7.3e-5 rad/s over metres, is taken as fixed to the body
            atol = 2e-4 if name == "attitude" else 2e-6 * scale
            np.testing.assert_allclose(np.atleast_1d(given), found[0], atol=atol, err_msg=f"{k} {name}")


@pytest.mark.parametrize("turn_deg", [0.0, 70.0, -160.0])
def test_size_of_the_magnetic_field_does_not_tell_the_heading_and_its_direction_is_linear_in_it(
    turn_deg: float,
) -> None:
    """The gate refuses a field of the wrong size at any heading; a field of the right size corrects any heading."""
    one = measurement("magnetometer", VALUES["magnetometer"])
    state = estimate(one.states())
    up_e = -state.C_ne[2]
    direction, size = rows(one, state)
    from_here = float(direction.innovation) / (
        float(size.innovation) + 20.02
    )  # of the field, by its intensity there
    turned = moved(state, "attitude", math.radians(turn_deg) * up_e)
    direction_turned, size_turned = rows(one, turned)

    assert np.dot(size_turned.partials["attitude"], up_e) == pytest.approx(0.0, abs=1e-9)
    assert size_turned.innovation == pytest.approx(size.innovation, abs=1e-9)
    moved_rad = float(direction_turned.innovation) / (float(size_turned.innovation) + 20.02) - from_here
    assert math.remainder(moved_rad + math.radians(turn_deg), 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_odometer_reads_along_the_forward_axis_of_a_vehicle_whose_imu_looks_aside() -> None:
    """30 deg to the right of the vehicle and 10 deg up: along the body's own axis the wheel would read 15 % less."""
    given = vehicle("car", non_holonomic={"mounting_yaw_deg": 30.0, "mounting_pitch_deg": 10.0})
    blocks = (*vehicle_states(given), *measurement("odometer", [13.0]).states())
    state = dataclasses.replace(estimate(blocks), w_ib_b=np.zeros(3), b_g=np.zeros(3))
    still = dataclasses.replace(state, optional=MappingProxyType(dict.fromkeys(state.optional, 0.0)))
    still = dataclasses.replace(still, optional=MappingProxyType({**still.optional, MOUNTING: np.zeros(2)}))
    ahead, _, _ = vehicle_axes(math.radians(10.0), math.radians(30.0))
    config = sensor("odometer")
    config = config.model_copy(update={"lever_arm_m": (0.0, 0.0, 0.0)})
    one = dataclasses.replace(
        measurement("odometer", [13.0]), config=config, mounting=VehicleMounting.of(given.non_holonomic)
    )
    along = dataclasses.replace(still, v_e=13.0 * still.C_eb @ ahead)
    assert rows(one, along)[0].innovation == pytest.approx(0.0, abs=1e-3)

    (row,) = rows(one, state)
    for name in (MOUNTING, "attitude", "velocity"):
        given_by = row.partials[name]

        def predicted(d: Float64, name: str = name) -> float:
            return -float(rows(one, moved(state, name, d))[0].innovation)

        found = finite_difference_jacobian(predicted, np.zeros(np.size(given_by)), STEPS.get(name, 1e-4))
        np.testing.assert_allclose(given_by, found[0], atol=2e-4, err_msg=name)


@pytest.mark.parametrize("kind", VALUES)
def test_every_state_of_a_sensor_is_seen_by_a_row(kind: str) -> None:
    one = measurement(kind, VALUES[kind])
    state = estimate(one.states())
    seen = {name for row in rows(one, state) for name in row.partials}
    assert {block.name for block in one.states()} <= seen
    assert {column.split("_")[0] for block in one.states() for column in block.columns} <= {kind}


def test_odometer_at_the_axle_does_not_feel_the_turn_of_the_lever() -> None:
    """The wheel's forward speed is that of the IMU plus w x l: 0.5 rad/s about down, 0.7 m to the right, -0.35 m/s."""
    state = dataclasses.replace(
        estimate(measurement("odometer", [0.0]).states()), w_ib_b=np.array([0.0, 0.0, 0.5])
    )
    state = dataclasses.replace(state, optional=MappingProxyType({"odometer_scale": 0.0}))
    here = rows(measurement("odometer", [0.0], lever_arm_m=[0.0, 0.0, 0.0]), state)[0].innovation
    right = rows(measurement("odometer", [0.0], lever_arm_m=[-3.0, 0.7, 0.0]), state)[0].innovation
    assert right - here == pytest.approx(0.35, abs=2e-4)  # the Earth's rate times metres


def test_unsigned_odometer_is_compared_with_the_size_of_the_speed() -> None:
    plain, unsigned = measurement("odometer", [5.0]), measurement("odometer", [5.0], signed=False)
    state = estimate(plain.states())
    forwards = dataclasses.replace(state, v_e=5.0 * state.C_eb[:, 0])
    backwards = dataclasses.replace(state, v_e=-5.0 * state.C_eb[:, 0])
    assert rows(plain, backwards)[0].innovation == pytest.approx(
        10.0 + rows(plain, forwards)[0].innovation, abs=1.0
    )
    assert abs(rows(unsigned, backwards)[0].innovation) < 1.0


def test_odometer_reading_zero_below_its_least_speed_says_little() -> None:
    state = estimate(measurement("odometer", [0.0]).states())
    exact, coarse = (measurement("odometer", [0.0], least_speed_mps=s) for s in (0.0, 0.8))
    ratio = rows(coarse, state)[0].variance - rows(exact, state)[0].variance
    assert ratio == pytest.approx(0.8**2 * readings_weight(exact))


def readings_weight(one: SensorMeasurement[Any]) -> float:
    return one.readings.at(T_NS).weight


def test_heading_differences_are_within_half_a_turn() -> None:
    state = estimate(measurement("heading", [0.0]).states())
    innovation = rows(measurement("heading", [state.yaw_rad + 2.0 * math.pi + 0.1]), state)[0].innovation
    offset = float(state.optional["heading_offset"])
    assert innovation == pytest.approx(0.1 - offset, abs=1e-9)


@pytest.mark.parametrize("kind", VALUES)
def test_reading_without_a_number_is_refused_and_keeps_its_rows(kind: str) -> None:
    good = measurement(kind, VALUES[kind])
    bad = measurement(kind, [math.nan] * len(VALUES[kind]))
    state = estimate(good.states())
    assert len(rows(good, state)) == len(rows(bad, state))
    assert all(math.isnan(row.innovation) for row in rows(bad, state))


def test_fix_without_a_height_keeps_north_and_east() -> None:
    whole = measurement("position", VALUES["position"])
    flat = measurement("position", [*VALUES["position"][:2], math.nan])
    state = estimate(whole.states())
    assert np.isnan([row.innovation for row in rows(flat, state)]).tolist() == [False, False, True]
    for k in (0, 1):  # 3 m of height move the fix by nothing that matters
        assert rows(flat, state)[k].innovation == pytest.approx(rows(whole, state)[k].innovation, abs=1e-4)


def test_attitude_near_the_vertical_gives_no_row_a_value() -> None:
    one = measurement("attitude", [0.0, 1.55, 0.0])
    state = estimate(())
    C_nb = Rotation.from_euler("ZYX", [0.4, 1.55, 0.2]).as_matrix()
    steep = dataclasses.replace(state, C_eb=state.C_ne.T @ C_nb)
    assert np.isnan([row.innovation for row in rows(one, steep)]).all()


# ------------------------------------------------------------------------------------------------- correlated noise


def table_of(times_s: list[float]) -> SensorTable:
    t_ns = T_NS + np.round(np.array(times_s) * 1e9).astype(np.int64)
    return SensorTable(
        "odometer", t_ns, np.arange(len(t_ns), dtype=float)[:, None], np.full((len(t_ns), 1), np.nan)
    )


def test_readings_sooner_than_the_interval_are_left_out_and_counted() -> None:
    config = sensor("odometer", interval_s=0.1)
    found = readings_of(config, table_of([0.0, 0.05, 0.1, 0.19, 0.5, 0.51]))
    assert found.values[:, 0].tolist() == [0.0, 2.0, 3.0, 4.0]
    assert found.left_out == 2
    everything = readings_of(sensor("odometer", interval_s=0.0), table_of([0.0, 0.05, 0.1, 0.19, 0.5, 0.51]))
    assert everything.left_out == 0


def test_ten_correlated_readings_weigh_as_little_as_they_are_worth() -> None:
    """Variance of the mean of a Gauss-Markov error over 10 s, tau = 1 s: 2 tau / T (1 - tau / T), that is 0.18."""
    config = sensor("odometer", interval_s=0.1, correlation_time_s=1.0)
    found = readings_of(config, table_of([0.1 * k for k in range(100)]))
    of_mean = 1.0 / np.sum(1.0 / found.weight)
    assert of_mean == pytest.approx(0.2, rel=0.01)
    row = rows(
        measurement("odometer", [1.0], correlation_time_s=1.0),
        estimate(measurement("odometer", [1.0]).states()),
    )[0]
    assert row.variance == pytest.approx(20.0 * row.single_variance)
    alone = readings_of(config, table_of([0.0, 10.0]))
    assert alone.weight[1] == 1.0


def test_live_readings_are_those_of_the_log() -> None:
    config = sensor("odometer", interval_s=0.1)
    times_s = [0.0, 0.05, 0.1, 0.19, 0.5, 0.51, 0.7]
    table, live = table_of(times_s), LiveReadings(config)
    for t_ns, value in zip(table.t_ns.tolist(), table.values, strict=True):
        live.add(t_ns, value, np.full(1, np.nan))
    found = readings_of(config, table)
    assert isinstance(found, Readings)
    assert live.times == found.times_ns.tolist()
    for t_ns in live.times:
        assert str(live.at(t_ns)) == str(found.at(t_ns))


def test_live_readings_repeat_where_those_of_the_log_do() -> None:
    config = sensor("velocity")
    table = table_of([0.0, 1.0, 2.0, 3.0, 4.0])
    values = np.array([[1.0, np.nan], [1.0, np.nan], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    table, live = (
        dataclasses.replace(table, values=values, sigma=np.full((5, 2), np.nan)),
        LiveReadings(config),
    )
    for t_ns, value in zip(table.t_ns.tolist(), values, strict=True):
        live.add(t_ns, value, np.full(2, np.nan))
    found = readings_of(config, table)
    repeated = [live.repeated(t_ns) for t_ns in live.times]
    assert str(repeated) == str([found.repeated(t_ns) for t_ns in live.times])
    assert [each is None for each in repeated] == [True, False, True, False, False]


@pytest.mark.parametrize(("axes", "sigma"), [("ned", (0.1, 0.2, 0.3)), ("enu", (0.2, 0.1, 0.3))])
def test_sigmas_of_the_flight_file_go_along_the_axes_of_the_log(
    axes: str, sigma: tuple[float, float, float]
) -> None:
    one = measurement("velocity", VALUES["velocity"], axes=axes, sigma_mps=sigma)

    assert [row.single_variance for row in rows(one, estimate(()))] == pytest.approx([0.01, 0.04, 0.09])
