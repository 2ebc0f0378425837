"""What a weak signal adds to the variance of its pseudorange, compiled; ``update.weak_signals`` learns its level."""

from __future__ import annotations

from typing import Final

from insgnss.filter.state import StateRecord
from insgnss.kernels.jit import kernel

ASSUMED_ROWS: Final = 2.0  # that the assumption of the settings counts for, before any row has been seen


@kernel(inline=True)
def weak_signal_level(m: StateRecord) -> float:
    """Return the factor on the variance that the settings assume for weak signals."""
    assumed = ASSUMED_ROWS * ASSUMED_ROWS / (ASSUMED_ROWS + m.weak_rows)
    return float((assumed + m.weak_shown) / (assumed + m.weak_rows))
