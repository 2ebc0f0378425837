"""The motion that the IMU's time goes with: what the sensors have shown, not what the filter has got wrong."""

from __future__ import annotations

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.filter.headings.motion import FORCE_MEAN_TIME_S, velocity_changed
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState
from insgnss.filter.state import DR, DV, StateRecord
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.vectors import cross, place, plus, rotate
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(apart=True)
def follow_motion(m: StateRecord, P: Float64, par: Parameters) -> None:
    """Carry on the velocity that counts as motion: the filter's, once it has changed by more than its error.

    An error of the velocity would show the IMU's time as motion does: in half an hour at rest a filter would find in
    it that the time is exact. So with d = v - v_shown

        v_shown <- v_shown + share d,  share = 1 - k^2 tr P_v / |d|^2

    Of the change only what the sensors have measured since the last epoch has moved the antenna. The rest was a
    correction: v is better known, the antenna is where it was, so dr <- dr + share (v_corrected - v_shown) ds.
    """
    at = par.at_imu_time
    if at < 0:
        return
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

    The acceleration is that of the last moments, less its noise, while the velocity is not that of the last seconds: a
    vehicle at rest vibrates.
    """
    if par.at_imu_time < 0:
        return
    place(a.shown_v_e, 0, plus(m.v_shown, a.turning_e))
    place(a.shown_a_e, 0, (0.0, 0.0, 0.0))
    if par.motion_gate2 > 0.0 and not velocity_changed(m, P, par.motion_gate2):
        return
    normal_gravity_ecef(m.r_e, a.shown_a_e)
    coriolis = cross((0.0, 0.0, -2.0 * WGS84_OMEGA_RADPS), m.v_e)
    x, y, z = plus(plus(a.shown_a_e, m.f_smooth), coriolis)
    force2 = x * x + y * y + z * z
    noise = 1.5 * par.motion_gate2 * par.accel_density / FORCE_MEAN_TIME_S
    share = max(1.0 - noise / force2, 0.0) if force2 > 0.0 else 0.0
    turning = rotate(m.C_eb, cross(a.w_b, cross(a.w_b, a.l_b)))
    place(a.shown_a_e, 0, plus((share * x, share * y, share * z), turning))
