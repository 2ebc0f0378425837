"""By how much the pseudorange of a weak signal is wrong: metres per dB, learnt from the residuals. Compiled.

A signal that a wall or a tree weakens, or that comes by a reflection alone, takes a longer way. On a square in Berlin
pseudoranges are late by 3.3 m for each dB that their C/N0 is below that of the strongest, in Hong Kong by the same up
to 30 m, under an open sky by less than 0.1 m. They are all late, so position and clock absorb a part, and once these
have, the residuals look sound: a filter that begins with thermal noise alone never learns better. So it begins with
the assumption s (``adaptation.weak_signal_m_per_db``), and residuals take it back where the sky is open:

    r = f r_0 + k a,   a = (s w)^2,   w the weakness of the signal (``signal_weakness``)
    k = (n + sum p^2 (e^2 - q f r_0) / a) / (n + sum p^2 q),   n = 4 / (2 + sum p^2 q)

over the rows with w > 0, which fade with the time constant of all levels; e is the residual of a row against the
others, of variance q r (``integrity``), f r_0 its variance without weakness. p = a / (f r_0 + a) is how clearly a row
shows k: by the estimator of least variance p^2 is its weight. Rows outside their gate count, as weak ones are refused
where k is too small. The assumption is a guess of where the log was made: it counts as two rows, and as fewer the more
rows there are. With n = 2 to the end a minute under an open sky leaves k = 0.01, which is still 2 m at 10 dB.
None counts more than three sigmas, and of each epoch the largest e^2 / (q r) does not count: one satellite that is
wrong is a fault, and no weakness. Of six normal errors the others show 0.6 of k. k is at least zero. A point
solution, which can learn nothing, takes k = 1 for rows whose sigma the log does not state.

On the square the horizontal error over sigma is 0.58 to 0.78 in the median and 2.7 to 5.0 at 95 %, in eight sets of 60
runs (0.83 and 1.7 would be right); without k a it is 1.7 to 2.4 and 5.6 to 9.5. Neglects: how long these errors last
(``reflections``), and that they are all late.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.rows.weak_signals import weak_signal_level
from insgnss.filter.state import StateRecord
from insgnss.filter.update.consistency import residual_variance
from insgnss.filter.update.integrity import explained_by, explained_variance
from insgnss.gnss.observation_rows import PSEUDORANGE
from insgnss.kernels.jit import kernel
from insgnss.status import GATED, USED
from insgnss.tables import Float64

_LARGEST_SQUARE: Final = 9.0  # of a residual over its variance


@kernel(inline=True)
def follow_weak_signals(m: StateRecord, par: Parameters, lines: Lines, fit: Float64, since_s: float) -> None:
    """Carry on the sums of k with an epoch ``since_s`` after the one before; ``fit`` is that of its pseudoranges."""
    level, decay = max(weak_signal_level(m), 1.0), math.exp(-since_s * par.adapt_gain)
    shown, rows = 0.0, 0.0
    largest, largest_shown, largest_rows = 0.0, 0.0, 0.0
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        in_gate = line.status[PSEUDORANGE] == USED
        if not (in_gate or line.status[PSEUDORANGE] == GATED) or line.doubt > 0.0 or not line.weakness > 0.0:
            continue
        r = line.variance[PSEUDORANGE]
        usual, assumed = r - line.weak, par.weak_signal2 * line.weakness * line.weakness
        left = explained_variance(line, PSEUDORANGE, fit) / r
        share = residual_variance(1.0, left) if in_gate else 1.0 + left
        square = (line.innovation[PSEUDORANGE] - explained_by(line, PSEUDORANGE, fit)) ** 2
        clear2 = (assumed / (usual + assumed)) ** 2
        counted = min(square, _LARGEST_SQUARE * share * (usual + level * assumed))
        of_row = clear2 * (counted - share * usual) / assumed
        shown += of_row
        rows += clear2 * share
        if square > largest * share * r:
            largest, largest_shown, largest_rows = square / (share * r), of_row, clear2 * share
    m.weak_shown = max(decay * m.weak_shown + shown - largest_shown, 0.0)
    m.weak_rows = decay * m.weak_rows + rows - largest_rows
