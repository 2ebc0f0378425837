"""The motion for the IMU's time offset: the sensors' measured motion, without the filter's corrections."""

from __future__ import annotations

import math

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.filter.headings.motion import FORCE_MEAN_TIME_S, velocity_changed
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState
from insgnss.filter.state import DR, DV, OFFSETS, StateRecord
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.vectors import Vector, cross, dot, place, plus, rotate, times
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(apart=True)
def follow_motion(m: StateRecord, P: Float64, par: Parameters) -> None:
    """Carry on the velocity that counts as motion: the filter's, once it has changed by more than its error.

    An error of the velocity would show the IMU's time as motion does: in half an hour at rest a filter would find in
    it that the time is exact. So with d = v - v_shown

        v_shown <- v_shown + share d,  share = 1 - k^2 tr P_v / |d|^2

    Only the measured part of the change since the last epoch has moved the antenna. The rest was a
    correction: v is better known, the antenna is where it was, so dr <- dr + share (v_corrected - v_shown) ds.
    """
    at = par.at_imu_time
    if at < 0:
        return
    m.near_s = max(abs(m.optional[at - OFFSETS]), 2.0 * math.sqrt(max(P[at, at], 0.0)))
    x, y, z = m.v_e[0] - m.v_shown[0], m.v_e[1] - m.v_shown[1], m.v_e[2] - m.v_shown[2]
    change2 = x * x + y * y + z * z
    doubt = par.motion_gate2 * (P[DV, DV] + P[DV + 1, DV + 1] + P[DV + 2, DV + 2])
    share = max(1.0 - doubt / change2, 0.0) if change2 > 0.0 else 0.0
    if share == 0.0:
        return
    for i in range(3):
        corrected = share * (m.v_corrected[i] - m.v_shown[i])
        for j in range(P.shape[0]):
            P[DR + i, j] += corrected * P[at, j]
        for j in range(P.shape[0]):
            P[j, DR + i] += corrected * P[j, at]
        m.v_shown[i] += share * (m.v_e[i] - m.v_shown[i])


@kernel(apart=True)
def place_motion(m: StateRecord, P: Float64, par: Parameters, a: AntennaState) -> None:
    """Write the antenna's velocity and acceleration, ECEF, that count as motion.

    At constant speed v an error ds of the IMU's time moves the antenna along the track as an error of the lever arm
    does, C dl = v ds, in turns as well: both turn with the body. So the turn of the velocity, (C w - w_ie) x v, counts
    by the rate w that the lever arm's column has (``place_turning``); otherwise the entry of a turn would separate the
    two. Only the rest of the acceleration separates them. It counts less its noise, and only while the velocity
    is not that of the last seconds: a vehicle at rest vibrates. Both are means of the last moments: vibration of 0.5
    m/s^2 in a sample would show the time as motion does, and the time would be known too well and too small.
    """
    if par.at_imu_time < 0:
        return
    place(a.shown_v_e, 0, plus(m.v_shown, a.turning_e))
    gravity, earth_rate = a.shown_a_e, (0.0, 0.0, WGS84_OMEGA_RADPS)
    normal_gravity_ecef(m.r_e, gravity)
    turn = cross(plus(rotate(m.C_eb, m.w_near), times(earth_rate, -1.0)), m.v_e)
    whole = plus(plus(gravity, times(cross(earth_rate, m.v_e), -2.0)), m.f_near)
    rest = plus(whole, times(turn, -1.0))
    along, turned = 1.0, 1.0
    if par.motion_gate2 > 0.0:
        along = _shown_share(m, P, par, rest)
        rate2 = dot(m.w_last, m.w_last)
        turned = dot(a.w_b, m.w_last) / rate2 if rate2 > 0.0 else 0.0
    centripetal = rotate(m.C_eb, cross(a.w_b, cross(a.w_b, a.l_b)))
    for i in range(3):
        a.shown_a_e[i] = along * rest[i] + turned * turn[i] + centripetal[i]


@kernel(inline=True)
def _shown_share(m: StateRecord, P: Float64, par: Parameters, rest: Vector) -> float:
    """Return the share of an acceleration beside that of turns which counts as motion.

    Its noise is that of the accelerometers and of the gyros' turn of the velocity.
    """
    rest2 = dot(rest, rest)
    if rest2 == 0.0 or not velocity_changed(m, P, par.motion_gate2):
        return 0.0
    density = par.accel_density + par.gyro_density * dot(m.v_e, m.v_e)
    return max(1.0 - 1.5 * par.motion_gate2 * density / (FORCE_MEAN_TIME_S * rest2), 0.0)
