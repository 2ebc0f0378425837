"""Range rates and carrier differences whose errors last longer than an epoch, compiled.

A reflected range rate is wrong by metres per second for seconds on end. A filter that takes each epoch's error for a
new one counts the same error several times: it claims a velocity, and by it a heading, that nothing has shown. So a row
counts as if its variance were s times as large, s the number of epochs for which an error lasts (``use_rows``).

The residuals z of the rows against each other (``integrity``; in sigmas, three at most) show s. Over five seconds the
mean m of z has the variance v q, q the mean of z^2, where each error is new, and s v q where errors last:

    s = (sum of m^2 / v) / (sum of q),    v <- (1 - f)^2 v + f^2,   f = 1 - exp(-T / 5 s)

over the bands of an epoch, T after the one before; both sums and the number n of bands are means over half a minute.
Before anything is shown, errors are taken to last for 3 s. That counts as three bands, and fades as the means fill:

    s = (n s + w max(1, 3 s / T)) / (n + w),   1 at least;   w = 3 at first

In a street of Hong Kong the errors of weak satellites have a correlation of 0.3 after one to three seconds; s is 1.5 on
average and 10 in places, under an open sky 1.0 to 1.2. Neglects: what all satellites have in common shows in no
residual, and of fewer than five rates or six carrier differences nothing does: there the assumption holds on.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import EpochWorkspace, Line
from insgnss.filter.state import ASSUMED, BANDS, MEANS, SQUARES, StateRecord
from insgnss.filter.update.integrity import explain, explained_by
from insgnss.filter.update.satellite_memory import FORGOTTEN_S, LASTING, N_LASTING, variance_of_mean
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, Observations
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Float64

_MEAN_S: Final = 5.0
_LEARNT_S: Final = 30.0  # over which residuals show how long errors last
_LARGEST_SIGMAS: Final = 3.0  # that one residual counts
_AT, _MEAN, _SQUARE, _VARIANCE = range(N_LASTING)


@kernel(apart=True)
def follow_lasting_errors(
    m: StateRecord,
    P: Float64,
    memory: Float64,
    s: EpochWorkspace,
    observation: Observations,
    kind: int,
    t_ns: int,
    par: Parameters,
) -> None:
    """Carry on, before the rows of a kind are gated, what shows how long their errors last.

    ``P`` is the prior, ``memory`` (slots, N_MEMORY), see ``satellite_memory``. An epoch with too few rows to leave a
    residual changes nothing.
    """
    lines, now = s.lines[: observation.shape[0]], t_ns * 1e-9
    if par.rate_error_s <= 0.0 or not explain(P, lines, kind, s.fit):
        return
    bands, squares, means, longest = 0, 0.0, 0.0, 0.0
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        if line.status[kind] != USED:
            continue
        z = (line.innovation[kind] - explained_by(line, kind, s.fit)) / math.sqrt(line.variance[kind])
        own = memory[observation[j].slot, LASTING + N_LASTING * (kind - RANGE_RATE) :]
        since = follow_band(own, min(max(z, -_LARGEST_SIGMAS), _LARGEST_SIGMAS), now)
        if since > 0.0:
            bands += 1
            squares += own[_SQUARE]
            means += own[_MEAN] * own[_MEAN] / own[_VARIANCE]
            longest = max(longest, since)
    share, lasting = 1.0 - math.exp(-longest / _LEARNT_S), m.lasting[kind]
    lasting[BANDS] += share * (bands - lasting[BANDS])
    lasting[SQUARES] += share * (squares - lasting[SQUARES])
    lasting[MEANS] += share * (means - lasting[MEANS])
    lasting[ASSUMED] -= share * lasting[ASSUMED]


@kernel(inline=True)
def follow_band(own: Float64, z: float, now: float) -> float:
    """Carry on the means of a band by a residual; return the time since the one before [s], 0 where they begin."""
    since = now - own[_AT]
    own[_AT] = now
    if not 0.0 < since <= FORGOTTEN_S:
        own[_MEAN], own[_SQUARE], own[_VARIANCE] = z, z * z, 1.0
        return 0.0
    new = 1.0 - math.exp(-since / _MEAN_S)
    own[_MEAN] += new * (z - own[_MEAN])
    own[_SQUARE] += new * (z * z - own[_SQUARE])
    own[_VARIANCE] = variance_of_mean(own[_VARIANCE], new)
    return float(since)


@kernel(inline=True)
def epochs_of_an_error(m: StateRecord, par: Parameters, kind: int, since_last: float) -> float:
    """Return for how many epochs, ``since_last`` [s] apart, an error of a kind lasts; 1 for pseudoranges."""
    if kind == PSEUDORANGE or par.rate_error_s <= 0.0:
        return 1.0
    bands, squares, weight = m.lasting[kind, BANDS], m.lasting[kind, SQUARES], m.lasting[kind, ASSUMED]
    shown = bands * m.lasting[kind, MEANS] / squares if squares > 0.0 else bands
    assumed = max(1.0, par.rate_error_s / since_last)
    return float(max(1.0, (shown + weight * assumed) / (bands + weight)))
