"""Do the rows of an epoch agree, which of them do not, and how far a fault that passes can move the position.

Detection is the weighted chi-square test of the residuals: without a fault sum (residual / sigma)^2 exceeds its limit
with the stated probability of false alarm [Parkinson and Axelrad 1988]. Exclusion looks for the smallest set of rows
without which the others pass: every single row, every pair (both in closed form from one fit), then the consensus of
``robust_fit``. With f redundant rows at most f / 2 are given up: more faults than that can agree among themselves. The
set counts as found when no other of its size explains the residuals nearly as well with another position.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.gnss.dilution import along
from insgnss.gnss.least_squares import (
    CLOCKS,
    FitRows,
    FitWorkspace,
    clock_of,
    copy_into,
    count,
    covariance,
    fit,
    n_unknowns,
    residual,
    rows_per_clock,
)
from insgnss.gnss.point.robust_fit import search
from insgnss.kernels.jit import kernel
from insgnss.tables import Bool, Float64

OK: Final = 0  # tested, and the rows agree
EXCLUDED: Final = 1  # the rows agree without those that were excluded
NOT_IDENTIFIED: Final = 2  # the rows disagree, and the wrong one cannot be identified
UNTESTED: Final = 3  # a solution without a redundant row
TOO_FEW: Final = 4  # fewer rows than unknowns
BAD_GEOMETRY: Final = 5  # singular, or dilution of precision beyond the limit

_TESTABLE: Final = 1e-6  # a row's share of redundancy below it: its error does not show in the residuals


class Redundancy(NamedTuple):
    """Each row's share in the residuals of one fit; scratch, allocated once."""

    S: Float64  # (k, k) I - W^1/2 H P H^T W^1/2
    r: Float64  # (k,) residual / sigma [-]
    A: Float64  # (k, 3) position per unit of the normalised row, P h / sigma [m]
    U: Float64  # (k, 3) lines of sight


class Fits(NamedTuple):
    """The shared data of a log's fits: the test's limits and scratch arrays."""

    limits: Float64  # (k + 1,) limit of chi-square by the number of redundant rows
    work: FitWorkspace
    room: Redundancy


@kernel
def redundancy_room(k: int) -> Redundancy:
    """Return scratch arrays for epochs of at most ``k`` rows."""
    return Redundancy(np.zeros((k, k)), np.zeros(k), np.zeros((k, 3)), np.zeros((k, 3)))


@kernel(apart=True)
def redundancy(
    rows: FitRows, use: Bool, x: Float64, P: Float64, work: FitWorkspace, room: Redundancy
) -> None:
    """Write the redundancy of a fit, ``x`` its solution and ``P`` its covariance.

    Equations: S = I - W^1/2 H P H^T W^1/2, r = W^1/2 (measured - predicted), A = (P H^T W^1/2)^T [Teunissen 2000,
    Testing theory, chapter 4]. Leaving out a set M of rows lowers chi-square by r_M^T S_MM^-1 r_M and moves the
    position by -A_M^T S_MM^-1 r_M, exactly where the rows are linear.
    """
    for k in range(len(use)):
        if not use[k]:
            continue
        room.r[k] = residual(rows, k, x, work) / rows.sigma[k]
        j = CLOCKS + rows.group[k]
        for a in range(3):
            room.U[k, a] = work.u[a]
            value = P[a, j]
            for c in range(3):
                value -= P[a, c] * work.u[c]
            room.A[k, a] = value / rows.sigma[k]
        for i in range(k + 1):
            if use[i]:
                # (P h_k) at the clock of row i, then h_i^T P h_k
                value = P[CLOCKS + rows.group[i], j] / rows.sigma[k]
                for a in range(3):
                    value -= (
                        P[CLOCKS + rows.group[i], a] * work.u[a] / rows.sigma[k] + room.U[i, a] * room.A[k, a]
                    )
                room.S[k, i] = -value / rows.sigma[i]
                room.S[i, k] = room.S[k, i]
        room.S[k, k] += 1.0


@kernel
def _relief(room: Redundancy, a: int, b: int, shift: Float64) -> float:
    """Return by how much chi-square falls without row ``a`` (and ``b`` unless negative), -1 where it is undetermined.

    ``shift`` receives how far the position moves.
    """
    aa = room.S[a, a]
    if not aa > _TESTABLE:
        return -1.0
    y_a, y_b = room.r[a] / aa, 0.0
    if b >= 0:
        bb, ab = room.S[b, b], room.S[a, b]
        determinant = aa * bb - ab * ab
        if not (bb > _TESTABLE and determinant > _TESTABLE * aa * bb):
            return -1.0
        y_a = (bb * room.r[a] - ab * room.r[b]) / determinant
        y_b = (aa * room.r[b] - ab * room.r[a]) / determinant
    for i in range(3):
        shift[i] = -room.A[a, i] * y_a - (room.A[b, i] * y_b if b >= 0 else 0.0)
    relief: float = room.r[a] * y_a + (room.r[b] * y_b if b >= 0 else 0.0)
    return relief


@kernel
def _best(room: Redundancy, use: Bool, size: int) -> tuple[int, int]:
    """Return the row (the second is -1), or the pair, whose absence lowers chi-square most; -1, -1 when none can."""
    best, best_a, best_b = 0.0, -1, -1
    shift = np.zeros(3)
    for a in range(len(use)):
        # a single row has the partner -1 alone
        for b in range(-1 if size == 1 else a + 1, 0 if size == 1 else len(use)):
            if use[a] and (b < 0 or use[b]):
                relief = _relief(room, a, b, shift)
                if relief > best:
                    best, best_a, best_b = relief, a, b
    return best_a, best_b


@kernel
def _has_rival(room: Redundancy, use: Bool, a: int, b: int, margin: float, near: float) -> bool:
    """Return whether another row (pair) lowers chi-square as much but for ``margin`` and ends up farther than ``near``.

    A rival with the same position, as the other one of a constellation's two satellites, is none.
    """
    here, there = np.zeros(3), np.zeros(3)
    best = _relief(room, a, b, here)
    for c in range(len(use)):
        for d in range(-1 if b < 0 else c + 1, 0 if b < 0 else len(use)):
            if use[c] and (d < 0 or use[d]) and _relief(room, c, d, there) > best - margin:
                apart = (here[0] - there[0]) ** 2 + (here[1] - there[1]) ** 2 + (here[2] - there[2]) ** 2
                if apart > near * near:
                    return True
    return False


@kernel
def _position_sigma(P: Float64) -> float:
    return math.sqrt(P[0, 0] + P[1, 1] + P[2, 2])


@kernel
def _drop_lonely(rows: FitRows, offered: Bool, use: Bool, n_clocks: int) -> None:
    """Exclude the last row of a clock that lost others: it says nothing, and which of them was wrong is not known."""
    before, after = rows_per_clock(rows, offered, n_clocks), rows_per_clock(rows, use, n_clocks)
    for k in range(len(use)):
        g = clock_of(rows, k)
        if use[k] and after[g] == 1 and before[g] > 1:
            use[k] = False


@kernel(apart=True)
def swaps_fit(
    rows: FitRows, offered: Bool, use: Bool, x: Float64, margin: float, near: float, fits: Fits
) -> bool:
    """Return whether one excluded row, put back in exchange for another one, fits as well with another position."""
    y, P = x.copy(), np.zeros((len(x), len(x)))
    for k in range(len(use)):
        if not offered[k] or use[k]:
            continue
        use[k] = True
        copy_into(x, y)
        rival = False
        if not math.isnan(fit(rows, use, y, fits.work)):
            covariance(fits.work.N, P)
            redundancy(rows, use, y, P, fits.work, fits.room)
            rival = _has_rival(fits.room, use, k, -1, margin, near)
        use[k] = False
        if rival:
            return True
    return False


@kernel(apart=True)
def few_excluded(rows: FitRows, use: Bool, freedom: int, x: Float64, P: Float64, fits: Fits) -> int:
    """Exclude the one or two rows without which the others agree; return EXCLUDED, NOT_IDENTIFIED or -1 for neither.

    ``x`` and ``P`` are those of the fit of all rows; ``use``, ``x`` and ``P`` change only where such rows are found.
    """
    redundancy(rows, use, x, P, fits.work, fits.room)
    y, offered = x.copy(), use.copy()
    for size in range(1, min(freedom // 2, 2) + 1):
        a, b = _best(fits.room, offered, size)
        if a < 0:
            continue
        use[a] = False
        if b >= 0:
            use[b] = False
        copy_into(x, y)
        total = fit(rows, use, y, fits.work)
        if not math.isnan(total) and total <= fits.limits[freedom - size]:
            copy_into(y, x)
            covariance(fits.work.N, P)
            rival = _has_rival(fits.room, offered, a, b, fits.limits[1], _position_sigma(P))
            _drop_lonely(rows, offered, use, len(x) - CLOCKS)
            return NOT_IDENTIFIED if rival else EXCLUDED
        for k in range(len(use)):
            use[k] = offered[k]
    return -1


@kernel(apart=True)
def many_excluded(
    rows: FitRows, use: Bool, freedom: int, start: Float64, x: Float64, P: Float64, fits: Fits
) -> int:
    """Look for the largest agreeing set; EXCLUDED when it is large enough and no rival is as good."""
    offered, n = use.copy(), count(use)
    total = search(rows, offered, start, fits.work, x, P, use)
    if math.isnan(total):
        return BAD_GEOMETRY
    lost, left = n - count(use), count(use) - n_unknowns(rows_per_clock(rows, use, len(x) - CLOCKS))
    if lost == 0 or 2 * lost > freedom or left < 1 or total > fits.limits[left]:
        return NOT_IDENTIFIED
    rival = swaps_fit(rows, offered, use, x, fits.limits[1], _position_sigma(P), fits)
    _drop_lonely(rows, offered, use, len(x) - CLOCKS)
    return NOT_IDENTIFIED if rival else EXCLUDED


@kernel(apart=True)
def agree(
    rows: FitRows, use: Bool, start: Float64, x: Float64, P: Float64, fits: Fits
) -> tuple[int, float, int]:
    """Fit an epoch's rows, test them, exclude faulty ones; return verdict, test statistic and redundant rows.

    The statistic is the chi-square of all rows offered, infinite where they have no common fit. NOT_IDENTIFIED leaves
    the best there is in ``x``.

    Parameters
    ----------
    rows : the observations of one epoch, all of one kind
    use : (k,) in: rows offered; out: rows in the solution
    start : (CLOCKS + groups,) first guess
    x, P : output: solution and its covariance as the sigmas say, not scaled by the residuals
    fits : limits and scratch
    """
    n, unknowns = count(use), n_unknowns(rows_per_clock(rows, use, len(x) - CLOCKS))
    freedom = n - unknowns
    if n < max(unknowns, 4):
        return TOO_FEW, math.nan, 0
    copy_into(start, x)
    total = fit(rows, use, x, fits.work)
    solved = not math.isnan(total)
    if solved:
        covariance(fits.work.N, P)
        if freedom == 0:
            return UNTESTED, 0.0, 0
        if total <= fits.limits[freedom]:
            return OK, total, freedom
        if freedom == 1:
            return NOT_IDENTIFIED, total, freedom
        verdict = few_excluded(rows, use, freedom, x, P, fits)
        if verdict >= 0:
            return verdict, total, freedom
    if freedom < 2:
        return BAD_GEOMETRY, math.nan, freedom
    verdict = many_excluded(rows, use, freedom, start, x, P, fits)
    return verdict, total if solved else math.inf, freedom


@kernel(apart=True)
def protection_levels(
    use: Bool, room: Redundancy, P: Float64, C_ne: Float64, limit: float, missed_sigmas: float
) -> tuple[float, float]:
    """Return horizontal and vertical protection level [m]: the effect of one undetected fault, plus noise.

    Equation: VPL = max_k slope_k sqrt(T) + K sigma_v, slope_k = |position per unit of test statistic| of a fault in row
    k, T the limit of the chi-square test, K the normal quantile of a missed detection; HPL likewise, its sigma along
    the major axis of the horizontal covariance [Walter and Enge 1995, Weighted RAIM for precision approach].
    Infinite where a row cannot be tested by the others. For a single fault; the sigmas must be true.

    Parameters
    ----------
    use, room, P : rows in the solution, their ``redundancy``, covariance (ECEF)
    C_ne : (3, 3) turns ECEF components into north-east-down ones
    limit, missed_sigmas : T and K
    """
    level, upright = 0.0, 0.0
    for k in range(len(use)):
        if not use[k]:
            continue
        north = C_ne[0, 0] * room.A[k, 0] + C_ne[0, 1] * room.A[k, 1] + C_ne[0, 2] * room.A[k, 2]
        east = C_ne[1, 0] * room.A[k, 0] + C_ne[1, 1] * room.A[k, 1] + C_ne[1, 2] * room.A[k, 2]
        down = C_ne[2, 0] * room.A[k, 0] + C_ne[2, 1] * room.A[k, 1] + C_ne[2, 2] * room.A[k, 2]
        if room.S[k, k] > _TESTABLE:
            level = max(level, (north * north + east * east) / room.S[k, k])
            upright = max(upright, down * down / room.S[k, k])
        elif math.sqrt(north * north + east * east + down * down) > 1e-3 * _position_sigma(P):
            return math.inf, math.inf
    nn, ee, ne = along(P, C_ne, 0, 0), along(P, C_ne, 1, 1), along(P, C_ne, 0, 1)
    major = 0.5 * (nn + ee) + math.sqrt(0.25 * (nn - ee) ** 2 + ne * ne)
    return (
        math.sqrt(level * limit) + missed_sigmas * math.sqrt(major),
        math.sqrt(upright * limit) + missed_sigmas * math.sqrt(along(P, C_ne, 2, 2)),
    )
