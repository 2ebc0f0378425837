"""Feeding an epoch's correction back: the state's own reset, and that of the axes of its covariance, compiled.

The errors of attitude and biases belong to the body. With a new heading their axes turn, and the gyros' information
(bias plus Earth rate) stays as well known as it was.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.constants import STANDARD_GRAVITY_MPS2, WGS84_OMEGA_RADPS
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState
from insgnss.filter.sensor_errors import add_further_errors
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, StateRecord
from insgnss.filter.update.lever_swing import keep_antenna
from insgnss.geodesy.local_level import up_direction
from insgnss.geodesy.rotations import quaternion_to_matrix, turn_left
from insgnss.geodesy.vectors import Vector, cross, dot, rotate, rotate_back
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

# Smaller turns add up to 1e-3 rad in an hour, which moves the end of a lever arm by 0.1 mm per sigma of the heading
_NO_TURN: Final = 1e-5  # [rad]


@kernel(apart=True)
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
    # C^T (w_ie + w_ie x delta psi): what the rates would be to first order
    p = w * (C[2, 0] + C[1, 0] * x - C[0, 0] * y)
    q = w * (C[2, 1] + C[1, 1] * x - C[0, 1] * y)
    r = w * (C[2, 2] + C[1, 2] * x - C[0, 2] * y)
    for i in range(3):
        m.r_e[i] += correction[DR + i]
        m.v_e[i] += correction[DV + i]
        m.v_corrected[i] = m.v_e[i]
        m.b_a[i] += correction[BA + i]
        m.b_g[i] += correction[BG + i]
    m.clock[0] += correction[CLOCK]
    m.clock[1] += correction[DRIFT]
    for i in range(OFFSETS, n):
        m.optional[i - OFFSETS] += correction[i]
    a, b, c = up_direction(m.r_e)
    turn = a * x + b * y + c * z
    turned_x, turned_y, turned_z = (
        _in_body(C, m.C_swung, 0),
        _in_body(C, m.C_swung, 1),
        _in_body(C, m.C_swung, 2),
    )
    turn_left(m.q_eb, x - turn * a, y - turn * b, z - turn * c)
    turn_left(m.q_eb, turn * a, turn * b, turn * c)
    quaternion_to_matrix(m.q_eb, m.C_eb)
    _place_column(m.C_swung, 0, rotate(C, turned_x))
    _place_column(m.C_swung, 1, rotate(C, turned_y))
    _place_column(m.C_swung, 2, rotate(C, turned_z))
    if abs(turn) >= _NO_TURN:
        m.b_g[0] += p - w * C[2, 0]
        m.b_g[1] += q - w * C[2, 1]
        m.b_g[2] += r - w * C[2, 2]


@kernel(inline=True)
def _in_body(C_eb: Float64, C: Float64, column: int) -> Vector:
    """Return a column of ``C`` (3, 3) in body axes."""
    return rotate_back(C_eb, (C[0, column], C[1, column], C[2, column]))


@kernel(inline=True)
def _place_column(C: Float64, column: int, a: Vector) -> None:
    """Write a vector into a column of ``C`` (3, 3)."""
    C[0, column], C[1, column], C[2, column] = a[0], a[1], a[2]


@kernel(apart=True)
def turn_attitude_errors(
    m: StateRecord, P: Float64, par: Parameters, correction: Float64, a: AntennaState
) -> None:
    """Turn the axes of the attitude's errors about the vertical with the correction of the heading.

    What tilts the attitude belongs to the body, the accelerometers' bias above all: with a new heading the axes of that
    tilt turn as well. Left where they were, the tilt and the bias would part, and roll and pitch seem better known.
    What has been measured stays as well known as it is: position and velocity of the antenna at the end of its lever
    arm, and what the gyros show, bias plus Earth rate. Left where they were, the next antenna position would seem to
    show the heading.

    Equation: P <- T P T^T with psi' = R psi, R = exp([u (u . delta psi) x]), u the vertical,
              dr' = dr + (I - R)(psi x l), dv' = dv + (I - R)(psi x a), a = C_eb (w_ib x l) as it was shown,
              db_g' = db_g + C_eb^T ((w_ie - R^T w_ie) x psi); of an uncertain lever arm dr' = dr + (I - R) C_eb dl
    Neglects: the turn of the tilt's own axes by half its correction, second order in it.

    Parameters
    ----------
    m, a : state and antenna before the correction
    """
    axis = up_direction(m.r_e)
    angle = axis[0] * correction[PSI] + axis[1] * correction[PSI + 1] + axis[2] * correction[PSI + 2]
    if not abs(angle) >= _NO_TURN:  # nor one that is not a number
        return
    turn = axis, math.sin(angle), 1.0 - math.cos(angle)
    x, y, z = turned(axis, -turn[1], turn[2], 0.0, 0.0, WGS84_OMEGA_RADPS)
    rate = -x, -y, WGS84_OMEGA_RADPS - z
    n = P.shape[0]
    for j in range(n):
        turn_column(m.C_eb, a, turn, rate, P[:, j])
    for i in range(n):
        turn_column(m.C_eb, a, turn, rate, P[i])
    if par.at_lever_arm >= 0:
        for j in range(3):
            x, y, z = m.C_eb[0, j], m.C_eb[1, j], m.C_eb[2, j]
            p, q, r = turned(axis, turn[1], turn[2], x, y, z)
            a.swing[0, j], a.swing[1, j], a.swing[2, j] = p - x, q - y, r - z
        keep_antenna(P, par.at_lever_arm, a.swing)
    for i in range(n):
        for j in range(i):
            P[i, j] = P[j, i]


@kernel(apart=True)
def turn_force_errors(m: StateRecord, P: Float64, par: Parameters, correction: Float64) -> None:
    """Keep the accelerometers' errors where they are in space while the tilt that belongs to them is corrected.

    An error of an accelerometer and the tilt that it has caused go together: the measurements show their difference
    alone. What corrects the one corrects the other, with the tilt the body's axes turn, and an error that stayed in
    them would get a share of the vertical, which is measured. So each such step would seem to show a little of the
    error. A tilt that the gyros' errors have made, and that is corrected, turns the axes back to where they were. Nor
    do they turn with an error that has made no tilt: one that has just begun.

    Equation: e = b_a + the further errors of force, C_eb e = const while C_eb <- exp([t x]) C_eb: e' = exp(-[s x]) e in
              covariance and correction, s = C_eb^T t; t is u x C_eb de / g, u the vertical, as far as the tilt's
              correction goes along it

    Parameters
    ----------
    m : state before the correction
    correction : (n,); its accelerometer biases are turned, too
    """
    add_further_errors(m, par, DV, correction, 1.0)
    up = rotate_back(m.C_eb, up_direction(m.r_e))
    s = cross(up, (correction[BA], correction[BA + 1], correction[BA + 2]))
    length = math.sqrt(dot(s, s))
    add_further_errors(m, par, DV, correction, -1.0)
    tilt = rotate_back(m.C_eb, (correction[PSI], correction[PSI + 1], correction[PSI + 2]))
    # s is level, so what the heading turns by does not count
    angle = min(dot(s, tilt) / length, length / STANDARD_GRAVITY_MPS2) if length > 0.0 else 0.0
    if not angle >= _NO_TURN:
        return
    axis = s[0] / length, s[1] / length, s[2] / length
    turn = axis, -math.sin(angle), 1.0 - math.cos(angle)
    n = P.shape[0]
    turn_force_column(m, par, turn, correction)
    for j in range(n):
        turn_force_column(m, par, turn, P[:, j])
    for i in range(n):
        turn_force_column(m, par, turn, P[i])
    for i in range(n):
        for j in range(i):
            P[i, j] = P[j, i]


@kernel(inline=True)
def turn_force_column(
    m: StateRecord, par: Parameters, turn: tuple[tuple[float, float, float], float, float], x: Float64
) -> None:
    """Turn the accelerometers' whole errors in an error state ``x`` (n,); ``turn``: axis, sine, 1 - cosine."""
    axis, sine, rest = turn
    add_further_errors(m, par, DV, x, 1.0)
    x[BA], x[BA + 1], x[BA + 2] = turned(axis, sine, rest, x[BA], x[BA + 1], x[BA + 2])
    add_further_errors(m, par, DV, x, -1.0)


@kernel(inline=True)
def turn_column(
    C: Float64,
    antenna: AntennaState,
    turn: tuple[tuple[float, float, float], float, float],
    rate: tuple[float, float, float],
    column: Float64,
) -> None:
    """Turn one column (n,) of a covariance, ``turn`` the axis, sine and 1 - cosine of R, ``rate`` w_ie - R^T w_ie."""
    axis, sine, rest = turn
    p, q, r = column[PSI], column[PSI + 1], column[PSI + 2]
    for arm, at in ((antenna.l_e, DR), (antenna.turning_e, DV)):
        x, y, z = q * arm[2] - r * arm[1], r * arm[0] - p * arm[2], p * arm[1] - q * arm[0]
        a, b, c = turned(axis, sine, rest, x, y, z)
        column[at] += x - a
        column[at + 1] += y - b
        column[at + 2] += z - c
    x, y, z = rate[1] * r - rate[2] * q, rate[2] * p - rate[0] * r, rate[0] * q - rate[1] * p
    for i in range(3):
        column[BG + i] += C[0, i] * x + C[1, i] * y + C[2, i] * z
    column[PSI], column[PSI + 1], column[PSI + 2] = turned(axis, sine, rest, p, q, r)


@kernel(inline=True)
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
