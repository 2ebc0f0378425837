"""Further antennas without the attitude stage: the epochs that they have in common."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

from insgnss.errors import InputError
from insgnss.gnss.antenna_phases import epoch_of
from insgnss.log.flight import Flight, FlightLogs

# adds the antennas' differences to the ledger of a GPS week
Record = Callable[[pd.DataFrame, int], pd.DataFrame]


def require_common_epochs(logs: FlightLogs, flight: Flight) -> None:
    """Refuse an antenna whose log has no phase at an epoch of the main one's.

    Raises
    ------
    InputError : there is such an antenna
    """
    antennas = () if flight.config.attitude is None else flight.config.attitude.antenna
    mains_ns = np.unique(logs.gnss.t_ns)
    for number, antenna in enumerate(antennas):
        cycles = logs.further[number].carrier_cycles if number < len(logs.further) else None
        t_ns = np.zeros(0, np.int64) if cycles is None else logs.further[number].t_ns[np.isfinite(cycles)]
        if not (epoch_of(t_ns, mains_ns) < len(mains_ns)).any():
            raise InputError(
                f"no epoch of antenna '{antenna.name}' matches a time of the main log",
                file=antenna.files[0],
                key="attitude.antenna.files",
                advice="log all antennas at one rate; their time tags may be 2 ms apart",
            )
