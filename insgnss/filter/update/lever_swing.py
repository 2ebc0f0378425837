"""An uncertain lever arm when the estimated attitude turns and the vehicle does not; compiled.

The lever arm's error dl is in body axes, the measured point is the antenna: dr + C dl. Where C_eb turns by the gyros'
noise or by a correction of the heading, the antenna has not moved, so it is the IMU's error that changes:

    dr' = dr - D dl,    D the change of C_eb that no rotation has shown

Without this, an antenna at rest under a heading estimate that drifts would make the filter find a lever arm of zero.
"""

from __future__ import annotations

from insgnss.constants import NS_PER_S
from insgnss.filter.headings.motion import LEVEL_GATE2
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState
from insgnss.filter.sensor_errors import gyro_error_variance
from insgnss.filter.state import DR, StateRecord
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel(apart=True)
def swing_lever_arm(m: StateRecord, P: Float64, par: Parameters, a: AntennaState, t_ns: int) -> None:
    """Let the antenna stay where the attitude has turned within the gyros' errors since the last epoch.

    Equation: D = (1 - s) (C_eb - C), s = 1 - (k^2 q T + 2^2 B T^2) / theta^2, theta^2 = |C_eb - C|^2 / 2, as in
              ``motion.place_turning``
    """
    if par.at_lever_arm < 0:
        return
    seconds = (t_ns - m.swung_ns) / NS_PER_S if m.swung_ns != 0 else 0.0
    noise = par.motion_gate2 * par.gyro_density * seconds
    if par.motion_gate2 > 0.0:
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
    if hidden > 0.0:
        keep_antenna(P, par.at_lever_arm, a.swing)


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
