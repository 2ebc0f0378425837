"""The compiled loop over a log: carry the bank to each epoch, update it, write the result.

The streaming engine calls the same function with one epoch at a time: both give the same bits.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.headings.headings import (
    heading_variance,
    is_open_again,
    is_wide,
    needs_pruning,
    share_noise_levels,
    weigh_headings,
    widest_variance,
)
from insgnss.filter.headings.sideslip import note_sideslip
from insgnss.filter.imu.sensor_outage import MOTION_TIME_S
from insgnss.filter.output.total_sigmas import write_slow
from insgnss.filter.output.tracing import write_trace
from insgnss.filter.output.writing import (
    CLOCK_STEP,
    DRIFT_STEP,
    MASKING_ON,
    MASKING_UNCERTAIN,
    MASKING_WAITS,
    MEASUREMENTS_BACK,
    NO_MEASUREMENTS,
    RANGES_NOISY,
    RATES_NOISY,
    TAG_STEP,
    TAGS_UNSTEADY,
    Output,
    Table,
    log_event,
    mixture_covariance,
    write_ledger,
    write_nav,
)
from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples, carry_bank, predict_covariance
from insgnss.filter.soundness import is_sound
from insgnss.filter.state import DV, OFFSETS, Bank, HeadRecord, StateRecord, copy_matrix, copy_state
from insgnss.filter.update.epoch_space import FilterWorkspace
from insgnss.filter.update.epoch_update import update_epoch
from insgnss.filter.update.judging import UpdateOutcome
from insgnss.filter.update.range_biases import place_range_biases
from insgnss.filter.update.tag_jumps import UNSTEADY
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.kernels.jit import kernel

# why the loop stopped
DONE: Final = 0  # all epochs processed
LOCKOUT: Final = 1  # most rows of a kind refused for too long
PRUNE: Final = 2  # a hypothesis is negligible, or has the heading of a heavier one
COVARIANCE_LOST: Final = 3  # the state is not finite any more, or a variance not positive
HEADING_KNOWN: Final = 4  # its sigma fell below the limit
HEADING_WIDE: Final = 5  # a hypothesis is less certain of its heading than one filter can be linear in
SUSPICION: Final = 6  # all satellites contradict the prediction again and again, or one has run away
HEADING_OPEN: Final = 7  # of several headings none is known any more
TAGS_JUMPED: Final = 8  # the GNSS tags have jumped

_FEW = 5  # rows of a kind, below which an epoch's fix has no redundancy
# satellites at an edge come and go: uncertainty that returns within it is one event
_UNCERTAIN_APART_S = 10.0
_NOISY: Final = 9.0  # times the variance before: of less the sigmas alone give notice
_MANY = 7  # pseudoranges that place the filter ...
_PER_REFUSED = 9  # ... so many used for each refused
_RATES = 4  # range rates that measure a velocity
_WAY_S = 3.0  # longest gap that they bridge
SILENCE_S = 10.0  # longer between two epochs is an outage, whatever the receiver's rate


@kernel(apart=True)
def advance(
    bank: Bank, stop_ns: int, imu: ImuSamples, par: Parameters, out: Output, work: FilterWorkspace
) -> None:
    """Carry the whole bank to ``stop_ns`` by way of the trace's times, writing the output times before it on the way.

    The bank is carried over whole samples only, which changes no bit of the filter; an output between
    samples is made on a copy of the leader. Times of the trace up to a start are passed over: there was no filter.
    """
    count, traced = out.counts[0], out.trace.counts[0]
    head: HeadRecord = bank.head[0]
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


@kernel(inline=True)
def newest_sample(head: HeadRecord, imu: ImuSamples, t_ns: int) -> int:
    """Return the time of the last sample up to ``t_ns``, the bank's own where none lies between."""
    k = head.next
    whole_ns: int = head.now_ns
    while k < imu.t_ns.shape[0] and imu.t_ns[k] <= t_ns:
        whole_ns = imu.t_ns[k]
        k += 1
    return whole_ns


@kernel(apart=True)
def write_between(
    bank: Bank, t_ns: int, imu: ImuSamples, par: Parameters, out: Output, work: FilterWorkspace
) -> None:
    """Write a navigation row at ``t_ns`` from a copy of the leader."""
    head: HeadRecord = bank.head[0]
    spare = work.spare
    copy_state(bank.state[head.leader], spare.state[0])
    copy_matrix(bank.P[head.leader], spare.P[0])
    spare.head[0].now_ns, spare.head[0].next = head.now_ns, head.next
    carry_bank(spare, t_ns, imu, par, work.scratch)
    predict_covariance(spare.state[0], spare.P[0], par, work.scratch)
    nothing_used = 0 * head.leader
    write_row(bank, spare, nothing_used, t_ns, nothing_used, par, out, work)


@kernel(apart=True)
def write_row(
    bank: Bank,
    source: Bank,
    i: int,
    t_ns: int,
    n_used: int,
    par: Parameters,
    out: Output,
    work: FilterWorkspace,
) -> None:
    """Write a row of member ``i`` of ``source`` with its covariance, or the bank's while the heading is open."""
    n_hypotheses = bank.state.shape[0]
    if n_hypotheses > 1:
        mixture_covariance(bank, work.P_out)
    else:
        copy_matrix(source.P[i], work.P_out)
    used, written = (n_used, n_hypotheses), out.counts[0].nav
    write_nav(out.nav, out.optional, out.counts[0], t_ns, source.state[i], work.P_out, par, used)
    if out.counts[0].nav > written:
        write_slow(out.nav, bank, written)


@kernel(inline=True)
def current_sample(bank: Bank, imu: ImuSamples) -> int:
    """Return the index of the inertial sample whose rate holds at the bank's time."""
    k: int = bank.head[0].next
    if k >= imu.t_ns.shape[0] or imu.t_ns[k - 1] == bank.head[0].now_ns:
        return k - 1
    return k


@kernel
def run_epochs(
    bank: Bank,
    epochs: tuple[int, int],
    rows: GnssRows,
    imu: ImuSamples,
    parameters: Table,
    drop: float,
    out: Output,
    work: FilterWorkspace,
) -> tuple[int, int]:
    """Process epochs; return why it stopped and the epoch after the one it stopped at.

    Parameters
    ----------
    epochs : the first of them, and the one after the last
    parameters : (1,) of ``PARAMETERS_DTYPE``
    drop : logarithm of the weight below which a hypothesis is negligible
    """
    par: Parameters = parameters[0]
    head: HeadRecord = bank.head[0]
    count = out.counts[0]
    for epoch in range(epochs[0], epochs[1]):
        t_ns = rows.epoch_ns[epoch]
        advance(bank, t_ns, imu, par, out, work)
        k = current_sample(bank, imu)
        done = update_bank(bank, epoch, rows, imu, k, par, out, work)
        if bank.state.shape[0] == 1:
            note_sideslip(head, bank.state[0], bank.P[0], t_ns)
        if k < imu.unknown.shape[0] and imu.unknown[k, 0] > 0.0:
            widen_velocity(bank, imu.unknown[k, 0], par)
        note_place(head, done, t_ns)
        head.epoch_step_ns = t_ns - head.epoch_ns
        head.epoch_ns = t_ns
        at_time = count.time < out.times_ns.shape[0] and out.times_ns[count.time] == t_ns
        if at_time:
            count.time += 1
        if bank.state[head.leader].log_likelihood == -math.inf:
            return COVARIANCE_LOST, epoch + 1
        if at_time or out.times_ns.shape[0] == 0:
            write_row(bank, bank, head.leader, t_ns, done.ranges_used, par, out, work)
        n_ranges, n_rates = done.ranges_used + done.ranges_refused, done.rates_used + done.rates_refused
        few = max(n_ranges, n_rates) < _FEW
        locked = mostly(done.ranges_used, done.ranges_refused, few)
        locked = locked or mostly(done.rates_used, done.rates_refused, few)
        head.rejected_epochs = head.rejected_epochs + 1 if locked else 0
        if not done.mean_nis > par.divergence_nis:
            head.diverged_ns = 0
        elif head.diverged_ns == 0:
            head.diverged_ns = t_ns
        diverged = head.diverged_ns != 0 and (t_ns - head.diverged_ns) * 1e-9 >= par.divergence_time
        if head.tag_jump_ns == t_ns and (head.tag_jumps <= UNSTEADY or par.at_gnss_time < 0):
            return TAGS_JUMPED, epoch + 1
        if head.rejected_epochs >= par.lockout_epochs or diverged:
            return LOCKOUT, epoch + 1
        if needs_pruning(bank, drop):
            return PRUNE, epoch + 1
        if is_wide(bank, widest_variance(bank, par.widest_heading_variance)):
            return HEADING_WIDE, epoch + 1
        if bank.state.shape[0] == 1 and is_suspect(bank.state[0], head.doubted_ns, t_ns, par.suspicion_limit):
            return SUSPICION, epoch + 1
        if head.heading_open == 1 and heading_variance(bank) < par.heading_known_variance:
            return HEADING_KNOWN, epoch + 1
        if is_open_again(bank, par.widest_heading_variance):
            return HEADING_OPEN, epoch + 1
    return DONE, epochs[1]


@kernel(inline=True)
def note_place(head: HeadRecord, done: UpdateOutcome, t_ns: int) -> None:
    """Note when many pseudoranges last agreed with the place; forget it where range rates stop measuring velocity."""
    late = (t_ns - head.epoch_ns) * 1e-9 > _WAY_S
    if late or done.rates_used < _RATES or done.rates_refused > done.rates_used:
        head.placed_ns = 0
    if done.ranges_used >= _MANY and _PER_REFUSED * done.ranges_refused <= done.ranges_used:
        head.placed_ns = t_ns


@kernel(inline=True)
def is_suspect(m: StateRecord, doubted_ns: int, t_ns: int, limit: float) -> bool:
    """Return whether there is a fault to report, or from ``doubted_ns`` on one to search for."""
    if limit <= 0.0:
        return False
    if m.stuck_since_ns == t_ns or m.crept_ns == t_ns:
        return True
    return bool(t_ns >= doubted_ns and m.suspicion > limit)


@kernel(inline=True)
def widen_velocity(bank: Bank, unknown: float, par: Parameters) -> None:
    """Add to the velocity's variance what an unknown rate adds between the antenna, which was measured, and the IMU.

    Equation: var(w x l) <= sigma^2 |l|^2 with the rate's variance sigma^2 = density / (2 T), as in ``sensor_outage``
    """
    lever2 = par.lever_b[0] ** 2 + par.lever_b[1] ** 2 + par.lever_b[2] ** 2
    for member in range(bank.state.shape[0]):
        for i in range(DV, DV + 3):
            bank.P[member, i, i] += unknown / (2.0 * MOTION_TIME_S) * lever2


@kernel(inline=True)
def mostly(used: int, refused: int, few: bool) -> bool:
    """Return whether most rows of a kind, and at least three unless an epoch has few, were refused by the gate."""
    return refused > used and (few or refused >= 3)


@kernel
def run_to(
    bank: Bank, stop_ns: int, imu: ImuSamples, parameters: Table, out: Output, work: FilterWorkspace
) -> None:
    """Carry the bank to ``stop_ns``, writing output times on the way, that one too."""
    par: Parameters = parameters[0]
    advance(bank, stop_ns, imu, par, out, work)
    count = out.counts[0]
    if count.time < out.times_ns.shape[0] and out.times_ns[count.time] == stop_ns:
        count.time += 1
        write_between(bank, stop_ns, imu, par, out, work)


@kernel(apart=True)
def update_bank(
    bank: Bank,
    epoch: int,
    rows: GnssRows,
    imu: ImuSamples,
    k: int,
    par: Parameters,
    out: Output,
    work: FilterWorkspace,
) -> UpdateOutcome:
    """Update every hypothesis with one epoch, in the rate of sample ``k``; return its effect on the leader.

    The leader is updated last, so that the work space then holds its entries for the ledger.
    """
    n = bank.state.shape[0]
    lead = bank.head[0].leader
    if par.n_slow > 0:
        place_range_biases(bank, par, rows, epoch, work.epoch.lines)
    for turn in range(n):
        i = turn if turn < lead else turn + 1
        if turn == n - 1:
            i = lead
        done = update_epoch(bank, i, par, rows, epoch, imu, k, work)
        sound = math.isfinite(done.log_likelihood) and is_sound(bank.state[i], bank.P[i])
        # one that is lost has no weight
        bank.state[i].log_likelihood = done.log_likelihood if sound else -math.inf
        bank.state[i].motion_information = done.motion_information if sound else 0.0
    if n > 1:
        weigh_headings(bank, par, False)
        share_noise_levels(bank)
    else:
        bank.head[0].log_likelihood += done.log_likelihood
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
    if bank.head[0].tag_jump_ns == t_ns and bank.head[0].tag_jumps <= UNSTEADY:
        note_tag_jump(bank.head[0], bank.state[lead], par, out, t_ns)
    risen = bank.state[lead].level_risen
    if risen[PSEUDORANGE] > _NOISY:
        log_event(out.events, out.counts[0], t_ns, RANGES_NOISY, math.sqrt(risen[PSEUDORANGE]))
    if risen[RANGE_RATE] > _NOISY:
        log_event(out.events, out.counts[0], t_ns, RATES_NOISY, math.sqrt(risen[RANGE_RATE]))
    if par.visibility != 0:
        note_masking(bank.head[0], bank.state[lead], out, t_ns)
    note_outage(bank.head[0], out, t_ns, done.ranges_used + done.rates_used)
    return done


@kernel(inline=True)
def note_tag_jump(head: HeadRecord, lead: StateRecord, par: Parameters, out: Output, t_ns: int) -> None:
    """Write an event on GNSS tags that have jumped, and one when they have jumped too often to be believed."""
    if par.at_gnss_time < 0:
        log_event(out.events, out.counts[0], t_ns, TAG_STEP, head.tag_late_s)
        return
    log_event(out.events, out.counts[0], t_ns, TAG_STEP, -lead.optional[par.at_gnss_time - OFFSETS])
    if head.tag_jumps == UNSTEADY:
        log_event(out.events, out.counts[0], t_ns, TAGS_UNSTEADY, UNSTEADY * 1.0)


@kernel(inline=True)
def note_masking(head: HeadRecord, lead: StateRecord, out: Output, t_ns: int) -> None:
    """Write an event when the visibility stage begins to wait for the heading, and when it begins to mask.

    Satellites whose visibility is uncertain are counted; the event has the time of the first and their number.
    """
    now = 1 if lead.mask_waits == 1 else 2
    if now != head.masking:
        head.masking = now
        log_event(out.events, out.counts[0], t_ns, MASKING_WAITS if now == 1 else MASKING_ON, 0.0)
    if lead.mask_uncertain > 0:
        if head.uncertain == 0:
            head.uncertain_ns = t_ns
        head.uncertain += lead.mask_uncertain
        head.uncertain_last_ns = t_ns
    elif head.uncertain > 0 and (t_ns - head.uncertain_last_ns) * 1e-9 > _UNCERTAIN_APART_S:
        log_event(out.events, out.counts[0], head.uncertain_ns, MASKING_UNCERTAIN, head.uncertain * 1.0)
        head.uncertain = 0


@kernel(inline=True)
def note_outage(head: HeadRecord, out: Output, t_ns: int, used: int) -> None:
    """Write an event when the measurements stop, refused or not written at all, and when they are back."""
    quiet = head.epoch_ns != 0 and (t_ns - head.epoch_ns) * 1e-9 > SILENCE_S
    if head.silent_ns == 0 and (used == 0 or quiet):
        head.silent_ns = head.epoch_ns if quiet else t_ns
        log_event(out.events, out.counts[0], head.silent_ns, NO_MEASUREMENTS, 0.0)
    if head.silent_ns != 0 and used > 0:
        log_event(out.events, out.counts[0], t_ns, MEASUREMENTS_BACK, (t_ns - head.silent_ns) * 1e-9)
        head.silent_ns = 0
