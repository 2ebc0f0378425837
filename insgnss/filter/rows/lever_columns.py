"""The lever arm, and the columns of its own error in the rows of an antenna's measurements."""

from __future__ import annotations

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import AntennaState, Line
from insgnss.filter.state import OFFSETS, StateRecord
from insgnss.geodesy.vectors import cross, place, place_negative, plus, rotate_back
from insgnss.kernels.jit import kernel


@kernel(inline=True)
def place_lever(m: StateRecord, par: Parameters, a: AntennaState) -> None:
    """Write the lever arm in body axes: that of the flight file, and what was found of its error."""
    for i in range(3):
        a.l_b[i] = par.lever_b[i]
        if par.at_lever_arm >= 0:
            a.l_b[i] += m.optional[par.at_lever_arm - OFFSETS + i]


@kernel(inline=True)
def lever_range_columns(
    m: StateRecord, par: Parameters, a: AntennaState, line: Line, kind: int, count: int
) -> int:
    """Write what a range grows by with the lever arm, -C^T u, from ``count`` on; return the end."""
    if par.at_lever_arm < 0:
        return count
    place_negative(line.h[kind], count, rotate_back(m.C_eb, a.u))
    return _columns(par, line, kind, count)


@kernel(inline=True)
def lever_rate_columns(
    m: StateRecord, par: Parameters, a: AntennaState, line: Line, kind: int, count: int
) -> int:
    """Write what a range rate grows by with the lever arm from ``count`` on; return the end.

    Equation: of -u . (C (w x l) - w_ie x C l): w x C^T u + C^T (u x w_ie), w the rate that was shown; and C^T of what
    the range rate grows by with the antenna's position
    """
    if par.at_lever_arm < 0:
        return count
    turning = cross(a.w_b, rotate_back(m.C_eb, a.u))
    fixed = rotate_back(m.C_eb, plus(cross(a.u, (0.0, 0.0, WGS84_OMEGA_RADPS)), a.dr))
    place(line.h[kind], count, plus(turning, fixed))
    return _columns(par, line, kind, count)


@kernel(inline=True)
def _columns(par: Parameters, line: Line, kind: int, count: int) -> int:
    """Write the lever arm's index in the error state."""
    for i in range(3):
        line.columns[kind][count + i] = par.at_lever_arm + i
    return count + 3
