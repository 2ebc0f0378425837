"""The linear dynamics of the error state over a short step, applied by its blocks, compiled.

In ECEF, with error = estimate minus truth and C_eb_hat = (I + [psi x]) C_eb:

    dr'  = dv
    dv'  = -[f_e x] psi - C_eb db_a - sum C_eb e_i m_k dx_k + (dg/dr) dr - 2 w_ie x dv
    psi' = -w_ie x psi - C_eb db_g - sum C_eb e_i m_k dx_k
    dx'  = -dx / time                (each state of first order: biases, scale factors, clocks ...)
    dclock' = ddrift

A further state x_k is an error of one sensor axis i in proportion to m_k, a component of the specific force or of the
rate (a ``Coupling``): a scale factor, a misalignment, a sensitivity to acceleration. Over a step it acts as a bias of
that axis does, x_k times the mean of m_k. That neglects how C_eb and m_k change together within the step.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from insgnss.constants import WGS84_GM_M3PS2, WGS84_OMEGA_RADPS
from insgnss.inertial.error_state import BA, BG, CLOCK, DR, DRIFT, DV, N_MOTION, PSI
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

COUPLING_DTYPE: Final = np.dtype(
    (
        np.record,
        [
            ("at", np.int64),  # the further state
            ("bias", np.int64),  # the bias of the same sensor and axis
            ("factor", np.float64),  # mean of m_k over the step
        ],
    )
)
Couplings: TypeAlias = npt.NDArray[Any]  # (k,) of COUPLING_DTYPE, those of one axis together
# columns in which the rows of the motion are carried across: as many as full vectors of the processor hold
_ACROSS: Final = 12


class StepSpace(NamedTuple):
    """Scratch of ``carry_covariance``."""

    along: Float64  # (n, n)
    before: Float64  # (n, _ACROSS); the last columns stay zero
    after: Float64  # (n, _ACROSS)


def step_space(n: int) -> StepSpace:
    """Return scratch for ``n`` error states."""
    return StepSpace(np.zeros((n, n)), np.zeros((n, _ACROSS)), np.zeros((n, _ACROSS)))


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
    move(s, C_dt, couplings, A, B, n)
    for i in range(N_MOTION, A.shape[0]):
        for c in range(n):
            B[i, c] = keep[i] * A[i, c]
    for c in range(n):
        B[CLOCK, c] += s.dt * A[DRIFT, c]


@kernel(inline=True)
def move(s: Step, C_dt: Float64, couplings: Couplings, A: Float64, B: Float64, n: int) -> None:
    """Write position, velocity and attitude of ``B = Phi A``, ``n`` columns; rows 9 to 14 of ``B`` are scratch.

    It goes along rows, which lie in one piece in memory. Each loop writes one row: the compiler makes vectors of it.

    psi and v are taken at mid-step (trapezoid), which makes Phi right to second order: dr gets f x psi dt^2/2 and
    C b_a dt^2/2, dv gets f x (C b_g) dt^2/2. Coriolis and gravity gradient take the start of the step: 2e-6 of dv at
    25 ms.
    Neglects: the Earth's turn (2 w_ie dt, 3e-6 at 20 ms) and the bias's decay (dt / (2 time), 2e-5 at 20 ms and 600 s)
    inside the step, as shares of the terms of first order.
    """
    sum_sensor_errors(couplings, A, B, n)
    # psi - w_ie dt x psi - C db_g dt
    for c in range(n):
        B[PSI, c] = A[PSI, c] + s.w * A[PSI + 1, c] - rotated(C_dt, 0, B, BG, c)
    for c in range(n):
        B[PSI + 1, c] = A[PSI + 1, c] - s.w * A[PSI, c] - rotated(C_dt, 1, B, BG, c)
    for c in range(n):
        B[PSI + 2, c] = A[PSI + 2, c] - rotated(C_dt, 2, B, BG, c)
    # dv + dg/dr dt dr - 2 w_ie dt x dv - C db_a dt - f dt x psi, psi the mean of before and after
    coriolis = 2.0 * s.w
    for c in range(n):
        g = s.g00 * A[DR, c] + s.g01 * A[DR + 1, c] + s.g02 * A[DR + 2, c] + coriolis * A[DV + 1, c]
        turned = s.f1 * mean(A, B, PSI + 2, c) - s.f2 * mean(A, B, PSI + 1, c)
        B[DV, c] = A[DV, c] + (g - rotated(C_dt, 0, B, BA, c) - turned)
    for c in range(n):
        g = s.g01 * A[DR, c] + s.g11 * A[DR + 1, c] + s.g12 * A[DR + 2, c] - coriolis * A[DV, c]
        turned = s.f2 * mean(A, B, PSI, c) - s.f0 * mean(A, B, PSI + 2, c)
        B[DV + 1, c] = A[DV + 1, c] + (g - rotated(C_dt, 1, B, BA, c) - turned)
    for c in range(n):
        g = s.g02 * A[DR, c] + s.g12 * A[DR + 1, c] + s.g22 * A[DR + 2, c]
        turned = s.f0 * mean(A, B, PSI + 1, c) - s.f1 * mean(A, B, PSI, c)
        B[DV + 2, c] = A[DV + 2, c] + (g - rotated(C_dt, 2, B, BA, c) - turned)
    # dr + dv dt with the mean of both velocities
    half = 0.5 * s.dt
    for i in range(3):
        for c in range(n):
            B[DR + i, c] = A[DR + i, c] + half * (A[DV + i, c] + B[DV + i, c])


@kernel(inline=True)
def sum_sensor_errors(couplings: Couplings, A: Float64, B: Float64, n: int) -> None:
    """Write the whole errors of the sensors in ``A``, biases and further states, into the biases' rows of ``B``."""
    for i in range(BA, BG + 3):
        for c in range(n):
            B[i, c] = A[i, c]
    k, count = 0, couplings.shape[0]
    while k < count:
        at, bias, factor = couplings[k].at, couplings[k].bias, couplings[k].factor
        if k + 2 < count and couplings[k + 2].bias == bias:  # one pass over the row in place of three
            second, by_second = couplings[k + 1].at, couplings[k + 1].factor
            third, by_third = couplings[k + 2].at, couplings[k + 2].factor
            if factor != 0.0 or by_second != 0.0 or by_third != 0.0:  # on a straight there is no rate
                for c in range(n):
                    B[bias, c] += factor * A[at, c] + by_second * A[second, c] + by_third * A[third, c]
            k += 3
        else:
            for c in range(n):
                B[bias, c] += factor * A[at, c]
            k += 1


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
    s: Step, C_dt: Float64, couplings: Couplings, keep: Float64, P: Float64, space: StepSpace
) -> None:
    """Carry ``P`` (n, n) over the step: P <- Phi P Phi^T.

    With B = Phi P the result is B Phi^T = (Phi B^T)^T, and it is symmetric: of B^T only the columns of the motion have
    to be carried on. The states behind the motion decay where they stand. P stays symmetric bit for bit.
    """
    n, B, before, after = P.shape[0], space.along, space.before, space.after
    move(s, C_dt, couplings, P, B, n)
    for c in range(n):
        for i in range(N_MOTION):
            before[c, i] = B[i, c]
    move(s, C_dt, couplings, before, after, _ACROSS)
    decay(s.dt, keep, P)
    for c in range(N_MOTION):
        before[CLOCK, c] += s.dt * before[DRIFT, c]
        B[c, CLOCK] += s.dt * B[c, DRIFT]
    for i in range(N_MOTION):
        for c in range(n):
            P[i, c] = keep[c] * B[i, c]
        for c in range(N_MOTION):
            P[i, c] = after[min(i, c), max(i, c)]
    for i in range(N_MOTION, n):
        for c in range(N_MOTION):
            P[i, c] = keep[i] * before[i, c]


@kernel(inline=True)
def decay(dt: float, keep: Float64, P: Float64) -> None:
    """Let the states behind the motion decay in ``P`` (n, n); its rows and columns of the motion are written later."""
    n = P.shape[0]
    still = True
    for i in range(CLOCK, n):
        still = still and keep[i] == 1.0
    for i in range(N_MOTION, n):
        if i < CLOCK or not still:
            for c in range(n):
                P[i, c] *= keep[i] * keep[c]
        else:
            for c in range(N_MOTION, CLOCK):
                P[i, c] *= keep[i] * keep[c]
    for c in range(n):
        P[CLOCK, c] += dt * P[DRIFT, c]
    for i in range(n):
        P[i, CLOCK] += dt * P[i, DRIFT]
