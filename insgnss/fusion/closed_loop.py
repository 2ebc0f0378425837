"""Feeding an epoch's correction back: the state's own reset, and that of the axes its covariance stands in, compiled.

The errors of attitude and biases belong to the body. With a new heading their axes turn, and what the gyros have shown
(bias plus Earth rate) stays as well known as it was.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.apart import apart
from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.fusion.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, StateRecord
from insgnss.geodesy.local_level import up_direction
from insgnss.geodesy.rotations import quaternion_to_matrix, turn_left
from insgnss.jit import inlined
from insgnss.tables import Float64

_NO_TURN: Final = 1e-12  # [rad]


@inlined
def close_loop(m: StateRecord, correction: Float64, n: int) -> None:
    """Feed the correction (truth minus estimate) back into the state; the error state is zero again.

    ``n`` leaves the clone out: its correction goes with it, the epoch just processed takes its place.

    Equation: C_eb <- exp([y u x]) exp([t x]) C_eb, u the vertical, y = u . delta psi, t = delta psi - y u: the tilt
    belongs to the attitude as it was, so it is corrected before the heading. With a new heading the Earth's rate has
    new components in body axes. The covariance moves the gyro bias against it to first order; the rest of
    b_g + C_eb^T w_ie = const, what the gyros have shown, follows here.
    """
    C, w = m.C_eb, WGS84_OMEGA_RADPS
    x, y, z = correction[PSI], correction[PSI + 1], correction[PSI + 2]
    for i in range(3):  # C^T (w_ie + w_ie x delta psi)
        m.b_g[i] += w * (C[2, i] + C[1, i] * x - C[0, i] * y)
    for i in range(3):
        m.r_e[i] += correction[DR + i]
        m.v_e[i] += correction[DV + i]
        m.b_a[i] += correction[BA + i]
        m.b_g[i] += correction[BG + i]
    m.clock[0] += correction[CLOCK]
    m.clock[1] += correction[DRIFT]
    for i in range(OFFSETS, n):
        m.optional[i - OFFSETS] += correction[i]
    a, b, c = up_direction(m.r_e)
    turn = a * x + b * y + c * z
    turn_left(m.q_eb, x - turn * a, y - turn * b, z - turn * c)
    turn_left(m.q_eb, turn * a, turn * b, turn * c)
    quaternion_to_matrix(m.q_eb, m.C_eb)
    for i in range(3):
        m.b_g[i] -= w * C[2, i]


@apart
def turn_attitude_errors(m: StateRecord, P: Float64, correction: Float64) -> None:
    """Turn the attitude's part of the covariance about the vertical with the correction of the heading.

    What tilts the attitude belongs to the body, the accelerometers' bias above all: with a new heading the axes of that
    tilt turn as well. Left where they were, the tilt and the bias would part, and roll and pitch seem better known.
    The same holds for the gyro bias' part that hides the Earth's rate.

    Equation: P_psi. <- R P_psi., R = exp([u (u . delta psi) x]), u the vertical;
              P_bg. <- P_bg. + C_eb^T ((w_ie - R^T w_ie) x P_psi.), with C_eb and P_psi before the correction
    Neglects: the turn of the tilt's own axes by half its correction, second order in it.
    """
    n = P.shape[0]
    axis = up_direction(m.r_e)
    angle = axis[0] * correction[PSI] + axis[1] * correction[PSI + 1] + axis[2] * correction[PSI + 2]
    if not abs(angle) >= _NO_TURN:  # nor one that is no number
        return
    sine, rest = math.sin(angle), 1.0 - math.cos(angle)
    keep_apparent_bias(m, P, turned(axis, -sine, rest, 0.0, 0.0, WGS84_OMEGA_RADPS))
    for j in range(n):
        x, y, z = turned(axis, sine, rest, P[PSI, j], P[PSI + 1, j], P[PSI + 2, j])
        P[PSI, j], P[PSI + 1, j], P[PSI + 2, j] = x, y, z
        if j < PSI or j >= PSI + 3:
            P[j, PSI], P[j, PSI + 1], P[j, PSI + 2] = x, y, z
    for i in range(PSI, PSI + 3):
        x, y, z = turned(axis, sine, rest, P[i, PSI], P[i, PSI + 1], P[i, PSI + 2])
        P[i, PSI], P[i, PSI + 1], P[i, PSI + 2] = x, y, z
    for i in range(PSI, PSI + 3):
        for j in range(PSI, i):
            P[j, i] = P[i, j]


@inlined
def keep_apparent_bias(m: StateRecord, P: Float64, rate: tuple[float, float, float]) -> None:
    """Move the gyro bias' part of the covariance so that bias plus Earth rate, what the gyros show, is as well known.

    ``rate`` is the Earth's rate turned back by the correction of the heading, R^T w_ie [rad/s].
    """
    n, C = P.shape[0], m.C_eb
    x, y, z = -rate[0], -rate[1], WGS84_OMEGA_RADPS - rate[2]
    for j in range(n):
        p, q, r = P[PSI, j], P[PSI + 1, j], P[PSI + 2, j]
        a, b, c = y * r - z * q, z * p - x * r, x * q - y * p
        for i in range(3):
            P[BG + i, j] += C[0, i] * a + C[1, i] * b + C[2, i] * c
    for j in range(n):  # and the columns, of the matrix whose rows are moved
        p, q, r = P[j, PSI], P[j, PSI + 1], P[j, PSI + 2]
        a, b, c = y * r - z * q, z * p - x * r, x * q - y * p
        for i in range(3):
            P[j, BG + i] += C[0, i] * a + C[1, i] * b + C[2, i] * c
    for i in range(BG, BG + 3):
        for j in range(BG, i):
            P[i, j] = P[j, i]


@inlined
def turned(
    axis: tuple[float, float, float], sine: float, rest: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return (x, y, z) = v turned about the unit vector ``axis`` a.

    Equation: v + sin a x v + rest a x (a x v), rest = 1 - cos  [Rodrigues]
    """
    a, b, c = axis
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    return (
        x + sine * u + rest * (b * w - c * v),
        y + sine * v + rest * (c * u - a * w),
        z + sine * w + rest * (a * v - b * u),
    )
