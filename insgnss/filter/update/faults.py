"""Faults that no single gate sees: several at once, slow ones, reflections; and robust weights. Compiled.

| fault | test | status |
|-------|------|--------|
| several wrong rows under a wide prior or clock | residuals after the update, see ``consistency`` | INCONSISTENT |
| an error that creeps in (1 m/s, 0.3 m/s) | means of its residuals against the others, see ``creeping`` | DRIFTING |
| a range rate that the others contradict again and again | for two seconds, see ``creeping`` | DRIFTING |
| a reflected signal in a street | weak for its elevation and too long | REFLECTED |

All are judged on the epoch's innovations before any of its rows has moved the state, so the order of rows does not
matter.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import Line, Lines
from insgnss.filter.state import StateRecord
from insgnss.gnss.observation_rows import PSEUDORANGE, Observations
from insgnss.kernels.jit import kernel
from insgnss.status import REFLECTED, USED

HUBER, STUDENT = 1, 2  # values of ``Parameters.robust``; 0: the gate alone

_CN0_SLOPE_DB: Final = 10.0  # what an antenna under open sky loses between the zenith and the horizon
_LEVEL_UP_S, _LEVEL_DOWN_S = 20.0, 300.0  # the open sky's level follows strong signals soon, weak ones slowly
_REFLECTED_SIGMA: Final = 2.0  # a reflection is longer than the direct way


@kernel(apart=True)
def weigh_robustly(lines: Lines, kind: int, par: Parameters) -> None:
    """Widen the variance of rows that stand out of the prior, instead of only refusing the farthest.

    Equation: r <- r / w, w = k / |nu| beyond k (Huber), w = (d + 1) / (d + nu^2) (Student's t, d degrees of freedom),
    nu the innovation over its sigma.                                       [Huber 1981, 7; Chang 2014, J. Geod. 88]
    """
    if par.robust == 0:
        return
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        if line.status[kind] != USED:
            continue
        nu2 = line.innovation[kind] ** 2 / (line.predicted[kind] + line.variance[kind])
        if par.robust == HUBER:
            if nu2 > par.huber_k * par.huber_k:
                line.variance[kind] *= math.sqrt(nu2) / par.huber_k
        else:
            line.variance[kind] *= max(1.0, (par.student_freedom + nu2) / (par.student_freedom + 1.0))


@kernel(apart=True)
def refuse_reflections(
    m: StateRecord, lines: Lines, observation: Observations, t_ns: int, par: Parameters
) -> None:
    """Refuse pseudoranges that are much weaker than expected at their elevation, and too long.

    The level of the open sky is followed in the state: C/N0 plus what the elevation explains, of the strongest signal.
    """
    if par.reflected_below_db <= 0.0:
        return
    strongest = 0.0
    for j in range(lines.shape[0]):
        line: Line = lines[j]
        cn0 = observation[j].cn0
        if line.status[PSEUDORANGE] != USED or math.isnan(cn0):
            continue
        at_zenith = cn0 + _CN0_SLOPE_DB * (1.0 + line.u_n[2])
        strongest = max(strongest, at_zenith)
        sigma = math.sqrt(line.predicted[PSEUDORANGE] + line.variance[PSEUDORANGE])
        weak = m.cn0_level - at_zenith > par.reflected_below_db
        if weak and line.innovation[PSEUDORANGE] > _REFLECTED_SIGMA * sigma:
            line.status[PSEUDORANGE] = REFLECTED
    since = min(max((t_ns - m.cn0_level_ns) * 1e-9, 0.0), _LEVEL_UP_S)
    m.cn0_level_ns = t_ns
    if strongest > 0.0:
        memory = _LEVEL_UP_S if strongest > m.cn0_level else _LEVEL_DOWN_S
        m.cn0_level += (strongest - m.cn0_level) * (since / memory if m.cn0_level > 0.0 else 1.0)
