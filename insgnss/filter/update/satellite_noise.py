"""Range rates of single satellites that are noisier than the others', compiled.

In a street most satellites are seen well, a few by reflections: their range rates are off by metres per second for
seconds on end, the others' by centimetres. A level common to all is wrong for both, and a gate forgets after each epoch
what the one before has shown. So each band of a satellite has a level of its own on the common variance, 1 where it is
as the others:

    r = L r_0,   L = max(1, (f L' + q) / (f + 1)),   q = e^2 / (1 - g D g^T / r) / r_0

with the residual e of the row against the others (``integrity``), L' the level of before, which falls back to 1 within
some seconds, and f how many epochs it counts for. Without memory (L' = 1) this is the weight of Student's t with f
degrees of freedom.                                                                        [Lange, Little & Taylor 1989]
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.update.consistency import LEAST_REDUNDANCY
from insgnss.filter.update.creeping import LEVEL, LEVEL_S
from insgnss.filter.update.integrity import explain, explained_by, explained_variance
from insgnss.gnss.observation_rows import RANGE_RATE, Observations
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Float64

_FREEDOM: Final = 3.0  # f: reflections have the tails of Student's t of three
_PASSES: Final = 3  # of levels and the common part in turn
_USUAL: Final = 1.5  # a level up to here needs no second pass
_FORGOTTEN_S: Final = 60.0


@kernel(apart=True)
def widen_noisy_rates(
    P: Float64,
    memory: Float64,
    lines: Lines,
    observation: Observations,
    t_ns: int,
    fit: Float64,
    par: Parameters,
) -> None:
    """Widen the variances of an epoch's range rates by the level of each satellite's band, and carry the levels on.

    Fewer than five rows show no level; what was known of them holds. ``memory`` is (slots, N_MEMORY), see ``creeping``.
    """
    for j in range(lines.shape[0]):
        lines[j].level = 1.0
    if par.rate_memory_s <= 0.0:
        return
    now = t_ns * 1e-9
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        if line.status[RANGE_RATE] == USED:
            level = level_now(memory[observation[j].slot], now, par.rate_memory_s)
            widen(line, level)
            memory[observation[j].slot, LEVEL], memory[observation[j].slot, LEVEL_S] = level, now
    for _ in range(_PASSES):
        if not explain(P, lines, RANGE_RATE, fit):
            break
        largest = 1.0
        for j in range(lines.shape[0]):
            line = lines[j]
            if line.status[RANGE_RATE] == USED:
                level = shown_level(line, memory[observation[j].slot, LEVEL], fit)
                widen(line, level)
                largest = max(largest, level)
        if largest <= _USUAL:
            break
    for j in range(lines.shape[0]):
        if lines[j].status[RANGE_RATE] == USED:
            memory[observation[j].slot, LEVEL] = lines[j].level


@kernel(inline=True)
def level_now(mean: Float64, now: float, memory_s: float) -> float:
    """Return the level of a band as it was, fallen back towards 1 since."""
    since = now - mean[LEVEL_S]
    if not 0.0 <= since <= _FORGOTTEN_S:
        return 1.0
    return float(1.0 + (mean[LEVEL] - 1.0) * math.exp(-since / memory_s))


@kernel(inline=True)
def shown_level(line: Line, before: float, fit: Float64) -> float:
    """Return the level of a row from its residual after ``fit``, and from the level ``before``."""
    r = line.variance[RANGE_RATE]
    rest = line.innovation[RANGE_RATE] - explained_by(line, RANGE_RATE, fit)
    own = max(r - explained_variance(line, RANGE_RATE, fit), LEAST_REDUNDANCY * r)
    shown = rest * rest / own * line.level
    return float(max(1.0, (_FREEDOM * before + shown) / (_FREEDOM + 1.0)))


@kernel(inline=True)
def widen(line: Line, level: float) -> None:
    """Give a row's range rate a level in place of the one that it has."""
    line.variance[RANGE_RATE] *= level / line.level
    line.level = level
