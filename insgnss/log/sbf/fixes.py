"""SBF's PVTGeodetic, the receiver's fixes from satellites, as a reference with sigmas, quality 2: no truth.

AsteRx SBi reference guide, "PVTGeodetic", "PosCovGeodetic", "VelCovGeodetic": angles in rad, velocity north, east, up.
Sigmas are those of the covariances of the same time. Where they are not logged, those of the place are half of the
accuracies that PVTGeodetic states from its revision 2 on: twice the rms of the distance across, twice the sigma of the
height.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from insgnss.log.files import records
from insgnss.log.own_solution import distinct_rows, own_reference, stated_sigmas
from insgnss.log.sbf.blocks import (
    FLOAT_MISSING,
    POS_COV,
    PVT,
    VEL_COV,
    Blocks,
    block_length,
    block_records,
    block_times_ns,
    time_known,
)
from insgnss.log.sbf.solution import solved_rows
from insgnss.tables import Event, Float64, Int64, ReferenceTable

_MODE_MASK, _FIX_2D = 0x0F, 0x80  # of the byte that names the kind of solution
_ACCURACIES: Final = np.dtype([("cm", "<u2", (2,))])  # across, height
_ACCURACIES_AT: Final = 90  # byte of the block
_NOT_STATED: Final = 65_534  # larger, or not known
_M_PER_CM: Final = 0.01


def fixes(data: bytes, blocks: Blocks) -> tuple[ReferenceTable | None, list[Event]]:
    """Return the fixes in three dimensions, None with less than two; the other blocks are counted."""
    rows = block_records(data, blocks, PVT)
    if not len(rows):
        return None, []
    in_space = (rows["mode"] & _MODE_MASK > 0) & (rows["mode"] & _FIX_2D == 0)
    place, kept, events = solved_rows(
        rows, in_space, "PVTGeodetic block(s) without a fix in three dimensions"
    )
    if len(kept) < 2:
        return None, events
    t_ns = block_times_ns(rows[kept])
    sigma = np.full((len(kept), 9), np.nan)
    for number, columns in ((POS_COV, slice(0, 3)), (VEL_COV, slice(3, 6))):
        sigma[:, columns] = _sigmas(block_records(data, blocks, number), t_ns)
    stated = _accuracies(data, np.array(blocks.starts[PVT], np.int64)[kept])
    sigma[:, :3] = np.where(np.isnan(sigma[:, :3]), stated, sigma[:, :3])
    velocity = rows["v_neu"][kept].astype(np.float64)
    velocity = np.where(velocity > FLOAT_MISSING, velocity, np.nan) * [1.0, 1.0, -1.0]
    return own_reference(t_ns, place[kept], sigma, velocity=velocity), events


def _sigmas(rows: Any, at_ns: Int64) -> Float64:
    """Return the roots (n, 3) of the variances at given times, NaN where no block states them."""
    rows = rows[time_known(rows) & (rows["error"] == 0)]
    sigma = np.full((len(at_ns), 3), np.nan)
    t_ns = block_times_ns(rows)
    kept = distinct_rows(t_ns, np.ones(len(rows), bool))
    _, here, there = np.intersect1d(at_ns, t_ns[kept], assume_unique=True, return_indices=True)
    variance = rows["variance"][kept][there].astype(np.float64)
    sigma[here] = stated_sigmas(np.sqrt(np.where(variance > 0.0, variance, np.nan)))
    return sigma


def _accuracies(data: bytes, starts: Int64) -> Float64:
    """Return the sigmas (n, 3) of the place by the accuracies of its block, NaN where it has none."""
    end = _ACCURACIES_AT + _ACCURACIES.itemsize
    long_enough = np.array([block_length(data, start) >= end for start in starts.tolist()], bool)
    sigma = np.full((len(starts), 3), np.nan)
    stated = records(data, (starts[long_enough] + _ACCURACIES_AT).tolist(), _ACCURACIES)["cm"].astype(float)
    stated = np.where(stated < _NOT_STATED, stated * _M_PER_CM / 2.0, np.nan)
    sigma[long_enough] = stated[:, [0, 0, 1]] / [math.sqrt(2.0), math.sqrt(2.0), 1.0]
    return stated_sigmas(sigma)
