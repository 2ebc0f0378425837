"""One GNSS epoch, compiled: its pseudoranges, then its range rates, one scalar at a time, then the closed loop."""

from __future__ import annotations

import math
from typing import NamedTuple

from insgnss.fusion.adaptation import adapt_noise
from insgnss.fusion.gating import absorb_clock_step, common_step, gate_rows
from insgnss.fusion.measurements import RANGE_COLUMNS, RATE_COLUMNS, Epoch, observe
from insgnss.fusion.parameters import Parameters
from insgnss.fusion.prediction import Scratch, predict_covariance
from insgnss.fusion.scalar_update import scalar_update
from insgnss.fusion.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, StateRecord
from insgnss.geodesy.rotations import quaternion_to_matrix, turn_left
from insgnss.gnss.observation_rows import Rows
from insgnss.jit import inlined, kernel
from insgnss.status import GATED, USED
from insgnss.tables import Float64

_SMALLEST_DRIFT_STEP_MPS = 20.0  # a smaller common step of the range rates may be vertical motion


class Outcome(NamedTuple):
    """What an epoch did to one hypothesis."""

    log_likelihood: float
    ranges_used: int
    ranges_refused: int  # by the gate
    rates_used: int
    rates_refused: int
    clock_step: float  # [m], 0 when there was none
    drift_step: float  # [m/s]
    strain: float  # the larger of both kinds' mean normalised innovation squared, none counting more than the gate


@kernel
def update_epoch(
    m: StateRecord,
    P: Float64,
    par: Parameters,
    rows: Rows,
    epoch: int,
    w_ib_b: Float64,
    f_b: Float64,
    s: Epoch,
    scratch: Scratch,
    since_last: float,
) -> Outcome:
    """Bring one hypothesis, already at the epoch's time, up to date with the epoch's rows.

    ``since_last`` is the time since the epoch before [s].

    Each row re-uses the running estimate: y_j = z_j - h(Y-) - h_j (Y(j-1) - Y-), so the result is the batch update's
    and the order of the rows matters only by rounding; the gates are all judged on the prior.
    """
    predict_covariance(m, P, par, scratch)
    drift_variance = P[DRIFT, DRIFT]
    observe(m, P, par, rows, epoch, w_ib_b, f_b, s)
    n = rows.first[epoch + 1] - rows.first[epoch]
    done = Outcome(0.0, 0, 0, 0, 0, 0.0, 0.0, 0.0)
    for kind in range(2):
        step, variance = common_step(s, kind, n, smallest_step(par, kind), P[CLOCK + kind, CLOCK + kind])
        if step != 0.0:
            absorb_clock_step(m.clock, P, s, kind, n, CLOCK + kind, step, variance)
        used, refused, strain = gate_rows(s, kind, n, gate2_of(par, kind))
        done = noted(done, kind, used, refused, step, strain)
    correction = s.vectors[0]
    for i in range(P.shape[0]):
        correction[i] = 0.0
    log_likelihood = 0.0
    for kind in range(2):
        spread = max(1.0, (par.range_correlation if kind == 0 else par.rate_correlation) / since_last)
        log_likelihood += use_rows(P, s, kind, n, gate2_of(par, kind), spread)
    if done.clock_step == 0.0 and done.drift_step == 0.0:
        adapt_noise(m, P, par, s, n, rows.epoch_ns[epoch], drift_variance)
    close_loop(m, correction, P.shape[0])
    return Outcome(
        log_likelihood,
        done.ranges_used,
        done.ranges_refused,
        done.rates_used,
        done.rates_refused,
        done.clock_step,
        done.drift_step,
        done.strain,
    )


@inlined
def gate2_of(par: Parameters, kind: int) -> float:
    """Return the squared gate of a kind."""
    return float(par.range_gate2 if kind == 0 else par.rate_gate2)


@inlined
def smallest_step(par: Parameters, kind: int) -> float:
    """Return the smallest common step that counts as the clock's: of the bias [m] or of the drift [m/s]."""
    return float(par.clock_jump_min if kind == 0 else _SMALLEST_DRIFT_STEP_MPS)


@inlined
def noted(done: Outcome, kind: int, used: int, refused: int, step: float, strain: float) -> Outcome:
    """Return the outcome with the numbers of one kind in it; fewer than four rows do not count as strain."""
    worst = max(done.strain, strain) if used + refused >= 4 else done.strain
    if kind == 0:
        return Outcome(0.0, used, refused, done.rates_used, done.rates_refused, step, done.drift_step, worst)
    return Outcome(0.0, done.ranges_used, done.ranges_refused, used, refused, done.clock_step, step, worst)


@inlined
def use_rows(P: Float64, s: Epoch, kind: int, n_rows: int, gate2: float, spread: float) -> float:
    """Update with each row of one kind in turn; return the logarithm of their likelihood (up to a constant).

    ``spread`` is by how much a variance counts more than one epoch's own, because epochs share their errors: the mean
    of n errors that are alike over n epochs has the variance of one, not of one n-th.
    """
    total = 0.0
    for j in range(n_rows):
        line = s.lines[j]
        if line.status[kind] == USED:
            extra = OFFSETS + line.group - 1 if kind == 0 and line.group > 0 else -1
            h = line.h_range if kind == 0 else line.h_rate
            columns = RANGE_COLUMNS if kind == 0 else RATE_COLUMNS
            y, S = scalar_update(
                P, h, columns, extra, line.innovation[kind], spread * line.variance[kind], s.vectors
            )
            total -= 0.5 * (y * y / S + math.log(S))
        elif line.status[kind] == GATED:
            total -= 0.5 * (gate2 + math.log(line.predicted[kind] + line.variance[kind]))
    return total


@inlined
def close_loop(m: StateRecord, correction: Float64, n: int) -> None:
    """Feed the correction (truth minus estimate) back into the state; the error state is zero again.

    Equation: C_eb <- exp([delta psi x]) C_eb. Neglects: the turn of the covariance's attitude axes by half the
    correction, second order in it.
    """
    for i in range(3):
        m.r_e[i] += correction[DR + i]
        m.v_e[i] += correction[DV + i]
        m.b_a[i] += correction[BA + i]
        m.b_g[i] += correction[BG + i]
    m.clock[0] += correction[CLOCK]
    m.clock[1] += correction[DRIFT]
    for i in range(OFFSETS, n):
        m.offsets[i - OFFSETS] += correction[i]
    turn_left(m.q_eb, correction[PSI], correction[PSI + 1], correction[PSI + 2])
    quaternion_to_matrix(m.q_eb, m.C_eb)
