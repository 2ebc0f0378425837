"""The inputs of the attitude stage of several antennas besides the filter."""

from __future__ import annotations

from dataclasses import dataclass

from insgnss.filter.antennas.rows import Antennas
from insgnss.filter.antennas.visibility import AntennaMasking


@dataclass(frozen=True)
class AntennaData:
    """The antennas and the settings of the attitude stage."""

    antennas: Antennas
    multipath_time_s: float
    ratio: float
    confirmations: int
    gate_sigma: float
    hiding: AntennaMasking | None = None  # obstructions of each antenna; None: nothing is masked
