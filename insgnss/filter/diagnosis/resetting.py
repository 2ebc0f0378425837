"""Setting a hypothesis right: its position, velocity and clock by a fix, its biases and attitude by doubt."""

from __future__ import annotations

import math

import numpy as np

from insgnss.filter.layout import Layout
from insgnss.filter.rows.clock_offsets import place_clocks
from insgnss.filter.start.fix import Fix, sigma_beyond_m
from insgnss.filter.state import BA, BG, DR, DRIFT, DV, PSI, StateRecord
from insgnss.filter.states.gnss_time import forget_gnss_time, gnss_time_of
from insgnss.filter.states.imu_time import to_imu_time
from insgnss.filter.states.lever_arm import hang_from_antenna, lever_of
from insgnss.filter.states.range_biases import RANGE_BIASES
from insgnss.geodesy.rotations import EARTH_RATE_E
from insgnss.gnss.least_squares import CLOCKS
from insgnss.inertial.sensor_model import SensorModel
from insgnss.tables import Float64

_DOUBTED_ATTITUDE_RAD = math.radians(5.0)  # added to an attitude that inertial samples have led astray
_RESET_VELOCITY_FLOOR_MPS = 0.1
_RESET_VELOCITY_SIGMA_MPS = 10.0  # of a reset without range rates


def reinitialise_position(
    m: StateRecord,
    P: Float64,
    fix: Fix,
    lever_b: Float64,
    layout: Layout,
    w_ib_b: Float64,
    inter_system_sigma_m: float,
) -> None:
    """Set position, velocity and clock of a hypothesis to a fix and forget what they shared with the other states.

    Equation: r_e = r_a - C l, v_e = v_a - C (w x l) + w_ie x C l, w the gyros' rate less its bias; what the attitude's
    variance makes of the lever arm l is added to both; of an error dl of l that is a state, dr = dr_a - C dl.

    Parameters
    ----------
    w_ib_b : (3,) the gyros' rate at the fix [rad/s]
    inter_system_sigma_m : of a clock offset that the fix does not give
    """
    beyond2 = sigma_beyond_m(layout.at(RANGE_BIASES) >= 0) ** 2
    lever_b = lever_of(m, lever_b, layout)
    states = [*range(DR, DR + 3), *range(DV, DV + 3), DRIFT]
    P_v = P[DV : DV + 3, DV : DV + 3].copy()
    P[states, :] = 0.0
    P[:, states] = 0.0
    l_e, turning = m.C_eb @ lever_b, np.cross(w_ib_b - m.b_g, lever_b)
    attitude = float(np.trace(P[PSI : PSI + 3, PSI : PSI + 3]))
    m.r_e[:] = fix.r_a - l_e
    of_lever = attitude * float(lever_b @ lever_b)
    P[DR : DR + 3, DR : DR + 3] = fix.P[:3, :3] + (beyond2 + of_lever) * np.eye(3)
    variances = fix.P.diagonal()[CLOCKS:]
    variance = variances[np.argmax(np.isfinite(fix.clocks))] + beyond2
    place_clocks(m, P, fix.clocks, variance, variances + 2.0 * variance, inter_system_sigma_m)
    if fix.v_a is not None:
        m.v_e[:] = fix.v_a - m.C_eb @ turning + np.cross(EARTH_RATE_E, l_e)
        of_lever = attitude * float(turning @ turning)
        P[DV : DV + 3, DV : DV + 3] = fix.P_v[:3, :3] + (_RESET_VELOCITY_FLOOR_MPS**2 + of_lever) * np.eye(3)
        m.clock[1] = fix.drift
        P[DRIFT, DRIFT] = fix.drift_variance
    else:
        P[DV : DV + 3, DV : DV + 3] = P_v + _RESET_VELOCITY_SIGMA_MPS**2 * np.eye(3)
        P[DRIFT, DRIFT] = 10.0**2
    m.clone_ns = 0
    m.drift_moved[:] = 0.0
    hang_from_antenna(m, P, None if fix.v_a is None else w_ib_b - m.b_g, layout)
    to_imu_time(m, P, layout, with_velocity=fix.v_a is not None)
    forget_gnss_time(m, P, layout, gnss_time_of(m, layout))


def inflate_bias_covariance(m: StateRecord, P: Float64, sensor: SensorModel, layout: Layout) -> None:
    """Inflate the sensor errors of a hypothesis and its attitude: its estimates went astray.

    They keep their values: most of a sensor's error exists from the start.
    """
    errors = [*range(BA, BG + 3), *layout.sensor_states]
    P[errors, :] = 0.0
    P[:, errors] = 0.0
    u = m.r_e / np.linalg.norm(m.r_e)  # up, to a fifth of a degree
    accel = sensor.accel_bias_variances(m.C_eb.T @ u)
    for i in range(3):
        P[BA + i, BA + i] = accel[i]
        P[BG + i, BG + i] = sensor.gyro_bias.sigma**2
        P[PSI + i, PSI + i] += _DOUBTED_ATTITUDE_RAD**2
    for at, variance in layout.sensor_states.items():
        P[at, at] = variance
