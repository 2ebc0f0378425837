"""Judging an epoch on its prior: common steps of the receiver clock, and the gate of each row, compiled.

Every decision of an epoch is taken before any of its rows touches the state, so the order of the satellites does not
matter.
"""

from __future__ import annotations

import math

from insgnss.fusion.measurements import Epoch
from insgnss.jit import inlined
from insgnss.median import median_of
from insgnss.status import GATED, USED
from insgnss.tables import Float64

_AGREEMENT = 2.0 / 3.0  # share of the rows that must show the same step before it counts as the clock's
_STEP_SPREAD_SIGMA = 5.0


@inlined
def common_step(s: Epoch, kind: int, n_rows: int, smallest: float, clock_variance: float) -> float:
    """Return the step [m or m/s] that the innovations of an epoch share and only a clock can make; 0 if there is none.

    The median of the innovations must be beyond ``smallest`` and 5 sigma of the predicted clock, and two thirds of at
    least two rows must agree with it within their own sigma without the clock's. A single satellite is no witness: its
    pseudorange may be wrong by itself.
    """
    values = s.vectors[3]
    n = 0
    large = 0
    for j in range(n_rows):
        if s.lines[j].status[kind] == USED:
            values[n] = s.lines[j].innovation[kind]
            n += 1
            if abs(s.lines[j].innovation[kind]) > smallest:
                large += 1
    if n < 2 or 2 * large < n:
        return 0.0
    step = median_of(values, n)
    if not abs(step) > max(smallest, _STEP_SPREAD_SIGMA * math.sqrt(clock_variance)):
        return 0.0
    agree = 0
    for j in range(n_rows):
        if s.lines[j].status[kind] == USED:
            own = max(s.lines[j].predicted[kind] - clock_variance, 0.0) + s.lines[j].variance[kind]
            if abs(s.lines[j].innovation[kind] - step) <= max(
                _STEP_SPREAD_SIGMA * math.sqrt(own), 0.05 * smallest
            ):
                agree += 1
    return step if agree >= max(2, _AGREEMENT * n) else 0.0


@inlined
def absorb_clock_step(
    clock: Float64, P: Float64, s: Epoch, kind: int, n_rows: int, column: int, step: float
) -> None:
    """Add a clock step to the state, forget what was known of that clock state, and correct the epoch's innovations.

    The new variance is the square of a hundredth of the step (at least 30 m, 3 m/s), far above what the median leaves.
    """
    clock[kind] += step
    n = P.shape[0]
    old = P[column, column]
    new = max(30.0 if kind == 0 else 3.0, 0.01 * abs(step)) ** 2
    for j in range(n_rows):
        if s.lines[j].status[kind] == USED:
            s.lines[j].innovation[kind] -= step
            # D loses the clock's correlations; a bound that errs on the wide side is enough for this one epoch
            s.lines[j].predicted[kind] = max(s.lines[j].predicted[kind] - old, 0.0) + new + old
    for i in range(n):
        P[column, i] = 0.0
        P[i, column] = 0.0
    P[column, column] = new


@inlined
def gate_rows(s: Epoch, kind: int, n_rows: int, gate2: float) -> tuple[int, int]:
    """Mark the rows whose normalised innovation squared is above ``gate2``; return how many passed and how many not.

    The comparison is written so that a NaN fails.
    """
    passed = 0
    refused = 0
    for j in range(n_rows):
        if s.lines[j].status[kind] != USED:
            continue
        nis = s.lines[j].innovation[kind] ** 2 / (s.lines[j].predicted[kind] + s.lines[j].variance[kind])
        if nis <= gate2:
            passed += 1
        else:
            s.lines[j].status[kind] = GATED
            refused += 1
    return passed, refused
