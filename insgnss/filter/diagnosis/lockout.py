"""Recovery from a lock-out without a fix: too few satellites to prove a step of the receiver clock at once.

A common step of fewer than five pseudoranges is not believed in one epoch unless it is large (``gating.common_step``),
and so few give no fix with redundancy either. What they refuse for many epochs on end and yet agree on is the clock's
all the same: persistence replaces the number of witnesses. One pseudorange is always self-consistent; using it to reset
the clock only gives up its small position information.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.filter.output.writing import CLOCK_STEP, DRIFT_STEP, event_in_words
from insgnss.filter.rows.lines import Lines
from insgnss.filter.state import BG, CLOCK, DR, DV, OFFSETS, Bank, StateRecord
from insgnss.filter.update.gating import AGREEMENT, STEP_FLOOR
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE
from insgnss.status import GATED, USED
from insgnss.tables import Event, Float64

Integers = npt.NDArray[np.integer[Any]]

_BLUR: Final = 2e-5  # of a step: a clock that drifts meanwhile, or steps between two satellites' measurements
_LEAST_FOR_A_FIX: Final = 3  # refused rows of a kind
_LEAST_RANGES: Final = 6  # fewer cannot tell a clock step from a sensor failure


class ClockStep(NamedTuple):
    """A step that refused rows of one kind agree on, with everything needed to absorb it."""

    kind: int  # PSEUDORANGE: of the clock's bias, RANGE_RATE: of its drift
    size: float  # by which the leader's clock is wrong [m or m/s]
    h: Float64  # (n,) the witnesses' mean row of H, zero at the clock's own state
    variance: float  # of that mean's own error [m^2 or m^2/s^2]
    witnesses: int  # satellites
    judged: int  # satellites of which a row of the kind reached the gate


def is_thin(lines: Lines) -> bool:
    """Return whether fewer rows were refused, of either kind, than a fix could be tried with."""
    refused = [int(np.sum(lines["status"][:, kind] == GATED)) for kind in (PSEUDORANGE, RANGE_RATE)]
    return max(refused, default=0) < _LEAST_FOR_A_FIX


def may_tell(lines: Lines) -> bool:
    """Return whether an epoch has enough pseudoranges, used or refused, to tell a clock step from a sensor failure."""
    status = lines["status"][:, PSEUDORANGE]
    return int(np.sum((status == USED) | (status == GATED))) >= _LEAST_RANGES


def clock_steps(
    lines: Lines, sv: Integers, P: Float64, correction: Float64, gate2: tuple[float, float]
) -> list[ClockStep]:
    """Return the steps of the clock's bias and drift that explain what an epoch's gate refused.

    At least two thirds of the satellites must show it; further bands of a satellite make no further witnesses.

    Parameters
    ----------
    lines : of the leader, innovations and rows of H as they stood at the epoch's prior
    sv : (k,) the satellite of each line
    P, correction : (n, n), (n,) the leader's covariance after the epoch, and what the epoch added to its prior
    gate2 : squared gates of the two kinds
    """
    steps = []
    for kind in (PSEUDORANGE, RANGE_RATE):
        step = _step(lines, sv, kind, P, correction, gate2[kind])
        if step is not None:
            steps.append(step)
    return steps


def _step(
    lines: Lines, sv: Integers, kind: int, P: Float64, correction: Float64, gate2: float
) -> ClockStep | None:
    status = lines["status"][:, kind]
    is_refused = status == GATED
    refused, sv_refused, sv_used = lines[is_refused], sv[is_refused], np.unique(sv[status == USED])
    judged = len(np.unique(np.append(sv_refused, sv_used)))
    if len(np.setdiff1d(sv_refused, sv_used)) <= len(sv_used):
        return None
    if kind == RANGE_RATE and judged == 1 and np.any(lines["status"][:, PSEUDORANGE] == USED):
        return None  # pseudoranges in use follow the drift: it is the one range rate that is wrong
    H, y = np.zeros((len(refused), len(P))), np.zeros(len(refused))
    for j, line in enumerate(refused):
        columns, h = line.columns[kind][: line.count[kind]], line.h[kind][: line.count[kind]]
        H[j, columns] = h
        y[j] = line.innovation[kind] - h @ correction[columns]
    H[:, CLOCK + kind] = 0.0  # whatever the clock is off by, all rows have in common
    variance = refused["variance"][:, kind] + (_BLUR * np.median(y)) ** 2
    agreeing, w = _agreeing(H @ P @ H.T + np.diag(variance), y, gate2)
    witnesses = len(np.unique(sv_refused[agreeing]))
    if witnesses < AGREEMENT * judged:
        return None
    own = float(w**2 @ variance[agreeing]) + STEP_FLOOR[kind] ** 2
    return ClockStep(kind, float(w @ y[agreeing]), w @ H[agreeing], own, witnesses, judged)


def _agreeing(S: Float64, y: Float64, gate2: float) -> tuple[Integers, Float64]:
    """Return which of the residuals ``y`` (k,) agree on a common value, and the weights of its estimate.

    Equation: w = S^-1 1 / (1^T S^-1 1), q = (y - w y)^T S^-1 (y - w y), k - 1 degrees of freedom
    Of a set that does not agree the one goes whose absence leaves the smallest q. A common error of any size in ``S``
    changes neither w nor q.
    """
    agreeing: Integers = np.arange(len(y))
    w, q = _common(S, y, agreeing)
    while q > gate2 + len(agreeing) - 2:
        without = [np.delete(agreeing, i) for i in range(len(agreeing))]
        agreeing = min(without, key=lambda k: _common(S, y, k)[1])
        w, q = _common(S, y, agreeing)
    return agreeing, w


def _common(S: Float64, y: Float64, rows: Integers) -> tuple[Float64, float]:
    block, ones = S[np.ix_(rows, rows)], np.ones(len(rows))
    w = np.linalg.solve(block, ones)
    w /= w.sum()
    rest = y[rows] - w @ y[rows]
    return w, float(rest @ np.linalg.solve(block, rest))


def apply_clock_step(bank: Bank, step: ClockStep, lever_b: Float64) -> None:
    """Set the stepped clock state of every hypothesis by the witnesses alone, whatever it was before.

    Equation: c <- c + w y, P <- T P T^T + (w R w^T) e_c e_c^T, T = I - e_c (w H): its error is what position and the
    other states are off by, seen along the witnesses' mean row, and their noise. No other state is touched, and the
    correlations keep the next epoch from taking the same ranges for news of the position.
    Neglects: that the lines are another hypothesis' when the leader changed with this very epoch.
    """
    column = CLOCK + step.kind
    lead = bank.state[bank.head[0].leader].copy()
    for m, P in zip(bank.state, bank.P, strict=True):
        m.clock[step.kind] = lead.clock[step.kind] + step.size - step.h @ _apart(m, lead, lever_b, len(P))
        row = -(P @ step.h)
        row[column] = -(step.h @ row) + step.variance
        P[column, :] = row
        P[:, column] = row
        m.clone_ns = 0  # the carrier may have stepped with the clock or not


def _apart(m: StateRecord, lead: StateRecord, lever_b: Float64, n: int) -> Float64:
    """Return (n,) by how much the state of ``m`` differs from the leader's; the attitude is in the position."""
    apart: npt.NDArray[Any] = np.zeros(n)
    apart[DR : DR + 3] = m.r_e - lead.r_e + (m.C_eb - lead.C_eb) @ lever_b
    apart[DV : DV + 3] = m.v_e - lead.v_e
    apart[BG : BG + 3] = m.b_g - lead.b_g
    apart[OFFSETS:] = (m.optional - lead.optional)[: n - OFFSETS]
    return apart


def in_words(t_ns: int, step: ClockStep, epochs: int) -> Event:
    """Return the event of a step absorbed after ``epochs`` epochs of refusals."""
    kind, rows = (CLOCK_STEP, "pseudorange") if step.kind == PSEUDORANGE else (DRIFT_STEP, "range rate")
    if step.judged == 1:
        why = f"the only satellite's {rows} was refused for {epochs} epochs, and no other satellite can check it"
    else:
        why = f"{rows}s of {step.witnesses} of {step.judged} satellites agree on it after {epochs} epochs of refusals"
    return event_in_words(t_ns, int(kind), step.size, f": {why}")
