"""The parts of an epoch's innovations: one explained by position, velocity or clock errors, and the rest. Compiled.

A deviation of all satellites at once is not multipath: [u, 1] maps an error of the antenna's position (or velocity)
and of the receiver's clock into the ranges of all of them, and nothing else does. So the innovations y of one kind are
split,

    y = G x + e,   G = [-u^T 1],   x by least squares,   G^T R^-1 e = 0

into the part G x that the inertial sensors and the clock can explain and the parity part e, which is the satellites'
own. Noise levels are learnt from e alone (``adaptation``). x is compared with the covariance of the prediction; a
persistent excess is a fault of the filter itself (``suspects``).  [Sturza 1988; Mehra 1970]
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.measurements.range_rate import COLUMNS as RATE_COLUMNS
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.state import CLOCK, DR, DRIFT, DV, StateRecord
from insgnss.gnss.observation_rows import CARRIER, PSEUDORANGE, RANGE_RATE
from insgnss.kernels.jit import kernel
from insgnss.status import GATED, USED
from insgnss.tables import Float64

UNKNOWNS: Final = 4  # position or velocity (or the position's change), and the clock's state
# rows of the work space ``fit``: covariance of what is explained, x, and scratch of three more
X: Final = 4
_WORK: Final = 5
_VELOCITY: Final = RATE_COLUMNS.index(DV)

_LEAST_PARITY_ROWS: Final = 5  # fewer have no parity part
_WIDER2: Final = 100.0  # ten sigmas of its own prediction that may be wrong before noise is blamed
OUTLIER2: Final = 25.0
INTERVAL_NS: Final = 900_000_000  # once a second is often enough
_MEMORY_S: Final = 8.0  # a sensor's fault shows for many seconds, a jolt for one or two
_FORGOTTEN_S: Final = 30.0  # after so long without rows what was seen before says nothing
_MOST_SIGMAS: Final = 5.0  # that one epoch counts


@kernel(inline=True)
def entry(line: Line, kind: int, i: int) -> float:
    """Return column ``i`` of G in the row of one kind; the last is the clock's, which is 1 in all kinds."""
    if i == UNKNOWNS - 1:
        return 1.0
    return float(line.h[kind, i + (_VELOCITY if kind == RANGE_RATE else 0)])


@kernel(inline=True)
def direction(line: Line, kind: int) -> tuple[float, float, float]:
    """Return the first three columns of G in the row of one kind; the last is 1 in all kinds."""
    h, at = line.h[kind], _VELOCITY if kind == RANGE_RATE else 0
    return h[at], h[at + 1], h[at + 2]


@kernel(inline=True)
def explained_by(line: Line, kind: int, fit: Float64) -> float:
    """Return the part of a row's innovation that ``fit`` explains, g x."""
    a, b, c = direction(line, kind)
    return float(a * fit[X, 0] + b * fit[X, 1] + c * fit[X, 2] + fit[X, 3])


@kernel(inline=True)
def explained_variance(line: Line, kind: int, fit: Float64) -> float:
    """Return g D g^T, D the covariance in ``fit``."""
    a, b, c = direction(line, kind)
    diagonal = a * a * fit[0, 0] + b * b * fit[1, 1] + c * c * fit[2, 2] + fit[3, 3]
    beside = a * b * fit[0, 1] + a * c * fit[0, 2] + b * c * fit[1, 2]
    return float(diagonal + 2.0 * (beside + a * fit[0, 3] + b * fit[1, 3] + c * fit[2, 3]))


@kernel
def invert(A: Float64, at: int) -> bool:
    """Invert the symmetric positive 4 x 4 block of ``A`` that begins at row ``at``, in place; False where it is none.

    Gauss and Jordan without pivoting, which a positive matrix does not need.
    """
    for j in range(UNKNOWNS):
        pivot = A[at + j, j]
        if not (pivot > 0.0 and pivot < 1e30):
            return False
        for c in range(UNKNOWNS):
            A[at + j, c] /= pivot
        A[at + j, j] = 1.0 / pivot
        for i in range(UNKNOWNS):
            if i != j:
                share = A[at + i, j]
                for c in range(UNKNOWNS):
                    if c != j:
                        A[at + i, c] -= share * A[at + j, c]
                A[at + i, j] = -share / pivot
    return True


@kernel(inline=True)
def state_of(kind: int, i: int) -> int:
    """Return which error state is unknown ``i`` of a kind."""
    if i == UNKNOWNS - 1:
        return DRIFT if kind == RANGE_RATE else CLOCK
    return (DV if kind == RANGE_RATE else DR) + i


@kernel(inline=True)
def add_row(line: Line, kind: int, y: float, r: float, fit: Float64) -> None:
    """Add one row to the normal equations in ``fit``: N += g g^T / r at the top, b += g y / r at x."""
    a, b, c = direction(line, kind)
    w = 1.0 / r
    wa, wb, wc = w * a, w * b, w * c
    fit[0, 0] += wa * a
    fit[1, 1] += wb * b
    fit[2, 2] += wc * c
    fit[3, 3] += w
    fit[0, 1] += wa * b
    fit[0, 2] += wa * c
    fit[1, 2] += wb * c
    fit[0, 3] += wa
    fit[1, 3] += wb
    fit[2, 3] += wc
    fit[X, 0] += wa * y
    fit[X, 1] += wb * y
    fit[X, 2] += wc * y
    fit[X, 3] += w * y


@kernel(inline=True)
def fill_below(fit: Float64) -> None:
    """Copy the upper triangle of the normal equations below the diagonal."""
    for i in range(1, UNKNOWNS):
        for j in range(i):
            fit[i, j] = fit[j, i]


@kernel(inline=True)
def solve(fit: Float64) -> bool:
    """Turn the normal equations in ``fit``, the half above the diagonal, into covariance and x; False without one."""
    fill_below(fit)
    if not invert(fit, 0):
        return False
    for i in range(UNKNOWNS):
        fit[_WORK, i] = fit[X, i]
    for i in range(UNKNOWNS):
        fit[X, i] = 0.0
        for j in range(UNKNOWNS):
            fit[X, i] += fit[i, j] * fit[_WORK, j]
    return True


@kernel(inline=True)
def clear(fit: Float64) -> None:
    """Set the normal equations to zero."""
    for i in range(UNKNOWNS + 1):
        for j in range(UNKNOWNS):
            fit[i, j] = 0.0


@kernel(apart=True)
def explain(prior: Float64, lines: Lines, kind: int, fit: Float64) -> bool:
    """Write into ``fit`` what the used rows of a kind have in common; return whether there is a rest to learn from.

    The filter's own prediction is believed as far as ten of its sigmas go, which keeps a parity part where rows are
    few: C = (G^T R^-1 G + (k P)^-1)^-1, x = C G^T R^-1 y, k = 100. D, stored in ``fit``, is the variance that y
    loses if P is right: E[e e^T] = R - G D G^T with D = C + (k - 1) / k C (k P)^-1 C.
    The carrier's difference has no such prior (its own is of two epochs): it needs two rows more than unknowns.
    """
    used = 0
    clear(fit)
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        if line.status[kind] == USED:
            add_row(line, kind, line.innovation[kind], line.variance[kind], fit)
            used += 1
    if used < _LEAST_PARITY_ROWS:
        return False
    if kind == CARRIER:
        return used >= UNKNOWNS + 2 and solve(fit)
    at = _WORK + 1
    for i in range(UNKNOWNS):
        for j in range(UNKNOWNS):
            fit[at + i, j] = _WIDER2 * prior[state_of(kind, i), state_of(kind, j)]
    with_prior = invert(fit, at)
    for i in range(UNKNOWNS):
        for j in range(UNKNOWNS):
            fit[i, j] += fit[at + i, j] if with_prior else 0.0
    if not solve(fit):
        return False
    if with_prior:
        add_prior_share(fit, at)
    return True


@kernel(inline=True)
def add_prior_share(fit: Float64, at: int) -> None:
    """Add (k - 1) / k C (k P)^-1 C to the covariance C in ``fit``; the inverse is at ``at``, scratch behind it."""
    to = at + UNKNOWNS
    for i in range(UNKNOWNS):
        for j in range(UNKNOWNS):
            fit[to, j] = 0.0
            for k in range(UNKNOWNS):
                fit[to, j] += fit[i, k] * fit[at + k, j]
        for j in range(UNKNOWNS):
            fit[at + UNKNOWNS + 1 + i, j] = 0.0
            for k in range(UNKNOWNS):
                fit[at + UNKNOWNS + 1 + i, j] += fit[to, k] * fit[k, j]
    for i in range(UNKNOWNS):
        for j in range(UNKNOWNS):
            fit[i, j] += (_WIDER2 - 1.0) / _WIDER2 * fit[to + 1 + i, j]


@kernel(apart=True)
def fit_freely(lines: Lines, kind: int, fit: Float64) -> int:
    """Write into ``fit`` the least-squares x of a kind, rows that the gate refused included; return how many agree.

    A gate judges each row on the prior: where the prior is wrong it refuses what is right. Rows that the first fit
    leaves five sigmas off are left out of the second.
    """
    count = 0
    for turn in range(2):
        fit_before = (fit[X, 0], fit[X, 1], fit[X, 2], fit[X, 3])
        clear(fit)
        count = 0
        for j in range(lines.shape[0]):
            line: Line = lines[j]
            if line.status[kind] != USED and line.status[kind] != GATED:
                continue
            y = line.innovation[kind]
            if turn == 1:
                a, b, c = direction(line, kind)
                rest = y - (a * fit_before[0] + b * fit_before[1] + c * fit_before[2] + fit_before[3])
                if rest * rest > OUTLIER2 * line.variance[kind]:
                    continue
            add_row(line, kind, y, line.variance[kind], fit)
            count += 1
        if count < _LEAST_PARITY_ROWS or not solve(fit):
            return 0
    return count


@kernel(apart=True)
def fit_all(lines: Lines, kind: int, fit: Float64) -> bool:
    """Write into ``fit`` the least-squares x of all rows of a kind, used or refused, none left out."""
    clear(fit)
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        if line.status[kind] == USED or line.status[kind] == GATED:
            add_row(line, kind, line.innovation[kind], line.variance[kind], fit)
    return solve(fit)


@kernel(apart=True)
def follow_explained(
    m: StateRecord, prior: Float64, par: Parameters, lines: Lines, fit: Float64, t_ns: int
) -> None:
    """Update the statistics on the filter's own prediction, and write how much of it is beyond chance.

    Equation: L s = x, L L^T = C + P, mean <- mean + a (s - mean), V <- (1 - a)^2 V + a^2, suspicion = |mean|^2 / V
    which is chi^2 of three while the filter is right: x has the covariance C + P then, and one epoch's is independent
    of the next. After an outage a is near one, so V is that of one epoch and falls again with the epochs that follow.
    L turns as slowly as the satellites move. Range rates are the witness, pseudoranges where there are none, and the
    carriers beside.
    """
    if t_ns - m.explained_ns < INTERVAL_NS:
        return
    since = (t_ns - m.explained_ns) * 1e-9
    m.explained_ns = t_ns
    m.suspicion = 0.0
    share = 1.0 - math.exp(-since / _MEMORY_S)
    for witness in range(2):
        kind = CARRIER if witness == 1 else RANGE_RATE
        if kind == CARRIER and par.at_clone < 0:
            continue
        count = fit_freely(lines, kind, fit)
        if count == 0 and kind == RANGE_RATE:
            kind = PSEUDORANGE
            count = fit_freely(lines, kind, fit)
        if count > 0:
            for i in range(3):
                for j in range(3):
                    fit[i, j] += own_covariance(prior, par, kind, i, j)
        in_sigmas = count > 0 and whiten(fit)
        decay = 1.0 - share if since <= _FORGOTTEN_S else 0.0
        m.explained_variance[witness] = decay * decay * m.explained_variance[witness] + share * share
        total = 0.0
        for i in range(3):
            sigmas = max(min(fit[X, i], _MOST_SIGMAS), -_MOST_SIGMAS) if in_sigmas else 0.0
            m.explained[witness, i] = decay * m.explained[witness, i] + share * sigmas
            total += m.explained[witness, i] * m.explained[witness, i]
        if share > 0.0:
            m.suspicion = max(m.suspicion, total / m.explained_variance[witness])


@kernel(inline=True)
def whiten(fit: Float64) -> bool:
    """Turn the first three unknowns x in ``fit`` into L^-1 x, L the Cholesky factor of their covariance in ``fit``.

    The factor replaces the covariance. False where the covariance is not positive.
    """
    for j in range(3):
        for i in range(j, 3):
            rest = fit[i, j]
            for k in range(j):
                rest -= fit[i, k] * fit[j, k]
            if i == j:
                if not 0.0 < rest < math.inf:
                    return False
                fit[j, j] = math.sqrt(rest)
            else:
                fit[i, j] = rest / fit[j, j]
        for k in range(j):
            fit[X, j] -= fit[j, k] * fit[X, k]
        fit[X, j] /= fit[j, j]
    return True


@kernel(inline=True)
def own_covariance(prior: Float64, par: Parameters, kind: int, i: int, j: int) -> float:
    """Return the covariance that the filter claims for the unknowns ``i`` and ``j`` of a kind."""
    a, b = state_of(kind, i), state_of(kind, j)
    if kind != CARRIER:
        return float(prior[a, b])
    before_a, before_b = par.at_clone + i, par.at_clone + j
    return float(prior[a, b] + prior[before_a, before_b] - prior[a, before_b] - prior[before_a, b])
