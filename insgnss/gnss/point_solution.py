"""Robust single-point position and velocity from one epoch: what starts a filter, and what restarts it.

A plain weighted fit is tested by its chi-square (false alarm 1e-4). If it fails, ``robust_fit`` searches for the
largest agreeing set. With n rows and p unknowns up to (n - p) / 2 rows are given up, and one redundant row must
remain, else the epoch is inconsistent: five satellites and four unknowns show a fault without telling which.

The steps are compiled, the decisions between them are not: the search's compilation waits for the first bad epoch.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.gnss.least_squares import (
    RANGE,
    RANGE_RATE,
    Bool,
    FitRows,
    Ties,
    Workspace,
    chi_square_limit,
    copy,
    count,
    covariance,
    fill,
    fit,
    free_clocks,
    n_unknowns,
    rows_per_clock,
    workspace,
)
from insgnss.gnss.robust_fit import search
from insgnss.tables import Float64, Int64

SOLVED: Final = 0  # and tested: there is redundancy
UNCHECKED: Final = 1  # solved, with no redundant row to test it
TOO_FEW: Final = 2  # fewer rows than unknowns
BAD_GEOMETRY: Final = 3  # singular, or dilution of precision beyond the limit
INCONSISTENT: Final = 4  # rows contradict each other and no agreeing set is large enough


def _drop_unusable(rows: FitRows, use: Bool) -> None:
    """Clear ``use`` where a row cannot be computed with."""
    columns = 6 if rows.kind == RANGE_RATE else 3
    for k in range(len(use)):
        good = math.isfinite(rows.measured[k]) and math.isfinite(rows.sigma[k]) and rows.sigma[k] > 0.0
        for j in range(columns):
            good = good and math.isfinite(rows.sat[k, j])
        use[k] = use[k] and good


def _forget_clocks(rows: FitRows, use: Bool, x: Float64, P: Float64) -> None:
    """Make the clocks without a row, and their covariances, NaN."""
    rows_of = np.bincount(rows.group[use], minlength=len(x) - 3)
    for j in range(3, len(x)):
        if rows_of[j - 3] == 0:
            x[j] = math.nan
            for i in range(len(x)):
                P[i, j] = math.nan
                P[j, i] = math.nan


def _agreeing(
    rows: FitRows, use: Bool, start: Float64, work: Workspace, x: Float64, P: Float64
) -> tuple[int, float]:
    """Fit all rows, then, if they disagree, the largest set that does not; return status and chi-square."""
    n = count(use)
    unknowns = n_unknowns(rows_per_clock(rows, use, len(x) - 3))
    if n < max(unknowns, 4):
        return TOO_FEW, math.nan
    offered = use.copy()
    copy(start, x)
    total = fit(rows, use, x, work)
    if not math.isnan(total):
        covariance(work.N, P)
        if n == unknowns:
            return UNCHECKED, 0.0
        if total <= chi_square_limit(n - unknowns):
            return SOLVED, total
    total = search(rows, offered, start, work, x, P, use) if n > unknowns else math.nan
    if math.isnan(total):
        return BAD_GEOMETRY, total
    kept, left = count(use), n_unknowns(rows_per_clock(rows, use, len(x) - 3))
    enough = kept > left and 2 * (n - kept) <= n - unknowns
    return SOLVED if enough and total <= chi_square_limit(kept - left) else INCONSISTENT, total


def _dilution(rows: FitRows, use: Bool, P: Float64) -> float:
    """Return the dilution of precision of the three components and the first clock in use.

    Equation: sqrt(P_xx + P_yy + P_zz + P_tt) / sigma with 1 / sigma^2 the mean of the rows' own: GDOP where all rows
    are equally good, and rows of large sigma count as little for the geometry as they do for the fit.
    """
    clock, weight = len(P), 0.0
    for k in range(len(use)):
        if use[k]:
            clock = min(clock, 3 + rows.group[k])
            weight += 1.0 / (rows.sigma[k] * rows.sigma[k])
    return math.sqrt((P[0, 0] + P[1, 1] + P[2, 2] + P[clock, clock]) * weight / count(use))


def _finish(
    rows: FitRows, use: Bool, gdop_limit: float, status: int, total: float, x: Float64, P: Float64
) -> int:
    """Judge the geometry, scale the covariance by chi-square over its freedom, forget clocks without a row."""
    if status != TOO_FEW and status != BAD_GEOMETRY and not _dilution(rows, use, P) <= gdop_limit:
        status = BAD_GEOMETRY
    if status == TOO_FEW or status == BAD_GEOMETRY:
        fill(x, math.nan)
        for i in range(len(x)):
            fill(P[i], math.nan)
        return status
    rows_of = rows_per_clock(rows, use, len(x) - 3)
    factor = max(total / max(count(use) - n_unknowns(rows_of), 1), 1.0)
    for i in range(len(x)):
        for j in range(len(x)):
            P[i, j] *= factor
    _forget_clocks(rows, use, x, P)
    return status


def point_position(
    sat: Float64,
    pseudorange: Float64,
    sigma: Float64,
    group: Int64,
    use: Bool,
    r_guess: Float64,
    gdop_limit: float,
    x: Float64,
    P: Float64,
    ties: Ties | None = None,
) -> int:
    """Return the status of a position fix from one epoch of pseudoranges; light time and Sagnac are inside.

    SOLVED and UNCHECKED give a position; INCONSISTENT leaves the best there is in ``x`` for the curious; else NaN.

    Parameters
    ----------
    sat : (n, >= 3) satellites, ECEF at transmission [m]
    pseudorange : (n,) corrected for the satellite clock, and for the atmosphere if it is known yet [m]
    sigma : (n,) of each, with all that is not corrected: too small a sigma makes the epoch inconsistent [m]
    group : (n,) clock of the row's constellation, 0 .. n_groups - 1
    use : (n,) in: rows that may be used; out: rows in the solution
    r_guess : (3,) first guess, ECEF [m]; zeros (the Earth's centre) do below 10 000 km of height
    gdop_limit : largest dilution of precision of position and one clock; 30 is usual
    x : (3 + n_groups,) output: position, ECEF [m], and each group's clock [m], NaN for a group without rows
    P : (3 + n_groups, 3 + n_groups) output: covariance, scaled by chi-square over its freedom where that is above 1
    ties : clocks that are known to be alike; none are when left out
    """
    ties = free_clocks(len(x) - 3) if ties is None else ties
    start = np.zeros(len(x))
    for j in range(3):
        start[j] = r_guess[j] if math.isfinite(r_guess[j]) else 0.0
    rows = FitRows(RANGE, sat, pseudorange, sigma, group, ties, start)
    _drop_unusable(rows, use)
    status, total = _agreeing(rows, use, start, workspace(len(x)), x, P)
    return _finish(rows, use, gdop_limit, status, total, x, P)


def point_velocity(
    sat: Float64,
    range_rate: Float64,
    sigma: Float64,
    use: Bool,
    r_e: Float64,
    gdop_limit: float,
    x: Float64,
    P: Float64,
) -> int:
    """Return the status of a velocity fix from one epoch of range rates, by the same search as the position.

    Parameters
    ----------
    sat : (n, >= 6) satellites, ECEF at transmission [m, m/s]
    range_rate : (n,) corrected for the satellite clock's drift [m/s]
    sigma : (n,) of each [m/s]
    use : (n,) in: rows that may be used; out: rows in the solution
    r_e : (3,) antenna position, ECEF [m]; 1 km of error makes 0.15 m/s times the dilution
    gdop_limit : largest dilution of precision of velocity and clock drift
    x : (4,) output: velocity, ECEF [m/s], and clock drift [m/s], one for all constellations
    P : (4, 4) output: covariance, scaled as in ``point_position``
    """
    one_clock = np.zeros(len(use), np.int64)
    rows = FitRows(RANGE_RATE, sat, range_rate, sigma, one_clock, free_clocks(1), r_e)
    _drop_unusable(rows, use)
    status, total = _agreeing(rows, use, np.zeros(len(x)), workspace(len(x)), x, P)
    return _finish(rows, use, gdop_limit, status, total, x, P)
