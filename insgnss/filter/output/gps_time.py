"""A state at GPS time, where the IMU's tags are off by a time that is estimated; otherwise the state as it is.

The state goes back by s, as the mean of as long moves it: the rate as it changes, all of that counting as error,
    w' = (w - its mean of the last moments) / their length,    C <- C exp(-[(w - w' s / 2) s x]),    d = C w' s^2 / 2
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from insgnss.filter.headings.motion import angular_acceleration
from insgnss.filter.parameters import Parameters
from insgnss.filter.state import DR, DV, OFFSETS, PSI, StateArray, StateRecord
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.vectors import place, plus, rotate, rotate_back, times
from insgnss.inertial.mechanization import mechanize
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(inline=True)
def place_at_gps_time(
    m: StateRecord, par: Parameters, r_e: Float64, v_e: Float64, q: Float64, C: Float64
) -> None:
    """Write position, velocity and attitude (3,), (3,), (4,), (3, 3)."""
    for i in range(3):
        r_e[i], v_e[i] = m.r_e[i], m.v_e[i]
        for j in range(3):
            C[i, j] = m.C_eb[i, j]
    if par.at_imu_time < 0:
        return
    for i in range(4):
        q[i] = m.q_eb[i]
    back, w, scratch = m.optional[par.at_imu_time - OFFSETS], np.empty(3), np.empty(3)
    f = np.empty(3)
    place(w, 0, plus(m.w_near, times(angular_acceleration(m), -0.5 * back)))
    place(f, 0, rotate_back(C, m.f_near))
    mechanize(q, C, r_e, v_e, w, f, -back, scratch)


@kernel(inline=True)
def covariance_at_gps_time(m: StateRecord, par: Parameters, P: Float64) -> None:
    """P <- T P T^T with dr' = dr - v ds, dv' = dv - a ds, psi' = psi - C w ds, a = C f + g; and d d^T in psi."""
    at = par.at_imu_time
    if at < 0:
        return
    gravity = np.empty(3)
    normal_gravity_ecef(m.r_e, gravity)
    a, w = plus(m.f_near, gravity), rotate(m.C_eb, m.w_near)
    for j in range(P.shape[0]):
        for i in range(3):
            P[DR + i, j] -= m.v_e[i] * P[at, j]
            P[DV + i, j] -= a[i] * P[at, j]
            P[PSI + i, j] -= w[i] * P[at, j]
    for j in range(P.shape[0]):
        for i in range(3):
            P[j, DR + i] -= m.v_e[i] * P[j, at]
            P[j, DV + i] -= a[i] * P[j, at]
            P[j, PSI + i] -= w[i] * P[j, at]
    d = rotate(m.C_eb, times(angular_acceleration(m), 0.5 * m.optional[at - OFFSETS] ** 2))
    for i in range(3):
        for j in range(3):
            P[PSI + i, PSI + j] += d[i] * d[j]


@kernel
def covariances_at_gps_time(states: StateArray, parameters: npt.NDArray[Any], P: Float64) -> None:
    """Carry covariances (m, q, q), each with its state of ``states`` (m,), to GPS time."""
    par = parameters[0]
    for k in range(P.shape[0]):
        covariance_at_gps_time(states[k], par, P[k])
