"""Which rows of an epoch contradict the others: a search over subsets, bounded in cost, compiled.

Taking out the row that stands out most, again and again, fails where several are wrong at once: under a wide prior
three wrong rows of twelve pull the solution so far that in one case of four a sound row stands out most. Here all sets
of one, two and three rows are compared, the smallest that leaves the others in agreement wins, and what then agrees
with those is taken back. Nothing is used beyond the epoch's innovations and their covariance at the prior.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.update.scalar_update import covariance_with, predicted_variance
from insgnss.kernels.jit import kernel
from insgnss.status import INCONSISTENT, USED
from insgnss.tables import Float64, Int64

LEAST_WITNESSES: Final = 6  # fewer rows cannot show which of them is wrong
LEAST_REDUNDANCY: Final = 0.1  # of a residual's variance over the row's: below, a residual says nothing
_LARGEST_SET: Final = 3
_MOST_CANDIDATES: Final = 20  # rows that stand out most: 1140 sets of three
_NONE: Final = -1


@kernel(inline=True)
def disagrees(P: Float64, lines: Lines, kind: int, correction: Float64, gate2: float, spread: float) -> bool:
    """Return whether a used row's residual after the update may be beyond the gate.

    Equation: e = z - h x+, var e >= (spread r - h P+ h^T) / spread, the update having taken r ``spread`` times
    """
    beyond = False
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        if line.status[kind] != USED:
            continue
        h, columns = line.h[kind], line.columns[kind][: line.count[kind]]
        residual = line.innovation[kind]
        for a in range(columns.shape[0]):
            residual -= h[a] * correction[columns[a]]
        r = line.variance[kind]
        # most rows are far from the gate, whatever their redundancy
        if residual * residual > gate2 * LEAST_REDUNDANCY * r:
            variance = residual_variance(r, predicted_variance(P, h, columns) / spread)
            beyond = beyond or residual * residual > gate2 * variance
    return beyond


@kernel(inline=True)
def residual_variance(variance: float, explained: float) -> float:
    """Return the variance of a residual: what a row's own has beyond what is explained, a tenth of it at least."""
    return max(variance - explained, LEAST_REDUNDANCY * variance)


@kernel(apart=True)
def refuse_inconsistent(P: Float64, lines: Lines, kind: int, gate2: float) -> int:
    """Mark the rows of a kind that the others contradict, a third of them at most; return how many.

    Equation: with the innovations y of covariance S = H P H^T + R at the prior and W = S^-1, a row's distance from all
    others is w^2 = (W y)_j^2 / W_jj; a set's (W y)_J^T W_JJ^-1 (W y)_J is by how much y^T W y falls without it
                                                                                   [Baarda 1968; Teunissen 2000, ch. 4]
    It allocates its work space: only an epoch that ``disagrees`` comes here. If a variance of S is not positive and
    finite, no row can be judged and none is marked.
    """
    index = np.empty(lines.shape[0], np.int64)
    n = used_rows(lines, kind, index)
    active = np.ones(n, np.int64)
    removed, _ = leave_contradicted(P, lines, kind, index[:n], active, gate2)
    for a in range(n):
        if active[a] == 0:
            lines[index[a]].status[kind] = INCONSISTENT
    return removed


@kernel(apart=True)
def few_are_wrong(P: Float64, lines: Lines, kind: int, gate2: float) -> bool:
    """Return whether the used rows of a kind, but for a third of them at most, agree with each other and the prior."""
    index = np.empty(lines.shape[0], np.int64)
    n = used_rows(lines, kind, index)
    return bool(leave_contradicted(P, lines, kind, index[:n], np.ones(n, np.int64), gate2)[1])


@kernel(inline=True)
def used_rows(lines: Lines, kind: int, index: Int64) -> int:
    """Write the indices of the used rows of a kind; return how many there are."""
    n = 0
    for j in range(lines.shape[0]):
        if lines[j].status[kind] == USED:
            index[n] = j
            n += 1
    return n


@kernel(apart=True)
def leave_contradicted(
    P: Float64, lines: Lines, kind: int, index: Int64, active: Int64, gate2: float
) -> tuple[int, bool]:
    """Clear ``active`` where a row of ``index`` is contradicted; return how many, and whether the others agree then."""
    n = index.shape[0]
    if n < LEAST_WITNESSES:
        return 0, False
    T = np.empty((n, n + 1))
    write_innovations(T, P, lines, kind, index)
    for j in range(n):
        if not exchange(T, j):
            return 0, False
    most, removed = n // 3, 0
    while removed < most and farthest(T, active, 1)[1] > gate2:
        size = remove_smallest_set(T, active, gate2, most - removed)
        if size == 0:
            active[:] = 1
            return 0, False
        removed += size
    agree = farthest(T, active, 1)[1] <= gate2
    for _ in range(removed):
        nearest, distance2 = farthest(T, active, 0)
        if nearest == _NONE or distance2 > gate2 or not exchange(T, nearest):
            break
        active[nearest] = 1
        removed -= 1
    return removed, agree


@kernel(inline=True)
def write_innovations(T: Float64, P: Float64, lines: Lines, kind: int, index: Int64) -> None:
    """Write S and behind it y of the rows ``index`` (n,) into ``T`` (n, n + 1)."""
    n, with_row = index.shape[0], np.empty(P.shape[0])
    for a in range(n):
        one = lines[index[a]]
        covariance_with(P, one.h[kind], one.columns[kind][: one.count[kind]], with_row)
        for b in range(a + 1):
            other = lines[index[b]]
            total = one.variance[kind] if a == b else 0.0
            for i in range(other.count[kind]):
                total += other.h[kind, i] * with_row[other.columns[kind, i]]
            T[a, b] = total
            T[b, a] = total
        T[a, n] = one.innovation[kind]


@kernel(inline=True)
def is_variance(value: float) -> bool:
    """Return whether a number can be divided by as a variance: positive and finite, which NaN is not."""
    return 0.0 < value < math.inf


@kernel
def exchange(T: Float64, j: int) -> bool:
    """Take row ``j`` into the set A of active rows, or out of it again: a step of Gauss and Jordan, its own inverse.

    Within A then stand S_AA^-1 and S_AA^-1 y_A; outside, S and y conditioned on the rows of A. The pivot is a
    variance, or the inverse of one; of any other nothing is changed, and the answer is no.
    """
    n, width = T.shape
    pivot = T[j, j]
    if not is_variance(pivot):
        return False
    for c in range(width):
        T[j, c] /= pivot
    T[j, j] = 1.0 / pivot
    for i in range(n):
        if i != j:
            share = T[i, j]
            for c in range(width):  # without a branch the compiler vectorises this loop
                T[i, c] -= share * T[j, c]
            T[i, j] = -share / pivot
    return True


@kernel
def farthest(T: Float64, active: Int64, which: int) -> tuple[int, float]:
    """Return the active row (``which`` 1) farthest from the others, or the inactive one (0) nearest, and w^2 of it.

    Where no row has a distance, -1 and 0.
    """
    row, distance2 = _NONE, 0.0
    for j in range(T.shape[0]):
        if active[j] == which:
            w2 = own_distance2(T, j)
            if w2 < 0.0:
                continue
            if row < 0 or (w2 > distance2) == (which == 1):
                row, distance2 = j, w2
    return row, distance2


@kernel(inline=True)
def own_distance2(T: Float64, j: int) -> float:
    """Return w^2 of row ``j``, -1 where its numbers give none."""
    n = T.shape[0]
    w2 = T[j, n] * T[j, n] / T[j, j] if is_variance(T[j, j]) else -1.0
    return w2 if w2 < math.inf else -1.0


@kernel(apart=True)
def remove_smallest_set(T: Float64, active: Int64, gate2: float, most: int) -> int:
    """Take out the smallest set of rows that leaves all others within the gate; return its size.

    The largest set that may be tried goes in any case. If the numbers of ``T`` indicate no set, the size is 0.
    """
    candidates = np.zeros(_MOST_CANDIDATES, np.int64)
    n_candidates = stand_out_most(T, active, candidates)
    chosen = np.zeros(_LARGEST_SET, np.int64)
    largest = min(most, _LARGEST_SET)
    for size in range(1, largest + 1):
        if not best_set(T, candidates[:n_candidates], size, chosen):
            return 0
        if not exchange_set(T, active, chosen, size, 0):
            return 0
        if size == largest or farthest(T, active, 1)[1] <= gate2:
            return size
        if not exchange_set(T, active, chosen, size, 1):
            return 0
    return 0


@kernel(inline=True)
def exchange_set(T: Float64, active: Int64, chosen: Int64, size: int, now: int) -> bool:
    """Take the first ``size`` rows of ``chosen`` out of the set of active rows (``now`` 0) or into it again (1)."""
    done = True
    for i in range(size):
        done = done and exchange(T, chosen[i])
        active[chosen[i]] = now
    return done


@kernel
def stand_out_most(T: Float64, active: Int64, candidates: Int64) -> int:
    """Write the active rows of the largest w^2, at most as many as there is room for; return how many."""
    count = 0
    for j in range(T.shape[0]):
        w2 = own_distance2(T, j)
        if active[j] == 0 or w2 < 0.0:
            continue
        place = min(count, candidates.shape[0] - 1)
        if count == candidates.shape[0]:
            if w2 <= own_distance2(T, candidates[place]):
                continue
        else:
            count += 1
        while place > 0:
            above = candidates[place - 1]
            if own_distance2(T, above) >= w2:
                break
            candidates[place] = above
            place -= 1
        candidates[place] = j
    return count


@kernel
def best_set(T: Float64, candidates: Int64, size: int, chosen: Int64) -> bool:
    """Write the set of ``size`` (1 to 3) candidates without which y^T W y is least; return whether there is one.

    Equation: (W y)_J^T W_JJ^-1 (W y)_J, built up row by row: what the next row adds given those before. A set of
    rows of which one is a linear combination of the others has no such number, and is passed over.
    """
    n, m = T.shape[0], candidates.shape[0]
    largest = -1.0
    for i in range(m):
        a = candidates[i]
        of_a = T[a, n] * T[a, n] / T[a, a]
        if size == 1:
            if of_a > largest:
                largest = of_a
                chosen[0] = a
            continue
        for j in range(i + 1, m):
            b = candidates[j]
            ba = T[b, a] / T[a, a]
            W_bb = T[b, b] - ba * T[a, b]
            u_b = T[b, n] - ba * T[a, n]
            if not is_variance(W_bb):
                continue
            of_b = of_a + u_b * u_b / W_bb
            if size == 2:
                if of_b > largest:
                    largest = of_b
                    chosen[0], chosen[1] = a, b
                continue
            for k in range(j + 1, m):
                c = candidates[k]
                ca = T[c, a] / T[a, a]
                cb = (T[c, b] - ca * T[a, b]) / W_bb
                W_cc = T[c, c] - ca * T[a, c] - cb * (T[b, c] - ba * T[a, c])
                u_c = T[c, n] - ca * T[a, n] - cb * u_b
                if is_variance(W_cc) and of_b + u_c * u_c / W_cc > largest:
                    largest = of_b + u_c * u_c / W_cc
                    chosen[0], chosen[1], chosen[2] = a, b, c
    return largest >= 0.0
