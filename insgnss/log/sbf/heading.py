"""SBF's AttEuler, the attitude from several antennas: its heading, as a further sensor's samples.

PolaRx5 reference guide, "AttEuler": heading clockwise from north, pitch and roll in degrees; bits 0 and 1 of the error
are of the baseline to the first auxiliary antenna, bit 7 says that no attitude was asked for. AttCovEuler has the
variances in deg^2.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.log.further_samples import HEADING, FurtherSamples, further_samples
from insgnss.log.sbf.blocks import (
    ATTITUDE,
    ATTITUDE_COV,
    FLOAT_MISSING,
    Blocks,
    block_records,
    block_times_ns,
    time_known,
)
from insgnss.tables import Event

_FIXED: Final = (2, 4)  # modes with fixed ambiguities: heading and pitch; with roll
_NO_HEADING: Final = 0b1000_0011  # bits of the error


def headings(data: bytes, blocks: Blocks) -> tuple[list[FurtherSamples], list[Event]]:
    """Return the headings with fixed ambiguities and their sigmas, and an event that counts the others.

    The list is empty if there is none. A heading without an AttCovEuler of its time has no sigma.
    """
    rows = block_records(data, blocks, ATTITUDE)
    if not len(rows):
        return [], []
    usable = time_known(rows) & np.isin(rows["mode"], _FIXED) & (rows["error"] & _NO_HEADING == 0)
    usable &= rows["heading_deg"] > FLOAT_MISSING
    events = []
    if not usable.all():
        detail = f"{int((~usable).sum())} AttEuler block(s) without a heading by fixed ambiguities left out"
        events.append(Event(None, "sbf_no_heading", detail))
    rows = rows[usable]
    t_ns = block_times_ns(rows)
    covariances = block_records(data, blocks, ATTITUDE_COV)
    stated = covariances[time_known(covariances) & (covariances["variance"][:, 0] > 0.0)]
    _, here, there = np.intersect1d(t_ns, block_times_ns(stated), return_indices=True)
    sigma_deg = np.full(len(rows), np.nan)
    sigma_deg[here] = np.sqrt(stated["variance"][there, 0])
    values = np.column_stack([rows["heading_deg"].astype(np.float64), sigma_deg])
    samples, left_out = further_samples(HEADING, "AttEuler", t_ns, values)
    return samples, events + left_out
