"""Rows of a vehicle's own motion: their partials by numbers, what they say, and what they must not say."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from insgnss.config.vehicle_kind import VehicleRows
from insgnss.filter.headings.heading_bank import add_to_state
from insgnss.filter.layout import Layout, StateBlock
from insgnss.filter.layout_names import state_layout
from insgnss.filter.own_rows.checked_rows import CheckedRow, checked_rows
from insgnss.filter.own_rows.declared import own_measurements
from insgnss.filter.own_rows.state_estimate import StateEstimate, state_estimate
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.state import BG, OFFSETS, PSI, Bank, new_bank
from insgnss.sensors.ticking import correlated
from insgnss.sensors.vehicle_motion import vehicle_axes
from insgnss.sensors.vehicle_rows import vehicle_measurements, vehicle_states
from tests.filter.scene import START_NS, attitude, new_filter, place
from tests.filter.test_sensor_errors import full_layout
from tests.jacobian import finite_difference_jacobian

AT = place()
AXLE_M = (-1.4, 0.3, 0.6)
RATE = np.array([0.05, -0.03, 0.3])
IMU = ImuSamples(
    START_NS + np.arange(-200, 1) * 10_000_000, np.tile(RATE, (201, 1)), np.tile([0.1, 0.2, -9.8], (201, 1))
)


def vehicle(kind: str, **tables: Any) -> VehicleRows:
    return VehicleRows.model_validate_json(json.dumps({"kind": kind, **tables}))


CAR = vehicle("car", non_holonomic={"axle_m": AXLE_M, "mounting_pitch_deg": 3.0, "mounting_yaw_deg": -4.0})
SHIP = vehicle("ship")


def bank_at(which: VehicleRows, yaw_deg: float = 60.0, v_n: Any = (7.0, 12.0, 1.0)) -> tuple[Bank, Layout]:
    """Return a filter of one heading, 5 deg of roll and 10 deg of pitch, with the vehicle's states."""
    layout = Layout(vehicle_states(which))
    plain = new_filter(AT, v_n=v_n, C_eb=attitude(AT, 5.0, 10.0, yaw_deg))
    bank = new_bank(1, layout.n_optional)
    bank.state[:] = plain.state
    bank.state[0].optional[: layout.n_values] = np.radians([1.5, 2.5])[: layout.n_values]
    return bank, layout


def estimate_of(bank: Bank, layout: Layout) -> StateEstimate:
    return state_estimate(bank.state[0], START_NS, RATE, IMU.f_b[0], state_layout(layout), IMU)


def rows_at(which: VehicleRows, bank: Bank, layout: Layout) -> list[Any]:
    own = own_measurements(vehicle_measurements(which))
    assert own is not None
    return checked_rows(own.kinds[0], estimate_of(bank, layout), state_layout(layout))


@pytest.mark.parametrize("which", [CAR, SHIP], ids=["non_holonomic", "course"])
def test_partials_are_those_of_the_prediction(which: VehicleRows) -> None:
    """Each by differences, in steps of 1 m/s, 1 mrad and 1e-4 rad/s; the innovation falls as the prediction grows."""
    bank, layout = bank_at(which)
    rows = rows_at(which, bank, layout)
    n = OFFSETS + layout.n_values
    H = np.zeros((len(rows), n))
    for h, row in zip(H, rows, strict=True):
        h[row.columns] = row.h

    def innovations(x: np.ndarray) -> np.ndarray:
        moved, _ = bank_at(which)
        add_to_state(moved.state[0], x, layout)
        return np.array([row.innovation for row in rows_at(which, moved, layout)])

    steps = np.full(n, 1e-3)
    steps[:6], steps[12:15] = 1.0, 1e-4
    found = -finite_difference_jacobian(innovations, np.zeros(n), steps)

    # the Earth's rate at the axle turns with the attitude: 7e-5 rad/s times 1.6 m is left out
    np.testing.assert_allclose(H[:, 3:], found[:, 3:], atol=2e-4)
    np.testing.assert_allclose(found[:, :3], 0.0, atol=2e-6)  # the vertical turns by 1.6e-7 rad/m


def at_rest(blocks: tuple[StateBlock, ...]) -> tuple[Bank, Layout, ImuSamples]:
    """Return a car that stands on a slope, the errors of its sensors as states, and samples with noise and turn."""
    layout, rng = Layout(blocks), np.random.default_rng(7)
    plain = new_filter(AT, v_n=(0.0, 0.0, 0.0), C_eb=attitude(AT, 5.0, 10.0, 60.0))
    bank = new_bank(1, layout.n_optional)
    bank.state[:] = plain.state
    bank.state[0].optional[: layout.n_values] = 1e-4
    noise = rng.standard_normal((len(IMU.t_ns), 6)) * 1e-3
    imu = ImuSamples(
        IMU.t_ns, np.array([2e-3, -1e-3, 3e-3]) + noise[:, :3], np.array([1.7, 0.8, -9.6]) + noise[:, 3:]
    )
    return bank, layout, imu


def zero_rates(bank: Bank, layout: Layout, imu: ImuSamples) -> list[CheckedRow]:
    kind = next(k for k in vehicle_measurements(vehicle("car")) if k.name == "zero_rate")
    own = own_measurements([kind])
    assert own is not None
    names = state_layout(layout)
    state = state_estimate(bank.state[0], START_NS, imu.w_ib_b[-1], imu.f_b[-1], names, imu)
    return checked_rows(own.kinds[0], state, names)


def test_zero_rate_is_the_whole_error_of_the_gyros() -> None:
    """Bias, scale factors, misalignments and g-sensitivity are states: the row's partials by differences."""
    layout = full_layout()
    bank, layout, imu = at_rest(layout.blocks)
    rows = zero_rates(bank, layout, imu)
    n = OFFSETS + layout.n_values
    H = np.zeros((3, n))
    for h, row in zip(H, rows, strict=True):
        h[row.columns] = row.h

    def innovations(x: np.ndarray) -> np.ndarray:
        moved, _, _ = at_rest(layout.blocks)
        add_to_state(moved.state[0], x, layout)
        return np.array([row.innovation for row in zero_rates(moved, layout, imu)])

    found = -finite_difference_jacobian(innovations, np.zeros(n), np.full(n, 1e-4))

    np.testing.assert_allclose(H[:, 3:], found[:, 3:], atol=1e-8)
    at = layout.at("gyro_g_sensitivity")
    np.testing.assert_allclose(H[0, at : at + 3], imu.f_b[-100:].mean(axis=0), atol=0.01)


def test_zero_rate_without_further_errors_of_the_gyros_is_that_of_their_bias() -> None:
    rows = zero_rates(*at_rest(()))
    assert all(set(row.columns) <= {*range(PSI, PSI + 3), *range(BG, BG + 3)} for row in rows)


def test_vehicle_that_moves_along_its_own_axis_has_no_innovation() -> None:
    """Forward with a rate about the axle: the IMU beside it moves sideways, the mounted IMU is turned."""
    bank, layout = bank_at(CAR)
    bank.state[0].optional[:2] = 0.0
    m = bank.state[0]
    w_eb_b = RATE - m.C_eb.T @ [0.0, 0.0, 7.292115e-5]
    ahead = vehicle_axes(math.radians(3.0), math.radians(-4.0))[0]
    m.v_e[:] = m.C_eb @ (9.0 * ahead - np.cross(w_eb_b, AXLE_M))
    for row in rows_at(CAR, bank, layout):
        assert abs(row.innovation) < 1e-12


def test_vehicle_axes_are_a_rotation_by_pitch_and_then_yaw() -> None:
    C = vehicle_axes(0.1, -0.2)
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-15)
    turned = [math.cos(0.2) * math.cos(0.1), -math.sin(0.2) * math.cos(0.1), -math.sin(0.1)]
    np.testing.assert_allclose(C[:, 0], turned)


@pytest.mark.parametrize("which", [CAR, SHIP], ids=["non_holonomic", "course"])
def test_rows_of_a_vehicle_that_moves_backward_are_those_of_one_that_moves_forward(
    which: VehicleRows,
) -> None:
    """A turn by 180 deg about the vertical, level: neither heading is chosen by the rows themselves."""
    found = []
    for yaw_deg in (60.0, -120.0):
        bank, layout = bank_at(which)
        bank.state[0].optional[:] = 0.0
        level = new_filter(AT, v_n=(12.0, -7.0, 0.0), C_eb=attitude(AT, 0.0, 0.0, yaw_deg))
        bank.state[0].C_eb[:], bank.state[0].v_e[:] = level.state[0].C_eb, level.state[0].v_e
        plain = vehicle(which.kind)
        found.append([abs(row.innovation) for row in rows_at(plain, bank, layout)])
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


@pytest.mark.parametrize(("kind", "least_mps"), [("car", 8.0), ("train", 2.0), ("ship", 2.0)])
def test_backward_motion_costs_a_heading_its_odds_and_forward_motion_nothing(
    kind: str, least_mps: float
) -> None:
    which = vehicle(kind)
    source: Any = vehicle_measurements(which)[0]
    for speed, wanted in ((-least_mps - 0.1, math.log(1e-4)), (-least_mps + 0.1, 0.0), (30.0, 0.0)):
        bank, layout = bank_at(which)
        m = bank.state[0]
        m.optional[:] = 0.0
        m.C_eb[:] = attitude(AT, 0.0, 0.0, 60.0)
        m.v_e[:] = speed * m.C_eb[:, 0]
        assert source.unlikely(estimate_of(bank, layout)) == pytest.approx(wanted)


def test_slow_or_steep_ship_has_no_course_row() -> None:
    bank, layout = bank_at(SHIP, v_n=(1.0, 1.0, 0.0))
    assert rows_at(SHIP, bank, layout) == []


def test_variance_grows_with_speed_corner_and_an_axle_that_is_not_known() -> None:
    straight = ImuSamples(IMU.t_ns, np.zeros_like(IMU.w_ib_b), IMU.f_b)
    own = own_measurements(vehicle_measurements(vehicle("car")))
    assert own is not None
    found = {}
    for name, imu, v in (("rest", straight, 0.0), ("fast", straight, 20.0), ("corner", IMU, 20.0)):
        bank, layout = bank_at(CAR, v_n=(v, 0.0, 0.0))
        m = bank.state[0]
        estimate = state_estimate(m, START_NS, RATE, IMU.f_b[0], state_layout(layout), imu)
        found[name] = checked_rows(own.kinds[0], estimate, state_layout(layout))[0].variance
    factor = correlated(1.0, 1.0, 1.0)
    turn2 = RATE[0] ** 2 + RATE[2] ** 2
    slip2 = math.radians(0.3) ** 2 * 400.0
    tyres2 = (math.radians(0.35) * RATE[2] * 400.0) ** 2
    assert found["rest"] == pytest.approx(factor * 0.05**2, rel=1e-3)
    assert found["fast"] == pytest.approx(factor * (0.05**2 + slip2), rel=1e-3)
    assert found["corner"] == pytest.approx(factor * (0.05**2 + slip2 + tyres2 + 1.5**2 * turn2), rel=2e-3)


@pytest.mark.parametrize("time_s", [0.1, 2.0, 30.0])
def test_variance_of_correlated_rows_is_that_of_their_mean(time_s: float, rng: np.random.Generator) -> None:
    """Mean of 4000 steps of a Gauss-Markov series, 2000 times: its variance within 5 sigma of sqrt(2 / 2000)."""
    steps, runs = 4000, 2000
    a = math.exp(-1.0 / time_s)
    x, total = rng.standard_normal(runs), np.zeros(runs)
    for _ in range(steps):
        total += x
        x = a * x + math.sqrt(1.0 - a * a) * rng.standard_normal(runs)
    ratio = np.mean((total / steps) ** 2) / (correlated(1.0, time_s, 1.0) / steps)
    assert abs(ratio - 1.0) < 5.0 * math.sqrt(2.0 / runs) + 2.0 * time_s / steps
