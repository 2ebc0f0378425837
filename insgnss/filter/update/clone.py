"""The clone of an epoch: antenna position and clock, which the next carrier differences count from, compiled."""

from __future__ import annotations

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState
from insgnss.filter.state import CLOCK, CLONE_CLOCK, DR, N_CLONE, PSI, StateRecord
from insgnss.gnss.range_model import EpochAtmosphere
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(apart=True)
def clone_epoch(
    m: StateRecord, P: Float64, par: Parameters, a: AntennaState, air: EpochAtmosphere, t_ns: int
) -> None:
    """Make the epoch just processed the one that the next carrier differences count from.

    Equation: d r_a = d r_e + psi x l_e + C dl - v ds + v ds', so the clone is J dx with J = [I, -[l_e x], C, -v, v] in
    (position, attitude, errors of the lever arm, of the IMU's time and of that of GNSS, where they are states) and 1 in
    the clock; P_cx = J P, P_cc = J P J^T.

    Parameters
    ----------
    m : the state after the update, with its antenna in ``a``
    air : of the epoch; its zenith delays are kept
    t_ns : the epoch's time tag
    """
    n, c = P.shape[0], par.at_clone
    m.clone_ns = t_ns
    m.clock_clone = m.clock[0]
    m.previous_zenith_delays[0], m.previous_zenith_delays[1] = air.dry, air.wet
    l_e = a.l_e
    for i in range(3):
        m.r_clone[i] = a.r_a[i]
    for j in range(n - N_CLONE):
        for i in range(3):
            # (psi x l)_i = psi_p l_q - psi_q l_p with i, p, q cyclic
            p, q = (i + 1) % 3, (i + 2) % 3
            P[j, c + i] = P[DR + i, j] + P[PSI + p, j] * l_e[q] - P[PSI + q, j] * l_e[p]
            if par.at_lever_arm >= 0:
                P[j, c + i] += _of_lever(m, P[par.at_lever_arm : par.at_lever_arm + 3, j], i)
            if par.at_imu_time >= 0:
                P[j, c + i] -= a.shown_v_e[i] * P[par.at_imu_time, j]
            if par.at_gnss_time >= 0:
                P[j, c + i] += a.v_a[i] * P[par.at_gnss_time, j]
            P[c + i, j] = P[j, c + i]
        P[j, c + CLONE_CLOCK] = P[CLOCK, j]
        P[c + CLONE_CLOCK, j] = P[CLOCK, j]
    for i in range(N_CLONE):
        for k in range(3):
            p, q = (k + 1) % 3, (k + 2) % 3
            P[c + i, c + k] = P[c + i, DR + k] + P[c + i, PSI + p] * l_e[q] - P[c + i, PSI + q] * l_e[p]
            if par.at_lever_arm >= 0:
                P[c + i, c + k] += _of_lever(m, P[c + i, par.at_lever_arm : par.at_lever_arm + 3], k)
            if par.at_imu_time >= 0:
                P[c + i, c + k] -= a.shown_v_e[k] * P[c + i, par.at_imu_time]
            if par.at_gnss_time >= 0:
                P[c + i, c + k] += a.v_a[k] * P[c + i, par.at_gnss_time]
        P[c + i, c + CLONE_CLOCK] = P[c + i, CLOCK]
    for i in range(N_CLONE):
        for k in range(i):
            P[c + i, c + k] = P[c + k, c + i]


@kernel(inline=True)
def _of_lever(m: StateRecord, by: Float64, axis: int) -> float:
    """Return a component of C times a covariance with the lever arm's error (3,)."""
    C = m.C_eb
    return float(C[axis, 0] * by[0] + C[axis, 1] * by[1] + C[axis, 2] * by[2])
