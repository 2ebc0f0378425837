"""Which rows of an epoch are used: what is known to be wrong, what stands out, and what creeps, compiled."""

from __future__ import annotations

from typing import NamedTuple

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import EpochWorkspace, Lines
from insgnss.filter.state import Bank
from insgnss.filter.update.adaptation import raise_level
from insgnss.filter.update.carrier_doubt import doubt_carriers
from insgnss.filter.update.creeping import follow_satellites, refuse_left_out
from insgnss.filter.update.faults import refuse_reflections, weigh_robustly
from insgnss.filter.update.gating import (
    absorb_clock_step,
    common_step,
    count_rows,
    gate_between,
    gate_rows,
    shown_clock,
    shown_clock_variance,
)
from insgnss.filter.update.lasting_errors import follow_lasting_errors
from insgnss.filter.update.satellite_noise import widen_noisy_rates
from insgnss.gnss.observation_rows import CARRIER, PSEUDORANGE, RANGE_RATE, Observations
from insgnss.kernels.jit import kernel
from insgnss.status import CLOCK_STEPPED, USED
from insgnss.tables import Float64


class UpdateOutcome(NamedTuple):
    """An epoch's effect on one hypothesis."""

    log_likelihood: float
    ranges_used: int
    ranges_refused: int  # by the gate
    rates_used: int
    rates_refused: int
    clock_step: float  # [m], 0 when there was none
    drift_step: float  # [m/s]
    mean_nis: float  # the larger of both kinds' mean normalised innovation squared, none counting more than the gate
    motion_information: float  # squared sigmas by which the shown motion has moved the rows' predictions


@kernel(apart=True)
def judge_rows(
    bank: Bank,
    member: int,
    par: Parameters,
    lines: Lines,
    observation: Observations,
    t_ns: int,
    s: EpochWorkspace,
) -> UpdateOutcome:
    """Refuse the ranges and rates of an epoch that are known to be wrong or that stand out; return what was found."""
    m, P, memory, values = bank.state[member], bank.P[member], bank.memory[member], s.vectors[3]
    done = UpdateOutcome(0.0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0.0)
    if par.drift_gate > 0.0:
        refuse_left_out(memory, lines, observation, t_ns * 1e-9)
    for kind in range(2):
        group = shown_clock(lines, kind)
        old = shown_clock_variance(P, kind, group)
        raise_level(m, P, lines, kind, s.fit, values, par)
        if kind == RANGE_RATE:
            widen_noisy_rates(P, memory, lines, observation, t_ns, s.fit, values, par)
            follow_lasting_errors(m, P, memory, s, observation, RANGE_RATE, t_ns, par)
        step, variance = common_step(lines, kind, values, par.kind[kind].least_step, old)
        if step != 0.0:
            absorb_clock_step(m.clock, P, lines, kind, group, step, variance)
        if kind == PSEUDORANGE:
            refuse_reflections(m, lines, observation, t_ns, par)
        used, refused, mean_nis = gate_rows(lines, kind, par.kind[kind].gate2)
        if bank.state.shape[0] == 1:  # rows that contradict a wrong heading must not be widened for its sake
            weigh_robustly(lines, kind, par)
        done = noted(done, kind, used, refused, step, mean_nis)
    if follow_satellites(m, memory, lines, observation, t_ns, s.fit, values, par):
        done = counted_again(done, lines, par)
    return done


@kernel(inline=True)
def gate_carriers(
    bank: Bank,
    member: int,
    par: Parameters,
    lines: Lines,
    vectors: Float64,
    done: UpdateOutcome,
    since_last: float,
) -> None:
    """Gate the carrier differences: the inertial prediction is what finds a slip that nothing else has found.

    Each is judged alone, with the clock's wander in its sigma, and against the others, without it.

    Where the receiver's clock stepped, the carrier may have stepped with it or not: its differences wait an epoch.
    """
    if done.clock_step != 0.0 or done.drift_step != 0.0:
        for j in range(lines.shape[0]):
            if lines[j].status[CARRIER] == USED:
                lines[j].status[CARRIER] = CLOCK_STEPPED
        return
    gate2 = par.kind[CARRIER].gate2
    gate_rows(lines, CARRIER, gate2)
    gate_between(bank.P[member], lines, vectors, gate2)
    if bank.state.shape[0] == 1:  # rows that contradict a wrong heading must not be widened for its sake
        doubt_carriers(bank.state[member], lines, vectors[2], gate2, since_last)


@kernel(inline=True)
def counted_again(done: UpdateOutcome, lines: Lines, par: Parameters) -> UpdateOutcome:
    """Return the outcome without satellites that are left out: known faults do not count against the filter."""
    again = UpdateOutcome(0.0, 0, 0, 0, 0, done.clock_step, done.drift_step, 0.0, 0.0)
    for kind in range(2):
        used, refused, mean_nis = count_rows(lines, kind, par.kind[kind].gate2)
        step = done.clock_step if kind == PSEUDORANGE else done.drift_step
        again = noted(again, kind, used, refused, step, mean_nis)
    return again


@kernel(inline=True)
def noted(
    done: UpdateOutcome, kind: int, used: int, refused: int, step: float, mean_nis: float
) -> UpdateOutcome:
    """Return the outcome with the numbers of one kind in it; fewer than four rows give no mean NIS."""
    worst = max(done.mean_nis, mean_nis) if used + refused >= 4 else done.mean_nis
    if kind == 0:
        return UpdateOutcome(
            0.0, used, refused, done.rates_used, done.rates_refused, step, done.drift_step, worst, 0.0
        )
    return UpdateOutcome(
        0.0, done.ranges_used, done.ranges_refused, used, refused, done.clock_step, step, worst, 0.0
    )
