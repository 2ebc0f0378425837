"""How long the errors of the pseudoranges last, found from the log, compiled.

White noise averages out; a reflection in a street stays for half a minute, and the mean of thirty epochs is no better
than one. The residual e of a pseudorange against the others (``integrity``) is compared with the mean m of its
satellite's residuals before, which forgets within T = 5 s (``satellite_memory``). For errors of correlation time tau

    E[e m] / E[e^2] = c = tau / (tau + T),   tau = T c / (1 - c)

whatever their size, and zero for white noise. The mean of many epochs has the variance that independent epochs 2 tau
apart would leave: so much longer than its own time each epoch counts (``epoch_update.use_rows``). What the slow errors
of orbit and clock explain is no noise and is taken off first.                            [Bartlett 1946; Sokal 1997]
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Lines
from insgnss.filter.state import StateRecord
from insgnss.filter.update.consistency import LEAST_REDUNDANCY
from insgnss.filter.update.integrity import explained_by, explained_variance
from insgnss.filter.update.satellite_memory import FAST, FAST_MEAN_S, FORGOTTEN_S, RANGE_S, takes_part
from insgnss.gnss.observation_rows import PSEUDORANGE, Observations
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_MEMORY_S: Final = 30.0
_MOST_SIGMAS: Final = 3.0  # that one residual counts


@kernel(inline=True)
def spread_of(m: StateRecord, par: Parameters, kind: int, since_last: float) -> float:
    """Return by how much a variance counts more than one epoch's own, see ``use_rows``."""
    lasts = par.kind[kind].correlation
    if kind == PSEUDORANGE:
        lasts = max(lasts, min(found_time(m), par.range_time_most))
    return float(max(1.0, lasts / since_last))


@kernel(inline=True)
def found_time(m: StateRecord) -> float:
    """Return 2 tau = 2 T c / (1 - c) as the residuals of the last half minute have it [s]."""
    if not m.range_lasting > 0.0:
        return 0.0
    new = m.range_square - m.range_lasting
    return 2.0 * FAST_MEAN_S * m.range_lasting / new if new > 0.0 else math.inf


@kernel(inline=True)
def follow_range_time(
    m: StateRecord, memory: Float64, lines: Lines, observation: Observations, now: float, fit: Float64
) -> None:
    """Carry on the means of e m and e^2 in variances of the rows, before the satellites' own means are carried on.

    ``memory`` is (slots, N_MEMORY), see ``satellite_memory``; ``fit`` what the pseudoranges have in common. A row
    has the weight of the part that it can show.
    """
    lasting, square, weights, lag = 0.0, 0.0, 0.0, 0.0
    for j in range(lines.shape[0]):
        line = lines[j]
        mean = memory[observation[j].slot]
        since = now - mean[RANGE_S]
        if takes_part(line, PSEUDORANGE) and 0.0 <= since <= FORGOTTEN_S:
            r = line.variance[PSEUDORANGE]
            own = max(1.0 - explained_variance(line, PSEUDORANGE, fit) / r, LEAST_REDUNDANCY)
            sigma = math.sqrt(own * r)
            e = within((line.innovation[PSEUDORANGE] - explained_by(line, PSEUDORANGE, fit)) / sigma)
            known = observation[j].bias_sigma ** 2 / r
            lasting += own * (e * within(mean[FAST] / sigma) - known)
            square += own * e * e
            weights += own
            lag += own * since
    if weights > 0.0:
        share = 1.0 - math.exp(-lag / weights / _MEMORY_S)
        m.range_lasting += share * (lasting / weights - m.range_lasting)
        m.range_square += share * (square / weights - m.range_square)


@kernel(inline=True)
def within(sigmas: float) -> float:
    """Return a residual within the most that one counts."""
    return max(min(sigmas, _MOST_SIGMAS), -_MOST_SIGMAS)
