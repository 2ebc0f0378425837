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
    """Write ``B = Phi A`` for the step ``s``: each column of ``A`` is an error state that is carried on.

    psi and v are taken at mid-step (trapezoid), which makes Phi right to second order: dr gets f x psi dt^2/2 and
    C b_a dt^2/2, dv gets f x (C b_g) dt^2/2. Coriolis and gravity gradient take the start of the step: 2e-6 of dv at
    25 ms. It goes along rows, which lie in one piece in memory.
    Neglects: the Earth's turn (2 w_ie dt, 3e-6 at 20 ms) and the bias's decay (dt / (2 time), 2e-5 at 20 ms and 600 s)
    inside the step, as shares of the terms of first order.

    Parameters
    ----------
    s : the step
    C_dt : (3, 3) integral of C_eb over the step [s]
    A, B : (n, n) input and output, not the same; error states in the order of ``fusion.state``
    """
    n = A.shape[1]
    half, coriolis = 0.5 * s.dt, 2.0 * s.w
    # psi - w_ie dt x psi - C db_g dt
    for c in range(n):
        B[6, c] = A[6, c] + s.w * A[7, c] - rotated(C_dt, 0, A, 12, c)
    for c in range(n):
        B[7, c] = A[7, c] - s.w * A[6, c] - rotated(C_dt, 1, A, 12, c)
    for c in range(n):
        B[8, c] = A[8, c] - rotated(C_dt, 2, A, 12, c)
    # dv + dg/dr dt dr - 2 w_ie dt x dv - C db_a dt - f dt x psi, psi the mean of before and after
    for c in range(n):
        g = s.g00 * A[0, c] + s.g01 * A[1, c] + s.g02 * A[2, c] + coriolis * A[4, c]
        B[3, c] = g - rotated(C_dt, 0, A, 9, c)
    for c in range(n):
        g = s.g01 * A[0, c] + s.g11 * A[1, c] + s.g12 * A[2, c] - coriolis * A[3, c]
        B[4, c] = g - rotated(C_dt, 1, A, 9, c)
    for c in range(n):
        g = s.g02 * A[0, c] + s.g12 * A[1, c] + s.g22 * A[2, c]
        B[5, c] = g - rotated(C_dt, 2, A, 9, c)
    for c in range(n):
        B[3, c] = A[3, c] + B[3, c] - (s.f1 * mean(A, B, 8, c) - s.f2 * mean(A, B, 7, c))
    for c in range(n):
        B[4, c] = A[4, c] + B[4, c] - (s.f2 * mean(A, B, 6, c) - s.f0 * mean(A, B, 8, c))
    for c in range(n):
        B[5, c] = A[5, c] + B[5, c] - (s.f0 * mean(A, B, 7, c) - s.f1 * mean(A, B, 6, c))
    # dr + dv dt with the mean of both velocities
    for i in range(3):
        for c in range(n):
            B[i, c] = A[i, c] + half * (A[3 + i, c] + B[3 + i, c])
    for i in range(9, A.shape[0]):
        keep = s.keep_a if i < 12 else (s.keep_g if i < 15 else 1.0)
        for c in range(n):
            B[i, c] = keep * A[i, c]
    for c in range(n):
        B[15, c] += s.dt * A[16, c]


@inlined
def rotated(C_dt: Float64, i: int, A: Float64, at: int, c: int) -> float:
    """Return component ``i`` of C dt b, b the three rows of column ``c`` of ``A`` from row ``at`` on."""
    return float(C_dt[i, 0] * A[at, c] + C_dt[i, 1] * A[at + 1, c] + C_dt[i, 2] * A[at + 2, c])


@inlined
def mean(A: Float64, B: Float64, i: int, c: int) -> float:
    """Return the mean of one element of both."""
    return float(0.5 * (A[i, c] + B[i, c]))


@borrowing
def carry_covariance(s: Step, C_dt: Float64, P: Float64, B: Float64) -> None:
    """Carry ``P`` (n, n) over the step: P <- Phi P Phi^T; ``B`` (n, n) is scratch.

    With B = Phi P, row i of the result is Phi applied to row i of B. Motion takes part in the first nine rows alone;
    of the others only what is on and above the diagonal is computed, and mirrored: P stays symmetric bit for bit.
    """
    n = P.shape[0]
    apply_transition(s, C_dt, P, B)
    for i in range(9):
        carry_motion(s, C_dt, B[i], P[i])
    for i in range(n):
        for c in range(max(i, 9), 12):
            P[i, c] = s.keep_a * B[i, c]
        for c in range(max(i, 12), 15):
            P[i, c] = s.keep_g * B[i, c]
        if i <= 15:
            P[i, 15] = B[i, 15] + s.dt * B[i, 16]
        for c in range(max(i, 16), n):
            P[i, c] = B[i, c]
    for i in range(n):
        for c in range(i):
            P[i, c] = P[c, i]


@inlined
def carry_motion(s: Step, C_dt: Float64, a: Float64, b: Float64) -> None:
    """Write position, velocity and attitude of ``b = Phi a`` (n,), as ``apply_transition`` does of every column."""
    half, coriolis = 0.5 * s.dt, 2.0 * s.w
    x, y, z = a[6], a[7], a[8]
    bx, by, bz = a[12], a[13], a[14]
    b[6] = x + s.w * y - (C_dt[0, 0] * bx + C_dt[0, 1] * by + C_dt[0, 2] * bz)
    b[7] = y - s.w * x - (C_dt[1, 0] * bx + C_dt[1, 1] * by + C_dt[1, 2] * bz)
    b[8] = z - (C_dt[2, 0] * bx + C_dt[2, 1] * by + C_dt[2, 2] * bz)
    px, py, pz = 0.5 * (x + b[6]), 0.5 * (y + b[7]), 0.5 * (z + b[8])
    x, y, z = a[0], a[1], a[2]
    u, v, w = a[3], a[4], a[5]
    bx, by, bz = a[9], a[10], a[11]
    gx = s.g00 * x + s.g01 * y + s.g02 * z + coriolis * v
    gy = s.g01 * x + s.g11 * y + s.g12 * z - coriolis * u
    gz = s.g02 * x + s.g12 * y + s.g22 * z
    gx -= C_dt[0, 0] * bx + C_dt[0, 1] * by + C_dt[0, 2] * bz
    gy -= C_dt[1, 0] * bx + C_dt[1, 1] * by + C_dt[1, 2] * bz
    gz -= C_dt[2, 0] * bx + C_dt[2, 1] * by + C_dt[2, 2] * bz
    b[3] = u + gx - (s.f1 * pz - s.f2 * py)
    b[4] = v + gy - (s.f2 * px - s.f0 * pz)
    b[5] = w + gz - (s.f0 * py - s.f1 * px)
    b[0] = x + half * (u + b[3])
    b[1] = y + half * (v + b[4])
    b[2] = z + half * (w + b[5])
