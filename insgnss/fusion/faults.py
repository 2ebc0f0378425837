"""Faults that no single gate sees: several at once, slow ones, reflections; and robust weights. Compiled.

| fault | test | status |
|-------|------|--------|
| several wrong rows under a wide prior | residuals after the update, see ``consistency`` | INCONSISTENT |
| an error that creeps in (1 m/s, 0.3 m/s) | fast against slow mean of the satellite's innovations | DRIFTING |
| a reflected signal in a street | weak for its elevation and too long | REFLECTED |

All are judged on what the epoch shows before any of its rows has moved the state, so the order of rows does not matter.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.apart import apart
from insgnss.fusion.lines import Line, Lines
from insgnss.fusion.parameters import Parameters
from insgnss.fusion.state import StateRecord
from insgnss.gnss.observation_rows import PSEUDORANGE, Observations
from insgnss.jit import inlined
from insgnss.median import median_of
from insgnss.status import DRIFTING, REFLECTED, USED
from insgnss.tables import Float64

HUBER, STUDENT = 1, 2  # values of ``Parameters.robust``; 0: the gate alone

_LEAST_WITNESSES: Final = 6  # a median of fewer rows may be the wrong one's

_FAST_S, _SLOW_S = 5.0, 30.0  # memories of the two means of a satellite's innovations
_FORGOTTEN_S: Final = 5.0  # a satellite unseen for longer starts anew
_TOO_WIDE: Final = 9.0  # predicted over the row's own variance: the innovation is then the state's error

_CN0_SLOPE_DB: Final = 10.0  # what an antenna under open sky loses between the zenith and the horizon
_LEVEL_UP_S, _LEVEL_DOWN_S = 20.0, 300.0  # the open sky's level follows strong signals soon, weak ones slowly
_REFLECTED_SIGMA: Final = 2.0  # a reflection is longer than the direct way


@apart
def weigh_robustly(lines: Lines, kind: int, par: Parameters) -> None:
    """Widen the variance of rows that stand out of the prior, instead of only refusing the farthest.

    Equation: r <- r / w, w = k / |nu| beyond k (Huber), w = (d + 1) / (d + nu^2) (Student's t, d degrees of freedom),
    nu the innovation over its sigma.                                       [Huber 1981, 7; Chang 2014, J. Geod. 88]
    """
    if par.robust == 0:
        return
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[kind] != USED:
            continue
        nu2 = line.innovation[kind] ** 2 / (line.predicted[kind] + line.variance[kind])
        if par.robust == HUBER:
            if nu2 > par.huber_k * par.huber_k:
                line.variance[kind] *= math.sqrt(nu2) / par.huber_k
        else:
            line.variance[kind] *= max(1.0, (par.student_freedom + nu2) / (par.student_freedom + 1.0))


@apart
def follow_innovations(
    memory: Float64, lines: Lines, observation: Observations, t_ns: int, values: Float64, par: Parameters
) -> None:
    """Carry both means of each satellite's range innovations on, and refuse those that creep away from the others.

    ``memory`` is (slots, 3): fast mean, slow mean [m], time of the last epoch [s]; what all satellites share (clock,
    position) is taken off by the epoch's median first. A row that its gate refuses leaves no trace
    in them. While the prior is much wider than the row (a new constellation's clock, after a reset) an innovation tells
    of the state, not of the satellite, and is not kept. ``values`` is scratch of at least the lines' length.
    """
    if par.drift_gate <= 0.0:
        return
    n = 0
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[PSEUDORANGE] != USED:
            continue
        if tells_of_the_satellite(line):
            values[n] = line.innovation[PSEUDORANGE]
            n += 1
        else:
            memory[observation[j].slot, 2] = -math.inf
    if n < _LEAST_WITNESSES:
        return
    common = median_of(values, n)
    now = t_ns * 1e-9
    for j in range(lines.shape[0]):
        line = lines[j]
        if line.status[PSEUDORANGE] != USED or not tells_of_the_satellite(line):
            continue
        mean = memory[observation[j].slot]
        value = line.innovation[PSEUDORANGE] - common
        since = now - mean[2]
        mean[2] = now
        if not 0.0 <= since <= _FORGOTTEN_S:
            mean[0], mean[1] = value, value
        else:
            mean[0] += (1.0 - math.exp(-since / _FAST_S)) * (value - mean[0])
            mean[1] += (1.0 - math.exp(-since / _SLOW_S)) * (value - mean[1])
        crept = mean[0] - mean[1]
        variance = line.predicted[PSEUDORANGE] + line.variance[PSEUDORANGE]
        if line.status[PSEUDORANGE] == USED and crept * crept > par.drift_gate**2 * variance:
            line.status[PSEUDORANGE] = DRIFTING


@inlined
def tells_of_the_satellite(line: Line) -> bool:
    """Return whether a pseudorange's innovation is not for the most part the state's own error."""
    return bool(line.predicted[PSEUDORANGE] <= _TOO_WIDE * line.variance[PSEUDORANGE])


@apart
def refuse_reflections(
    m: StateRecord, lines: Lines, observation: Observations, t_ns: int, par: Parameters
) -> None:
    """Refuse pseudoranges that are much weaker than their elevation lets expect, and too long.

    The level of the open sky is followed in the state: C/N0 plus what the elevation explains, of the strongest signal.
    """
    if par.reflected_below_db <= 0.0:
        return
    strongest = 0.0
    for j in range(lines.shape[0]):
        line = lines[j]
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
