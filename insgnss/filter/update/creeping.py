"""Satellites whose measurements creep away from those of all others, slower than any gate sees. Compiled.

One satellite's deviation from the others (the parity part of ``integrity``) does not depend on where the filter
believes to be, so it can be followed for as long as one likes:

    range rates    mean over ten seconds: code and Doppler that run away together are off by the ramp's rate at once.
                   Its sigma follows from the noise about the means where that is less than the assumed noise, because
                   rates that are wrong by a constant raise the assumed noise of all
    pseudoranges   mean over five seconds less that over thirty: a code that runs away alone; what stays as it is,
                   orbit, clock and atmosphere, drops out

On those means stands the same search for the smallest set that leaves the others in agreement as on an epoch's rows
(``consistency``): of two or three that creep together the one that stands out most may be a sound one. A kind of which
a third does not agree is not the satellites' fault; nothing is refused then. A satellite that is left out is no
witness: those that are left in say whether it may come back.                                  [Brenner 1996; Lee 1986]
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.rows.usual_variance import usual_variance
from insgnss.filter.state import StateRecord
from insgnss.filter.update.consistency import (
    LEAST_WITNESSES,
    exchange,
    farthest,
    remove_smallest_set,
    residual_variance,
)
from insgnss.filter.update.integrity import (
    INTERVAL_NS,
    UNKNOWNS,
    add_row,
    clear,
    entry,
    explained_by,
    explained_variance,
    fit_freely,
    solve,
)
from insgnss.filter.update.satellite_memory import (
    CONTRADICTED_S,
    CONTRADICTED_SINCE_S,
    FAST,
    FORGOTTEN_S,
    LEFT_OUT_S,
    RATE,
    RATE_MEAN_S,
    RATE_SINCE_S,
    SCATTER,
    SLOW,
    carry_means,
    takes_part,
)
from insgnss.gnss.median import median_of
from insgnss.gnss.observation_rows import N_KINDS, PSEUDORANGE, RANGE_RATE, Observations
from insgnss.kernels.jit import kernel
from insgnss.status import DRIFTING, GATED, INCONSISTENT, USED
from insgnss.tables import Float64, Int64

# errors of a rate in a street or of a walker persist for so long, twice their correlation time
_ALIKE_S: Final = 4.0
RATE_FLOOR2: Final = 0.03**2  # of a mean: rates of atmosphere and message that last [m^2/s^2]
# that long a band stays out once it was found by range or rate: turns hide satellites
_HELD_S: Final = (3.0, 20.0)
_CONTRADICTED_S: Final = 2.0  # for so long on end: a reflection of a moving antenna's lasts for less
# how long a satellite stays out while its rows cannot show whether it is still wrong
KEPT_OUT_S: Final = 120.0
_SETTLED_EPOCHS: Final = 10  # until then means and noise are still of the time before the level rose
_INNOCENT: Final = 1.0  # squared sigmas of a rate's mean that lets a band back before
_FREE: Final = 1e4  # prior variance of what all have in common, over the largest of a mean
LEAST_AGREEING: Final = 5  # one more than the unknowns: fewer agree on anything


@kernel(apart=True)
def follow_satellites(
    m: StateRecord,
    memory: Float64,
    lines: Lines,
    observation: Observations,
    t_ns: int,
    fit: Float64,
    values: Float64,
    par: Parameters,
) -> bool:
    """Carry the means of each satellite's band on, find those that creep, and refuse all kinds of these.

    Those that were left out already are refused (``refuse_left_out``): they do not take part in what all have in
    common. Return whether any more are. ``memory`` is (slots, N_MEMORY), see ``satellite_memory``.
    """
    if par.drift_gate <= 0.0 and par.reflection_rate <= 0.0:
        return False
    now, gate2 = t_ns * 1e-9, par.drift_gate**2
    refused = False
    if t_ns - m.explained_ns >= INTERVAL_NS:
        for kind in range(2):
            if fit_freely(lines, kind, fit) < LEAST_AGREEING:
                continue
            for j in range(lines.shape[0]):
                if takes_part(lines[j], kind):
                    carry_means(memory[observation[j].slot], lines[j], kind, now, fit)
            if not gate2 > 0.0:
                continue
            quiet = 1.0
            if kind == RANGE_RATE and m.level_epochs[kind] >= _SETTLED_EPOCHS:
                quiet = shown_noise(memory, lines, observation, values, now)
            if stands_out(memory, lines, observation, kind, now, fit, gate2, quiet):
                anew = kind == RANGE_RATE
                n_creeping = find_creeping(memory, lines, observation, kind, now, gate2, anew, quiet)
                if n_creeping == 0 and anew:
                    n_creeping = find_creeping(memory, lines, observation, kind, now, gate2, False, quiet)
                if n_creeping > 0:
                    refused = refuse_left_out(memory, lines, observation, now)
                    if kind == RANGE_RATE:
                        m.crept_ns = t_ns
    return refused


@kernel(inline=True)
def hold_contradicted(
    m: StateRecord, memory: Float64, lines: Lines, observation: Observations, t_ns: int
) -> None:
    """Leave out from the next epoch on the satellites whose range rate the others contradict again and again.

    In turns satellites come and go: of those that run away together too many may be left among a few for any epoch to
    tell. Where more than a third is contradicted nothing is known of any.
    """
    now, refused, n = t_ns * 1e-9, 0, 0
    for j in range(lines.shape[0]):
        status = lines[j].status[RANGE_RATE]
        if status == GATED or status == INCONSISTENT:
            refused += 1
        if status == GATED or status == INCONSISTENT or status == USED:
            n += 1
    if n < LEAST_WITNESSES or 3 * refused > n:
        return
    for j in range(lines.shape[0]):
        status, mean = lines[j].status[RANGE_RATE], memory[observation[j].slot]
        if status == USED:
            mean[CONTRADICTED_S] = -math.inf
        elif status == GATED or status == INCONSISTENT:
            if not now - mean[CONTRADICTED_S] <= FORGOTTEN_S:
                mean[CONTRADICTED_SINCE_S] = now
            mean[CONTRADICTED_S] = now
            if now - mean[CONTRADICTED_SINCE_S] >= _CONTRADICTED_S:
                mean[LEFT_OUT_S] = now + _HELD_S[RANGE_RATE]
                m.crept_ns = t_ns


@kernel(inline=True)
def refuse_left_out(memory: Float64, lines: Lines, observation: Observations, now: float) -> bool:
    """Refuse the rows of all satellites that are left out; return whether there are any."""
    found = False
    for j in range(lines.shape[0]):
        if memory[observation[j].slot, LEFT_OUT_S] > now:
            found = True
            for kind in range(N_KINDS):
                if lines[j].status[kind] == USED or lines[j].status[kind] == GATED:
                    lines[j].status[kind] = DRIFTING
    return found


@kernel(inline=True)
def shown_noise(
    memory: Float64, lines: Lines, observation: Observations, values: Float64, now: float
) -> float:
    """Return the variance of range rates about their means over the assumed one: the median, at most one."""
    n = 0
    for j in range(lines.shape[0]):
        mean = memory[observation[j].slot]
        if crept(mean, lines[j], RANGE_RATE, now, 1.0)[1] > 0.0 and mean[SCATTER] >= 0.0:
            values[n] = mean[SCATTER] / usual_variance(lines[j], RANGE_RATE)
            n += 1
    return float(min(median_of(values, n), 1.0) if n >= LEAST_AGREEING else 1.0)


@kernel(inline=True)
def crept(mean: Float64, line: Line, kind: int, now: float, quiet: float) -> tuple[float, float]:
    """Return by how much a row has crept and the variance of that; a variance of zero where nothing can be said.

    ``quiet``: by how much the noise about the means is below the one assumed (``shown_noise``).
    """
    if not takes_part(line, kind):
        return 0.0, 0.0
    if kind == PSEUDORANGE:
        return mean[FAST] - mean[SLOW], line.variance[kind]
    if not now - mean[RATE_SINCE_S] >= RATE_MEAN_S:
        return 0.0, 0.0
    return mean[RATE], quiet * _ALIKE_S / (2.0 * RATE_MEAN_S) * usual_variance(line, kind) + RATE_FLOOR2


@kernel(apart=True)
def stands_out(
    memory: Float64,
    lines: Lines,
    observation: Observations,
    kind: int,
    now: float,
    fit: Float64,
    gate2: float,
    quiet: float,
) -> bool:
    """Return whether the mean of a satellite in use is beyond the gate, less the common part of all satellites in use.

    An excluded satellite in view returns once its mean range rate agrees with theirs.
    """
    clear(fit)
    count = 0
    for j in range(lines.shape[0]):
        mean = memory[observation[j].slot]
        value, variance = crept(mean, lines[j], kind, now, quiet)
        if variance > 0.0 and not mean[LEFT_OUT_S] > now:
            add_row(lines[j], kind, value, variance, fit)
            count += 1
    if count < LEAST_AGREEING or not solve(fit):
        return False
    beyond = False
    for j in range(lines.shape[0]):
        mean = memory[observation[j].slot]
        value, variance = crept(mean, lines[j], kind, now, quiet)
        if variance > 0.0:
            rest = value - explained_by(lines[j], kind, fit)
            explained = explained_variance(lines[j], kind, fit)
            if not mean[LEFT_OUT_S] > now:
                own = residual_variance(variance, explained)
                beyond = beyond or rest * rest > gate2 * own
            elif kind == RANGE_RATE:
                own = variance + explained
                if rest * rest < _INNOCENT * own and explained < variance:
                    mean[LEFT_OUT_S] = -math.inf
                elif rest * rest > gate2 * own:
                    mean[LEFT_OUT_S] = now + KEPT_OUT_S
    return beyond and count >= LEAST_WITNESSES


@kernel(apart=True)
def find_creeping(
    memory: Float64,
    lines: Lines,
    observation: Observations,
    kind: int,
    now: float,
    gate2: float,
    anew: bool,
    quiet: float,
) -> int:
    """Mark the smallest set of satellites without which the means agree; return how many there are.

    ``anew``: all are asked, those that are left out, too, and come back where the others are at fault. While three run
    away, two of them and a sound one may leave the rest in agreement for some seconds.
    Equation: as ``consistency.refuse_inconsistent``, of the means, their common part free.
    A range counts only while it moves away: one that comes back to the others was wrong before.
    It allocates its work space: only where a mean stands out it is called.
    """
    index = np.empty(lines.shape[0], np.int64)
    n = 0
    for j in range(lines.shape[0]):
        mean = memory[observation[j].slot]
        _, variance = crept(mean, lines[j], kind, now, quiet)
        if variance > 0.0 and (anew or not mean[LEFT_OUT_S] > now):
            index[n] = j
            n += 1
    T = np.empty((n, n + 1))
    write_means(T, memory, lines, observation, kind, now, index[:n], quiet)
    active = np.ones(n, np.int64)
    for j in range(n):
        exchange(T, j)
    most = min(n // 3, n - LEAST_AGREEING)
    removed = 0
    while removed < most and farthest(T, active, 1)[1] > gate2:
        removed += remove_smallest_set(T, active, gate2, most - removed)
    if farthest(T, active, 1)[1] > gate2:
        return 0
    n_creeping = 0
    for a in range(n):
        mean = memory[observation[index[a]].slot]
        away = kind == RANGE_RATE or abs(mean[FAST]) > abs(mean[SLOW])
        if active[a] == 0 and away:
            n_creeping += 1
            mean[LEFT_OUT_S] = now + _HELD_S[kind]
        elif active[a] == 1 and anew:
            mean[LEFT_OUT_S] = -math.inf
    return n_creeping


@kernel(inline=True)
def write_means(
    T: Float64,
    memory: Float64,
    lines: Lines,
    observation: Observations,
    kind: int,
    now: float,
    index: Int64,
    quiet: float,
) -> None:
    """Write the means' covariance, with a free common part, and the means behind it into ``T`` (n, n + 1)."""
    n = index.shape[0]
    largest = 0.0
    for j in index:
        largest = max(largest, crept(memory[observation[j].slot], lines[j], kind, now, quiet)[1])
    for a in range(n):
        one = lines[index[a]]
        value, variance = crept(memory[observation[index[a]].slot], one, kind, now, quiet)
        for b in range(a + 1):
            total = variance if a == b else 0.0
            for i in range(UNKNOWNS):
                total += _FREE * largest * entry(one, kind, i) * entry(lines[index[b]], kind, i)
            T[a, b] = total
            T[b, a] = total
        T[a, n] = value
