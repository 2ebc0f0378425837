"""Judging an epoch on its prior: common steps of the receiver clock, and the gate of each row, compiled.

Every decision of an epoch is taken before any of its rows touches the state, so the order of the satellites does not
matter.
"""

from __future__ import annotations

import math

from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.state import CLOCK, OFFSETS
from insgnss.filter.update.scalar_update import predicted_variance
from insgnss.gnss.median import median_of
from insgnss.gnss.observation_rows import CARRIER, PSEUDORANGE
from insgnss.kernels.jit import kernel
from insgnss.status import GATED, USED
from insgnss.tables import Float64

AGREEMENT = 2.0 / 3.0  # share of the rows that must show the same step before it counts as the clock's
_STEP_SIGMA = 5.0
_ENOUGH_WITNESSES = 5
_SMALL_SHARE = 0.02  # of the smallest step that few witnesses are believed
_BLUR = 1e-4
STEP_FLOOR = (3.0, 0.1)  # least sigma of a step, of bias [m] and drift [m/s]


@kernel(apart=True)
def common_step(
    lines: Lines, kind: int, values: Float64, smallest: float, clock_variance: float
) -> tuple[float, float]:
    """Return the step [m or m/s] that an epoch's innovations share and only a clock can make, and its variance.

    The step is zero when there is none. At least half of the rows must be beyond five sigmas, their median beyond five
    sigmas of the predicted clock, and two thirds of at least two rows must agree with it within their own sigma without
    the clock's. Fewer than five witnesses are believed only beyond ``smallest``, and a single one never: its
    pseudorange may be wrong by itself. What few go on showing is for ``lockout``. ``values`` is scratch of at least the
    lines' length.
    """
    n = 0
    beyond = 0
    predicted = 0.0
    limit2 = _STEP_SIGMA * _STEP_SIGMA
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[kind] == USED:
            values[n] = line.innovation[kind]
            n += 1
            predicted += line.predicted[kind]
            if line.innovation[kind] ** 2 > limit2 * (line.predicted[kind] + line.variance[kind]):
                beyond += 1
    if n < 2 or 2 * beyond < n:
        return 0.0, 0.0
    step = median_of(values, n)
    # a wrong vertical velocity looks much like a small step of the drift: there no number of witnesses helps
    least = smallest if n < _ENOUGH_WITNESSES or kind == 1 else _SMALL_SHARE * smallest
    if not abs(step) > max(least, _STEP_SIGMA * math.sqrt(max(clock_variance, predicted / n))):
        return 0.0, 0.0
    agree = 0
    spread = 0.0
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[kind] == USED:
            own = max(line.predicted[kind] - clock_variance, 0.0) + line.variance[kind]
            # a clock that drifts during the step, or steps between two satellites' measurements, blurs it by a little
            blur = max(_STEP_SIGMA * math.sqrt(own), _BLUR * abs(step))
            if abs(line.innovation[kind] - step) <= blur:
                agree += 1
                spread += own
    if agree < max(2, AGREEMENT * n):
        return 0.0, 0.0
    # twice the sigma of the mean of those that agree: a median is a little worse than a mean
    return step, 4.0 * spread / (agree * agree) + STEP_FLOOR[kind] ** 2


@kernel(inline=True)
def shown_clock(lines: Lines, kind: int) -> int:
    """Return the group whose clock the used rows show: the reference, or where it has no row the first one's."""
    first = 0
    for j in range(lines.shape[0]):
        if kind == PSEUDORANGE and lines[j].status[kind] == USED:
            if lines[j].group == 0:
                return 0
            first = first if first > 0 else lines[j].group
    return first


@kernel(inline=True)
def shown_clock_variance(P: Float64, kind: int, group: int) -> float:
    """Return the variance of what the rows of a group see as their clock: c + o, of rates the drift."""
    clock, offset = CLOCK + kind, OFFSETS + group - 1
    more = 2.0 * P[clock, offset] + P[offset, offset] if group > 0 else 0.0
    return float(P[clock, clock] + more)


@kernel
def absorb_clock_step(
    clock: Float64, P: Float64, lines: Lines, kind: int, group: int, step: float, variance: float
) -> None:
    """Add a clock step to the state, drop that clock state's correlations, and correct the epoch's innovations.

    Equation: of a group with the offset o its clock s = c + o has stepped: c = s - o, s alike nothing else
    """
    clock[kind] += step
    n, column, offset = P.shape[0], CLOCK + kind, OFFSETS + group - 1
    old = shown_clock_variance(P, kind, group)
    for j in range(lines.shape[0]):
        if lines[j].status[kind] == USED:
            lines[j].innovation[kind] -= step
            # D loses the clock's correlations; a bound that errs on the wide side is enough for this one epoch
            lines[j].predicted[kind] = max(lines[j].predicted[kind] - old, 0.0) + variance + old
    for i in range(n):
        P[column, i] = -P[offset, i] if group > 0 else 0.0
        P[i, column] = P[column, i]
    P[column, column] = variance + (P[offset, offset] if group > 0 else 0.0)


@kernel(apart=True)
def gate_rows(lines: Lines, kind: int, gate2: float) -> tuple[int, int, float]:
    """Mark the rows whose normalised innovation squared is above ``gate2``; return what ``count_rows`` does.

    The variance holds the slow errors that the state has not taken yet. The comparisons are written so that a NaN
    fails, and an innovation whose variance is not positive and finite.
    """
    for j in range(lines.shape[0]):
        if lines[j].status[kind] == USED:
            variance = whole_variance(lines[j], kind)
            nis = lines[j].innovation[kind] ** 2 / variance
            if not (nis <= gate2 and 0.0 < variance < math.inf):
                lines[j].status[kind] = GATED
    return count_rows(lines, kind, gate2)


@kernel(inline=True)
def whole_variance(line: Line, kind: int) -> float:
    """Return the variance of an innovation, of a pseudorange with the slow errors."""
    astray = line.astray if kind == PSEUDORANGE else 0.0
    return float(line.predicted[kind] + line.variance[kind] + slow_variance(line, kind) + astray)


@kernel(inline=True)
def slow_variance(line: Line, kind: int) -> float:
    """Return what the slow errors of message and air that the state has not taken add to an innovation's variance."""
    return float(line.slow) if kind == PSEUDORANGE else 0.0


@kernel(inline=True)
def count_rows(lines: Lines, kind: int, gate2: float) -> tuple[int, int, float]:
    """Return how many rows passed the gate, how many did not, and the mean of their normalised innovations squared.

    None of these counts more than the gate.
    """
    passed = 0
    refused = 0
    nis = 0.0
    for j in range(lines.shape[0]):
        if lines[j].status[kind] == USED:
            variance = whole_variance(lines[j], kind)
            nis += min(lines[j].innovation[kind] ** 2 / variance, gate2)
            passed += 1
        elif lines[j].status[kind] == GATED:
            nis += gate2
            refused += 1
    return passed, refused, nis / max(passed + refused, 1)


@kernel(apart=True)
def gate_between(P: Float64, lines: Lines, vectors: Float64, gate2: float) -> None:
    """Mark the carrier differences whose difference from the row of the median innovation is above ``gate2``.

    Equation: nu = (y_j - y_m)^2 / ((h_j - h_m) P (h_j - h_m)^T + r_j + r_m)
    What all rows share drops out, and with it an ordinary crystal's wander of a decimetre in a second, behind which a
    slip of a cycle hides from ``gate_rows``. If at most half agree, the right ones are unknown: all are
    refused. All have the same columns. ``vectors`` (4, k) is scratch; the third row then holds the predicted variance
    of each row against the median one, and their mean for that.
    """
    h, between = vectors[1], vectors[2]
    middle, n = median_row(lines, CARRIER, vectors[3])
    if n < 2:
        if n == 1:
            between[middle] = lines[middle].predicted[CARRIER]
        return
    m = lines[middle]
    columns = m.columns[CARRIER][: m.count[CARRIER]]
    agree, total = 1, 0.0
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[CARRIER] != USED or j == middle:
            continue
        for a in range(columns.shape[0]):
            h[a] = line.h[CARRIER, a] - m.h[CARRIER, a]
        own = line.variance[CARRIER] + m.variance[CARRIER]
        apart = line.innovation[CARRIER] - m.innovation[CARRIER]
        between[j] = predicted_variance(P, h, columns)
        total += between[j]
        if apart * apart <= gate2 * (between[j] + own):
            agree += 1
        else:
            line.status[CARRIER] = GATED
    between[middle] = total / (n - 1)
    if 2 * agree <= n:
        for j in range(lines.shape[0]):
            if lines[j].status[CARRIER] == USED:
                lines[j].status[CARRIER] = GATED


@kernel(inline=True)
def median_row(lines: Lines, kind: int, values: Float64) -> tuple[int, int]:
    """Return the used row of the median innovation, and how many there are.

    Of an even number the lower of the two in the middle: the mean of both is as near to one as to the other, and
    rounding or the order of the rows would choose.
    """
    n = 0
    for j in range(lines.shape[0]):
        if lines[j].status[kind] == USED:
            values[n] = lines[j].innovation[kind]
            n += 1
    median_of(values, n)  # which sorts them
    median = values[(n - 1) // 2] if n > 0 else 0.0
    nearest = -1
    least = math.inf
    for j in range(lines.shape[0]):
        if lines[j].status[kind] == USED and abs(lines[j].innovation[kind] - median) < least:
            least = abs(lines[j].innovation[kind] - median)
            nearest = j
    return nearest, n
