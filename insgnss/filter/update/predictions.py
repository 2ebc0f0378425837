"""The prediction of a row by its kind: the list of kinds, and the chain that the compiler reads."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.filter.measurements import pseudorange as of_pseudorange
from insgnss.filter.measurements import range_rate as of_range_rate
from insgnss.filter.measurements.carrier_difference import carrier_difference
from insgnss.filter.measurements.pseudorange import pseudorange
from insgnss.filter.measurements.range_rate import range_rate
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.lines import EpochWorkspace, Line
from insgnss.filter.state import ABSENT_STATE, N_CLONE, StateRecord
from insgnss.gnss.observation_rows import CARRIER, PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.kernels.jit import kernel
from insgnss.tables import Int64

# the kinds in the order of their numbers; ``predict`` names them once more, as the compiler follows no list
KINDS: Final = {PSEUDORANGE: pseudorange, RANGE_RATE: range_rate, CARRIER: carrier_difference}


@kernel(inline=True)
def predict(
    kind: int, m: StateRecord, par: Parameters, rows: GnssRows, i: int, s: EpochWorkspace, line: Line
) -> tuple[float, float]:
    """Write the row of H of row ``i`` of a kind into ``line``; return its innovation and its variance."""
    if kind == PSEUDORANGE:
        return pseudorange(m, par, rows, i, s, line)
    if kind == RANGE_RATE:
        return range_rate(m, par, rows, i, s, line)
    return carrier_difference(m, par, rows, i, s, line)


def columns_of(at_clone: int) -> tuple[Int64, Int64, Int64]:
    """Return where the entries of each kind's row stand, those of the further states left out."""
    ranges, rates = (np.array(of.COLUMNS, np.int64) for of in (of_pseudorange, of_range_rate))
    clone = max(at_clone, 0) + np.arange(N_CLONE)
    return ranges, rates, np.concatenate([ranges, clone])


# of the rows without further states
RANGE_COLUMNS, RATE_COLUMNS, _ = columns_of(ABSENT_STATE)
