"""The streaming engine's view of observations: a table of them cut into epochs, each with its time tag."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from insgnss.tables import GnssTable


def tag_of(epoch: GnssTable) -> int:
    """Return an epoch's time tag."""
    return int(epoch.t_ns[0])


def epochs_of(table: GnssTable) -> Iterator[GnssTable]:
    """Yield a table's epochs one by one, in the order of time."""
    times = np.unique(table.t_ns)
    for t_ns in times:
        yield table.take(np.flatnonzero(table.t_ns == t_ns))


def empty_epoch() -> GnssTable:
    """Return a table without rows."""
    nothing = np.zeros(0)
    no_index = np.zeros(0, np.int16)
    return GnssTable(
        t_ns=np.zeros(0, np.int64),
        sv=no_index,
        signal=no_index,
        pseudorange_m=nothing,
        doppler_hz=nothing,
        range_rate_mps=nothing,
        cn0_dbhz=nothing,
        sv_names=(),
        signal_names=(),
        sat=np.zeros((0, 8)),
    )
