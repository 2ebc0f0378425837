"""Scale factors, misalignments, g-sensitivity as states: the whole error of a sensor, and what a start knows of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insgnss.config.flight import ImuGrade
from insgnss.config.library import filter_config, imu_grade
from insgnss.config.process import SensorError
from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.filter.diagnosis.resetting import inflate_bias_covariance
from insgnss.filter.headings.motion import unknown_force
from insgnss.filter.layout import SENSORS, Layout
from insgnss.filter.registry import layout_of
from insgnss.filter.sensor_errors import (
    BIAS_OF,
    accel_error_covariance,
    biases_to_whole_errors,
    gyro_error_variance,
    whole_error_rows,
    whole_errors,
)
from insgnss.filter.start.start import LEVEL_FLOOR_RAD, StartAttitude, open_bank
from insgnss.filter.state import BA, BG, DV, OFFSETS, PSI, Bank, new_bank
from insgnss.filter.states.wanted import StateInputs
from insgnss.filter.update.closed_loop import turn_force_errors
from insgnss.geodesy.local_level import up_direction
from insgnss.inertial.sensor_model import UNIT_OF_ERROR, sensor_model
from tests.filter.scene import START_NS, parameters, place
from tests.filter.test_start_covariance import T_NS, kinematics

FORCE, RATE = np.array([1.0, -2.0, -9.0]), np.array([0.1, -0.2, 0.3])


EXACT_TAGS = {"process.imu_time_sigma_s": 0.0}


def full_layout(grade: ImuGrade | None = None) -> Layout:
    """Return the layout with every error of a sensor as a state, behind one clock offset."""
    wanted = StateInputs(
        filter_config("tight", EXACT_TAGS), ("G", "E"), False, grade or imu_grade("industrial")
    )
    return layout_of(wanted)


def numbers(layout: Layout) -> Any:
    """Return the filter's numbers with the layout's couplings."""
    par = parameters()
    for i, (at, into, axis, times) in enumerate(layout.couplings):
        par["coupling_at"][0, i], par["coupling_into"][0, i] = at, into
        par["coupling_axis"][0, i], par["coupling_times"][0, i] = axis, times
    par["n_couplings"] = len(layout.couplings)
    return par[0]


def drawn(layout: Layout, rng: np.random.Generator) -> tuple[Bank, np.ndarray]:
    """Return a filter with drawn states in a turn, and how its sensors' errors grow with the error state (6, n)."""
    bank = new_bank(1, layout.n_optional)
    m, n = bank.state[0], bank.P.shape[1]
    m.f_last[:], m.w_last[:] = FORCE, RATE
    m.b_a[:], m.b_g[:] = rng.normal(size=3), rng.normal(size=3)
    m.optional[: layout.n_values] = rng.normal(size=layout.n_values)
    root = rng.normal(size=(n, n))
    bank.P[0] = root @ root.T
    M = np.zeros((6, n))  # accelerometers, then gyros
    M[:3, BA : BA + 3] = M[3:, BG : BG + 3] = np.eye(3)
    at = layout.at("gyro_scale_factor")
    M[3:, at : at + 3] = np.diag(RATE)
    at = layout.at("accel_scale_factor")
    M[:3, at : at + 3] = np.diag(FORCE)
    for name, row, of in (("gyro_misalignment", 3, RATE), ("accel_misalignment", 0, FORCE)):
        at, across = layout.at(name), [(i, j) for i in range(3) for j in range(3) if i != j]
        for k, (i, j) in enumerate(across):
            M[row + i, at + k] = of[j]
    at = layout.at("gyro_g_sensitivity")
    for k in range(9):
        M[3 + k // 3, at + k] = FORCE[k % 3]
    return bank, M


def test_names_are_those_of_settings_and_grade() -> None:
    assert set(get_args(SensorError)) == set(UNIT_OF_ERROR)
    for name, unit in UNIT_OF_ERROR.items():
        assert f"{name}_{unit}" in ImuGrade.model_fields


def test_states_are_those_that_the_grade_has_and_the_settings_want() -> None:
    grade = imu_grade("industrial").model_copy(update={"gyro_misalignment_mrad": 0.0})
    layout = full_layout(grade)
    assert layout.names[1:] == [name for name in UNIT_OF_ERROR if name != "gyro_misalignment"]
    config = filter_config("tight", {"process.sensor_error_states": ["accel_scale_factor"], **EXACT_TAGS})
    layout = layout_of(StateInputs(config, ("G",), False, imu_grade("industrial")))
    assert layout.names == ["accel_scale_factor"]
    left = sensor_model(imu_grade("industrial"), layout.names)
    assert left.accel_scale == pytest.approx(1e-3) and left.accel_scale_factor == 0.0
    assert left.gyro_scale == pytest.approx(math.sqrt(2.0) * 1e-3)


def test_whole_errors_are_the_sums_of_their_parts(rng: np.random.Generator) -> None:
    layout = full_layout()
    bank, M = drawn(layout, rng)
    m, P, par = bank.state[0], bank.P[0], numbers(layout)
    x = np.zeros(len(P))
    x[BA : BA + 3], x[BG : BG + 3], x[OFFSETS : OFFSETS + layout.n_values] = (
        m.b_a, m.b_g, m.optional[: layout.n_values],
    )  # fmt: skip
    accel, gyro, rows, T = np.zeros(3), np.zeros(3), np.zeros((3, len(P))), np.eye(len(P))

    whole_errors(m, par, accel, gyro)
    accel_error_covariance(m, par, P, rows)
    variance = gyro_error_variance(m, par, P)
    both = [whole_error_rows(m, layout, sensor, len(P)) for sensor in SENSORS]
    T[BA : BA + 3], T[BG : BG + 3] = M[:3], M[3:]
    expected = T @ P @ T.T
    biases_to_whole_errors(m, par, P)

    np.testing.assert_allclose(np.concatenate([accel, gyro]), M @ x, rtol=1e-12)
    np.testing.assert_allclose(np.vstack(both), M, rtol=1e-12)
    np.testing.assert_allclose(P, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rows[:, BA : BA + 3], expected[BA : BA + 3, BA : BA + 3], rtol=1e-9)
    np.testing.assert_allclose(rows[:, PSI : PSI + 3], expected[BA : BA + 3, PSI : PSI + 3], rtol=1e-9)
    assert variance == pytest.approx(np.trace(expected[BG : BG + 3, BG : BG + 3]) / 3.0)
    assert BIAS_OF == {DV: BA, PSI: BG}


@pytest.mark.parametrize(
    ("of_it", "turned_by"), [(1.0, 1.0), (1.7, 1.0), (0.4, 0.4), (0.0, 0.0), (-0.5, 0.0)]
)
def test_accelerometer_errors_stay_in_space_while_the_tilt_that_belongs_to_them_is_corrected(
    of_it: float, turned_by: float, rng: np.random.Generator
) -> None:
    """An error that has just begun has made no tilt: ``of_it`` is the part of its tilt that is corrected with it."""
    layout = full_layout()
    bank, M = drawn(layout, rng)
    m, P, par = bank.state[0], bank.P[0], numbers(layout)
    m.r_e[:] = place().r_e
    m.C_eb[:] = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    correction = 0.1 * rng.normal(size=len(P))
    up, of_force = np.array(up_direction(m.r_e)), np.array([0, 1, 2]) + BA
    tilt = np.cross(up, m.C_eb @ M[:3] @ correction) / STANDARD_GRAVITY_MPS2
    correction[PSI : PSI + 3] = of_it * tilt + 0.3 * up
    tilt *= turned_by
    whole = np.eye(len(P))
    whole[of_force] = M[:3]
    turned = np.eye(len(P))
    turned[np.ix_(of_force, of_force)] = m.C_eb.T @ Rotation.from_rotvec(-tilt).as_matrix() @ m.C_eb
    T = np.linalg.inv(whole) @ turned @ whole
    expected, expected_correction, before = (
        T @ P @ T.T,
        T @ correction,
        m.C_eb @ M[:3] @ P @ M[:3].T @ m.C_eb.T,
    )

    turn_force_errors(m, P, par, correction)

    np.testing.assert_allclose(P, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(correction, expected_correction, rtol=1e-9, atol=1e-12)
    assert (P.T == P).all()
    C_eb = Rotation.from_rotvec(tilt).as_matrix() @ m.C_eb
    np.testing.assert_allclose(C_eb @ M[:3] @ P @ M[:3].T @ C_eb.T, before, rtol=1e-9, atol=1e-9)


def opened(grade: ImuGrade | None = None, **changes: Any) -> tuple[Bank, Layout]:
    """Return the bank of one attitude at rest, with an industrial sensor unless another is given."""
    grade = grade or imu_grade("industrial")
    layout, par = full_layout(grade), parameters([2.0, -1.5, -3.0])[0]
    how = StartAttitude(0.1, -0.2, 1.0, 0.02, 0.26, 1.0, np.array([1e-3, 0.0, -2e-3]), 1e-4, True)
    kin = replace(kinematics(np.eye(3), np.eye(3)), clocks=np.zeros(2))
    config = filter_config("tight17")
    bank = open_bank(kin, [replace(how, **changes)], np.zeros(3), par, config, grade, T_NS, layout)
    assert bank.head[0].now_ns == START_NS
    return bank, layout


def test_start_at_rest_knows_the_sum_of_the_gyros_errors_and_shares_it_out() -> None:
    bank, layout = opened()
    m, P = bank.state[0], bank.P[0]
    gyro = whole_error_rows(m, layout, "gyro", len(P))

    whole = np.zeros(3)
    whole_errors(m, numbers(layout), np.zeros(3), whole)

    np.testing.assert_allclose(whole, [1e-3, 0.0, -2e-3], atol=1e-12)
    np.testing.assert_allclose(gyro @ P @ gyro.T, 1e-8 * np.eye(3), atol=1e-12)
    # 80 and 3 deg/h of bias stand against 36 deg/h/g: the bias has the greater share
    assert 0.7 < m.b_g[0] / 1e-3 < 0.95
    assert m.optional[layout.at("gyro_g_sensitivity") - OFFSETS] != 0.0
    assert np.all(np.linalg.eigvalsh(P) > -1e-12)


@pytest.mark.parametrize("sd", [0.0, 1e-5])
def test_gyros_without_an_error_in_their_grade_start_with_what_they_read_as_bias(sd: float) -> None:
    kept = ("gyro_range_deg_per_s", "gyro_correlation_time_s")
    perfect = {name: 0.0 for name in ImuGrade.model_fields if name.startswith("gyro_") and name not in kept}
    bank, _ = opened(imu_grade("industrial").model_copy(update=perfect), sd_b_g=sd)
    m, P = bank.state[0], bank.P[0]
    np.testing.assert_allclose(m.b_g, [1e-3, 0.0, -2e-3], atol=1e-12)
    np.testing.assert_allclose(P[BG : BG + 3, BG : BG + 3], sd**2 * np.eye(3), atol=1e-15)


def test_gyros_far_worse_than_their_grade_have_a_bias_and_no_absurd_g_sensitivity() -> None:
    """0.5 deg/s where the grade says 80 deg/h: nothing but the bias may be so far off."""
    read = np.radians([0.5, -0.5, 0.5])
    bank, layout = opened(b_g=read, sd_b_g=1e-4)
    m, P = bank.state[0], bank.P[0]
    assert np.all(np.abs(m.b_g / read - 1.0) < 0.2)
    for at, variance in layout.sensor_states.items():
        assert abs(m.optional[at - OFFSETS]) < 5.0 * math.sqrt(variance)
        assert P[at, at] <= variance * (1.0 + 1e-9)
    J = whole_error_rows(m, layout, "gyro", len(P))
    np.testing.assert_allclose(J @ P @ J.T, 1e-8 * np.eye(3), atol=1e-12)


def test_start_in_motion_knows_nothing_of_the_gyros() -> None:
    bank, layout = opened(sd_b_g=None, level_from_bias=False)
    P = bank.P[0]
    assert P[BG, BG] == sensor_model(imu_grade("industrial"), layout.names).gyro_bias.sigma ** 2
    for at, variance in layout.sensor_states.items():
        assert P[at, at] == variance


def test_levelling_is_off_by_all_that_the_accelerometers_are_off_by() -> None:
    """Tilt = error / g: of the bias, of the scale factor times the force along an axis, of misalignments times g."""
    bank, layout = opened()
    m, P = bank.state[0], bank.P[0]
    accel = whole_error_rows(m, layout, "accelerometer", len(P))
    C_ne = place().C_ne
    of_tilt = np.zeros((3, len(P)))
    of_tilt[:, PSI : PSI + 3] = C_ne
    east, north = (C_ne @ m.C_eb @ accel)[[1, 0]] / STANDARD_GRAVITY_MPS2

    # what is left of tilt once the accelerometers' errors are taken off is the floor
    left = of_tilt[:2] - np.vstack([east, -north])

    np.testing.assert_allclose(left @ P @ left.T, LEVEL_FLOOR_RAD**2 * np.eye(2), rtol=1e-3, atol=1e-9)
    # and a vehicle that stands still shows no force beyond it
    rows = np.zeros((3, len(P)))
    accel_error_covariance(m, numbers(layout), P, rows)
    g_e = -place().f_e
    unknown = unknown_force(m.C_eb, P, rows, g_e, float(g_e @ g_e), 1.0, np.zeros(len(P)))
    assert unknown == pytest.approx(2.0 * (LEVEL_FLOOR_RAD * STANDARD_GRAVITY_MPS2) ** 2, rel=0.02)


def test_doubted_errors_keep_their_values_and_lose_what_was_known(rng: np.random.Generator) -> None:
    layout = full_layout()
    bank, _ = drawn(layout, rng)
    m, P = bank.state[0], bank.P[0]
    m.r_e[:], m.C_eb[:] = place().r_e, np.eye(3)
    before = m.optional.copy()

    inflate_bias_covariance(m, P, sensor_model(imu_grade("industrial"), layout.names), layout)

    assert np.all(m.optional == before)
    for at, variance in layout.sensor_states.items():
        assert P[at, at] == variance and np.count_nonzero(P[at]) == 1
