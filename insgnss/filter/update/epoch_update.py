"""One GNSS epoch, compiled: its measurements kind by kind, one scalar at a time, then the closed loop."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples, predict_covariance
from insgnss.filter.rows.lines import CLONE_ROWS, EpochWorkspace, Line, Lines
from insgnss.filter.rows.usual_variance import foreseen_variance
from insgnss.filter.soundness import is_sound
from insgnss.filter.state import (
    BIAS_FACTOR,
    CLOCK,
    DR,
    DRIFT,
    DRIFT_FACTOR,
    N_CLONE,
    Bank,
    StateRecord,
    copy_matrix,
)
from insgnss.filter.update.adaptation import adapt_noise
from insgnss.filter.update.clone import clone_epoch
from insgnss.filter.update.closed_loop import close_loop, turn_attitude_errors, turn_force_errors
from insgnss.filter.update.consistency import disagrees, refuse_inconsistent
from insgnss.filter.update.creeping import hold_contradicted
from insgnss.filter.update.epoch_space import FilterWorkspace
from insgnss.filter.update.far_prior import is_far, predict_nearer
from insgnss.filter.update.integrity import follow_explained
from insgnss.filter.update.judging import UpdateOutcome, gate_carriers, judge_rows
from insgnss.filter.update.lasting_errors import epochs_of_an_error, follow_lasting_errors
from insgnss.filter.update.lever_swing import swing_lever_arm
from insgnss.filter.update.masking import OFF, mask_hidden
from insgnss.filter.update.phase_locks import refuse_unlocked
from insgnss.filter.update.prior_rows import place_antenna, predict_measurements
from insgnss.filter.update.scalar_update import scalar_update
from insgnss.filter.update.shown_motion import follow_motion
from insgnss.filter.update.slow_errors import follow_slow_errors, keep_gain, place_slow_variances
from insgnss.filter.update.tag_jumps import follow_tag_jump
from insgnss.filter.update.wrong_rates import refuse_wrong_rates
from insgnss.gnss.observation_rows import (
    ABSENT,
    CARRIER,
    N_KINDS,
    PSEUDORANGE,
    RANGE_RATE,
    GnssRows,
)
from insgnss.kernels.jit import kernel
from insgnss.status import GATED, INCONSISTENT, NOT_STARTED, USED
from insgnss.tables import Float64

_OUTAGE_S = 2.5  # without an epoch
_LONGEST_OUTAGE_S = 1e5  # the first epoch of all has none before it
# -ln of the density of a reflected range rate: one in ten (in Hong Kong 9 % are more than 2 m/s off), and flat over
# 18 m/s, twice a car's speed in a street, with the sqrt(2 pi) of ``use_rows``
_ONE_IN_TEN: Final = 2.3
_FLAT: Final = 2.0
_SMALL, _LARGE = 1e-200, 1e200  # within which a product of variances stays


@kernel(apart=True)
def update_epoch(
    bank: Bank,
    member: int,
    par: Parameters,
    rows: GnssRows,
    epoch: int,
    imu: ImuSamples,
    sample: int,
    work: FilterWorkspace,
) -> UpdateOutcome:
    """Bring one hypothesis, already at the epoch's time, up to date with the epoch's rows.

    Each row re-uses the running estimate: y_j = z_j - h(Y-) - h_j (Y(j-1) - Y-), so the result is the batch update's
    and the order of the rows matters only by rounding; the gates are all judged on the prior. A hypothesis that is lost
    already (``soundness``) uses no row; its likelihood is none.
    """
    m, P, s, scratch = bank.state[member], bank.P[member], work.epoch, work.scratch
    w_ib_b, f_b = imu.w_ib_b[sample], imu.f_b[sample]
    first, last, t_ns = rows.first[epoch], rows.first[epoch + 1], rows.epoch_ns[epoch]
    since_last = (t_ns - bank.head[0].epoch_ns) * 1e-9
    predict_covariance(m, P, par, scratch)
    if not is_sound(m, P):
        leave_out(rows, epoch, s.lines)
        return UpdateOutcome(-math.inf, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0)
    doubt_clock(m, P, par, since_last)
    swing_lever_arm(m, P, par, s.antenna[0], t_ns)
    follow_motion(m, P, par)
    predict_measurements(m, P, par, rows, epoch, w_ib_b, f_b, s)
    if is_far(P):
        predict_nearer(bank, member, par, rows, epoch, imu, sample, work)
    follow_tag_jump(bank, member, par, rows, epoch, s)
    lines, observation = s.lines[: last - first], rows.observation[first:last]
    correction = s.vectors[0]
    place_slow_variances(bank, member, par, rows, epoch, lines)
    refuse_wrong_rates(m, bank.memory[member], rows, epoch, lines)
    if rows.carrier.shape[0] > 0:
        refuse_unlocked(m, bank.memory[member], rows, epoch, lines, since_last)
    if par.visibility != OFF:
        mask_hidden(m, P, par, observation, s, bank.seen[member], work.masking, since_last)
    response = m.motion_response[: P.shape[0] if m.log_weight < 0.0 else 0]  # of one of several headings
    done = judge_rows(bank, member, par, lines, observation, t_ns, s)
    if par.at_clone >= 0:
        follow_lasting_errors(m, P, bank.memory[member], s, observation, CARRIER, t_ns, par)
    gate_carriers(bank, member, par, lines, s.vectors, done, since_last)
    log_likelihood, information, no_ranges, no_rates = use_epoch(
        m, P, lines, s.vectors, par, since_last, scratch.A, response
    )  # the prior is in scratch.A then
    if par.drift_gate > 0.0:
        hold_contradicted(m, bank.memory[member], lines, observation, t_ns)
    if done.clock_step == 0.0 and done.drift_step == 0.0:
        adapt_noise(m, scratch.A, P, par, s, last - first, t_ns)
        follow_explained(m, scratch.A, par, lines, s.fit, t_ns)
    if par.motion_gate2 > 0.0:
        turn_attitude_errors(m, P, par, correction, s.antenna[0])
        turn_force_errors(m, P, par, correction)
    follow_slow_errors(bank, member, par, rows, epoch, since_last, s)
    close_loop(m, correction, P.shape[0] - (N_CLONE if par.at_clone >= 0 else 0))
    if par.at_clone >= 0:
        place_antenna(m, par, w_ib_b, f_b, s.antenna[0])
        begin_difference(m, P, par, s, t_ns, response)
    return UpdateOutcome(
        log_likelihood,
        done.ranges_used - no_ranges,
        done.ranges_refused,
        done.rates_used - no_rates,
        done.rates_refused,
        done.clock_step,
        done.drift_step,
        done.mean_nis,
        information,
    )


@kernel(inline=True)
def begin_difference(
    m: StateRecord, P: Float64, par: Parameters, s: EpochWorkspace, t_ns: int, response: Float64
) -> None:
    """Make this epoch's antenna the reference of the next epoch's carrier differences."""
    keep_clone_rows(P, par, s.vectors)
    clone_epoch(m, P, par, s.antenna[0], s.air[0], t_ns)
    if response.shape[0] > 0:
        clone_response(response, par.at_clone)


@kernel(inline=True)
def keep_clone_rows(P: Float64, par: Parameters, vectors: Float64) -> None:
    """Write the smoother's data of the epoch before, which is about to be replaced."""
    for i in range(N_CLONE):
        for j in range(P.shape[0]):
            vectors[CLONE_ROWS + i, j] = P[par.at_clone + i, j]


@kernel(inline=True)
def clone_response(response: Float64, at_clone: int) -> None:
    """Let the clone's part of the motion's response begin where antenna and clock stand."""
    for i in range(3):
        response[at_clone + i] = response[DR + i]
    response[at_clone + 3] = response[CLOCK]


@kernel(inline=True)
def leave_out(rows: GnssRows, epoch: int, lines: Lines) -> None:
    """Mark the rows of an epoch as unused because no filter runs."""
    first = rows.first[epoch]
    for j in range(rows.first[epoch + 1] - first):
        line = lines[j]
        line.u_n[0] = math.nan
        for kind in range(2):
            line.status[kind] = rows.observation[first + j].status[kind]
        line.status[CARRIER] = rows.carrier[first + j].status if rows.carrier.shape[0] > 0 else ABSENT
        for kind in range(N_KINDS):
            line.innovation[kind] = math.nan
            if line.status[kind] == USED:
                line.status[kind] = NOT_STARTED


@kernel(inline=True)
def doubt_clock(m: StateRecord, P: Float64, par: Parameters, since_last: float) -> None:
    """Give the clock its grade's own wander over an outage, however quiet it has been found over a second.

    Equation: P += (1 - f) q [[T^3/3, T^2/2], [T^2/2, T]] for the drift's density q and its factor f < 1, and
    P_clock += (1 - f) q T likewise for the bias
    """
    if not _OUTAGE_S < since_last < _LONGEST_OUTAGE_S:
        return
    bias = max(1.0 - m.noise_factor[BIAS_FACTOR], 0.0) * par.clock_bias_density
    drift = max(1.0 - m.noise_factor[DRIFT_FACTOR], 0.0) * par.clock_drift_density
    P[CLOCK, CLOCK] += bias * since_last + drift * since_last**3 / 3.0
    P[CLOCK, DRIFT] += drift * since_last**2 / 2.0
    P[DRIFT, CLOCK] = P[CLOCK, DRIFT]
    P[DRIFT, DRIFT] += drift * since_last


@kernel(apart=True)
def use_epoch(
    m: StateRecord,
    P: Float64,
    lines: Lines,
    vectors: Float64,
    par: Parameters,
    since_last: float,
    prior: Float64,
    response: Float64,
) -> tuple[float, float, int, int]:
    """Update with all rows of an epoch; return the sums of ``use_rows``, and how many rows were taken out again.

    Where rows of a kind contradict each other after the update, those that the others contradict (a third of them at
    most) are found and the update is done once more without them; an epoch that agrees costs nothing. The last two
    numbers are how many of each kind were taken out.
    """
    n = P.shape[0]
    correction = vectors[0]
    copy_matrix(P, prior)
    for i in range(response.shape[0]):
        vectors[3, i] = response[i]
    no_ranges, no_rates, no_carriers = 0, 0, 0
    log_likelihood, information = 0.0, 0.0
    spreads = (
        spread_of(m, par, PSEUDORANGE, since_last),
        spread_of(m, par, RANGE_RATE, since_last),
        spread_of(m, par, CARRIER, since_last),
    )
    for turn in range(2):
        for i in range(n):
            correction[i] = 0.0
        log_likelihood, information = 0.0, 0.0
        for kind in range(N_KINDS):
            of_kind = use_rows(P, lines, vectors, kind, par.kind[kind].gate2, spreads[kind], response)
            log_likelihood += of_kind[0]
            information += of_kind[1]
        if turn == 1 or par.residual_gate2 <= 0.0:
            break
        no_ranges = left_out_of(PSEUDORANGE, prior, P, lines, correction, par, spreads[PSEUDORANGE])
        if response.shape[0] == 0:  # under a wrong heading the right rates contradict each other
            no_rates = left_out_of(RANGE_RATE, prior, P, lines, correction, par, spreads[RANGE_RATE])
            no_carriers = left_out_of(CARRIER, prior, P, lines, correction, par, spreads[CARRIER])
        if no_ranges + no_rates + no_carriers == 0:
            break
        copy_matrix(prior, P)
        for i in range(response.shape[0]):
            response[i] = vectors[3, i]
    return log_likelihood, information, no_ranges, no_rates


@kernel(inline=True)
def left_out_of(
    kind: int,
    prior: Float64,
    P: Float64,
    lines: Lines,
    correction: Float64,
    par: Parameters,
    spread: float,
) -> int:
    """Refuse the rows of a kind that the others contradict after an update; return how many."""
    if not disagrees(P, lines, kind, correction, par.residual_gate2, spread):
        return 0
    return int(refuse_inconsistent(prior, lines, kind, par.residual_gate2))


@kernel(inline=True)
def spread_of(m: StateRecord, par: Parameters, kind: int, since_last: float) -> float:
    """Return by how much a variance counts more than one epoch's own, see ``use_rows``."""
    declared = par.kind[kind].correlation / since_last
    return float(max(declared, epochs_of_an_error(m, par, kind, since_last)))


@kernel(apart=True)
def use_rows(
    P: Float64, lines: Lines, vectors: Float64, kind: int, gate2: float, spread: float, response: Float64
) -> tuple[float, float]:
    """Update with each row of one kind in turn; return the logarithm of their likelihood (up to a constant).

    The second number is by how many squared sigmas the shown motion has moved what the rows are expected to be.
    ``response`` (n,), or (0,) where only one heading is left, is corrected by each row as the state is:
    q <- q - K h q.

    ``spread`` s is by how much a variance counts more than one epoch's own, because epochs share their errors: the mean
    of n errors that are equal over n epochs has the variance of one, not of one n-th. So n rows carry the information
    of n / s independent ones, of their noise r, too:

        ln L = -1/2 sum (y^2 / S + ln(S / (s r)) + (ln r) / s),   S = h P h^T + s r

    which is greatest where r is the variance of the errors, as the likelihood of independent rows is. A row whose
    innovation has no positive, finite variance, as the covariance has lost its sign, is refused.

    A range rate whose own level L has risen in this epoch (``satellite_noise``) costs 3/2 ln L more. So its density
    falls with L^-2, as that of Student's t, and no hypothesis gains by noise that follows its own innovation. It does
    not fall below that of a reflection, which may have any range rate of a street; nor does that of a refused one.
    """
    total, information = 0.0, 0.0
    ratios, noise = 1.0, 1.0  # products of S / (s r) and of r, whose logarithms are taken once for many
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[kind] == USED:
            columns = line.columns[kind][: line.count[kind]]
            r = line.variance[kind]
            y, S = scalar_update(P, line.h[kind], columns, line.innovation[kind], spread * r, vectors)
            if 0.0 < S < math.inf and math.isfinite(y):
                keep_gain(vectors, j, kind, P.shape[0])
                information += respond(line, kind, response, vectors) / S
                ratio = S / (spread * r)
                if kind == RANGE_RATE and line.extra > line.foreseen:
                    cost = 0.5 * (y * y / S + math.log(ratio) + math.log(r) / spread)
                    cost += 1.5 * math.log(r / foreseen_variance(line, kind)) / spread
                    total -= min(cost, reflection_cost(math.log(S)) / spread)
                    continue
                total -= 0.5 * y * y / S
                if not (_SMALL < ratios * ratio < _LARGE and _SMALL < noise * r < _LARGE):
                    total -= 0.5 * (math.log(ratios) + math.log(noise) / spread)
                    ratios, noise = 1.0, 1.0
                ratios *= ratio
                noise *= r
            else:
                line.status[kind] = GATED
        if line.status[kind] in (GATED, INCONSISTENT):
            # a hypothesis must not gain by leaving out what contradicts it
            S = line.predicted[kind] + line.variance[kind]
            log_S = math.log(S) if 0.0 < S < math.inf else 0.0
            total -= (reflection_cost(log_S) if kind == RANGE_RATE else 0.5 * (gate2 + log_S)) / spread
    return total - 0.5 * (math.log(ratios) + math.log(noise) / spread), information


def charge(
    squares: Float64 | float, S: Float64 | float, r: Float64 | float, spread: Float64 | float
) -> Float64:
    """Return the terms of ``use_rows`` for rows outside the loop, interpreted: y^2 / S + ln(S / (s r)) + (ln r) / s."""
    return np.asarray(squares + np.log(S / (spread * r)) + np.log(r) / spread)


def charge_of_refused(kind: int, gate2: float, S: Float64, spread: Float64 | float) -> Float64:
    """Return the terms of ``use_rows`` for rows that it leaves out: twice a reflection's cost or the gate's, over s."""
    log_S = np.log(S)
    reflected = 2.0 * (_ONE_IN_TEN + np.maximum(_FLAT, 0.5 * log_S))
    return np.asarray((reflected if kind == RANGE_RATE else gate2 + log_S) / spread)


@kernel(inline=True)
def reflection_cost(log_S: float) -> float:
    """Return what a range rate costs that may be anything within 18 m/s, or within the sigma sqrt(S) if wider."""
    return _ONE_IN_TEN + max(_FLAT, 0.5 * log_S)


@kernel(inline=True)
def respond(line: Line, kind: int, response: Float64, vectors: Float64) -> float:
    """Correct the response to the shown motion by a row used just now; return the square of what it moved the row by.

    The row's gain is still where ``scalar_update`` wrote it.
    """
    moved = 0.0
    if response.shape[0] > 0:
        for a in range(line.count[kind]):
            moved += line.h[kind, a] * response[line.columns[kind, a]]
        for c in range(response.shape[0]):
            response[c] -= vectors[1, c] * moved
    return moved * moved
