"""The errors of satellites' ranges that last for minutes: orbit and clock of the message, one state each.

The states are in sigmas: a row's column is the sigma of its own satellite. As only the satellites' motion through
the sky separates them from the antenna's position and the receiver's clock, they converge slowly, and they bound the
sigma of the position from below.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import GaussMarkov, StateBlock
from insgnss.filter.states.wanted import StateInputs

RANGE_BIASES: Final = "range_biases"


def range_biases(wanted: StateInputs) -> StateBlock | None:
    """Return the block where the settings make states of them."""
    if not (wanted.config.process.range_bias_states and wanted.n_satellites > 0):
        return None
    columns = tuple(f"range_bias_{i}" for i in range(wanted.n_satellites))
    process = GaussMarkov(1.0, wanted.config.slow_errors.satellite_time_s)
    return StateBlock(RANGE_BIASES, columns, "sigma", 1.0, process, shown=False)
