"""The linear dynamics of the error state over a short step, applied by its blocks, compiled.

In ECEF, with error = estimate minus truth and C_eb_hat = (I + [psi x]) C_eb:

    dr'  = dv
    dv'  = -[f_e x] psi - C_eb db_a + (dg/dr) dr - 2 w_ie x dv
    psi' = -w_ie x psi - C_eb db_g
    db'  = -db / time                (each bias)
    dclock' = ddrift
"""

from __future__ import annotations

import math
from typing import NamedTuple

from insgnss.constants import WGS84_GM_M3PS2, WGS84_OMEGA_RADPS
from insgnss.jit import borrowing, inlined
from insgnss.tables import Float64


class Step(NamedTuple):
    """The numbers of one step: everything the transition needs, with the time step already in it."""

    dt: float  # [s]
    f0: float  # velocity increment of the specific force, ECEF [m/s]
    f1: float
    f2: float
    w: float  # Earth's turn [rad]
    g00: float  # gravity gradient times dt [1/s]
    g01: float
    g02: float
    g11: float
    g12: float
    g22: float
    keep_a: float  # exp(-dt / time) of the accelerometer bias
    keep_g: float  # of the gyro bias


@inlined
def transition_step(
    dt: float, f0: float, f1: float, f2: float, r_e: Float64, time_a: float, time_g: float
) -> Step:
    """Return the numbers of a step of ``dt`` [s] in which the specific force adds (f0, f1, f2) [m/s] in ECEF.

    Equation: dg/dr = -GM/r^3 (I - 3 u u^T) + w_ie^2 diag(1, 1, 0), u = r/|r|
    Neglects: the gradient of J2, at most 0.7 % (poles) of the gradient, which itself adds 3e-6 of the position error
    per s^2.
    """
    x, y, z = r_e[0], r_e[1], r_e[2]
    inv_r2 = 1.0 / (x * x + y * y + z * z)
    central = -WGS84_GM_M3PS2 * inv_r2 * math.sqrt(inv_r2)
    spread = -3.0 * central * inv_r2
    w2 = WGS84_OMEGA_RADPS * WGS84_OMEGA_RADPS
    return Step(
        dt,
        f0,
        f1,
        f2,
        WGS84_OMEGA_RADPS * dt,
        (central + spread * x * x + w2) * dt,
        spread * x * y * dt,
        spread * x * z * dt,
        (central + spread * y * y + w2) * dt,
        spread * y * z * dt,
        (central + spread * z * z) * dt,
        math.exp(-dt / time_a),
        math.exp(-dt / time_g),
    )


@borrowing
def apply_transition(s: Step, C_dt: Float64, A: Float64, B: Float64) -> None:
    """Write ``B = Phi A`` for the step ``s``, row by row of the error state; ``A`` and ``B`` are (n, n), not the same.

    Each block below is one line of the dynamics; psi and v are taken at mid-step (trapezoid), which makes Phi right to
    second order: dr gets f x psi dt^2/2 and C b_a dt^2/2, dv gets f x (C b_g) dt^2/2. Coriolis and gravity gradient
    take the start of the step: 2e-6 of dv at 25 ms.
    Neglects: the Earth's turn (2 w_ie dt, 3e-6 at 20 ms) and the bias's decay (dt / (2 time), 2e-5 at 20 ms and 600 s)
    inside the step, as shares of the terms of first order.

    Parameters
    ----------
    s : the step
    C_dt : (3, 3) integral of C_eb over the step [s]
    A, B : (n, n) input and output; rows are error states in the order of ``fusion.state``
    """
    attitude_rows(s, C_dt, A, B)
    gravity = ((s.g00, s.g01, s.g02), (s.g01, s.g11, s.g12), (s.g02, s.g12, s.g22))
    f = (s.f0, s.f1, s.f2)
    coriolis = (2.0 * s.w, -2.0 * s.w, 0.0)
    for i in range(3):
        # i, a, b run cyclically: (f x psi)_i = f_a psi_b - f_b psi_a
        a, b = (i + 1) % 3, (i + 2) % 3
        velocity_row(i, 1 - i if i < 2 else 2, coriolis[i], gravity[i], C_dt, A, B)
        add_specific_force(i, a, b, f[a], f[b], A, B)
    position_and_bias_rows(s, A, B)


@inlined
def attitude_rows(s: Step, C_dt: Float64, A: Float64, B: Float64) -> None:
    """Write psi - w_ie dt x psi - C db_g dt."""
    turn = (s.w, -s.w, 0.0)
    for i in range(3):
        other = 7 - i if i < 2 else 8
        w, c0, c1, c2 = turn[i], C_dt[i, 0], C_dt[i, 1], C_dt[i, 2]
        for j in range(A.shape[0]):
            B[6 + i, j] = A[6 + i, j] + w * A[other, j] - (c0 * A[12, j] + c1 * A[13, j] + c2 * A[14, j])


@inlined
def velocity_row(
    i: int, other: int, coriolis: float, g: tuple[float, float, float], C_dt: Float64, A: Float64, B: Float64
) -> None:
    """Write row ``i`` of dv + dg/dr dt dr - 2 w_ie dt x dv - C db_a dt."""
    c0, c1, c2 = C_dt[i, 0], C_dt[i, 1], C_dt[i, 2]
    g0, g1, g2 = g
    for j in range(A.shape[0]):
        B[3 + i, j] = A[3 + i, j] + coriolis * A[3 + other, j] + g0 * A[0, j] + g1 * A[1, j] + g2 * A[2, j]
    for j in range(A.shape[0]):
        B[3 + i, j] -= c0 * A[9, j] + c1 * A[10, j] + c2 * A[11, j]


@inlined
def add_specific_force(i: int, a: int, b: int, f_a: float, f_b: float, A: Float64, B: Float64) -> None:
    """Subtract f dt x psi at mid-step from velocity row ``i``."""
    half_a, half_b = 0.5 * f_a, 0.5 * f_b
    for j in range(A.shape[0]):
        B[3 + i, j] -= half_a * (A[6 + b, j] + B[6 + b, j]) - half_b * (A[6 + a, j] + B[6 + a, j])


@inlined
def position_and_bias_rows(s: Step, A: Float64, B: Float64) -> None:
    """Write dr + dv dt with the velocity at mid-step, the decaying biases and the clock."""
    n = A.shape[0]
    half = 0.5 * s.dt
    for i in range(3):
        for j in range(n):
            B[i, j] = A[i, j] + half * (A[3 + i, j] + B[3 + i, j])
    for i in range(9, 15):
        keep = s.keep_a if i < 12 else s.keep_g
        for j in range(n):
            B[i, j] = keep * A[i, j]
    for j in range(n):
        B[15, j] = A[15, j] + s.dt * A[16, j]
    for i in range(16, n):
        for j in range(n):
            B[i, j] = A[i, j]
