"""The paper's scenario: D = h P h^T of five satellites that an outage hides for 20 s, against independent numbers.

A. I. Sokolov and Yu. S. Yurchenko, 2015: eleven satellites, a user at rest, five of them off from 80 to 100 s. Of the
inertial sensor and the clock the paper says nothing; the numbers held against here were computed apart from this
package with the exact discretization over each second, for stated grades. This package adds Coriolis and the gravity
gradient (0.1 % of D) and carries the covariance in short steps.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from insgnss.constants import C_MPS, STANDARD_GRAVITY_MPS2
from insgnss.fusion.lines import ANTENNA_DTYPE, RANGE_COLUMNS, RATE_COLUMNS
from insgnss.fusion.measurements import range_row, rate_row
from insgnss.fusion.prediction import new_scratch, predict_covariance
from insgnss.fusion.scalar_update import predicted_variance, scalar_update
from insgnss.fusion.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI
from insgnss.tables import Float64
from tests.fusion.scene import new_filter, parameters, place

SCENARIO_S = 1200.0
# satellite: azimuth and elevation at the start and at the end [deg]; linear in between
SKY_DEG = {
    1: (76, 68, 23, 26), 2: (320, 314, 20, 26), 4: (282, 270, 42, 41), 10: (294, 294, 19, 28), 13: (240, 244, 50, 59),
    16: (106, 100, 13, 20), 20: (144, 144, 50, 41), 23: (172, 116, 82, 79), 30: (88, 80, 22, 26), 31: (46, 44, 24, 17),
    32: (126, 128, 27, 19),
}  # fmt: skip
HIDDEN = (1, 16, 30, 31, 32)
OFF_FROM_S, OFF_UNTIL_S = 80, 100
RANGE_VARIANCE_M2, RATE_VARIANCE_M2PS2 = 4.0, 0.25
STEP_S = 0.05
TIMES_S = (79, 100, 101, 110)

DEG_PER_H = np.radians(1.0) / 3600.0


class Grade(NamedTuple):
    """One grade: deg/h, deg/sqrt h, m/s^2, m/s/sqrt h, s."""

    gyro_bias: float
    arw: float
    accel_bias: float
    vrw: float
    time_s: float


G = STANDARD_GRAVITY_MPS2
NAVIGATION = Grade(0.01, 0.003, 50e-6 * G, 0.003, 3600.0)
TACTICAL = Grade(1.0, 0.1, 1e-3 * G, 0.06, 1000.0)
TACTICAL_LOW = Grade(10.0, 0.3, 3e-3 * G, 0.12, 600.0)
EIGHTY_DEG_PER_H = Grade(80.0, 0.3, 0.06, 0.12, 600.0)
CONSUMER = Grade(300.0, 1.0, 20e-3 * G, 0.6, 300.0)
TCXO, OCXO = (2e-19, 2e-20), (8e-22, 4e-25)  # h0 [s], h-2 [1/s]

# D [m^2] of satellites 1, 16, 30, 31, 32 just before the update at 79, 100, 101 and 110 s
EXPECTED_M2 = {
    "navigation, TCXO": (NAVIGATION, TCXO, """
        0.220 0.248 0.201 0.306 0.248  0.790 0.819 0.737 0.930 0.637
        0.470 0.512 0.430 0.607 0.433  0.223 0.261 0.203 0.314 0.258"""),
    "tactical, TCXO": (TACTICAL, TCXO, """
        0.250 0.320 0.227 0.361 0.295  1.721 2.028 1.673 1.813 1.357
        0.672 0.845 0.625 0.860 0.652  0.258 0.327 0.233 0.378 0.308"""),
    "tactical low, TCXO": (TACTICAL_LOW, TCXO, """
        0.290 0.379 0.257 0.449 0.350  2.837 3.384 2.765 2.935 2.140
        0.787 1.031 0.721 1.068 0.797  0.296 0.386 0.260 0.457 0.360"""),
    "80 deg/h, TCXO": (EIGHTY_DEG_PER_H, TCXO, """
        0.317 0.420 0.275 0.510 0.388  3.610 4.266 3.502 3.756 2.643
        0.833 1.111 0.754 1.180 0.870  0.321 0.424 0.278 0.518 0.397"""),
    "consumer, TCXO": (CONSUMER, TCXO, """
        0.349 0.485 0.297 0.591 0.437  4.515 5.453 4.379 4.731 3.326
        0.861 1.208 0.770 1.277 0.951  0.351 0.484 0.298 0.591 0.444"""),
    "navigation, OCXO": (NAVIGATION, OCXO, """
        0.110 0.126 0.089 0.199 0.125  0.386 0.338 0.321 0.565 0.266
        0.299 0.278 0.248 0.455 0.233  0.121 0.136 0.098 0.212 0.135"""),
    "tactical, OCXO": (TACTICAL, OCXO, """
        0.159 0.164 0.132 0.264 0.168  1.004 0.694 0.840 1.303 0.472
        0.551 0.430 0.459 0.773 0.345  0.174 0.171 0.144 0.288 0.178"""),
}  # fmt: skip


def study_parameters(grade: Grade, clock: tuple[float, float]) -> npt.NDArray[Any]:
    """Return the filter's numbers: Gauss-Markov biases with q = 2 sigma^2 / tau, clock densities from h0 and h-2."""
    sigma_g, sigma_a = grade.gyro_bias * DEG_PER_H, grade.accel_bias
    return parameters(
        gyro_density=(np.radians(grade.arw) / 60.0) ** 2,
        accel_density=(grade.vrw / 60.0) ** 2,
        gyro_bias_density=2.0 * sigma_g**2 / grade.time_s,
        accel_bias_density=2.0 * sigma_a**2 / grade.time_s,
        gyro_bias_time=grade.time_s,
        accel_bias_time=grade.time_s,
        clock_bias_density=C_MPS**2 * clock[0] / 2.0,
        clock_drift_density=C_MPS**2 * 2.0 * np.pi**2 * clock[1],
    )


def line_of_sight(C_ne: Float64, sv: int, t_s: float) -> Float64:
    """Return the unit vector to a satellite, in ECEF."""
    share = t_s / SCENARIO_S
    az0, az1, el0, el1 = np.radians(SKY_DEG[sv])
    az, el = az0 + share * (az1 - az0), el0 + share * (el1 - el0)
    return C_ne.T @ np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)])


def rows_towards(m: np.record, par: np.record, u_e: Float64) -> tuple[Float64, Float64]:
    """Return the filter's rows of H of a pseudorange and a range rate towards ``u_e``, without lever arm."""
    antenna = np.zeros(1, ANTENNA_DTYPE)
    antenna["u"][0] = u_e
    h_range, h_rate = np.zeros(len(RATE_COLUMNS)), np.zeros(len(RATE_COLUMNS))
    range_row(antenna[0], h_range)
    rate_row(m, par, antenna[0], h_rate)
    return h_range[: len(RANGE_COLUMNS)].copy(), h_rate


def hidden_variances(grade: Grade, clock: tuple[float, float]) -> dict[int, list[float]]:
    """Return D of the five satellites at ``TIMES_S``."""
    at, par = place(59.97, 30.32, 1000.0), study_parameters(grade, clock)[0]
    bank = new_filter(at)
    m, P, scratch = bank.state[0], bank.P[0], new_scratch(OFFSETS)
    P[:] = initial_covariance(at.C_ne, grade)
    f_e, v = at.C_ne.T @ [0.0, 0.0, -STANDARD_GRAVITY_MPS2], np.zeros((3, OFFSETS))
    found = {}
    for t in range(1, TIMES_S[-1] + 1):
        for _ in range(round(1.0 / STEP_S)):
            m.sum_dt, m.sum_dv, m.sum_C = STEP_S, f_e * STEP_S, m.C_eb * STEP_S
            m.sum_gyro_q, m.sum_accel_q = par.gyro_density * STEP_S, par.accel_density * STEP_S
            predict_covariance(m, P, par, scratch)
        rows = {sv: rows_towards(m, par, line_of_sight(at.C_ne, sv, t)) for sv in SKY_DEG}
        if t in TIMES_S:
            found[t] = [predicted_variance(P, rows[sv][0], RANGE_COLUMNS) for sv in HIDDEN]
        off = HIDDEN if OFF_FROM_S <= t < OFF_UNTIL_S else ()
        for kind, columns, variance in (
            (0, RANGE_COLUMNS, RANGE_VARIANCE_M2),
            (1, RATE_COLUMNS, RATE_VARIANCE_M2PS2),
        ):
            for sv in SKY_DEG:
                if sv not in off:
                    scalar_update(P, rows[sv][kind], columns, 0.0, variance, v)
    return found


def initial_covariance(C_ne: Float64, grade: Grade) -> Float64:
    """Return P0: 30 m, 1 m/s, roll and pitch 1 deg, heading 3 deg, biases of the grade, clock 30 km and 100 m/s."""
    P = np.zeros((OFFSETS, OFFSETS))
    tilt = C_ne.T @ np.diag(np.radians([1.0, 1.0, 3.0]) ** 2) @ C_ne
    blocks = ((DR, 30.0), (DV, 1.0), (BA, grade.accel_bias), (BG, grade.gyro_bias * DEG_PER_H))
    for first, sigma in blocks:
        P[first : first + 3, first : first + 3] = sigma**2 * np.eye(3)
    P[PSI : PSI + 3, PSI : PSI + 3] = 0.5 * (tilt + tilt.T)
    P[CLOCK, CLOCK], P[DRIFT, DRIFT] = 30e3**2, 100.0**2
    return P


@pytest.mark.parametrize("name", list(EXPECTED_M2))
def test_variance_of_the_hidden_ranges_is_that_of_the_independent_study(name: str) -> None:
    grade, clock, numbers = EXPECTED_M2[name]
    expected = np.array(numbers.split(), dtype=np.float64).reshape(len(TIMES_S), len(HIDDEN))

    found = np.array(list(hidden_variances(grade, clock).values()))

    # three printed digits are up to 0.6 % of the smallest; reached 0.2 to 0.5 %, with a navigation grade 1.9 %
    np.testing.assert_allclose(found, expected, rtol=0.02)
