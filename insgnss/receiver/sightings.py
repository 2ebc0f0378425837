"""Which satellites the receiver itself saw, and when: the presence that the supervisor's detections are judged by."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from insgnss.receiver.tracking_state import MISSING, NOT_KNOWN, PRESENT
from insgnss.tables import Bool, GnssTable, Int8, Int64

LATE_EPOCHS: Final = 1.5  # usual intervals after which an epoch says nothing any more: one was left out


class Sightings(NamedTuple):
    """The epochs of a receiver's log, and which satellites have a pseudorange in each, on any signal."""

    epoch_ns: Int64  # (k,) increasing
    seen: Bool  # (k, s)
    sv_names: tuple[str, ...]  # (s,)


def sightings_of(gnss: GnssTable) -> Sightings:
    """Return the receiver's sightings; a row without a pseudorange is not a sighting, but its epoch counts."""
    epoch_ns, epoch = np.unique(gnss.t_ns, return_inverse=True)
    seen = np.zeros((len(epoch_ns), len(gnss.sv_names)), np.bool_)
    has_range = np.isfinite(gnss.pseudorange_m)
    seen[epoch[has_range], gnss.sv[has_range]] = True
    return Sightings(epoch_ns, seen, gnss.sv_names)


def presence(
    sightings: Sightings, t_ns: Int64, sv_names: Sequence[str], usual_ns: float | None = None
) -> Int8:
    """Return (n, m) PRESENT or MISSING by the newest epoch not later than each time.

    NOT_KNOWN where there is none, or where it is older than one and a half of the log's usual intervals. A satellite
    that is never in the log is MISSING.

    Parameters
    ----------
    t_ns : (n,) GPS time
    sv_names : names of the m satellites
    usual_ns : the usual interval of the receiver's epochs; that of these epochs if None
    """
    if not len(sightings.epoch_ns):
        return np.full((len(t_ns), len(sv_names)), NOT_KNOWN, np.int8)
    column = {name: i for i, name in enumerate(sightings.sv_names)}
    places = np.array([column.get(name, -1) for name in sv_names], np.int64)
    if usual_ns is None:
        steps = np.diff(sightings.epoch_ns)
        usual_ns = float(np.median(steps)) if len(steps) else 0.0
    newest = np.searchsorted(sightings.epoch_ns, t_ns, side="right") - 1
    known = (newest >= 0) & (t_ns - sightings.epoch_ns[newest] <= LATE_EPOCHS * usual_ns)
    seen = np.zeros((len(t_ns), len(sv_names)), np.bool_)
    logged = np.flatnonzero(places >= 0)
    seen[:, logged] = sightings.seen[np.ix_(np.maximum(newest, 0), places[logged])]
    found = np.where(seen, PRESENT, MISSING)
    return np.where(known[:, None], found, NOT_KNOWN).astype(np.int8)
