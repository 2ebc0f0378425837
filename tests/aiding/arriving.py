"""A log fed to the engine in the order of time, and the aiding that comes out of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

import insgnss
from insgnss.aiding.table import AidingTable
from insgnss.log.flight import FlightLogs
from insgnss.tables import GnssTable


@dataclass
class Collected:
    """Takes the tables of an engine's aiding."""

    tables: list[AidingTable] = field(default_factory=list)
    weeks: list[int] = field(default_factory=list)

    def send(self, table: AidingTable, week: int) -> None:
        """Keep a table."""
        self.tables.append(table)
        self.weeks.append(week)

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """Return all rows, parts of the sigma too; satellites by name."""
        parts = [t.columns(week, parts=True) for t, week in zip(self.tables, self.weeks, strict=True)]
        together = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        return together | {"sv": np.array(self.tables[0].sv_names)[together["sv"]]}


def feed(engine: insgnss.Engine, logs: FlightLogs, *, epoch_first: bool, late_ns: int = 0) -> None:
    """Feed samples and epochs; an epoch at the time of a sample comes before it or after it.

    ``late_ns`` is how much later than its time each epoch arrives.
    """
    epochs: list[GnssTable] = [
        logs.gnss.take(np.flatnonzero(logs.gnss.t_ns == t)) for t in np.unique(logs.gnss.t_ns)
    ]
    waiting = [(int(e.t_ns[0]) + late_ns, e) for e in epochs]
    for t_ns, w, f in zip(logs.imu.t_ns, logs.imu.w_ib_b, logs.imu.f_b, strict=True):
        while waiting and waiting[0][0] < t_ns + epoch_first:
            engine.gnss(waiting.pop(0)[1])
        engine.imu(int(t_ns), w, f)
