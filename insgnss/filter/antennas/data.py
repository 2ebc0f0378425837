"""What the attitude stage of several antennas is given beside the filter, and the ledger it writes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from insgnss.filter.antennas.rows import Antennas
from insgnss.filter.antennas.visibility import Hiding
from insgnss.gnss.antenna_phases import AntennaPhases
from insgnss.status import NO_DIFFERENCE, NOT_STARTED, USED
from insgnss.tables import Float64, Int8


@dataclass(frozen=True)
class DifferenceLedger:
    """What became of every phase of the antennas beside the main one: one entry for each row of the phases."""

    status: Int8  # (n,)
    innovation: Float64  # (n,) [m], NaN where nothing was predicted
    variance: Float64  # (n,) its predicted variance


def new_ledger(phases: AntennaPhases) -> DifferenceLedger:
    """Return a ledger as it stands before the filter runs."""
    n = len(phases.status)
    status = np.where(phases.status == USED, NOT_STARTED, phases.status).astype(np.int8)
    status[phases.first[-1] :] = np.where(
        phases.status[phases.first[-1] :] == USED, NO_DIFFERENCE, phases.status[phases.first[-1] :]
    )
    return DifferenceLedger(status, np.full(n, math.nan), np.full(n, math.nan))


@dataclass(frozen=True)
class AntennaData:
    """All that the stage needs beside the filter: the phases, the antennas, its settings, and where it writes."""

    phases: AntennaPhases
    antennas: Antennas
    ledger: DifferenceLedger
    multipath_time_s: float
    ratio: float
    confirmations: int
    gate_sigma: float
    hiding: Hiding | None = None  # what hides satellites from each antenna; None: nothing is masked
