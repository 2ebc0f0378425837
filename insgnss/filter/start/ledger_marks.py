"""The status of an epoch's rows outside the compiled filter: before a start, or in the fix of a start or reset."""

from __future__ import annotations

import numpy as np

from insgnss.filter.output.writing import Output
from insgnss.filter.start.fix import Fix
from insgnss.gnss.observation_rows import ABSENT, GnssRows
from insgnss.status import NO_EPOCH_BEFORE, NOT_STARTED, REFUSED_AT_START, USED, USED_FOR_START


def mark_rows(out: Output, rows: GnssRows, epoch: int, fix: Fix | None) -> None:
    """Write the status of an epoch's usable rows outside the filter: not started, or part of a fix."""
    ledger = out.ledger
    index = np.arange(rows.first[epoch], rows.first[epoch + 1])
    if len(out.carrier):
        carrier = out.carrier["status"][index]
        carrier[carrier == USED] = NOT_STARTED if fix is None else NO_EPOCH_BEFORE
        out.carrier["status"][index] = carrier
    status = ledger["status"][index]
    usable = rows.observation["status"][index] == USED
    if fix is None:
        status[usable] = NOT_STARTED
    else:
        status[usable & ~fix.used.T] = REFUSED_AT_START
        status[usable & fix.used.T] = USED_FOR_START
    status[rows.observation["status"][index] == ABSENT] = ABSENT
    ledger["status"][index] = status
