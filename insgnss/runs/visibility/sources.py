"""The input of the command: a saved run or a reference trajectory, with a flight's satellites and antennas."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from insgnss.antenna.equipment import installation
from insgnss.antenna.installation import Installation
from insgnss.config.filter import FilterConfig
from insgnss.config.flight import MountedAntenna, Reference
from insgnss.errors import ConfigError
from insgnss.log.flight import Flight
from insgnss.log.gnss_log import read_gnss_logs
from insgnss.log.reference import read_reference
from insgnss.log.rinex.navigation import read_navigation
from insgnss.runs.datum import FLIGHT
from insgnss.runs.result import Run
from insgnss.runs.visibility.attitude_history import AttitudeHistory
from insgnss.runs.visibility.sky import SatelliteDirections, sky_of_navigation, sky_of_table
from insgnss.runs.visibility.study import VisibilityStudy, visibility
from insgnss.tables import Event, NavigationData

_LONGEST_GAP_S = 60.0  # between two rows of a run's satellite: it moves by half a degree meanwhile


@dataclass(frozen=True)
class Sources:
    """The inputs of a study, read."""

    attitude: AttitudeHistory
    sky: SatelliteDirections
    antennas: Installation
    events: list[Event]


def visibility_of(
    source: Path, flight: Flight, filter: FilterConfig, pattern: str | None = None, step_s: float = 1.0
) -> VisibilityStudy:
    """Return the study of a saved run (a folder) or a reference trajectory (a CSV file).

    Parameters
    ----------
    source : the run's folder, or a trajectory in the form of the flight file's ``[reference]``
    flight : gives the week, the satellites' messages and the antennas
    filter : its ``[visibility]`` and elevation mask count
    pattern : gain pattern, by name or file, in place of those of the flight file's antennas
    step_s : least time between two attitudes

    Raises
    ------
    InsGnssError : something of it is missing or wrong
    """
    read = read_sources(source, flight, pattern, step_s)
    study = visibility(
        read.attitude,
        read.sky,
        read.antennas,
        filter.visibility,
        elevation_mask_deg=filter.measurements.elevation_mask_deg,
        week=flight.config.gps_week,
        events=read.events,
    )
    study.satellites.attrs[FLIGHT] = flight.name
    return study


def read_sources(source: Path, flight: Flight, pattern: str | None, step_s: float) -> Sources:
    """Return attitude, sky and antennas, and the events of the files.

    Raises
    ------
    InsGnssError : a file cannot be used; ConfigError for a step that is none
    """
    if not (math.isfinite(step_s) and step_s >= 0.0):
        raise ConfigError(f"invalid step {step_s}", key="step_s", advice="give seconds, 0 for every row")
    config = flight.config
    antennas, events = installation(
        _antennas(flight, pattern), flight.path.absolute().parent, config.gnss.lever_b
    )
    if source.is_dir():
        run = Run.load(source)
        attitude, source_events = AttitudeHistory.of_nav(run.nav, config.gps_week, step_s)
        if not config.gnss.navigation:
            sky = sky_of_table(attitude, run.satellites, config.gps_week, _LONGEST_GAP_S)
            return Sources(attitude, sky, antennas, events + source_events)
    else:
        columns = config.reference or Reference(file=source)
        reference, source_events = read_reference(
            columns.model_copy(update={"file": source}), config.gps_week
        )
        attitude, missing = AttitudeHistory.of_reference(reference, step_s, source)
        source_events = source_events + missing
    navigation, more_events = _navigation(flight)
    return Sources(
        attitude, sky_of_navigation(attitude, navigation), antennas, events + source_events + more_events
    )


def _antennas(flight: Flight, pattern: str | None) -> tuple[MountedAntenna, ...]:
    """Return the flight file's antennas, their patterns replaced by the one asked for; one level antenna if none."""
    named = flight.config.gnss.antenna
    if pattern is None:
        if not named:
            advice = "describe one in the flight file ([[gnss.antenna]]), or name a pattern (--antenna)"
            raise ConfigError("no antenna is described", file=flight.path, key="gnss.antenna", advice=advice)
        return named
    if not named:
        return (MountedAntenna(pattern=pattern),)
    return tuple(antenna.model_copy(update={"pattern": pattern}) for antenna in named)


def _navigation(flight: Flight) -> tuple[NavigationData, list[Event]]:
    """Return the satellites' messages, from navigation files or the receiver's own log."""
    gnss = flight.config.gnss
    if gnss.navigation:
        return read_navigation(gnss.navigation)
    logs = read_gnss_logs(gnss, flight.config.gps_week, flight.path, flight.config.columns_by_file())
    if logs.navigation is None or not logs.navigation.has_messages:
        advice = "name RINEX files under gnss.navigation, or study a saved run, which has their positions"
        raise ConfigError(
            "no source of satellite positions", file=flight.path, key="gnss.navigation", advice=advice
        )
    return logs.navigation, logs.events
