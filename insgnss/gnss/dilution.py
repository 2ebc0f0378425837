"""Dilution of precision: the effect of an error of one metre in every range, by the satellites' directions alone."""

from __future__ import annotations

import math
from typing import Final

from insgnss.gnss.least_squares import CLOCKS, FitRows, FitWorkspace, cholesky, clock_of, covariance
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.kernels.jit import kernel
from insgnss.tables import Bool, Float64

DOPS: Final = ("gdop", "pdop", "hdop", "vdop", "tdop")


@kernel(apart=True)
def dilution(
    rows: FitRows, use: Bool, x: Float64, C_ne: Float64, work: FitWorkspace, Q: Float64, dop: Float64
) -> bool:
    """Write GDOP, PDOP, HDOP, VDOP and TDOP; False, and NaN, where the geometry is singular.

    Equation: Q = (H^T H)^-1 with the rows h = (-u, 1 at its clock), PDOP^2 = Q_nn + Q_ee + Q_dd, TDOP^2 = Q_tt of the
    first clock in use, GDOP^2 = PDOP^2 + TDOP^2 [Misra and Enge 2011, section 6.1.2].
    Every row counts, a second band too. A clock is an unknown more: a row alone on its clock changes nothing. Clocks
    that are tied count as one.

    Parameters
    ----------
    rows, use : the pseudoranges of one epoch and which of them are in the solution
    x : (CLOCKS + groups,) position, ECEF [m], then clocks (not needed)
    C_ne : (3, 3) turns ECEF components into north-east-down ones
    work : scratch
    Q : (CLOCKS + groups, CLOCKS + groups) output: (H^T H)^-1, ECEF
    dop : (5,) output
    """
    p, clock = len(Q), len(Q)
    for a in range(p):
        for c in range(p):
            work.N[a, c] = 0.0
    for k in range(len(use)):
        if use[k]:
            line_of_sight_range(rows.sat, k, x, work.u)
            j = CLOCKS + clock_of(rows, k)
            clock = min(clock, j)
            for a in range(3):
                for c in range(a + 1):
                    work.N[a, c] += work.u[a] * work.u[c]
                work.N[j, a] -= work.u[a]
            work.N[j, j] += 1.0
    for j in range(CLOCKS, p):
        if work.N[j, j] == 0.0:
            work.N[j, j] = 1.0
    if clock == p or not cholesky(work.N):
        for i in range(5):
            dop[i] = math.nan
        return False
    covariance(work.N, Q)
    north, east, down = along(Q, C_ne, 0, 0), along(Q, C_ne, 1, 1), along(Q, C_ne, 2, 2)
    time = Q[clock, clock]
    dop[0], dop[1] = math.sqrt(north + east + down + time), math.sqrt(north + east + down)
    dop[2], dop[3], dop[4] = math.sqrt(north + east), math.sqrt(down), math.sqrt(time)
    return True


@kernel
def along(P: Float64, C: Float64, i: int, j: int) -> float:
    """Return element i, j of C P C^T for the first three rows and columns of ``P``."""
    value = 0.0
    for a in range(3):
        for c in range(3):
            value += C[i, a] * P[a, c] * C[j, c]
    return value
