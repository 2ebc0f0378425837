"""The logs of a vehicle's further antennas, read like the main one and held against it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from insgnss.config.flight import FlightConfig, FurtherAntenna
from insgnss.errors import InputError, TimeError
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.gnss_log import read_receiver
from insgnss.tables import Event, GnssTable


def read_further_antennas(config: FlightConfig, main: GnssTable) -> tuple[tuple[GnssTable, ...], list[Event]]:
    """Return the observations of each antenna of ``config.attitude``, in its order, and the events.

    Raises
    ------
    InputError or a subclass : a log is missing, cannot be read, or has no carrier phase
    TimeError : a log has no time in common with the main one
    """
    if config.attitude is None:
        return (), []
    require_carrier(main, "the log of [gnss]", config.gnss.files[0])
    tables, events = [], []
    for antenna in config.attitude.antenna:
        table, more_events = read_further_antenna(config, antenna, main)
        tables.append(table)
        events += more_events
    return tuple(tables), events


def read_further_antenna(
    config: FlightConfig, antenna: FurtherAntenna, main: GnssTable
) -> tuple[GnssTable, list[Event]]:
    """Return the observations of one antenna; errors as ``read_further_antennas``."""
    own = {"files": antenna.files, "format": antenna.format or config.gnss.format}
    log = read_receiver(config.gnss.model_copy(update=own), config.gps_week, config.columns_by_file())
    require_carrier(log.gnss, f"the log of antenna '{antenna.name}'", antenna.files[0])
    _require_overlap(config, antenna, log.gnss, main)
    channels = log.gnss.glonass_channels | config.gnss.glonass_channels
    events = [replace(event, detail=f"antenna {antenna.name}: {event.detail}") for event in log.events]
    return replace(log.gnss, glonass_channels=channels), events


def require_carrier(gnss: GnssTable, whose: str, file: object) -> None:
    """Refuse a log without carrier phases.

    Raises
    ------
    InputError : there is not one
    """
    if gnss.carrier_cycles is None or not np.isfinite(gnss.carrier_cycles).any():
        raise InputError(
            f"{whose} has no carrier phase, which the attitude needs",
            file=str(file),
            key="gnss.columns.carrier",
            advice="log carrier phases (RINEX L1C, UBX RXM-RAWX), or leave out the [attitude] block",
        )


def _require_overlap(config: FlightConfig, antenna: FurtherAntenna, gnss: GnssTable, main: GnssTable) -> None:
    if gnss.t_ns[0] <= main.t_ns[-1] and main.t_ns[0] <= gnss.t_ns[-1]:
        return
    spans = [ns_to_week_seconds(table.t_ns[[0, -1]], config.gps_week) for table in (gnss, main)]
    (first, last), (begin, end) = spans
    raise TimeError(
        f"the log of antenna '{antenna.name}' covers {first:.3f} to {last:.3f} s, the main one {begin:.3f} to"
        f" {end:.3f} s of week {config.gps_week}: they do not overlap",
        file=antenna.files[0],
        key="attitude.antenna.files",
        advice="name the log of the same flight; columns and time are read as those of [gnss]",
    )
