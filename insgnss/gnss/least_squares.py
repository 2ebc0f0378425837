"""Weighted least squares over the rows of one epoch: position from pseudoranges, or velocity from range rates.

The unknowns are three components and one clock per group; every row has the derivative (-u, 1). Two clocks may be tied:
their difference is zero with a known sigma and counts as no further unknown. Gauss-Newton with a Cholesky factor; no
matrix is inverted but for the covariance at the end. Vectors are filled and copied by loops: slices take Numba long to
compile.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.gnss.line_of_sight import line_of_sight, line_of_sight_range
from insgnss.gnss.measurement_kinds import PSEUDORANGE
from insgnss.gnss.measurement_kinds import RANGE_RATE as RANGE_RATE
from insgnss.kernels.jit import kernel
from insgnss.tables import Bool, Float64, Int64

CLOCKS: Final = 3  # where the clocks, or the drift, stand among the unknowns
RANGE: Final = PSEUDORANGE

_MOST_STEPS: Final = 20  # Gauss-Newton needs 5 to 6 from the Earth's centre
_CONVERGED: Final = 1e-5  # last step [m, m/s]; the next one would be smaller by 1e5
_LOST: Final = 1e12  # a step beyond it leads nowhere
_SINGULAR: Final = 1e-10  # a pivot this small beside its diagonal: dilution beyond 1e5


class Ties(NamedTuple):
    """Which clocks are known to be equal."""

    home: Int64  # (g,) the clock before it to which a clock is tied, else -1
    weight: float  # 1 / variance of their difference [1/m^2]


class FitRows(NamedTuple):
    """The observations of one epoch, all of one kind."""

    kind: int  # RANGE or RANGE_RATE
    sat: Float64  # (n, >= 6) satellites, ECEF at transmission
    measured: Float64  # (n,) corrected for everything but geometry and receiver clock [m, m/s]
    sigma: Float64  # (n,)
    group: Int64  # (n,) clock of the row
    ties: Ties
    r_e: Float64  # (3,) antenna position for RANGE_RATE [m]


class FitWorkspace(NamedTuple):
    """Scratch arrays of one fit, allocated once."""

    u: Float64  # (3,)
    g: Float64  # (3,)
    N: Float64  # (p, p) normal matrix, then its lower Cholesky factor
    b: Float64  # (p,)


@kernel
def fill(target: Float64, value: float) -> None:
    """Set a vector to one value (a loop: slices take Numba long to compile)."""
    for i in range(len(target)):
        target[i] = value


@kernel
def copy_into(source: Float64, target: Float64) -> None:
    """Copy a vector of numbers."""
    for i in range(len(source)):
        target[i] = source[i]


@kernel
def count(flags: Bool) -> int:
    """Return how many flags are set."""
    total = 0
    for k in range(len(flags)):
        if flags[k]:
            total += 1
    return total


@kernel
def free_clocks(n: int) -> Ties:
    """Return ``n`` clocks of which none is tied."""
    return Ties(np.full(n, -1, np.int64), 0.0)


@kernel
def workspace(p: int) -> FitWorkspace:
    """Return scratch arrays for ``p`` unknowns."""
    return FitWorkspace(np.zeros(3), np.zeros(3), np.zeros((p, p)), np.zeros(p))


@kernel
def residual(rows: FitRows, k: int, x: Float64, work: FitWorkspace) -> float:
    """Return measured minus predicted of row ``k``; the line of sight is left in ``work.u``."""
    if rows.kind == RANGE:
        predicted = line_of_sight_range(rows.sat, k, x, work.u)
    else:
        _, predicted = line_of_sight(rows.sat, k, rows.r_e, x, work.u, work.g)
    misfit: float = rows.measured[k] - predicted - x[CLOCKS + rows.group[k]]
    return misfit


@kernel
def _add_row(N: Float64, u: Float64, j: int, weight: float) -> None:
    """Add weight h h^T of the row h = (-u, 1 in column ``j``) to the lower triangle of ``N``."""
    for a in range(3):
        for c in range(a + 1):
            N[a, c] += weight * u[a] * u[c]
        N[j, a] -= weight * u[a]
    N[j, j] += weight


@kernel
def normal_matrix(rows: FitRows, use: Bool, x: Float64, work: FitWorkspace) -> float:
    """Build N = H^T W H and b = H^T W residual in ``work``; return chi-square, the sum of (residual / sigma)^2.

    The clock of a group without a row gets a unit diagonal, so that it stays as it is.
    """
    for a in range(len(work.b)):
        work.b[a] = 0.0
        for c in range(a + 1):
            work.N[a, c] = 0.0
    total = 0.0
    for k in range(len(use)):
        if not use[k]:
            continue
        weight = 1.0 / (rows.sigma[k] * rows.sigma[k])
        misfit = residual(rows, k, x, work)
        total += weight * misfit * misfit
        j = CLOCKS + rows.group[k]
        _add_row(work.N, work.u, j, weight)
        for a in range(3):
            work.b[a] -= weight * misfit * work.u[a]
        work.b[j] += weight * misfit
    total += _tie_clocks(rows.ties, x, work)
    for j in range(CLOCKS, len(work.b)):
        if work.N[j, j] == 0.0:
            work.N[j, j] = 1.0
    return total


@kernel
def _tie_clocks(ties: Ties, x: Float64, work: FitWorkspace) -> float:
    """Add the tied clocks' differences to the normal matrix; return their part of chi-square."""
    total = 0.0
    for g in range(len(ties.home)):
        i, j = CLOCKS + ties.home[g], CLOCKS + g
        if i < 3 or (work.N[i, i] == 0.0 and work.N[j, j] == 0.0):
            continue
        apart = x[j] - x[i]
        work.N[i, i] += ties.weight
        work.N[j, j] += ties.weight
        work.N[j, i] -= ties.weight
        work.b[i] += ties.weight * apart
        work.b[j] -= ties.weight * apart
        total += ties.weight * apart * apart
    return total


@kernel
def cholesky(N: Float64) -> bool:
    """Replace the lower triangle of ``N`` by its Cholesky factor; False when it is singular."""
    for j in range(len(N)):
        diagonal = N[j, j]
        for c in range(j):
            N[j, j] -= N[j, c] * N[j, c]
        if not N[j, j] > _SINGULAR * diagonal:
            return False
        N[j, j] = math.sqrt(N[j, j])
        for i in range(j + 1, len(N)):
            for c in range(j):
                N[i, j] -= N[i, c] * N[j, c]
            N[i, j] /= N[j, j]
    return True


@kernel
def cholesky_solve(L: Float64, b: Float64) -> None:
    """Replace ``b`` by the solution of L L^T x = b."""
    p = len(b)
    for i in range(p):
        for c in range(i):
            b[i] -= L[i, c] * b[c]
        b[i] /= L[i, i]
    for i in range(p - 1, -1, -1):
        for c in range(i + 1, p):
            b[i] -= L[c, i] * b[c]
        b[i] /= L[i, i]


@kernel(apart=True)
def fit(rows: FitRows, use: Bool, x: Float64, work: FitWorkspace) -> float:
    """Solve for ``x`` (in and out) by Gauss-Newton over the rows in use; return chi-square, NaN when there is none.

    NaN means a singular geometry or steps that do not converge. Else ``work.N`` holds the Cholesky factor of
    the normal matrix.
    """
    for _ in range(_MOST_STEPS):
        total = normal_matrix(rows, use, x, work)
        if not cholesky(work.N):
            return math.nan
        cholesky_solve(work.N, work.b)
        largest = 0.0
        for j in range(len(x)):
            if not abs(work.b[j]) < _LOST:
                return math.nan
            x[j] += work.b[j]
            largest = max(largest, abs(work.b[j]))
        if largest < _CONVERGED:
            return total
    return math.nan


@kernel
def covariance(L: Float64, P: Float64) -> None:
    """Write the inverse of L L^T into ``P``."""
    for j in range(len(P)):
        fill(P[j], 0.0)
        P[j, j] = 1.0
        cholesky_solve(L, P[j])  # symmetric: a row serves as the column


@kernel
def rows_per_clock(rows: FitRows, use: Bool, n_clocks: int) -> Int64:
    """Return the number of rows in use of each clock, tied clocks counted as one."""
    rows_of = np.zeros(n_clocks, np.int64)
    for k in range(len(use)):
        if use[k]:
            rows_of[clock_of(rows, k)] += 1
    return rows_of


@kernel
def clock_of(rows: FitRows, k: int) -> int:
    """Return the clock of row ``k``, of tied ones the first."""
    group = rows.group[k]
    home = rows.ties.home[group]
    return int(home if home >= 0 else group)


@kernel
def n_unknowns(rows_of: Int64) -> int:
    """Return 3 + the number of clocks that have a row."""
    unknowns = 3
    for j in range(len(rows_of)):
        if rows_of[j] > 0:
            unknowns += 1
    return unknowns
