"""Rows of GNSS observations, put into the order of their epochs."""

from __future__ import annotations

import numpy as np

from insgnss.tables import Event, GnssTable, Int64


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
