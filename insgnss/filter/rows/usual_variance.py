"""The variance of a row without what its satellite's own noise adds in this epoch, compiled."""

from __future__ import annotations

from insgnss.filter.rows.lines import Line
from insgnss.gnss.observation_rows import RANGE_RATE
from insgnss.kernels.jit import kernel


@kernel(inline=True)
def usual_variance(line: Line, kind: int) -> float:
    """Return the variance of a row at the level of all, without what its own satellite's noise adds."""
    return float(line.variance[kind] - line.extra if kind == RANGE_RATE else line.variance[kind])


@kernel(inline=True)
def foreseen_variance(line: Line, kind: int) -> float:
    """Return the variance of a row with its satellite's own noise as predicted from earlier epochs."""
    return float(usual_variance(line, kind) + (line.foreseen if kind == RANGE_RATE else 0.0))
