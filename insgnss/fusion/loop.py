"""The compiled loop over a log: carry the bank to each epoch, update it, write what came of it.

The streaming engine calls the same function with one epoch at a time: both give the same bits.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.antenna.installation import Installation
from insgnss.antenna.visibility import Limits
from insgnss.apart import apart
from insgnss.fusion.epoch_update import Outcome, update_epoch
from insgnss.fusion.lines import Epoch, new_epoch
from insgnss.fusion.masking import NO_LIMITS, Masking, new_masking
from insgnss.fusion.output import (
    CLOCK_STEP,
    DRIFT_STEP,
    MASKING_ON,
    MASKING_WAITS,
    MEASUREMENTS_BACK,
    NO_MEASUREMENTS,
    Output,
    Table,
    log_event,
    mixture_covariance,
    write_ledger,
    write_nav,
)
from insgnss.fusion.parameters import Parameters
from insgnss.fusion.prediction import Imu, Scratch, carry_bank, new_scratch, predict_covariance
from insgnss.fusion.state import OFFSETS, PSI, Bank, HeadRecord, Layout, StateRecord, copy_state, new_bank
from insgnss.fusion.tracing import copy_matrix, write_trace
from insgnss.gnss.observation_rows import Rows
from insgnss.jit import borrowing, inlined
from insgnss.tables import Float64

# why the loop stopped
DONE: Final = 0  # all epochs processed
LOCKOUT: Final = 1  # most rows of a kind refused for too long
THIN_OUT: Final = 2  # a hypothesis has become negligible
COVARIANCE_LOST: Final = 3  # a variance is not positive any more
HEADING_KNOWN: Final = 4  # its sigma fell below the limit
SUSPICION: Final = 5  # all satellites contradict the prediction again and again, or one has run away

_SAME_HEADING = 1.0  # two hypotheses nearer than this many of their own sigmas are one
_SMALLEST_DIFFERENCE_RAD = 0.02
_FEW = 5  # rows of a kind, below which an epoch's fix has no redundancy
SILENCE_S = 10.0  # longer between two epochs is an outage, whatever the receiver's rate


class Workspace(NamedTuple):
    """All work space of the loop, allocated once per log."""

    epoch: Epoch
    scratch: Scratch
    spare: Bank  # one member: the leader carried on to an output time
    P_out: Float64  # (n, n)
    masking: Masking


def new_workspace(
    rows_per_epoch: int,
    layout: Layout,
    installation: Installation | None = None,
    limits: Limits = NO_LIMITS,
) -> Workspace:
    """Return work space for epochs of at most ``rows_per_epoch`` rows and the error states of ``layout``.

    ``installation`` and ``limits`` are those of the visibility stage.
    """
    n = OFFSETS + layout.n_optional
    epoch = new_epoch(rows_per_epoch, n, layout.at_clone)
    masking = new_masking(installation, limits)
    return Workspace(epoch, new_scratch(n), new_bank(1, layout.n_optional), np.zeros((n, n)), masking)


@apart
def advance(bank: Bank, stop_ns: int, imu: Imu, par: Parameters, out: Output, work: Workspace) -> None:
    """Carry the whole bank to ``stop_ns`` by way of the trace's times, writing the output times before it on the way.

    All that the bank is carried by way of are whole samples, which changes no bit of the filter; an output between
    samples is made on a copy of the leader. Times of the trace up to a start are passed over: there was no filter.
    """
    count, traced = out.counts[0], out.trace.counts[0]
    head = bank.head[0]
    while True:
        goal_ns = stop_ns
        writes = count.time < out.times_ns.shape[0] and out.times_ns[count.time] < stop_ns
        if writes:
            goal_ns = newest_sample(head, imu, out.times_ns[count.time])
        traces = traced.next < out.trace.times_ns.shape[0] and out.trace.times_ns[traced.next] <= goal_ns
        if traces:
            goal_ns = out.trace.times_ns[traced.next]
            traced.next += 1
        ahead = goal_ns > head.now_ns
        carry_bank(bank, goal_ns, imu, par, work.scratch)
        if traces:
            if ahead:
                asked_for = out.trace.is_epoch[traced.next - 1]
                write_trace(bank, goal_ns, asked_for, par, out.trace, work.P_out, work.scratch)
        elif writes:
            t_ns = out.times_ns[count.time]
            count.time += 1
            if t_ns >= head.now_ns:
                write_between(bank, t_ns, imu, par, out, work)
        else:
            return


@inlined
def newest_sample(head: HeadRecord, imu: Imu, t_ns: int) -> int:
    """Return the time of the last sample up to ``t_ns``, the bank's own where none lies between."""
    k = head.next
    whole_ns: int = head.now_ns
    while k < imu.t_ns.shape[0] and imu.t_ns[k] <= t_ns:
        whole_ns = imu.t_ns[k]
        k += 1
    return whole_ns


@inlined
def write_between(bank: Bank, t_ns: int, imu: Imu, par: Parameters, out: Output, work: Workspace) -> None:
    """Write a navigation row at ``t_ns`` from a copy of the leader."""
    head = bank.head[0]
    spare = work.spare
    copy_state(bank.state[head.leader], spare.state[0])
    copy_matrix(bank.P[head.leader], spare.P[0])
    spare.head[0].now_ns, spare.head[0].next = head.now_ns, head.next
    carry_bank(spare, t_ns, imu, par, work.scratch)
    predict_covariance(spare.state[0], spare.P[0], par, work.scratch)
    nothing_used = 0 * head.leader
    write_row(bank, spare, nothing_used, t_ns, nothing_used, out, work)


@apart
@borrowing
def write_row(bank: Bank, source: Bank, i: int, t_ns: int, n_used: int, out: Output, work: Workspace) -> None:
    """Write a row of member ``i`` of ``source`` with its covariance, or the bank's while the heading is open."""
    n_hypotheses = bank.state.shape[0]
    if n_hypotheses > 1:
        mixture_covariance(bank, work.P_out)
    else:
        copy_matrix(source.P[i], work.P_out)
    write_nav(out.nav, out.optional, out.counts[0], t_ns, source.state[i], work.P_out, n_used, n_hypotheses)


@inlined
def current_sample(bank: Bank, imu: Imu) -> int:
    """Return the index of the inertial sample whose rate holds at the bank's time."""
    k: int = bank.head[0].next
    if k >= imu.t_ns.shape[0] or imu.t_ns[k - 1] == bank.head[0].now_ns:
        return k - 1
    return k


@borrowing
def run_epochs(
    bank: Bank,
    first: int,
    last: int,
    rows: Rows,
    imu: Imu,
    parameters: Table,
    drop: float,
    out: Output,
    work: Workspace,
) -> tuple[int, int]:
    """Process the epochs ``first`` to ``last - 1``; return why it stopped and the epoch after the one it stopped at.

    Parameters
    ----------
    parameters : (1,) of ``PARAMETERS_DTYPE``
    drop : logarithm of the weight below which a hypothesis is negligible
    """
    par = parameters[0]
    head = bank.head[0]
    count = out.counts[0]
    for epoch in range(first, last):
        t_ns = rows.epoch_ns[epoch]
        advance(bank, t_ns, imu, par, out, work)
        k = current_sample(bank, imu)
        done = update_bank(bank, epoch, rows, imu.w_ib_b[k], imu.f_b[k], par, out, work)
        head.epoch_step_ns = t_ns - head.epoch_ns
        head.epoch_ns = t_ns
        at_time = count.time < out.times_ns.shape[0] and out.times_ns[count.time] == t_ns
        if at_time:
            count.time += 1
        if at_time or out.times_ns.shape[0] == 0:
            write_row(bank, bank, head.leader, t_ns, done.ranges_used, out, work)
        if not positive(bank.state[head.leader], bank.P[head.leader]):
            return COVARIANCE_LOST, epoch + 1
        n_ranges, n_rates = done.ranges_used + done.ranges_refused, done.rates_used + done.rates_refused
        few = max(n_ranges, n_rates) < _FEW
        locked = mostly(done.ranges_used, done.ranges_refused, few)
        locked = locked or mostly(done.rates_used, done.rates_refused, few)
        head.locked_out = head.locked_out + 1 if locked else 0
        if not done.strain > par.strain_limit:
            head.strained_ns = 0
        elif head.strained_ns == 0:
            head.strained_ns = t_ns
        strained = head.strained_ns != 0 and (t_ns - head.strained_ns) * 1e-9 >= par.strain_time
        if head.locked_out >= par.lockout_epochs or strained:
            return LOCKOUT, epoch + 1
        if thins_out(bank, drop):
            return THIN_OUT, epoch + 1
        if bank.state.shape[0] == 1 and t_ns >= head.doubted_ns and par.suspicion_limit > 0.0:
            if bank.state[0].suspicion > par.suspicion_limit or bank.state[0].crept_ns == t_ns:
                return SUSPICION, epoch + 1
        if head.heading_open == 1 and bank.state.shape[0] == 1:
            if yaw_variance(bank.state[0], bank.P[0]) < par.heading_known_variance:
                return HEADING_KNOWN, epoch + 1
    return DONE, last


@inlined
def mostly(used: int, refused: int, few: bool) -> bool:
    """Return whether most rows of a kind, and at least three unless an epoch has few, were refused by the gate."""
    return refused > used and (few or refused >= 3)


@borrowing
def yaw_variance(m: StateRecord, P: Float64) -> float:
    """Return the variance of the rotation about the local vertical (taken through the Earth's centre) [rad^2]."""
    r = math.sqrt(m.r_e[0] ** 2 + m.r_e[1] ** 2 + m.r_e[2] ** 2)
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += m.r_e[i] * P[PSI + i, PSI + j] * m.r_e[j]
    return total / (r * r)


@apart
@borrowing
def superfluous(bank: Bank, i: int, drop: float) -> bool:
    """Return whether hypothesis ``i`` can go: of negligible weight, or the same heading as a heavier one."""
    state = bank.state
    if state[i].log_weight < drop:
        return True
    own = math.sqrt(yaw_variance(state[i], bank.P[i]))
    for j in range(state.shape[0]):
        heavier = state[j].log_weight > state[i].log_weight or (
            state[j].log_weight == state[i].log_weight and j < i
        )
        if heavier:
            c = 0.0
            for k in range(4):
                c += state[i].q_eb[k] * state[j].q_eb[k]
            angle = 2.0 * math.acos(min(1.0, abs(c)))
            if angle < max(_SMALLEST_DIFFERENCE_RAD, _SAME_HEADING * own):
                return True
    return False


@inlined
def thins_out(bank: Bank, drop: float) -> bool:
    """Return whether the bank holds a hypothesis that can go."""
    n = bank.state.shape[0]
    if n > 1:
        for i in range(n):
            if superfluous(bank, i, drop):
                return True
    return False


@borrowing
def run_to(bank: Bank, stop_ns: int, imu: Imu, parameters: Table, out: Output, work: Workspace) -> None:
    """Carry the bank to ``stop_ns``, writing output times on the way, that one too."""
    par = parameters[0]
    advance(bank, stop_ns, imu, par, out, work)
    count = out.counts[0]
    if count.time < out.times_ns.shape[0] and out.times_ns[count.time] == stop_ns:
        count.time += 1
        write_between(bank, stop_ns, imu, par, out, work)


@inlined
def positive(m: StateRecord, P: Float64) -> bool:
    """Return whether the state is finite and no variance is negative; zero is a state known exactly."""
    for i in range(P.shape[0]):
        if not (P[i, i] >= 0.0 and P[i, i] < 1e30):
            return False
    return math.isfinite(m.r_e[0] + m.r_e[1] + m.r_e[2] + m.v_e[0] + m.q_eb[0])


@inlined
def update_bank(
    bank: Bank,
    epoch: int,
    rows: Rows,
    w_ib_b: Float64,
    f_b: Float64,
    par: Parameters,
    out: Output,
    work: Workspace,
) -> Outcome:
    """Update every hypothesis with one epoch; return what it did to the leader.

    The leader is updated last, so that the work space then holds its entries for the ledger.
    """
    n = bank.state.shape[0]
    lead = bank.head[0].leader
    since_last = (rows.epoch_ns[epoch] - bank.head[0].epoch_ns) * 1e-9
    for turn in range(n):
        i = turn if turn < lead else turn + 1
        if turn == n - 1:
            i = lead
        done = update_epoch(
            bank.state[i], bank.P[i], par, rows, epoch, w_ib_b, f_b, work.epoch, work.scratch,
            work.masking, bank.seen[i], bank.memory[i], since_last, n == 1,
        )  # fmt: skip
        if n > 1:
            bank.state[i].log_weight += done.log_likelihood
        else:
            bank.head[0].log_likelihood += done.log_likelihood
    normalise_weights(bank)
    t_ns = rows.epoch_ns[epoch]
    write_ledger(
        out.ledger,
        out.carrier,
        rows.first[epoch],
        work.epoch.lines[: rows.first[epoch + 1] - rows.first[epoch]],
    )
    if done.clock_step != 0.0:
        log_event(out.events, out.counts[0], t_ns, CLOCK_STEP, done.clock_step)
        bank.head[0].renewed_ns = t_ns
    if done.drift_step != 0.0:
        log_event(out.events, out.counts[0], t_ns, DRIFT_STEP, done.drift_step)
        bank.head[0].renewed_ns = t_ns
    if par.visibility != 0:
        note_masking(bank.head[0], bank.state[lead], out, t_ns)
    note_outage(bank.head[0], out, t_ns, done.ranges_used + done.rates_used)
    return done


@inlined
def note_masking(head: HeadRecord, lead: StateRecord, out: Output, t_ns: int) -> None:
    """Write an event when the visibility stage begins to wait for the heading, and when it begins to mask."""
    now = 1 if lead.mask_waits == 1 else 2
    if now != head.masking:
        head.masking = now
        log_event(out.events, out.counts[0], t_ns, MASKING_WAITS if now == 1 else MASKING_ON, 0.0)


@inlined
def note_outage(head: HeadRecord, out: Output, t_ns: int, used: int) -> None:
    """Write an event when the measurements stop, refused or not written at all, and when they are back."""
    quiet = head.epoch_ns != 0 and (t_ns - head.epoch_ns) * 1e-9 > SILENCE_S
    if head.silent_ns == 0 and (used == 0 or quiet):
        head.silent_ns = head.epoch_ns if quiet else t_ns
        log_event(out.events, out.counts[0], head.silent_ns, NO_MEASUREMENTS, 0.0)
    if head.silent_ns != 0 and used > 0:
        log_event(out.events, out.counts[0], t_ns, MEASUREMENTS_BACK, (t_ns - head.silent_ns) * 1e-9)
        head.silent_ns = 0


@inlined
def normalise_weights(bank: Bank) -> None:
    """Make the weights sum to one and name the heaviest hypothesis the leader."""
    state = bank.state
    lead = 0
    for i in range(1, state.shape[0]):
        if state[i].log_weight > state[lead].log_weight:
            lead = i
    top = state[lead].log_weight
    total = 0.0
    for i in range(state.shape[0]):
        total += math.exp(state[i].log_weight - top)
    for i in range(state.shape[0]):
        state[i].log_weight -= top + math.log(total)
    bank.head[0].leader = lead
