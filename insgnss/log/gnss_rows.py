"""Rows of GNSS observations: the order of their epochs, and where a carrier phase may have slipped."""

from __future__ import annotations

import numpy as np

from insgnss.tables import Bool, Event, GnssTable, Int64


def in_time_order(table: GnssTable, file: str) -> tuple[GnssTable, list[Event]]:
    """Return the rows sorted by epoch, stable within an epoch, and an event when they were not."""
    falls = np.flatnonzero(np.diff(table.t_ns) < 0)
    if not len(falls):
        return table, []
    detail = f"{file}: time falls back at {len(falls)} row(s); the rows were sorted"
    order = np.argsort(table.t_ns, kind="stable")
    return table.take(order), [Event(int(table.t_ns[falls[0] + 1]), "gnss_time_order", detail)]


def epochs(table: GnssTable) -> tuple[Int64, Int64]:
    """Return the time tag of each epoch and the row at which it starts (with the number of rows as last entry)."""
    starts = np.concatenate(([0], np.flatnonzero(np.diff(table.t_ns)) + 1)).astype(np.int64)
    return table.t_ns[starts], np.concatenate((starts, [len(table.t_ns)]))


def satellites_per_epoch(table: GnssTable, which: Bool) -> Int64:
    """Return how many different satellites have one of the rows ``which`` (n,) in each epoch."""
    _, starts = epochs(table)
    epoch = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    pairs = np.unique(epoch[which] * len(table.sv_names) + table.sv[which])
    return np.bincount(pairs // len(table.sv_names), minlength=len(starts) - 1)


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
