"""The linear dynamics of the error state over a short step, applied by its blocks, compiled.

In ECEF, with error = estimate minus truth and C_eb_hat = (I + [psi x]) C_eb:

    dr'  = dv
    dv'  = -[f_e x] psi - C_eb db_a - sum C_eb e_i m_k dx_k + (dg/dr) dr - 2 w_ie x dv
    psi' = -w_ie x psi - C_eb db_g - sum C_eb e_i m_k dx_k
    dx'  = -dx / time                (each state of first order: biases, scale factors, clocks ...)
    dclock' = ddrift

A further state x_k is an error of one sensor axis i in proportion to m_k, a component of the specific force or of the
rate (a ``Coupling``): a scale factor, a misalignment, a sensitivity to acceleration.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.constants import WGS84_GM_M3PS2, WGS84_OMEGA_RADPS
from insgnss.inertial.error_state import BA, BG, CLOCK, DR, DRIFT, DV, FURTHER, N_MOTION, PSI
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

COUPLING_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("at", np.int64),  # the further state
            ("into", np.int64),  # DV: an error of the accelerometers, PSI: of the gyros
            ("s", np.float64, (3,)),  # integral of C_eb e_i m_k over the step, ECEF
        ],
    )
)
Couplings: TypeAlias = npt.NDArray[Any]  # (k,) of COUPLING_DTYPE


class Step(NamedTuple):
    """The numbers of one step: everything the motion's transition needs, with the time step already in it."""

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


@kernel(inline=True)
def transition_step(dt: float, f0: float, f1: float, f2: float, r_e: Float64) -> Step:
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
    )


@kernel
def apply_transition(
    s: Step, C_dt: Float64, couplings: Couplings, keep: Float64, A: Float64, B: Float64
) -> None:
    """Write ``B = Phi A`` for the step ``s``: each column of ``A`` is an error state that is carried on.

    Parameters
    ----------
    s : the step
    C_dt : (3, 3) integral of C_eb over the step [s]
    couplings : (k,) of the further states into the motion
    keep : (n,) decay factor of each state of first order over the step, exp(-dt / time)
    A, B : (n, n) input and output, not the same; error states as in ``error_state``
    """
    n = A.shape[1]
    move(s, C_dt, couplings, A, B)
    for i in range(N_MOTION, A.shape[0]):
        for c in range(n):
            B[i, c] = keep[i] * A[i, c]
    for c in range(n):
        B[CLOCK, c] += s.dt * A[DRIFT, c]


@kernel(inline=True)
def move(s: Step, C_dt: Float64, couplings: Couplings, A: Float64, B: Float64) -> None:
    """Write position, velocity and attitude of ``B = Phi A``; it goes along rows, which lie in one piece in memory.

    psi and v are taken at mid-step (trapezoid), which makes Phi right to second order: dr gets f x psi dt^2/2 and
    C b_a dt^2/2, dv gets f x (C b_g) dt^2/2. Coriolis and gravity gradient take the start of the step: 2e-6 of dv at
    25 ms.
    Neglects: the Earth's turn (2 w_ie dt, 3e-6 at 20 ms) and the bias's decay (dt / (2 time), 2e-5 at 20 ms and 600 s)
    inside the step, as shares of the terms of first order.
    """
    n = A.shape[1]
    # psi - w_ie dt x psi - C db_g dt
    for c in range(n):
        B[PSI, c] = A[PSI, c] + s.w * A[PSI + 1, c] - rotated(C_dt, 0, A, BG, c)
    for c in range(n):
        B[PSI + 1, c] = A[PSI + 1, c] - s.w * A[PSI, c] - rotated(C_dt, 1, A, BG, c)
    for c in range(n):
        B[PSI + 2, c] = A[PSI + 2, c] - rotated(C_dt, 2, A, BG, c)
    # dv + dg/dr dt dr - 2 w_ie dt x dv - C db_a dt - f dt x psi, psi the mean of before and after
    coriolis = 2.0 * s.w
    for c in range(n):
        g = s.g00 * A[DR, c] + s.g01 * A[DR + 1, c] + s.g02 * A[DR + 2, c] + coriolis * A[DV + 1, c]
        B[DV, c] = A[DV, c] + (g - rotated(C_dt, 0, A, BA, c))
    for c in range(n):
        g = s.g01 * A[DR, c] + s.g11 * A[DR + 1, c] + s.g12 * A[DR + 2, c] - coriolis * A[DV, c]
        B[DV + 1, c] = A[DV + 1, c] + (g - rotated(C_dt, 1, A, BA, c))
    for c in range(n):
        g = s.g02 * A[DR, c] + s.g12 * A[DR + 1, c] + s.g22 * A[DR + 2, c]
        B[DV + 2, c] = A[DV + 2, c] + (g - rotated(C_dt, 2, A, BA, c))
    for k in range(couplings.shape[0]):
        at, into, part = couplings[k].at, couplings[k].into, couplings[k].s
        x, y, z = part[0], part[1], part[2]
        for c in range(n):
            B[into, c] -= x * A[at, c]
            B[into + 1, c] -= y * A[at, c]
            B[into + 2, c] -= z * A[at, c]
    for c in range(n):
        B[DV, c] -= s.f1 * mean(A, B, PSI + 2, c) - s.f2 * mean(A, B, PSI + 1, c)
    for c in range(n):
        B[DV + 1, c] -= s.f2 * mean(A, B, PSI, c) - s.f0 * mean(A, B, PSI + 2, c)
    for c in range(n):
        B[DV + 2, c] -= s.f0 * mean(A, B, PSI + 1, c) - s.f1 * mean(A, B, PSI, c)
    # dr + dv dt with the mean of both velocities
    half = 0.5 * s.dt
    for i in range(3):
        for c in range(n):
            B[DR + i, c] = A[DR + i, c] + half * (A[DV + i, c] + B[DV + i, c])


@kernel(inline=True)
def rotated(C_dt: Float64, i: int, A: Float64, at: int, c: int) -> float:
    """Return component ``i`` of C dt b, b the three rows of column ``c`` of ``A`` from row ``at`` on."""
    return float(C_dt[i, 0] * A[at, c] + C_dt[i, 1] * A[at + 1, c] + C_dt[i, 2] * A[at + 2, c])


@kernel(inline=True)
def mean(A: Float64, B: Float64, i: int, c: int) -> float:
    """Return the mean of one element of both."""
    return float(0.5 * (A[i, c] + B[i, c]))


@kernel
def carry_covariance(
    s: Step, C_dt: Float64, couplings: Couplings, keep: Float64, P: Float64, B: Float64
) -> None:
    """Carry ``P`` (n, n) over the step: P <- Phi P Phi^T; ``B`` (n, n) is scratch.

    With B = Phi P, row i of the result is Phi applied to row i of B. Only the rows of the motion need B; the states
    behind them decay where they stand, and their covariance with the motion is that of its rows, mirrored: P stays
    symmetric bit for bit.
    """
    n = P.shape[0]
    of_a, of_g = keep[BA], keep[BG]
    move(s, C_dt, couplings, P, B)
    for i in range(N_MOTION):
        move_row(s, C_dt, couplings, B[i], P[i])
        decay_row(s.dt, of_a, of_g, keep, 1.0, B[i], P[i])
    still = True
    for i in range(FURTHER, n):
        still = still and keep[i] == 1.0
    for i in range(N_MOTION, n):
        if still and i >= FURTHER:
            decay_biases(of_a, of_g, P[i])
        else:
            decay_row(0.0, of_a, of_g, keep, keep[i], P[i], P[i])
    for c in range(N_MOTION, n):
        P[CLOCK, c] += s.dt * P[DRIFT, c]
    for i in range(N_MOTION, n):
        P[i, CLOCK] += s.dt * P[i, DRIFT]
    for i in range(1, n):
        for c in range(min(i, N_MOTION)):
            P[i, c] = P[c, i]


@kernel(inline=True)
def decay_biases(of_a: float, of_g: float, b: Float64) -> None:
    """Let the biases decay in one column (n,)."""
    for i in range(3):
        b[BA + i] *= of_a
        b[BG + i] *= of_g


@kernel(inline=True)
def decay_row(dt: float, of_a: float, of_g: float, keep: Float64, own: float, a: Float64, b: Float64) -> None:
    """Write the states of first order of ``b = own Phi a``, of one column (n,); the clock's drift acts over ``dt``."""
    for i in range(BA, BA + 3):
        b[i] = own * of_a * a[i]
    for i in range(BG, BG + 3):
        b[i] = own * of_g * a[i]
    b[CLOCK] = own * (a[CLOCK] + dt * a[DRIFT])
    b[DRIFT] = own * a[DRIFT]
    for i in range(FURTHER, b.shape[0]):
        b[i] = own * keep[i] * a[i]


@kernel(inline=True)
def move_row(s: Step, C_dt: Float64, couplings: Couplings, a: Float64, b: Float64) -> None:
    """Write position, velocity and attitude of ``b = Phi a``, of one column (n,): the equations of ``move``."""
    half, coriolis = 0.5 * s.dt, 2.0 * s.w
    x, y, z = a[PSI], a[PSI + 1], a[PSI + 2]
    bx, by, bz = a[BG], a[BG + 1], a[BG + 2]
    px = x + s.w * y - (C_dt[0, 0] * bx + C_dt[0, 1] * by + C_dt[0, 2] * bz)
    py = y - s.w * x - (C_dt[1, 0] * bx + C_dt[1, 1] * by + C_dt[1, 2] * bz)
    pz = z - (C_dt[2, 0] * bx + C_dt[2, 1] * by + C_dt[2, 2] * bz)
    x, y, z = a[DR], a[DR + 1], a[DR + 2]
    u, v, w = a[DV], a[DV + 1], a[DV + 2]
    bx, by, bz = a[BA], a[BA + 1], a[BA + 2]
    gx = s.g00 * x + s.g01 * y + s.g02 * z + coriolis * v
    gy = s.g01 * x + s.g11 * y + s.g12 * z - coriolis * u
    gz = s.g02 * x + s.g12 * y + s.g22 * z
    vx = u + (gx - (C_dt[0, 0] * bx + C_dt[0, 1] * by + C_dt[0, 2] * bz))
    vy = v + (gy - (C_dt[1, 0] * bx + C_dt[1, 1] * by + C_dt[1, 2] * bz))
    vz = w + (gz - (C_dt[2, 0] * bx + C_dt[2, 1] * by + C_dt[2, 2] * bz))
    for k in range(couplings.shape[0]):
        part, value = couplings[k].s, a[couplings[k].at]
        if couplings[k].into == DV:
            vx, vy, vz = vx - part[0] * value, vy - part[1] * value, vz - part[2] * value
        else:
            px, py, pz = px - part[0] * value, py - part[1] * value, pz - part[2] * value
    b[PSI], b[PSI + 1], b[PSI + 2] = px, py, pz
    px, py, pz = 0.5 * (a[PSI] + px), 0.5 * (a[PSI + 1] + py), 0.5 * (a[PSI + 2] + pz)
    b[DV] = vx - (s.f1 * pz - s.f2 * py)
    b[DV + 1] = vy - (s.f2 * px - s.f0 * pz)
    b[DV + 2] = vz - (s.f0 * py - s.f1 * px)
    b[DR] = x + half * (u + b[DV])
    b[DR + 1] = y + half * (v + b[DV + 1])
    b[DR + 2] = z + half * (w + b[DV + 2])
