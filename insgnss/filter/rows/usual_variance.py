"""The variance of a row without what is its satellite's own in this epoch: noise, or a weak signal. Compiled."""

from __future__ import annotations

from insgnss.filter.rows.lines import Line
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE
from insgnss.kernels.jit import kernel


@kernel(inline=True)
def usual_variance(line: Line, kind: int) -> float:
    """Return the variance of a row at the level of all, without what its own satellite or a weak signal adds."""
    if kind == PSEUDORANGE:
        return float(line.variance[kind] - line.weak)
    return float(line.variance[kind] - line.extra if kind == RANGE_RATE else line.variance[kind])


@kernel(inline=True)
def foreseen_variance(line: Line, kind: int) -> float:
    """Return the variance of a row with its satellite's own noise as predicted from earlier epochs."""
    return float(line.variance[kind] + (line.foreseen - line.extra if kind == RANGE_RATE else 0.0))
