"""The search for the rows that agree, when some of an epoch's observations are false by any amount.

A consensus over minimal subsets (Fischler and Bolles 1981), scored as in Torr and Zisserman (2000): ``_TRIALS`` subsets
of as many rows as unknowns are drawn by a fixed congruential sequence (same input, same bits). Each gives a candidate;
its score is the sum of squared normalised residuals of all rows, each cut at ``_CUT``. The supporters of the best
candidate are fitted together, then rows are dropped and taken in one by one.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.gnss.least_squares import (
    Bool,
    FitRows,
    Workspace,
    copy,
    count,
    covariance,
    fit,
    n_unknowns,
    residual,
    rows_per_clock,
)
from insgnss.jit import kernel
from insgnss.tables import Float64, Int64

# 1000 subsets: with 40 % false rows and 6 unknowns 47 of them are clean; 3 ms, spent only when the plain fit fails
_TRIALS: Final = 1000
_CUT: Final = 5.0  # sigmas; subsets amplify the noise, so it is wider than the gate
_GATE: Final = 4.0  # sigmas of the residual's own deviation: 6e-5 of true rows are lost


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
def _score(rows: FitRows, among: Bool, x: Float64, work: Workspace, near: Bool) -> float:
    """Return the cut sum of squared normalised residuals; mark the rows within the cut in ``near``."""
    total = 0.0
    for k in range(len(among)):
        near[k] = False
        if among[k]:
            normal = abs(residual(rows, k, x, work)) / rows.sigma[k]
            near[k] = normal < _CUT
            total += min(normal * normal, _CUT * _CUT)
    return total


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
def _draw(m: int, members: Int64, state: int, trial: Bool) -> int:
    """Mark ``m`` of the rows ``members`` in ``trial``, all equally likely; return the generator's new state.

    ``members`` is shuffled on the way (Fisher and Yates, the first ``m`` steps).
    """
    for k in range(len(trial)):
        trial[k] = False
    for i in range(m):
        state = state * 48271 % 2147483647  # Park and Miller (1988), fits into 64 bits
        j = i + state % (len(members) - i)
        members[i], members[j] = members[j], members[i]
        trial[members[i]] = True
    return state


@kernel
def polish(rows: FitRows, among: Bool, x: Float64, P: Float64, work: Workspace, use: Bool) -> float:
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
            own = spread(P, work.u, 3 + rows.group[k])
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
def search(
    rows: FitRows, candidates: Bool, start: Float64, work: Workspace, x: Float64, P: Float64, use: Bool
) -> float:
    """Replace ``use`` by the largest agreeing set, ``x`` and ``P`` by its fit; return its chi-square, NaN when none.

    Parameters
    ----------
    rows, candidates : the observations, and which of them may be used
    start : first guess of every fit
    work : scratch
    x, P, use : output
    """
    unknowns = n_unknowns(rows_per_clock(rows, candidates, len(x) - 3))
    members = _places(candidates)
    trial, near = np.zeros(len(use), np.bool_), np.zeros(len(use), np.bool_)
    best, state = math.inf, len(members)  # any positive seed will do
    for _ in range(_TRIALS):
        state = _draw(unknowns, members, state, trial)
        copy(start, x)
        # the subset alone; then, of a better candidate, all its supporters together, which are better still
        while not math.isnan(fit(rows, trial, x, work)):
            score = _score(rows, candidates, x, work, near)
            if not score < best:
                break
            best = score
            for k in range(len(use)):
                trial[k] = near[k]
                use[k] = near[k]
    if best == math.inf:
        return math.nan
    copy(start, x)
    return polish(rows, candidates, x, P, work, use)
