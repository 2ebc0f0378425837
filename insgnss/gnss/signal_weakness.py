"""By how much a signal is weaker than it would be under an open sky."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.tables import Float64, Int64

_STRONGEST: Final = 3  # of the signals of a band, the weakest that still counts as free
_ALIKE_DB: Final = 3.0  # by which free signals of a band differ


def weakness_db(cn0_dbhz: Float64, band: Int64, first: Int64) -> Float64:
    """Return (n,) by how much each row's C/N0 is below that of free signals of its band in its epoch [dB], 0 at least.

    Equation: w = max(0, C/N0 of the third strongest - 3 dB - C/N0); of fewer than three the weakest takes its place

    Parameters
    ----------
    cn0_dbhz : (n,) NaN where not logged; there w is 0
    band : (n,) number of the frequency band
    first : (m + 1,) first row of each epoch
    """
    weak = np.zeros(len(cn0_dbhz))
    epoch = np.repeat(np.arange(len(first) - 1), np.diff(first))
    rows = np.flatnonzero(np.isfinite(cn0_dbhz))
    rows = rows[np.lexsort((-cn0_dbhz[rows], band[rows], epoch[rows]))]
    runs = np.column_stack([epoch[rows], band[rows]])
    begin = np.flatnonzero(np.append(True, np.any(np.diff(runs, axis=0) != 0, axis=1))[: len(rows)])
    length = np.diff(np.append(begin, len(rows)))
    free = cn0_dbhz[rows[begin + np.minimum(_STRONGEST, length) - 1]] - _ALIKE_DB
    weak[rows] = np.maximum(np.repeat(free, length) - cn0_dbhz[rows], 0.0)
    return weak
