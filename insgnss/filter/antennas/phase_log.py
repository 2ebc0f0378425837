"""The phases of several antennas in addition to the filter's rows, of a whole log or one epoch, and their status."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from insgnss.gnss.antenna_phases import AntennaPhases, antenna_phases
from insgnss.gnss.observation_rows import GnssRows
from insgnss.status import NO_DIFFERENCE, NOT_STARTED, USED
from insgnss.tables import Float64, GnssTable, Int8

KIND: Final = "attitude_difference"  # the name of the differences in the ledger


@dataclass(frozen=True)
class DifferenceLedger:
    """The status of every phase of the further antennas: one entry for each row of the phases."""

    status: Int8  # (n,)
    innovation: Float64  # (n,) [m], NaN where nothing was predicted
    variance: Float64  # (n,) its predicted variance


@dataclass(frozen=True)
class PhaseLog:
    """The phases and their ledger."""

    phases: AntennaPhases
    ledger: DifferenceLedger


def new_ledger(phases: AntennaPhases) -> DifferenceLedger:
    """Return a ledger as it stands before the filter runs."""
    n = len(phases.status)
    status = np.where(phases.status == USED, NOT_STARTED, phases.status).astype(np.int8)
    status[phases.first[-1] :] = np.where(
        phases.status[phases.first[-1] :] == USED, NO_DIFFERENCE, phases.status[phases.first[-1] :]
    )
    return DifferenceLedger(status, np.full(n, math.nan), np.full(n, math.nan))


def phase_log(logs: Sequence[tuple[GnssTable, GnssRows]], channels: Mapping[str, int]) -> PhaseLog:
    """Return the phases of all antennas with a new ledger; arguments as of ``antenna_phases``."""
    phases = antenna_phases(logs, channels)
    return PhaseLog(phases, new_ledger(phases))
