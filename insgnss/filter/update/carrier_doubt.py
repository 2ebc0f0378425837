"""How far a carrier difference that has passed the gate may be wrong all the same, compiled.

A gate of five sigmas is narrow where the velocity is known, and a metre per second wide where it is not: there most
slips and reflections pass it, and would count as good to millimetres. What passes is wrong with the probability

    p = e b / (e b + (1 - e) w),   b = min(g sqrt(S), w),   e: share of the wrong among those that come to the gate,

with the gate g, the variance S of what is predicted against the median row, and w within which wrong ones lie: as far
as the test against Doppler lets them. A wrong one lies anywhere within b, so the variance of what passes is

    r <- r + p b^2 / 3                            [probabilistic data association: Bar-Shalom & Tse 1975]

One in five of the wrong ones passes the tests by chance (``phase_locks``), so e is a fifth of the share that failed
them in the last half minute; before any were tested, a tenth counts as failed. These tests ask no filter: what the gate
refuses may as well be the fault of the state, and noise must not hide a fault. Where the velocity is known, S is small
and nothing changes. While several headings are possible no row is widened: under a wrong heading S is as large, and the
right rows must go on contradicting it.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.rows.lines import Lines
from insgnss.filter.state import StateRecord
from insgnss.filter.update.phase_locks import AT_FIRST, PASSES_UNLOCKED
from insgnss.gnss.carrier_rows import DOPPLER_LIMIT_MPS
from insgnss.gnss.observation_rows import CARRIER
from insgnss.kernels.jit import kernel
from insgnss.status import USED
from insgnss.tables import Float64

_ROWS_AT_FIRST: Final = 20.0  # that the share of the beginning counts as


@kernel(inline=True)
def doubt_carriers(m: StateRecord, lines: Lines, S: Float64, gate2: float, since_last: float) -> None:
    """Widen the used carrier differences by what the gate may have let pass; ``S`` (n,) [m^2], see above."""
    failed = (m.carriers_failed + AT_FIRST * _ROWS_AT_FIRST) / (m.carriers_tested + _ROWS_AT_FIRST)
    wrong = PASSES_UNLOCKED * failed
    within = DOPPLER_LIMIT_MPS * min(since_last, 1.0)
    for j in range(lines.shape[0]):
        if lines[j].status[CARRIER] == USED:
            passed = min(math.sqrt(gate2 * S[j]), within)
            probability = wrong * passed / (wrong * passed + (1.0 - wrong) * within)
            lines[j].variance[CARRIER] += probability * passed * passed / 3.0
