"""A GNSS time tag that has jumped: the pseudoranges of an epoch contradict the prior as only a time can make them.

A tag that is late by d moves each satellite by its own velocity: a pseudorange is off by d times its rate, -800 to
800 m/s. With the innovations y of covariance S = H P H^T + R at the prior and the rates g, the tag leaves
q = (y - d g)^T S^-1 (y - d g), d = g^T S^-1 y / g^T S^-1 g, of n rows about n. Two other explanations compete:

    noise that has risen by any factor   log odds n / 2 ln(y^T S^-1 y / q) - ln(1 + T sqrt(g^T S^-1 g / 2 pi))
    another place, unknown               log odds (q_place - q) n / 2 q,  q_place what position and clock leave

d being anywhere in T. The lesser of the two counts, q at least n. Where neither tag nor place alone explains the epoch,
both may be wrong: a filter that was started with wrong tags is at a wrong place. With S^-1/2 g and S^-1/2 y less what
position and clock explain in place of these, the first law gives the odds of n - 4 rows.

The pseudoranges of an epoch that shows a jump but not for certain are left out; the next epoch that shows the same adds
its odds. The offset of the tags is a state from then on (``states.gnss_time``), unknown again at each further jump; at
each epoch once jumps have followed each other.                                                   [Kass & Raftery 1995]
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import EpochWorkspace, Lines
from insgnss.filter.state import CLOCK, DR, OFFSETS, Bank, HeadRecord, StateRecord, forget_state
from insgnss.filter.states.gnss_time import JUMP_SIGMA_S, LONGEST_FOR_RATES_S, SPOILT_MPS
from insgnss.filter.update.consistency import LEAST_WITNESSES, is_variance, used_rows, write_innovations
from insgnss.filter.update.scalar_update import predicted_variance
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.gnss.observation_rows import CARRIER, N_KINDS, PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.status import TAG_JUMP, USED
from insgnss.tables import Float64

_UNUSUAL: Final = 4.0  # mean square of the innovations over their variances, below which no tag has jumped
_LONGEST_S: Final = 1.5 * JUMP_SIGMA_S  # a leap second, too
_LEAST_ODDS: Final = 3.0  # logarithm, below which an epoch shows no jump
_AGREE: Final = 4.0  # sigmas within which two epochs show the same jump ...
_AGREE_S: Final = 3.0  # ... if they are not further apart
UNSTEADY: Final = 3  # jumps, each within so long after the one before, and the tags are believed no more
_UNSTEADY_S: Final = 60.0
# columns of X in ``tag_evidence``: three of position and one of the clock are the place
_CLOCK, _GROWTH, _INNOVATION, _COLUMNS = 3, 4, 5, 6
_N_PLACE: Final = 4
_MANY: Final = 8  # pseudoranges that tell a wrong tag and a wrong place from noise


class TagEvidence(NamedTuple):
    """What the pseudoranges of an epoch say of its time tag."""

    late_s: float  # by which it has become late
    sigma_s: float
    log_odds: float  # that it has; 0: it does not show
    elsewhere: int  # 1 if the place is wrong as well


NOTHING: Final = TagEvidence(0.0, 0.0, 0.0, 0)


@kernel(apart=True)
def follow_tag_jump(
    bank: Bank, member: int, par: Parameters, rows: GnssRows, epoch: int, s: EpochWorkspace
) -> None:
    """Look whether the tag of an epoch has jumped, once for all hypotheses, and refuse the rows that cannot be used.

    Where the offset of the tags is a state, it is unknown again and the rows are used; otherwise the pseudoranges are
    refused. Carrier differences are refused in any case, range rates if the offset is large. A place that is found to
    be wrong becomes uncertain. The lines are predicted.
    """
    head, P, t_ns = bank.head[0], bank.P[member], rows.epoch_ns[epoch]
    lines = s.lines[: rows.first[epoch + 1] - rows.first[epoch]]
    is_state = par.at_gnss_time >= 0
    if head.tag_tested_ns != t_ns:
        head.tag_tested_ns = t_ns
        if is_state and head.tag_jumps >= UNSTEADY:
            head.tag_shown_ns, head.tag_jump_ns, head.tag_late_s = t_ns, t_ns, 0.0
            head.tag_jumps = UNSTEADY + 1
        else:
            lately = head.tag_odds > 0.0 and (t_ns - head.tag_shown_ns) * 1e-9 < _AGREE_S
            found = NOTHING
            if lately or are_unusual(lines):
                found = tag_evidence(bank.state[member], P, par, rows, epoch, s)
            if found.log_odds > 0.0:
                note_jump(head, found, par, t_ns)
    if is_state and may_be_long(bank.state[member], P, par.at_gnss_time):
        refuse_from(RANGE_RATE, N_KINDS, lines)
    if head.tag_shown_ns != t_ns:
        return
    if abs(head.tag_late_s) > LONGEST_FOR_RATES_S:
        refuse_from(RANGE_RATE, N_KINDS, lines)
    refuse_from(CARRIER, N_KINDS, lines)
    if head.tag_elsewhere == 1 and head.tag_jump_ns == t_ns:
        forget_place(P, SPOILT_MPS * head.tag_late_s)
    if not is_state or head.tag_jump_ns != t_ns:
        refuse_from(PSEUDORANGE, RANGE_RATE, lines)
    else:
        forget_state(bank, member, par.at_gnss_time, JUMP_SIGMA_S**2)
    for j in range(lines.shape[0]):
        line = lines[j]
        for kind in range(CARRIER):
            if line.status[kind] == USED:
                columns = line.columns[kind][: line.count[kind]]
                line.predicted[kind] = predicted_variance(P, line.h[kind], columns)


def expect_jump(bank: Bank, par: Parameters, t_ns: int, late_s: float) -> None:
    """Make place and clock uncertain and take the tags for late, as far as the next epoch shows it as well."""
    head = bank.head[0]
    head["tag_shown_ns"], head["tag_late_s"], head["tag_elsewhere"] = t_ns, late_s, 0
    head["tag_odds"] = par.tag_jump_odds
    for member in range(len(bank.P)):
        forget_place(bank.P[member], SPOILT_MPS * late_s)


@kernel(inline=True)
def may_be_long(m: StateRecord, P: Float64, at: int) -> bool:
    """Return whether the offset of the tags is, or may be, too long for the acceleration of one moment."""
    limit = LONGEST_FOR_RATES_S
    return bool(abs(m.optional[at - OFFSETS]) > limit or P[at, at] > limit * limit)


@kernel(inline=True)
def note_jump(head: HeadRecord, found: TagEvidence, par: Parameters, t_ns: int) -> None:
    """Add the odds of an epoch to those of the epochs just before that show the same jump."""
    late = (t_ns - head.tag_shown_ns) * 1e-9 > _AGREE_S or found.elsewhere != head.tag_elsewhere
    if late or not abs(found.late_s - head.tag_late_s) < _AGREE * found.sigma_s:
        head.tag_odds = 0.0
    head.tag_odds += found.log_odds
    head.tag_shown_ns, head.tag_late_s, head.tag_elsewhere = t_ns, found.late_s, found.elsewhere
    if head.tag_odds > (1.0 + 2.0 * found.elsewhere) * par.tag_jump_odds:
        head.tag_jumps = 1 + (head.tag_jumps if (t_ns - head.tag_jump_ns) * 1e-9 < _UNSTEADY_S else 0)
        head.tag_jump_ns, head.tag_odds = t_ns, 0.0


@kernel(inline=True)
def refuse_from(first: int, end: int, lines: Lines) -> None:
    """Refuse the rows of the kinds from ``first`` to before ``end``: pseudoranges, range rates, carrier differences."""
    for j in range(lines.shape[0]):
        for kind in range(first, end):
            if lines[j].status[kind] == USED:
                lines[j].status[kind] = TAG_JUMP


@kernel(inline=True)
def forget_place(P: Float64, sigma_m: float) -> None:
    """Make position and clock uncertain by so much more."""
    for i in range(3):
        P[DR + i, DR + i] += sigma_m * sigma_m
    P[CLOCK, CLOCK] += sigma_m * sigma_m


@kernel(apart=True)
def tag_evidence(
    m: StateRecord, P: Float64, par: Parameters, rows: GnssRows, epoch: int, s: EpochWorkspace
) -> TagEvidence:
    """Return what an epoch says of its GNSS tag.

    It allocates its work space: only an epoch of unusual innovations, or after one that showed a jump, comes so far.
    """
    lines = s.lines[: rows.first[epoch + 1] - rows.first[epoch]]
    index = np.empty(lines.shape[0], np.int64)
    n = used_rows(lines, PSEUDORANGE, index)
    if n < LEAST_WITNESSES or par.tag_jump_odds == math.inf:
        return NOTHING
    S, X, a = np.empty((n, n + 1)), np.empty((n, _COLUMNS)), s.antenna[0]
    write_innovations(S, P, lines, PSEUDORANGE, index[:n])
    u, dr = np.empty(3), np.empty(3)
    for k in range(n):
        _, rate = line_of_sight(rows.sat, rows.first[epoch] + index[k], a.r_a, a.v_a, u, dr)
        for i in range(3):
            X[k, i] = u[i]
        X[k, _CLOCK] = 1.0
        X[k, _GROWTH] = -(rate + m.clock[1])  # a late tag: the measurement is older
        X[k, _INNOVATION] = S[k, n]
    if not whiten(S, X):
        return NOTHING
    growth2, both, whole = products(X)
    alone = explained(growth2, both, whole, n * 1.0)
    remove_place(X)
    growth2_apart, both_apart, left_by_place = products(X)
    left = max(whole - both * both / growth2, n * 1.0)
    odds = min(alone.log_odds, 0.5 * n * (left_by_place - left) / left)
    if odds > _LEAST_ODDS:
        return TagEvidence(alone.late_s, alone.sigma_s, odds, 0)
    if n < _MANY:
        return NOTHING
    apart = explained(growth2_apart, both_apart, left_by_place, n - _N_PLACE * 1.0)
    if apart.log_odds > _LEAST_ODDS:
        return TagEvidence(apart.late_s, apart.sigma_s, apart.log_odds, 1)
    return NOTHING


@kernel
def late_apart(X: Float64) -> TagEvidence:
    """Return what the rows of an epoch say of its tag at a place that nothing has told before.

    ``X`` (n, 6): line of sight, clock, growth and innovation of each row over its sigma; ``late_s`` is NaN where they
    do not show that the tag is late. It serves as scratch.
    """
    n = X.shape[0]
    if n >= _MANY:
        remove_place(X)
        growth2, both, whole = products(X)
        found = explained(growth2, both, whole, n - _N_PLACE * 1.0)
        if found.log_odds > _LEAST_ODDS:
            return found
    return TagEvidence(math.nan, math.nan, 0.0, 0)


@kernel(inline=True)
def products(X: Float64) -> tuple[float, float, float]:
    """Return g.g, g.y and y.y."""
    growth2, both, whole = 0.0, 0.0, 0.0
    for k in range(X.shape[0]):
        growth2 += X[k, _GROWTH] ** 2
        both += X[k, _GROWTH] * X[k, _INNOVATION]
        whole += X[k, _INNOVATION] ** 2
    return growth2, both, whole


@kernel(inline=True)
def explained(growth2: float, both: float, whole: float, freedom: float) -> TagEvidence:
    """Return what innovations of ``freedom`` degrees say for a wrong tag against noise."""
    late_s = both / growth2 if is_variance(growth2) else math.nan
    if not abs(late_s) < _LONGEST_S:
        return NOTHING
    left = max(whole - late_s * both, freedom)
    choice = math.log(1.0 + 2.0 * _LONGEST_S * math.sqrt(growth2 / math.tau))
    odds = 0.5 * freedom * math.log(whole / left) - choice
    return TagEvidence(late_s, math.sqrt(left / (freedom * growth2)), odds, 0)


@kernel(inline=True)
def are_unusual(lines: Lines) -> bool:
    """Return whether most pseudoranges are far from the prediction."""
    n, total = 0, 0.0
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[PSEUDORANGE] == USED:
            n += 1
            variance = line.predicted[PSEUDORANGE] + line.variance[PSEUDORANGE]
            total += line.innovation[PSEUDORANGE] ** 2 / variance
    return total > _UNUSUAL * n


@kernel(inline=True)
def whiten(S: Float64, X: Float64) -> bool:
    """X <- L^-1 X with S = L L^T, which takes the place of ``S``; return whether S is a covariance."""
    n, width = X.shape
    for j in range(n):
        for k in range(j):
            share = S[j, k]
            for i in range(j, n):
                S[i, j] -= S[i, k] * share
            for c in range(width):
                X[j, c] -= share * X[k, c]
        if not is_variance(S[j, j]):
            return False
        root = math.sqrt(S[j, j])
        for i in range(j, n):
            S[i, j] /= root
        for c in range(width):
            X[j, c] /= root
    return True


@kernel(inline=True)
def remove_place(X: Float64) -> None:
    """Take from g and y what position and clock explain of them (Gram and Schmidt)."""
    for c in range(_GROWTH):
        square = 0.0
        for k in range(X.shape[0]):
            square += X[k, c] ** 2
        for later in range(c + 1, _COLUMNS):
            share = 0.0
            for k in range(X.shape[0]):
                share += X[k, c] * X[k, later]
            for k in range(X.shape[0]):
                X[k, later] -= share / square * X[k, c]
