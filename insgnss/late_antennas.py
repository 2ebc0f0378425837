"""Several antennas, loaded where a flight has them: they are seldom, and take as long to load as half of all else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd

from insgnss.errors import InputError
from insgnss.filter.setup import FilterSetup
from insgnss.gnss.antenna_phases import epoch_of
from insgnss.gnss.observation_rows import Rows
from insgnss.log.flight import Flight, FlightLogs
from insgnss.tables import Event

Record = Callable[[pd.DataFrame, int], pd.DataFrame]


def with_aid(setup: FilterSetup, flight: Flight) -> FilterSetup:
    """Return the setup with the attitude stage of the flight's antennas, as yet without phases."""
    if flight.config.attitude is None:
        return setup
    from insgnss.several_antennas import attitude_aid

    return replace(setup, aid=attitude_aid(setup, flight))


def with_antennas(
    setup: FilterSetup, logs: FlightLogs, flight: Flight, rows: Rows
) -> tuple[FilterSetup, Record | None, list[Event]]:
    """Return what ``several_antennas.with_antennas`` does; the setup alone where the flight has one antenna."""
    if flight.config.attitude is None:
        return setup, None, []
    from insgnss import several_antennas

    return several_antennas.with_antennas(setup, logs, flight, rows)


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
                f"no epoch of antenna '{antenna.name}' is at a time of the main log's",
                file=antenna.files[0],
                key="attitude.antenna.files",
                advice="log all antennas at one rate; their time tags may be 2 ms apart",
            )
