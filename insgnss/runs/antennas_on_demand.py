"""A flight's further antennas; the attitude stage is imported only for a flight that has them.

Its import takes half as long as all others together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from insgnss.errors import InputError
from insgnss.filter.setup import FilterSetup
from insgnss.gnss.antenna_phases import epoch_of
from insgnss.gnss.observation_rows import GnssRows
from insgnss.log.flight import Flight, FlightLogs
from insgnss.tables import Event

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


def with_aid(setup: FilterSetup, flight: Flight) -> FilterSetup:
    """Return the setup with the attitude stage of the flight's antennas, still without phases."""
    if flight.config.attitude is None:
        return setup
    from insgnss.runs.multi_antenna import attitude_aid

    return replace(setup, aid=attitude_aid(setup, flight, flight.config.attitude))


def with_antennas(
    setup: FilterSetup, logs: FlightLogs, flight: Flight, rows: GnssRows
) -> tuple[FilterSetup, Record | None, list[Event]]:
    """Return the setup with the antennas' phases, a function that adds their ledger to a run's, and events.

    Parameters
    ----------
    rows : the filter's rows of the main log

    Raises
    ------
    as ``attitude_aid``
    InputError : an antenna's log and the main one have no epoch in common
    """
    if flight.config.attitude is None:
        return setup, None, []
    from insgnss.runs.multi_antenna import attitude_aid, with_differences

    aid = attitude_aid(setup, flight, flight.config.attitude)
    require_common_epochs(logs, flight)
    aid.log = setup.phases(logs.gnss, rows, logs.further)
    return replace(setup, aid=aid), partial(with_differences, aid.log, aid.names), list(aid.remarks)
