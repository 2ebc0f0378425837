"""The angle between the nose and the velocity, and how fast a vehicle changes it: it gives a heading after a gap.

The vehicle itself shows whether its course gives its heading: a car keeps the angle within a degree, an aircraft for
as long as the wind lasts, a drone or a man with a telephone does not.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.state import DV, PSI, HeadRecord, StateRecord
from insgnss.geodesy.local_level import up_direction
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

LEAST_SPEED_MPS: Final = 3.0
MOST_SIGMA_RAD: Final = math.radians(5.0)  # of heading and course, for the angle to be known
# of the nose against the horizon, for the course to give the heading
STEEPEST: Final = math.sin(math.radians(45.0))
LEAST_UPRIGHT: Final = math.cos(math.radians(75.0))
LONGEST_PAUSE_S: Final = 10.0  # between two epochs whose change counts
MEMORY_S: Final = 120.0


@kernel(apart=True)
def sideslip(m: StateRecord, P: Float64) -> tuple[float, float]:
    """Return the angle from the horizontal velocity to the nose, clockwise from above, and its variance [rad, rad^2].

    The variance is infinite where the vehicle is slow, steep or its heading not known.
    """
    vertical = up_direction(m.r_e)
    ux, uy, uz = vertical
    up = m.v_e[0] * ux + m.v_e[1] * uy + m.v_e[2] * uz
    vx, vy, vz = m.v_e[0] - up * ux, m.v_e[1] - up * uy, m.v_e[2] - up * uz
    nx, ny, nz = m.C_eb[0, 0], m.C_eb[1, 0], m.C_eb[2, 0]
    along = vx * nx + vy * ny + vz * nz
    across = ux * (vy * nz - vz * ny) + uy * (vz * nx - vx * nz) + uz * (vx * ny - vy * nx)
    speed2 = vx * vx + vy * vy + vz * vz
    variance = 0.0
    for i in range(3):
        variance += P[DV + i, DV + i] / 3.0
    if speed2 < LEAST_SPEED_MPS**2 or variance > MOST_SIGMA_RAD**2 * speed2:
        return 0.0, math.inf
    belly = m.C_eb[0, 2] * ux + m.C_eb[1, 2] * uy + m.C_eb[2, 2] * uz
    if abs(nx * ux + ny * uy + nz * uz) > STEEPEST or belly > -LEAST_UPRIGHT:
        return 0.0, math.inf  # in a loop or a roll
    variance /= speed2
    for i in range(3):
        for j in range(3):
            variance += vertical[i] * P[PSI + i, PSI + j] * vertical[j]
    if not 0.0 < variance < 2.0 * MOST_SIGMA_RAD**2:
        return 0.0, math.inf
    return -math.atan2(across, along), variance


@kernel(apart=True)
def note_sideslip(head: HeadRecord, m: StateRecord, P: Float64, t_ns: int) -> None:
    """Keep the angle of an epoch, and let the density of its changes follow [rad^2/s]."""
    angle, variance = sideslip(m, P)
    if variance == math.inf:
        return
    dt = (t_ns - head.slip_ns) * 1e-9
    if head.slip_ns != 0 and 0.0 < dt <= LONGEST_PAUSE_S:
        change = math.atan2(math.sin(angle - head.slip), math.cos(angle - head.slip))
        head.slip_s = min(head.slip_s + dt, MEMORY_S)
        head.slip_walk += dt / head.slip_s * (change * change / dt - head.slip_walk)
    head.slip, head.slip_variance, head.slip_ns = angle, variance, t_ns
