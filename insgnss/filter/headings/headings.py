"""The headings of a bank: their likelihood at an epoch, and which of them are still distinct; compiled.

Two hypotheses that agree to half a sigma are one Gaussian again; one that is wider than a filter can be linear in is to
be split (``heading_bank`` does both).
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.headings.motion import sees_earth_rate
from insgnss.filter.parameters import Parameters
from insgnss.filter.state import N_FACTORS, N_LASTING_SUMS, PSI, Bank, StateArray, StateRecord
from insgnss.geodesy.local_level import up_direction
from insgnss.gnss.observation_rows import N_KINDS
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_SAME_HEADING: Final = 0.5  # sigmas of the lighter one
# and no farther: together they are as linear as each of them was
_SAME_HEADING_RAD: Final = math.radians(5.0)
SMALLEST_DIFFERENCE_RAD: Final = 0.02
FINER: Final = 3  # times as many headings where a motion shows the heading better than they are linear
WRONG_EPOCH: Final = 0.01  # odds that the rows of an epoch are wrong together and say nothing of the heading
# squared sigmas of an epoch's rows per rad^2 by which noise that turns with the heading can move them: one for each
# horizontal axis, if the rows know it better than the accelerometers
_BY_NOISE: Final = 2.0
_CURVED: Final = 0.1  # sigmas of an epoch's rows that the second order of a heading may make


@kernel
def yaw_variance(m: StateRecord, P: Float64) -> float:
    """Return the variance of the rotation about the local vertical [rad^2]."""
    up = up_direction(m.r_e)
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += up[i] * P[PSI + i, PSI + j] * up[j]
    return total


@kernel
def turn_about(m: StateRecord, other: StateRecord) -> float:
    """Return the turn about the vertical that brings ``m`` nearest to the attitude of ``other`` [rad]."""
    p, q = other.q_eb, m.q_eb  # p (x) conj(q)
    c = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]
    x = -p[0] * q[1] + p[1] * q[0] - p[2] * q[3] + p[3] * q[2]
    y = -p[0] * q[2] + p[2] * q[0] - p[3] * q[1] + p[1] * q[3]
    z = -p[0] * q[3] + p[3] * q[0] - p[1] * q[2] + p[2] * q[1]
    up = up_direction(m.r_e)
    sine = x * up[0] + y * up[1] + z * up[2]
    return 2.0 * (math.atan2(sine, c) if c >= 0.0 else math.atan2(-sine, -c))


@kernel
def heading_variance(bank: Bank) -> float:
    """Return the variance of the heading about the leader's, of all hypotheses together [rad^2]."""
    lead = bank.state[bank.head[0].leader]
    total = 0.0
    for i in range(bank.state.shape[0]):
        m: StateRecord = bank.state[i]
        total += math.exp(m.log_weight) * (yaw_variance(m, bank.P[i]) + turn_about(lead, m) ** 2)
    return total


@kernel(apart=True)
def is_prunable(bank: Bank, i: int, drop: float) -> bool:
    """Return whether hypothesis ``i`` can go: of negligible weight, or the same heading as a heavier one."""
    return bank.state[i].log_weight < drop or same_heading(bank, i) >= 0


@kernel
def same_heading(bank: Bank, i: int) -> int:
    """Return the first heavier hypothesis that has the attitude of hypothesis ``i``, -1 if there is none."""
    state = bank.state
    own = math.sqrt(max(yaw_variance(state[i], bank.P[i]), 0.0))
    nearest = max(SMALLEST_DIFFERENCE_RAD, min(_SAME_HEADING * own, _SAME_HEADING_RAD))
    for j in range(state.shape[0]):
        heavier = state[j].log_weight > state[i].log_weight or (
            state[j].log_weight == state[i].log_weight and j < i
        )
        if heavier:
            c = 0.0
            for k in range(4):
                c += state[i].q_eb[k] * state[j].q_eb[k]
            angle = 2.0 * math.acos(min(1.0, abs(c)))
            if angle < nearest:
                return j
    return -1


@kernel(inline=True)
def needs_pruning(bank: Bank, drop: float) -> bool:
    """Return whether the bank holds a hypothesis that can go."""
    n = bank.state.shape[0]
    if n > 1:
        for i in range(n):
            if is_prunable(bank, i, drop):
                return True
    return False


@kernel(inline=True)
def is_wide(bank: Bank, widest: float) -> bool:
    """Return whether the variance of a hypothesis' heading is above ``widest`` [rad^2]."""
    for i in range(bank.state.shape[0]):
        if yaw_variance(bank.state[i], bank.P[i]) > widest:
            return True
    return False


@kernel(inline=True)
def is_open_again(bank: Bank, widest: float) -> bool:
    """Return whether a heading that counts as known is one of several farther apart than one filter may be wide."""
    known = bank.head[0].heading_open == 0 and bank.head[0].more_than_headings == 0
    return known and bank.state.shape[0] > 1 and heading_variance(bank) > widest


@kernel(inline=True)
def widest_variance(bank: Bank, widest: float) -> float:
    """Return the variance of a heading from which on a member is to be split [rad^2], at most ``widest``.

    Equation: sigma^2 / 2 sqrt(sum_i w_i I_i) = c, I_i the squared sigmas per rad^2 by which the shown motion moved the
    epoch's rows: what a heading does to them in second order. No finer than a third of the widest sigma.
    """
    carried = 0.0
    for i in range(bank.state.shape[0]):
        carried += math.exp(bank.state[i].log_weight) * bank.state[i].motion_information
    linear = 2.0 * _CURVED / math.sqrt(carried) if carried > 0.0 else math.inf
    return max(min(widest, linear), widest / FINER**2)


def headings_wanted(bank: Bank, usual: int, widest: float) -> int:
    """Return how many headings are to take the place of members that are too wide."""
    return usual if widest_variance(bank, widest) == widest else FINER * usual


@kernel(apart=True)
def weigh_headings(bank: Bank, par: Parameters, in_full: bool) -> None:
    """Multiply the weights by the likelihood of an epoch, by the share of it that shown motion has made.

    Equation: w_i *= (L_i / L_max)^rho + e, rho = I / (I + v), I = sum_i w_i sum_rows (h q_i)^2 / S_i, q_i the response
    to the motion that was shown, e the odds that an epoch is wrong altogether. In a street most range rates of an epoch
    may be wrong, and without e one such epoch would choose a heading for good.

    Hypotheses differ, too, in the direction in which they integrate the accelerometers' noise: without motion their
    likelihood ratio is a driftless random walk that would choose one in the end. Between two headings that differ by d,
    the motion gives ln L the mean d^2 I / 2; motion and noise give it the variance d^2 (I + v). The variance of a true
    log-likelihood ratio is twice its mean; the power rho makes it so. rho is common to all, so it favours none.

    Hypotheses that differ in more than their headings (a given start against others, a filter against a fix) are
    weighed in full, and so are rows that measure the heading, by ``in_full``.
    """
    state, lead = bank.state, bank.head[0].leader
    carried = 0.0
    for i in range(state.shape[0]):
        carried += math.exp(state[i].log_weight) * state[i].motion_information
    all_of_it = par.motion_gate2 <= 0.0 or bank.head[0].more_than_headings == 1
    all_of_it = all_of_it or sees_earth_rate(state[lead], par, bank.P[lead])
    share = 1.0 if all_of_it or in_full else carried / (carried + _BY_NOISE)
    largest = -math.inf
    for i in range(state.shape[0]):
        largest = max(largest, state[i].log_likelihood)
    for i in range(state.shape[0]):
        if state[i].log_likelihood == -math.inf:
            state[i].log_weight = -math.inf
            continue
        behind = share * (state[i].log_likelihood - largest)
        state[i].log_weight += behind if all_of_it else math.log(math.exp(behind) + WRONG_EPOCH)
    normalise_weights(bank)


@kernel(inline=True)
def share_noise_levels(bank: Bank) -> None:
    """Give all headings the mean of what was learnt of noise: it is the receiver's and the street's, not a heading's.

    Otherwise one that has taken an epoch for noise is never contradicted again, whatever comes, and wins over the one
    that is right. Hypotheses that differ in more than their headings keep their own levels: there noise tells them
    apart. How long errors last is the same for all even then: likelihoods compare only where rows count alike.
    """
    state = bank.state
    if state[bank.head[0].leader].log_weight == -math.inf:
        return
    for kind in range(N_KINDS):
        for which in range(N_LASTING_SUMS):
            share_mean(state, state["lasting"][:, kind, which])
    if bank.head[0].more_than_headings != 0:
        return
    for kind in range(N_FACTORS):
        share_mean(state, state["noise_factor"][:, kind])
    share_mean(state, state["weak_shown"])
    share_mean(state, state["weak_rows"])


@kernel(inline=True)
def share_mean(state: StateArray, values: Float64) -> None:
    """Replace a number (n,) of all hypotheses by its weighted mean; one that is lost has no part in it."""
    mean = 0.0
    for i in range(values.shape[0]):
        weight = math.exp(state[i].log_weight)
        mean += weight * values[i] if weight > 0.0 else 0.0
    values[:] = mean


@kernel(inline=True)
def normalise_weights(bank: Bank) -> None:
    """Make the weights sum to one and name the heaviest hypothesis the leader; leave them where all are lost."""
    state = bank.state
    lead = 0
    for i in range(1, state.shape[0]):
        if state[i].log_weight > state[lead].log_weight:
            lead = i
    top = state[lead].log_weight
    bank.head[0].leader = lead
    if top == -math.inf:
        return
    total = 0.0
    for i in range(state.shape[0]):
        total += math.exp(state[i].log_weight - top)
    for i in range(state.shape[0]):
        state[i].log_weight -= top + math.log(total)
