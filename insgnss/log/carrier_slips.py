"""Where a carrier phase may have slipped, by the time for which the receiver says it has been locked."""

from __future__ import annotations

import numpy as np

from insgnss.tables import Bool, GnssTable, Int64


def slipped_rows(table: GnssTable, lock_ms: Int64, halved: Bool, ceiling_ms: int | Int64) -> Bool:
    """Return for rows in time order whether the carrier may have slipped since its last valid value.

    It has when the lock time fell or is shorter than the time since then, or when a half cycle was subtracted or added;
    beyond the lock time's ceiling nothing is known. The first value of a satellite and signal is not a slip.

    Parameters
    ----------
    table : (n,) rows
    lock_ms, halved : (n,) of each row
    ceiling_ms : the lock time counts no further, for all or (n,)
    """
    assert table.carrier_cycles is not None
    ceiling = np.broadcast_to(np.asarray(ceiling_ms, np.int64), lock_ms.shape)
    valid = np.flatnonzero(np.isfinite(table.carrier_cycles))
    track = table.sv[valid].astype(np.int64) * len(table.signal_names) + table.signal[valid]
    order = valid[np.argsort(track, kind="stable")]
    track = np.sort(track, kind="stable")
    same = np.diff(track) == 0
    before, after = order[:-1][same], order[1:][same]
    elapsed_ms = (table.t_ns[after] - table.t_ns[before]) // 1_000_000
    slipped = (lock_ms[after] < lock_ms[before]) | (lock_ms[after] < np.minimum(elapsed_ms, ceiling[after]))
    slipped |= (elapsed_ms > ceiling[after]) | (halved[after] != halved[before]) | (lock_ms[after] == 0)
    result = np.zeros(len(table.t_ns), np.bool_)
    result[after] = slipped
    return result
