"""Setting a hypothesis right: its position, velocity and clock by a fix, its biases and attitude by doubt."""

from __future__ import annotations

import math

import numpy as np

from insgnss.fusion.fix import Fix
from insgnss.fusion.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI
from insgnss.inertial.sensor_model import SensorModel
from insgnss.tables import Float64

_RESET_BIAS_SIGMA_M = 2.0  # what a fix leaves beyond its own covariance
_DOUBTED_ATTITUDE_RAD = math.radians(5.0)  # added to an attitude that inertial samples have led astray
_RESET_VELOCITY_SIGMA_MPS = 10.0  # of a reset without range rates


def reset_kinematics(m: np.record, P: Float64, fix: Fix, lever_b: Float64, n_offsets: int) -> None:
    """Set position, velocity and clock of a hypothesis to a fix and forget what they shared with the other states."""
    states = [*range(DR, DR + 3), *range(DV, DV + 3), CLOCK, DRIFT, *range(OFFSETS, OFFSETS + n_offsets)]
    kept = P[DV : DV + 3, DV : DV + 3].copy()
    P[states, :] = 0.0
    P[:, states] = 0.0
    reference = int(np.flatnonzero(np.isfinite(fix.clocks))[0])
    m.r_e[:] = fix.r_a - m.C_eb @ lever_b
    P[DR : DR + 3, DR : DR + 3] = fix.P[:3, :3] + _RESET_BIAS_SIGMA_M**2 * np.eye(3)
    m.clock[0] = fix.clocks[reference]
    P[CLOCK, CLOCK] = fix.P[3 + reference, 3 + reference] + _RESET_BIAS_SIGMA_M**2
    if fix.v_a is not None:
        m.v_e[:] = fix.v_a
        P[DV : DV + 3, DV : DV + 3] = fix.P_v[:3, :3] + 0.1**2 * np.eye(3)
        m.clock[1] = fix.drift
        P[DRIFT, DRIFT] = fix.P_v[3, 3]
    else:
        P[DV : DV + 3, DV : DV + 3] = kept + _RESET_VELOCITY_SIGMA_MPS**2 * np.eye(3)
        P[DRIFT, DRIFT] = 10.0**2
    m.clone_ns = 0
    for i in range(OFFSETS, OFFSETS + n_offsets):
        group = i - OFFSETS + 1
        known = math.isfinite(fix.clocks[group]) and reference == 0
        m.optional[i - OFFSETS] = fix.clocks[group] - fix.clocks[0] if known else 0.0
        P[i, i] = fix.P[3 + group, 3 + group] + 2.0 * P[CLOCK, CLOCK] if known else 3000.0**2


def doubt_sensors(m: np.record, P: Float64, sensor: SensorModel) -> None:
    """Forget the biases of a hypothesis and widen its attitude: it went astray though it refused little."""
    biases = slice(BA, BG + 3)
    P[biases, :] = 0.0
    P[:, biases] = 0.0
    m.b_a[:] = 0.0
    m.b_g[:] = 0.0
    u = m.r_e / np.linalg.norm(m.r_e)  # up, to a fifth of a degree
    accel = sensor.accel_bias_variances(m.C_eb.T @ u)
    for i in range(3):
        P[BA + i, BA + i] = accel[i]
        P[BG + i, BG + i] = sensor.gyro_bias.sigma**2
        P[PSI + i, PSI + i] += _DOUBTED_ATTITUDE_RAD**2
