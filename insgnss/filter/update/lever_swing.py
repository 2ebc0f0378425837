"""The antenna when the estimated attitude turns and the vehicle does not; compiled.

The measured point is the antenna at the end of the lever arm l, whose own error dl is in body axes:

    e = dr + psi x C l + C dl

Where C turns by D within the gyros' errors, or by a correction of the heading, the antenna has not moved: e stays, and
it is the IMU's error that changes:

    dr' = dr - psi x (D l) - D dl

Without this, an antenna at rest under a heading estimate that drifts would show that heading to the filter, and where
the lever arm is a state a lever arm of zero.
"""

from __future__ import annotations

from insgnss.constants import NS_PER_S
from insgnss.filter.headings.motion import LEVEL_GATE2
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lever_columns import place_lever
from insgnss.filter.rows.lines import AntennaState
from insgnss.filter.sensor_errors import gyro_error_variance
from insgnss.filter.state import DR, PSI, StateRecord
from insgnss.geodesy.vectors import Vector, cross, rotate
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(apart=True)
def swing_lever_arm(m: StateRecord, P: Float64, par: Parameters, a: AntennaState, t_ns: int) -> None:
    """Let the antenna stay where the attitude has turned within the gyros' errors since the last epoch.

    Equation: D = (1 - s) (C_eb - C), 1 - s = (k^2 q T + 2^2 B T^2) / theta^2 and at most 1, theta^2 = |C_eb - C|^2 / 2
    of the time T, q the density of the gyros' noise, B the variance of their biases
    """
    if par.motion_gate2 <= 0.0:
        return
    seconds = (t_ns - m.swung_ns) / NS_PER_S if m.swung_ns != 0 else 0.0
    noise = par.motion_gate2 * par.gyro_density * seconds
    noise += LEVEL_GATE2 * gyro_error_variance(m, par, P) * seconds**2
    turned2 = 0.0
    for i in range(3):
        for j in range(3):
            turned2 += 0.5 * (m.C_eb[i, j] - m.C_swung[i, j]) ** 2
    hidden = min(noise / turned2, 1.0) if turned2 > 0.0 else 0.0
    for i in range(3):
        for j in range(3):
            a.swing[i, j] = hidden * (m.C_eb[i, j] - m.C_swung[i, j])
            m.C_swung[i, j] = m.C_eb[i, j]
    m.swung_ns = t_ns
    if not hidden > 0.0:
        return
    place_lever(m, par, a)
    keep_antenna_of_attitude(P, rotate(a.swing, (a.l_b[0], a.l_b[1], a.l_b[2])))
    if par.at_lever_arm >= 0:
        keep_antenna(P, par.at_lever_arm, a.swing)


@kernel(inline=True)
def keep_antenna_of_attitude(P: Float64, d: Vector) -> None:
    """P <- T P T^T with dr' = dr - psi x d."""
    for j in range(P.shape[0]):
        x, y, z = cross((P[PSI, j], P[PSI + 1, j], P[PSI + 2, j]), d)
        P[DR, j] -= x
        P[DR + 1, j] -= y
        P[DR + 2, j] -= z
    for j in range(P.shape[0]):
        x, y, z = cross((P[j, PSI], P[j, PSI + 1], P[j, PSI + 2]), d)
        P[j, DR] -= x
        P[j, DR + 1] -= y
        P[j, DR + 2] -= z


@kernel(inline=True)
def keep_antenna(P: Float64, at: int, D: Float64) -> None:
    """P <- T P T^T with dr' = dr - D dl, dl the three states from ``at`` on."""
    n = P.shape[0]
    for j in range(n):
        for i in range(3):
            P[DR + i, j] -= D[i, 0] * P[at, j] + D[i, 1] * P[at + 1, j] + D[i, 2] * P[at + 2, j]
    for j in range(n):
        for i in range(3):
            P[j, DR + i] -= D[i, 0] * P[j, at] + D[i, 1] * P[j, at + 1] + D[i, 2] * P[j, at + 2]
