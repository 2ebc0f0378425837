"""Several antennas, imported only for a flight that has them: the import takes as long as half of all others."""

from __future__ import annotations

from dataclasses import replace

from insgnss.filter.setup import FilterSetup
from insgnss.gnss.observation_rows import GnssRows
from insgnss.log.flight import Flight, FlightLogs
from insgnss.runs.further_antennas import Record
from insgnss.tables import Event


def with_aid(setup: FilterSetup, flight: Flight) -> FilterSetup:
    """Return the setup with the attitude stage of the flight's antennas, as yet without phases."""
    if flight.config.attitude is None:
        return setup
    from insgnss.runs.multi_antenna import attitude_aid

    return replace(setup, aid=attitude_aid(setup, flight))


def with_antennas(
    setup: FilterSetup, logs: FlightLogs, flight: Flight, rows: GnssRows
) -> tuple[FilterSetup, Record | None, list[Event]]:
    """Return the result of ``multi_antenna.with_antennas``; the setup alone where the flight has one antenna."""
    if flight.config.attitude is None:
        return setup, None, []
    from insgnss.runs import multi_antenna

    return multi_antenna.with_antennas(setup, logs, flight, rows)
