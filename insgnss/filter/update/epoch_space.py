"""Makes the work space of an epoch."""

from __future__ import annotations

import math

import numpy as np

from insgnss.filter.rows.lines import ANTENNA_DTYPE, CLONE_ROWS, FIT_ROWS, LINE_DTYPE, Epoch
from insgnss.filter.state import ABSENT_STATE, N_CLONE
from insgnss.filter.update.predictions import columns_of
from insgnss.gnss.range_model import AIR_DTYPE


def new_epoch(k: int, n: int, at_clone: int = ABSENT_STATE) -> Epoch:
    """Return work space for epochs of at most ``k`` rows and ``n`` error states, the clone from ``at_clone`` on."""
    lines = np.zeros(k, LINE_DTYPE)
    for kind, columns in enumerate(columns_of(at_clone)):
        lines["columns"][:, kind, : len(columns)] = columns
        lines["count"][:, kind] = len(columns)
    lines["gain"] = math.nan
    return Epoch(
        lines,
        np.zeros(1, ANTENNA_DTYPE),
        np.zeros(2, AIR_DTYPE),
        np.zeros((CLONE_ROWS + N_CLONE, max(k, n))),
        np.zeros((FIT_ROWS, 4)),
    )
