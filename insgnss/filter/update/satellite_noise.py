"""Range rates of single satellites that are noisier than the others', compiled.

In a street most satellites are seen well, a few by reflections: their range rates are off by metres per second for
seconds on end, the others' by centimetres. A level common to all is wrong for both, and a gate forgets after each epoch
what the one before has shown. So each band of a satellite has a level L of its own, 1 where it is as the others:

    r = L r_0,   L = max(1, l / l_q - 1),   l = (3 l' + q) / 4,   q = e^2 / (1 - g D g^T / r) / r_0

with the common variance r_0, the residual e of the row against the others (``integrity``), and the mean square l' of
before, which falls back to 1 within some seconds. l_q is that of the quietest fifth, 1 at least: noise that has risen
for all belongs to none. Without memory (l' = 1) and without the 1, 1 / L is the weight of Student's t with three
degrees of freedom, the tails that reflections have. The 1 leaves ordinary rows alone, up to 2.2 sigmas: normal errors
cost 2.5 % of the variance, without it 10 % (simulated).                           [Lange, Little & Taylor 1989]

A level lowers a weight and hides nothing: rows that contradict all others are refused first, at the common variance.
The ledger has the variance that was foreseen from the epochs before.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.rows.usual_variance import usual_variance
from insgnss.filter.update.consistency import refuse_inconsistent, residual_variance
from insgnss.filter.update.creeping import LEAST_AGREEING
from insgnss.filter.update.integrity import explain, explained_by, explained_variance
from insgnss.filter.update.satellite_memory import SQUARE, SQUARE_S
from insgnss.gnss.median import median_of
from insgnss.gnss.observation_rows import RANGE_RATE, Observations
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Float64

_FREEDOM: Final = 3.0
_WORTH_A_SEARCH2: Final = 9.0  # squared sigmas: wrong rows hide each other, and show less than they are off
_PASSES: Final = 3  # of levels and the common part in turn
_USUAL: Final = 1.1  # a level up to here needs no second pass
_CALM: Final = 1.0
_QUIET: Final = 5  # one in so many
_FORGOTTEN_S: Final = 60.0


@kernel(apart=True)
def widen_noisy_rates(
    P: Float64,
    memory: Float64,
    lines: Lines,
    observation: Observations,
    t_ns: int,
    fit: Float64,
    values: Float64,
    par: Parameters,
) -> None:
    """Refuse range rates that the others contradict, widen the rest by their levels, and carry their mean squares on.

    Fewer than five rows show no level; what was known of them holds. ``memory`` is (slots, N_MEMORY), see
    ``satellite_memory``.
    """
    if par.rate_memory_s <= 0.0:
        return
    now = t_ns * 1e-9
    explained = explain(P, lines, RANGE_RATE, fit)
    if explained and par.residual_gate2 > 0.0 and one_stands_out(lines, fit):
        if refuse_inconsistent(P, lines, RANGE_RATE, par.residual_gate2) > 0:
            explained = explain(P, lines, RANGE_RATE, fit)
    for j in range(lines.shape[0]):
        if lines[j].status[RANGE_RATE] == USED:
            own = memory[observation[j].slot]
            own[SQUARE], own[SQUARE_S] = square_now(own, now, par.rate_memory_s), now
            lines[j].square = own[SQUARE]
    largest = set_levels(lines, values)
    for j in range(lines.shape[0]):
        lines[j].foreseen = lines[j].extra
    for _ in range(_PASSES if explained else 0):
        # at the level of all it was explained above
        if largest > 1.0 and not explain(P, lines, RANGE_RATE, fit):
            break
        for j in range(lines.shape[0]):
            if lines[j].status[RANGE_RATE] == USED:
                before, shown = memory[observation[j].slot, SQUARE], shown_square(lines[j], fit)
                lines[j].square = min((_FREEDOM * before + shown) / (_FREEDOM + 1.0), par.adapt_most)
        largest = set_levels(lines, values)
        if largest <= _USUAL:
            break
    for j in range(lines.shape[0]):
        if lines[j].status[RANGE_RATE] == USED:
            memory[observation[j].slot, SQUARE] = lines[j].square


@kernel(inline=True)
def set_levels(lines: Lines, values: Float64) -> float:
    """Give each range rate the level of its mean square against the quietest's; return the largest level."""
    n, quiet, largest = 0, 1.0, 1.0
    for j in range(lines.shape[0]):
        if lines[j].status[RANGE_RATE] == USED:
            values[n] = lines[j].square
            n += 1
    if n >= LEAST_AGREEING:
        median_of(values, n)  # which sorts them
        quiet = max(values[n // _QUIET], 1.0)
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        if line.status[RANGE_RATE] == USED:
            usual = usual_variance(line, RANGE_RATE)
            level = max(1.0, line.square / quiet - _CALM)
            line.variance[RANGE_RATE] = level * usual
            line.extra = line.variance[RANGE_RATE] - usual
            largest = max(largest, level)
    return largest


@kernel(inline=True)
def one_stands_out(lines: Lines, fit: Float64) -> bool:
    """Return whether a range rate is far enough from what ``fit`` says to search for wrong ones."""
    for j in range(lines.shape[0]):
        if lines[j].status[RANGE_RATE] == USED and shown_square(lines[j], fit) > _WORTH_A_SEARCH2:
            return True
    return False


@kernel(inline=True)
def square_now(own: Float64, now: float, memory_s: float) -> float:
    """Return the mean square of a band as it was, fallen back towards 1 since."""
    since = now - own[SQUARE_S]
    if not 0.0 <= since <= _FORGOTTEN_S:
        return 1.0
    return float(1.0 + (own[SQUARE] - 1.0) * math.exp(-since / memory_s))


@kernel(inline=True)
def shown_square(line: Line, fit: Float64) -> float:
    """Return q of a used row: its squared residual after ``fit`` over the variance that it has at the level of all."""
    left = explained_variance(line, RANGE_RATE, fit) / line.variance[RANGE_RATE]
    rest = line.innovation[RANGE_RATE] - explained_by(line, RANGE_RATE, fit)
    return float(rest * rest / (residual_variance(1.0, left) * usual_variance(line, RANGE_RATE)))
