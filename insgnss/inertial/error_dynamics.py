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
from insgnss.jit import kernel
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


@kernel
def transition_step(
    dt: float, f0: float, f1: float, f2: float, r_e: Float64, time_a: float, time_g: float
) -> Step:
    """Return the numbers of a step of ``dt`` [s] in which the specific force adds (f0, f1, f2) [m/s] in ECEF.

    Equation: dg/dr = -GM/r^3 (I - 3 u u^T) + w_ie^2 diag(1, 1, 0), u = r/|r|
    Neglects: the gradient of J2, 0.3 % of the gradient, which itself adds 1e-6 of the position error per s^2.
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


@kernel
def apply_transition(s: Step, C_dt: Float64, A: Float64, B: Float64) -> None:
    """Write ``B = Phi A`` for the step ``s``, row by row of the error state; ``A`` and ``B`` are (n, n), not the same.

    Each line below is one line of the dynamics; psi and v are taken at mid-step (trapezoid), which makes Phi right to
    second order: dr gets f x psi dt^2/2 and C b_a dt^2/2, dv gets f x (C b_g) dt^2/2.

    Parameters
    ----------
    s : the step
    C_dt : (3, 3) integral of C_eb over the step [s]
    A, B : (n, n) input and output; rows are error states in the order of ``fusion.state``
    """
    n = A.shape[0]
    c00, c01, c02 = C_dt[0, 0], C_dt[0, 1], C_dt[0, 2]
    c10, c11, c12 = C_dt[1, 0], C_dt[1, 1], C_dt[1, 2]
    c20, c21, c22 = C_dt[2, 0], C_dt[2, 1], C_dt[2, 2]
    half = 0.5 * s.dt
    for j in range(n):
        r0, r1, r2 = A[0, j], A[1, j], A[2, j]
        v0, v1, v2 = A[3, j], A[4, j], A[5, j]
        p0, p1, p2 = A[6, j], A[7, j], A[8, j]
        a0, a1, a2 = A[9, j], A[10, j], A[11, j]
        b0, b1, b2 = A[12, j], A[13, j], A[14, j]
        # psi - w_ie dt x psi - C db_g dt
        q0 = p0 + s.w * p1 - (c00 * b0 + c01 * b1 + c02 * b2)
        q1 = p1 - s.w * p0 - (c10 * b0 + c11 * b1 + c12 * b2)
        q2 = p2 - (c20 * b0 + c21 * b1 + c22 * b2)
        m0, m1, m2 = 0.5 * (p0 + q0), 0.5 * (p1 + q1), 0.5 * (p2 + q2)
        # dv - f dt x psi_mid - C db_a dt + dg/dr dt dr - 2 w_ie dt x dv
        u0 = v0 - s.f1 * m2 + s.f2 * m1 - (c00 * a0 + c01 * a1 + c02 * a2)
        u1 = v1 - s.f2 * m0 + s.f0 * m2 - (c10 * a0 + c11 * a1 + c12 * a2)
        u2 = v2 - s.f0 * m1 + s.f1 * m0 - (c20 * a0 + c21 * a1 + c22 * a2)
        u0 += s.g00 * r0 + s.g01 * r1 + s.g02 * r2 + 2.0 * s.w * v1
        u1 += s.g01 * r0 + s.g11 * r1 + s.g12 * r2 - 2.0 * s.w * v0
        u2 += s.g02 * r0 + s.g12 * r1 + s.g22 * r2
        # dr + dv_mid dt
        B[0, j], B[1, j], B[2, j] = r0 + half * (v0 + u0), r1 + half * (v1 + u1), r2 + half * (v2 + u2)
        B[3, j], B[4, j], B[5, j] = u0, u1, u2
        B[6, j], B[7, j], B[8, j] = q0, q1, q2
        B[9, j], B[10, j], B[11, j] = s.keep_a * a0, s.keep_a * a1, s.keep_a * a2
        B[12, j], B[13, j], B[14, j] = s.keep_g * b0, s.keep_g * b1, s.keep_g * b2
        B[15, j] = A[15, j] + s.dt * A[16, j]
        for i in range(16, n):
            B[i, j] = A[i, j]
