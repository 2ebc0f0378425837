"""A flight file's satellite data: the log in any format, messages, products, base station, further antennas."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from insgnss.config.flight import Base, FlightConfig, FurtherAntenna, Gnss, ObservationLog
from insgnss.config.log_table import TimeScale
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError, InputError, NavigationDataError, TimeError
from insgnss.gnss.phase_centre import SatelliteAntennas
from insgnss.gnss.table_joining import joined
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.android.reader import read_android
from insgnss.log.csv.columns import NOTHING_SHARED, FileColumns
from insgnss.log.events import counted
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.gnss_rows import in_time_order
from insgnss.log.overlap import check_navigation_time
from insgnss.log.phone_satellites import states_beside, with_slots
from insgnss.log.precise import read_antennas, read_precise
from insgnss.log.receiver import ReceiverLog, no_measurements
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.sbf.reader import MEASUREMENTS_NOT_READ, read_sbf
from insgnss.log.ubx.reader import read_ubx
from insgnss.tables import Event, GnssTable, NavigationData, PreciseProducts


@dataclass(frozen=True)
class GnssLogs:
    """The observations and the data that give the satellite positions."""

    gnss: GnssTable
    navigation: NavigationData | None
    products: PreciseProducts | None
    antennas: SatelliteAntennas | None
    base: GnssTable | None
    events: list[Event]


def read_gnss_logs(
    config: Gnss, week: int, flight_file: Path, shared: FileColumns = NOTHING_SHARED
) -> GnssLogs:
    """Read the GNSS log of a flight and its satellite data.

    Messages in a receiver's own file are used together with those of the navigation files. ``shared`` are the
    columns that all logs of the flight read, by file.

    Raises
    ------
    InputError or a subclass : a file is missing or cannot be read
    NavigationDataError : there is nothing that says where the satellites were, or it is of another day
    """
    log = read_receiver(config, week, shared)
    gnss, events = log.gnss, list(log.events)
    if config.glonass_channels:
        gnss = replace(gnss, glonass_channels=gnss.glonass_channels | config.glonass_channels)
    navigation, more_events = with_files(log.navigation, config.navigation, gnss.sat is not None)
    events += more_events
    gnss, more_events = with_slots(gnss, navigation)
    events += more_events
    if config.format == "android":
        gnss, more_events = states_beside(gnss, navigation, bool(config.precise))
        events += more_events
    products = antennas = base = None
    if config.precise:
        products, more_events = read_precise(config.precise)
        events += more_events
    if config.antennas is not None:
        antennas, more_events = read_antennas(config.antennas)
        events += more_events
    messages = navigation is not None and navigation.has_messages
    if gnss.sat is None and not messages and products is None:
        raise missing_navigation(flight_file)
    if gnss.sat is None and navigation is not None and messages and products is None:
        events += check_navigation_time(navigation, gnss.t_ns, config.navigation or config.files)
    if config.base is not None:
        of_base = read_base(config.base, week, shared)
        channels = of_base.gnss.glonass_channels | config.glonass_channels
        base = replace(of_base.gnss, glonass_channels=channels)
        events += [replace(event, detail=f"base: {event.detail}") for event in of_base.events]
    return GnssLogs(gnss, navigation, products, antennas, base, events)


def without_gnss() -> GnssLogs:
    """Return the log of a flight that has no raw GNSS data."""
    return GnssLogs(replace(no_measurements(), sat=np.zeros((0, 8))), None, None, None, None, [])


def read_receiver(config: Gnss, week: int, shared: FileColumns = NOTHING_SHARED) -> ReceiverLog:
    """Read the observations in the format that the flight file names, range rates with their standard sign.

    Raises
    ------
    ConfigError : the flight has position fixes alone
    InputError or a subclass : a file is missing or cannot be read
    """
    if not config.files:
        advice = "give [gnss] with its files; 'insgnss replay' runs on position fixes alone"
        raise ConfigError("the flight has no raw GNSS data", key="gnss.files", advice=advice)
    log = _read_format(config, week, shared)
    return log if config.rate_sign == "standard" else replace(log, gnss=reversed_rates(log.gnss))


def reversed_rates(gnss: GnssTable) -> GnssTable:
    """Return a log whose Doppler and range rates have the other sign."""
    return replace(gnss, doppler_hz=-gnss.doppler_hz, range_rate_mps=-gnss.range_rate_mps)


def _read_format(config: Gnss, week: int, shared: FileColumns) -> ReceiverLog:
    if config.format in ("csv", "rinex"):
        gnss, events = read_gnss(config, week, shared)
        return ReceiverLog(gnss, events=events)
    log = _whole(config.files, _READERS[config.format])
    events = list(log.events)
    if config.time != TimeScale(offset_s=config.time.offset_s):
        detail = f"{config.format} states its own time scale: of gnss.time only offset_s is used"
        events.append(Event(None, "time_settings_not_used", detail))
    if not len(log.gnss.t_ns):
        advice = "name the file with the measurements, or convert both files in one call"
        raise InputError(
            "the log holds no raw measurement that can be read",
            file=config.files[0],
            key="gnss.files",
            advice=next((event.detail for event in events if event.kind == MEASUREMENTS_NOT_READ), advice),
        )
    shift_ns = round(config.time.offset_s * NS_PER_S)
    return replace(log, gnss=log.gnss.later(shift_ns), events=events)


def read_base(config: Base, week: int, shared: FileColumns = NOTHING_SHARED) -> ReceiverLog:
    """Read the base station's observations."""
    written = {name: getattr(config, name) for name in ObservationLog.model_fields}
    return read_receiver(Gnss(**written), week, shared)


def _with_samples_told(log: ReceiverLog, path: Path) -> ReceiverLog:
    """Return the log with an event for each further sensor in it, whose samples a flight file takes from a CSV file."""
    events = list(log.events)
    for one in log.further:
        written = f"'insgnss convert' writes them to {one.file} for a [[sensor]]"
        what = f"{one.kind} samples ({one.source}) not used: {written}"
        events += counted("sensor_samples_not_used", len(one.t_ns), what, path)
    return replace(log, events=events)


def _whole(paths: Sequence[Path], read: Callable[[Path], ReceiverLog]) -> ReceiverLog:
    """Return the logs of all files as one."""
    logs = [_with_samples_told(read(path), path) for path in paths]
    if len(logs) == 1:
        return logs[0]
    gnss, reordered = in_time_order(joined([log.gnss for log in logs]), str(paths[0]))
    navigation: NavigationData | None = None
    for log in logs:
        if log.navigation is not None:
            navigation = log.navigation if navigation is None else merged(navigation, log.navigation)
    return ReceiverLog(gnss, navigation, None, [e for log in logs for e in log.events] + reordered)


_READERS: Final[dict[str, Callable[[Path], ReceiverLog]]] = {
    "ubx": lambda path: read_ubx([path]),
    "sbf": read_sbf,
    "android": read_android,
}


def with_files(
    own: NavigationData | None, files: Sequence[Path], stated: bool
) -> tuple[NavigationData | None, list[Event]]:
    """Return the messages of navigation files together with a log's own; of what both have, the files' count.

    ``stated``: the log states where its satellites were, so that a file may hold ionosphere coefficients alone.

    Raises
    ------
    NavigationDataError : a file cannot be used
    """
    if not files:
        return own, []
    from_files, events = read_navigation(files, coefficients_suffice=stated)
    return (from_files if own is None else merged(from_files, own)), events


def merged(first: NavigationData, second: NavigationData) -> NavigationData:
    """Return the messages of both; of a message that both have, and of all coefficients, the first's count."""
    # the choice of messages takes the last of those with one reference time, so the first comes last
    states = [n.state_vectors for n in (second, first) if n.state_vectors is not None]
    return NavigationData(
        _stacked([second.ephemerides, first.ephemerides]),
        second.klobuchar if first.klobuchar is None else first.klobuchar,
        second.leap_seconds if first.leap_seconds is None else first.leap_seconds,
        _stacked(states) if states else None,
        second.ionosphere | first.ionosphere,
        second.inter_signal_s | first.inter_signal_s,
    )


def _stacked(tables: list[Any]) -> Any:
    """Return several tables of one kind, row under row."""
    columns = {}
    for field in fields(tables[0]):
        parts = [getattr(table, field.name) for table in tables]
        columns[field.name] = sum(parts, ()) if isinstance(parts[0], tuple) else np.concatenate(parts)
    return type(tables[0])(**columns)


def missing_navigation(path: Path) -> NavigationDataError:
    """Return the error of a flight without any source of satellite positions."""
    return NavigationDataError(
        "no satellite positions: the GNSS log has no satellite states and there is no navigation file",
        file=path,
        key="gnss.navigation",
        advice="name a RINEX navigation file of the day under gnss.navigation, precise products under gnss.precise,"
        " or give the columns sat_x_m ... sat_clock_drift_mps",
    )


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
