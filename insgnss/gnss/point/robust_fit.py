"""The search for the rows that agree, when some of an epoch's observations are false by any amount.

A consensus over minimal subsets (Fischler and Bolles 1981), scored as in Torr and Zisserman (2000): ``_TRIALS`` subsets
of as many rows as unknowns are drawn by a fixed congruential sequence (same input, same bits). Each gives a candidate;
its score is the sum of squared normalised residuals of all rows, each cut at ``_CUT_SIGMAS``. The supporters of the
best candidate are fitted together, then rows are dropped and taken in one by one.

Almost all subsets are worse than the best one by far. A candidate by the rows linearised at the best position so far
costs a fifth of its fit and shows that; only what comes near the best is fitted. The margins of ``_is_worse`` cover
the effect of the rows' curvature, so that the result is that of fitting every subset.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import C_MPS, WGS84_OMEGA_RADPS
from insgnss.gnss.least_squares import (
    CLOCKS,
    RANGE,
    RANGE_RATE,
    FitRows,
    FitWorkspace,
    clock_of,
    copy_into,
    count,
    covariance,
    fit,
    free_clocks,
    n_unknowns,
    residual,
    rows_per_clock,
)
from insgnss.kernels.jit import kernel
from insgnss.tables import Bool, Float64, Int64

# 1000 subsets: with 40 % false rows and 6 unknowns 47 of them are clean; 3 ms, spent only when the plain fit fails
_TRIALS: Final = 1000
_CUT_SIGMAS: Final = 5.0  # sigmas; subsets amplify the noise, so it is wider than the gate
_GATE: Final = 4.0  # sigmas of the residual's own deviation: 6e-5 of true rows are lost
# A score by linearised rows is worse for certain from factor * best + share * rows on: within 200 m a range bends by
# 1 mm, which a poor subset amplifies to 0.1 m
_NEAR_M: Final = 200.0
_NEAR_FACTOR, _NEAR_SHARE = 1.2, 0.5
# A second step, the rows bent, is exact to a millimetre within 10 km
_SECOND_FACTOR, _SECOND_SHARE, _SECOND_M = 1.01, 0.01, 1e4
_LEAST_DETERMINANT: Final = 1e-9  # relative to the cubed trace: dilution beyond 1e4
# Where rows can be linearised: on the Earth or above it
LOWEST_M, HIGHEST_M = 6.3e6, 1.0e8


class LinearisedRows(NamedTuple):
    """The rows linearised at a position, and scratch for a subset's solution."""

    at: Float64  # (3 + groups,) the position and its clocks
    u: Float64  # (k, 3) derivatives of the rows, along the lines of sight
    bend: Float64  # (k,) second derivative across them, 1 / (2 range) [1/m]
    r: Float64  # (k,) residuals [m, m/s]
    weight: Float64  # (k,) 1 / sigma^2
    step: Float64  # (3 + groups,) of a subset's solution from there
    left: Float64  # (k,) what the subset's rows leave at the step made so far
    sums: Float64  # (groups, 5) over a subset: sum of weight, mean of u, sum of weight left
    adjugate: Float64  # (7,) of its normal matrix: xx, xy, xz, yy, yz, zz; determinant


@kernel
def spread(P: Float64, u: Float64, j: int) -> float:
    """Return h P h^T for the row h = (-u, 1 in column ``j``)."""
    value: float = P[j, j]
    for a in range(3):
        value -= 2.0 * u[a] * P[a, j]
        for c in range(3):
            value += u[a] * u[c] * P[a, c]
    return value


@kernel
def _score(rows: FitRows, among: Bool, x: Float64, work: FitWorkspace, near: Bool) -> float:
    """Return the cut sum of squared normalised residuals; mark the rows within the cut in ``near``."""
    total = 0.0
    for k in range(len(among)):
        near[k] = False
        if among[k]:
            normal = abs(residual(rows, k, x, work)) / rows.sigma[k]
            near[k] = normal < _CUT_SIGMAS
            total += min(normal * normal, _CUT_SIGMAS * _CUT_SIGMAS)
    return total


@kernel
def _linear(k: int, p: int) -> LinearisedRows:
    return LinearisedRows(
        np.zeros(p),
        np.zeros((k, 3)),
        np.zeros(k),
        np.zeros(k),
        np.zeros(k),
        np.zeros(p),
        np.zeros(k),
        np.zeros((p - CLOCKS, 5)),
        np.zeros(7),
    )


@kernel
def _linearise(rows: FitRows, among: Bool, x: Float64, work: FitWorkspace, linear: LinearisedRows) -> bool:
    """Write the rows linearised at ``x``; return whether that can be done there."""
    size = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    if not (size < HIGHEST_M and (rows.kind == RANGE_RATE or size > LOWEST_M)):
        return False
    copy_into(x, linear.at)
    for k in range(len(among)):
        if among[k]:
            linear.r[k] = residual(rows, k, x, work)
            linear.weight[k] = 1.0 / (rows.sigma[k] * rows.sigma[k])
            turn = 0.0
            if rows.kind == RANGE:
                x_s, y_s, z_s = rows.sat[k, 0], rows.sat[k, 1], rows.sat[k, 2]
                # the Earth turns more while the signal travels longer
                turn = WGS84_OMEGA_RADPS / C_MPS * (work.u[0] * y_s - work.u[1] * x_s)
                linear.bend[k] = 0.5 / math.sqrt((x_s - x[0]) ** 2 + (y_s - x[1]) ** 2 + (z_s - x[2]) ** 2)
            for a in range(3):
                linear.u[k, a] = work.u[a] / (1.0 - turn)
    return True


@kernel
def _normal_matrix(group: Int64, members: Int64, m: int, linear: LinearisedRows) -> bool:
    """Write the adjugate of a subset's normal matrix, its clocks eliminated; False when it is close to singular.

    Equation: sum w (u - mean u)(u - mean u)^T, the means over the rows of one clock.
    """
    sums = linear.sums
    for g in range(len(sums)):
        for a in range(4):
            sums[g, a] = 0.0
    for n in range(m):
        k = members[n]
        g, w = group[k], linear.weight[k]
        sums[g, 0] += w
        for a in range(3):
            sums[g, 1 + a] += w * linear.u[k, a]
    for g in range(len(sums)):
        if sums[g, 0] > 0.0:
            share = 1.0 / sums[g, 0]
            for a in range(1, 4):
                sums[g, a] *= share
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(m):
        k = members[n]
        g, w = group[k], linear.weight[k]
        x = linear.u[k, 0] - sums[g, 1]
        y = linear.u[k, 1] - sums[g, 2]
        z = linear.u[k, 2] - sums[g, 3]
        xx, xy, xz = xx + w * x * x, xy + w * x * y, xz + w * x * z
        yy, yz, zz = yy + w * y * y, yz + w * y * z, zz + w * z * z
    J = linear.adjugate
    J[0], J[1], J[2] = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    J[3], J[4], J[5] = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    J[6] = xx * J[0] + xy * J[1] + xz * J[2]
    return bool(J[6] > _LEAST_DETERMINANT * (xx + yy + zz) ** 3)


@kernel
def _add_step(group: Int64, members: Int64, m: int, linear: LinearisedRows) -> None:
    """Add to the step what the least squares of the subset's ``left`` ask for, clocks included.

    Equation: min sum w (left + u dx - c_g)^2, c_g = mean(left + u dx).
    """
    sums, step, J = linear.sums, linear.step, linear.adjugate
    for g in range(len(sums)):
        sums[g, 4] = 0.0
    for n in range(m):
        k = members[n]
        sums[group[k], 4] += linear.weight[k] * linear.left[k]
    bx, by, bz = 0.0, 0.0, 0.0
    for n in range(m):
        k = members[n]
        g = group[k]
        e = linear.weight[k] * (sums[g, 4] / sums[g, 0] - linear.left[k])
        bx += e * (linear.u[k, 0] - sums[g, 1])
        by += e * (linear.u[k, 1] - sums[g, 2])
        bz += e * (linear.u[k, 2] - sums[g, 3])
    x = (J[0] * bx + J[1] * by + J[2] * bz) / J[6]
    y = (J[1] * bx + J[3] * by + J[4] * bz) / J[6]
    z = (J[2] * bx + J[4] * by + J[5] * bz) / J[6]
    step[0], step[1], step[2] = step[0] + x, step[1] + y, step[2] + z
    for g in range(len(sums)):
        if sums[g, 0] > 0.0:
            along = sums[g, 1] * x + sums[g, 2] * y + sums[g, 3] * z
            step[CLOCKS + g] += sums[g, 4] / sums[g, 0] + along


@kernel
def _left(k: int, group: Int64, bent: bool, linear: LinearisedRows) -> float:
    """Return the residual of row ``k`` after the step, its range linear, or to second order (``bent``).

    Equation: r + u dx - (|dx|^2 - (u dx)^2) / (2 rho) - c.
    """
    x, y, z = linear.step[0], linear.step[1], linear.step[2]
    along = linear.u[k, 0] * x + linear.u[k, 1] * y + linear.u[k, 2] * z
    left: float = linear.r[k] + along - linear.step[CLOCKS + group[k]]
    if bent:
        left -= linear.bend[k] * (x * x + y * y + z * z - along * along)
    return left


@kernel
def _linear_score(group: Int64, members: Int64, bent: bool, linear: LinearisedRows, limit: float) -> float:
    """Return the cut sum of squared normalised residuals after the step, or something beyond ``limit``."""
    total = 0.0
    # the subset's own rows stand first and fit: those that may not stand last
    for n in range(len(members) - 1, -1, -1):
        k = members[n]
        left = _left(k, group, bent, linear)
        total += min(left * left * linear.weight[k], _CUT_SIGMAS * _CUT_SIGMAS)
        if total > limit:
            break
    return total


@kernel
def _is_worse(
    rows: FitRows, members: Int64, m: int, start: Float64, best: float, linear: LinearisedRows
) -> bool:
    """Return whether the candidate of the first ``m`` members scores worse than ``best`` for certain.

    Otherwise ``linear.step`` leads to the candidate, or is NaN where it is undetermined. A clock without a row in the
    subset stays as in ``start``.
    """
    step, n = linear.step, len(members)
    if not _normal_matrix(rows.group, members, m, linear):
        step[0] = math.nan
        return False
    for j in range(len(step)):
        step[j] = 0.0 if j < CLOCKS or linear.sums[j - CLOCKS, 0] > 0.0 else start[j] - linear.at[j]
    for i in range(m):
        linear.left[members[i]] = linear.r[members[i]]
    _add_step(rows.group, members, m, linear)
    size2 = step[0] * step[0] + step[1] * step[1] + step[2] * step[2]
    limit = _NEAR_FACTOR * best + _NEAR_SHARE * n
    if size2 < _NEAR_M * _NEAR_M and _linear_score(rows.group, members, False, linear, limit) > limit:
        return True
    if not size2 < _SECOND_M * _SECOND_M:
        step[0] = math.nan
        return False
    for i in range(m):
        linear.left[members[i]] = _left(members[i], rows.group, True, linear)
    _add_step(rows.group, members, m, linear)
    limit = _SECOND_FACTOR * best + _SECOND_SHARE * n
    return _linear_score(rows.group, members, True, linear, limit) > limit


@kernel
def _places(flags: Bool) -> Int64:
    """Return the indices of the flags that are set."""
    places = np.zeros(count(flags), np.int64)
    n = 0
    for k in range(len(flags)):
        if flags[k]:
            places[n] = k
            n += 1
    return places


@kernel
def _draw(m: int, members: Int64, state: int) -> int:
    """Put ``m`` of the rows ``members`` first, all equally likely; return the generator's new state.

    ``members`` is shuffled on the way (Fisher and Yates, the first ``m`` steps).
    """
    for i in range(m):
        state = state * 48271 % 2147483647  # Park and Miller (1988), fits into 64 bits
        j = i + state % (len(members) - i)
        members[i], members[j] = members[j], members[i]
    return state


@kernel(apart=True)
def polish(rows: FitRows, among: Bool, x: Float64, P: Float64, work: FitWorkspace, use: Bool) -> float:
    """Take in or drop the row that deserves it most until nothing changes; return chi-square, NaN when singular.

    A row in use is dropped when its residual exceeds the gate times its deviation sqrt(s^2 - h P h^T); one left
    out returns when it lies within the gate of sqrt(s^2 + h P h^T). A row dropped once does not return again.
    """
    allowed = among.copy()
    while True:
        total = fit(rows, use, x, work)
        if math.isnan(total):
            return total
        covariance(work.N, P)
        worst, worst_k, closest, closest_k = _GATE, -1, _GATE, -1
        for k in range(len(use)):
            if not (use[k] or allowed[k]):
                continue
            misfit = abs(residual(rows, k, x, work))
            variance = rows.sigma[k] * rows.sigma[k]
            own = spread(P, work.u, CLOCKS + rows.group[k])
            if use[k] and variance - own > 1e-6 * variance:
                normal = misfit / math.sqrt(variance - own)
                if normal > worst:
                    worst, worst_k = normal, k
            elif not use[k]:
                normal = misfit / math.sqrt(variance + own)
                if normal < closest:
                    closest, closest_k = normal, k
        if worst_k >= 0:
            use[worst_k] = allowed[worst_k] = False
        elif closest_k >= 0:
            use[closest_k] = True
        else:
            return total


@kernel
def _without_ties(rows: FitRows, n_clocks: int) -> FitRows:
    """Return the rows with one clock for those that are tied, whose difference widens the sigma."""
    group, sigma = rows.group.copy(), rows.sigma.copy()
    for k in range(len(group)):
        group[k] = clock_of(rows, k)
        if group[k] != rows.group[k]:
            sigma[k] = math.sqrt(sigma[k] * sigma[k] + 1.0 / rows.ties.weight)
    return FitRows(rows.kind, rows.sat, rows.measured, sigma, group, free_clocks(n_clocks), rows.r_e)


@kernel(apart=True)
def search(
    rows: FitRows, candidates: Bool, start: Float64, work: FitWorkspace, x: Float64, P: Float64, use: Bool
) -> float:
    """Replace ``use`` by the largest agreeing set, ``x`` and ``P`` by its fit; return its chi-square, NaN when none.

    The subsets share one clock among tied ones; the last fit, which drops and takes in, has them all.

    Parameters
    ----------
    rows, candidates : the observations, and which of them may be used
    start : first guess of every fit
    work : scratch
    x, P, use : output
    """
    tied, rows = rows, _without_ties(rows, len(x) - CLOCKS)
    unknowns = n_unknowns(rows_per_clock(rows, candidates, len(x) - CLOCKS))
    members = _places(candidates)
    trial, near = np.zeros(len(use), np.bool_), np.zeros(len(use), np.bool_)
    best, state = math.inf, len(members)  # any positive seed will do
    linear, is_linear = _linear(len(use), len(x)), False
    for _ in range(_TRIALS):
        state = _draw(unknowns, members, state)
        copy_into(start, x)
        if is_linear:
            if _is_worse(rows, members, unknowns, start, best, linear):
                continue
            if not math.isnan(linear.step[0]):
                for j in range(len(x)):
                    x[j] = linear.at[j] + linear.step[j]
        for k in range(len(trial)):
            trial[k] = False
        for i in range(unknowns):
            trial[members[i]] = True
        # the subset alone; then, of a better candidate, all its supporters together, which are better still
        while not math.isnan(fit(rows, trial, x, work)):
            score = _score(rows, candidates, x, work, near)
            if not score < best:
                break
            best = score
            is_linear = _linearise(rows, candidates, x, work, linear)
            for k in range(len(use)):
                trial[k] = near[k]
                use[k] = near[k]
    if best == math.inf:
        return math.nan
    copy_into(start, x)
    return polish(tied, candidates, x, P, work, use)
