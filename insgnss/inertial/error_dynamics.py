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
def apply_transition(s: Step, C_dt: Float64, A: Float64, B: Float64, whole: bool) -> None:
    """Write ``B = (Phi A)^T`` for the step ``s``: each column of ``A`` is an error state that is carried on.

    Twice applied, from P, this is Phi P Phi^T. The second time B need not be ``whole``: it is symmetric, and of the
    rows of biases and clock only what is on and above the diagonal is then written. psi and v are taken at mid-step
    (trapezoid), which makes Phi right to second order: dr gets f x psi dt^2/2 and C b_a dt^2/2, dv gets
    f x (C b_g) dt^2/2. Coriolis and gravity gradient take the start of the step: 2e-6 of dv at 25 ms.
    Neglects: the Earth's turn (2 w_ie dt, 3e-6 at 20 ms) and the bias's decay (dt / (2 time), 2e-5 at 20 ms and 600 s)
    inside the step, as shares of the terms of first order.

    Parameters
    ----------
    s : the step
    C_dt : (3, 3) integral of C_eb over the step [s]
    A, B : (n, n) input and output, not the same; error states in the order of ``fusion.state``
    """
    for j in range(A.shape[0]):
        if whole or j < 9:
            carry_motion(s, C_dt, A, B, j)
        for i in range(9, 12):
            B[j, i] = s.keep_a * A[i, j]
        for i in range(12, 15):
            B[j, i] = s.keep_g * A[i, j]
        B[j, 15] = A[15, j] + s.dt * A[16, j]
        for i in range(16, A.shape[0]):
            B[j, i] = A[i, j]


@inlined
def carry_motion(s: Step, C_dt: Float64, A: Float64, B: Float64, j: int) -> None:
    """Write attitude, velocity and position of column ``j`` of ``Phi A``."""
    half, coriolis = 0.5 * s.dt, 2.0 * s.w
    # psi - w_ie dt x psi - C db_g dt, and the mean of before and after
    x, y, z = A[6, j], A[7, j], A[8, j]
    bx, by, bz = A[12, j], A[13, j], A[14, j]
    B[j, 6] = x + s.w * y - (C_dt[0, 0] * bx + C_dt[0, 1] * by + C_dt[0, 2] * bz)
    B[j, 7] = y - s.w * x - (C_dt[1, 0] * bx + C_dt[1, 1] * by + C_dt[1, 2] * bz)
    B[j, 8] = z - (C_dt[2, 0] * bx + C_dt[2, 1] * by + C_dt[2, 2] * bz)
    px, py, pz = 0.5 * (x + B[j, 6]), 0.5 * (y + B[j, 7]), 0.5 * (z + B[j, 8])
    # dv - f dt x psi + dg/dr dt dr - 2 w_ie dt x dv - C db_a dt
    x, y, z = A[0, j], A[1, j], A[2, j]
    u, v, w = A[3, j], A[4, j], A[5, j]
    ax, ay, az = A[9, j], A[10, j], A[11, j]
    gx = s.g00 * x + s.g01 * y + s.g02 * z + coriolis * v
    gy = s.g01 * x + s.g11 * y + s.g12 * z - coriolis * u
    gz = s.g02 * x + s.g12 * y + s.g22 * z
    gx -= C_dt[0, 0] * ax + C_dt[0, 1] * ay + C_dt[0, 2] * az
    gy -= C_dt[1, 0] * ax + C_dt[1, 1] * ay + C_dt[1, 2] * az
    gz -= C_dt[2, 0] * ax + C_dt[2, 1] * ay + C_dt[2, 2] * az
    B[j, 3] = u + gx - (s.f1 * pz - s.f2 * py)
    B[j, 4] = v + gy - (s.f2 * px - s.f0 * pz)
    B[j, 5] = w + gz - (s.f0 * py - s.f1 * px)
    # dr + dv dt with the mean of both velocities
    B[j, 0] = x + half * (u + B[j, 3])
    B[j, 1] = y + half * (v + B[j, 4])
    B[j, 2] = z + half * (w + B[j, 5])
