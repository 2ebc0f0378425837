"""A flight: the file that names the logs, and the logs read and held against each other."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from insgnss.config.flight import NO_WEEK, FlightConfig, ImuGrade, Oscillator
from insgnss.config.library import antenna_file, imu_grade, oscillator
from insgnss.config.strict import StrictModel, load_toml
from insgnss.constants import NS_PER_WEEK
from insgnss.errors import ConfigError
from insgnss.gnss.phase_centre import SatelliteAntennas
from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.detect import with_stated_format, with_stated_format_of_antenna
from insgnss.log.files import sha256
from insgnss.log.gnss_log import GnssLogs, read_further_antennas, read_gnss_logs, read_receiver, without_gnss
from insgnss.log.imu.csv_log import inertial, read_imu
from insgnss.log.imu.sensor_csv import read_sensor
from insgnss.log.overlap import check_overlap, outside_events, sensor_outside
from insgnss.log.reference import read_reference
from insgnss.results.shown import ResultDisplay
from insgnss.tables import (
    Event,
    GnssTable,
    ImuTable,
    Int64,
    NavigationData,
    PreciseProducts,
    ReferenceTable,
    SensorTable,
)

_Settings = TypeVar("_Settings", bound=StrictModel)
# of a flight without an inertial log: nothing is computed with it
_UNUSED_GRADE: Final = "mems_consumer"


@dataclass(frozen=True, repr=False)
class FlightLogs(ResultDisplay):
    """Everything a flight's files hold."""

    imu: ImuTable
    gnss: GnssTable
    navigation: NavigationData | None
    reference: ReferenceTable | None
    events: list[Event]
    input_hashes: dict[str, str]  # SHA-256 of each file read
    products: PreciseProducts | None = None
    antennas: SatelliteAntennas | None = None
    base: GnssTable | None = None  # a base station's observations
    further: tuple[GnssTable, ...] = ()  # of the further antennas, in the order of [attitude]
    sensors: tuple[
        SensorTable, ...
    ] = ()  # of the further sensors that have a log, in the order of [[sensor]]


@dataclass(frozen=True, repr=False)
class Flight(ResultDisplay):
    """A checked flight file: settings with absolute paths, the sensor's grade and the oscillator resolved.

    ``insgnss.Flight.load("flight.toml").read()`` gives the logs.
    """

    path: Path
    config: FlightConfig
    imu_grade: ImuGrade
    oscillator: Oscillator

    @classmethod
    def load(cls, path: str | Path) -> Flight:
        """Read and check a flight file; of its logs only what it leaves out is read: the format, the week.

        Raises
        ------
        MissingFileError : there is no such flight file
        ConfigError : unknown key, missing key or impossible value, with file and line
        ModelError : the grade or the oscillator is not in the library
        """
        path = Path(path)
        config = _resolved(load_toml(path, FlightConfig), path.absolute().parent)
        grade = _UNUSED_GRADE if config.imu is None else config.imu.grade
        clock = config.gnss.oscillator
        folder = (path.absolute().parent,)
        grade = imu_grade(grade, folder) if isinstance(grade, str) else grade
        if config.gps_week == NO_WEEK:
            config = config.model_copy(update={"gps_week": _week_of_the_log(config, grade, path)})
        return cls(path, config, grade, oscillator(clock, folder) if isinstance(clock, str) else clock)

    def _about(self) -> Iterator[str]:
        gnss = self.config.gnss
        yield f"'{self.name}' of {self.path}"
        yield f"week {self.config.gps_week}"
        yield f"{len(self.inertial_files())} inertial and {len(gnss.files)} GNSS files ({gnss.format})"
        yield "no reference" if self.config.reference is None else "with a reference"

    @property
    def name(self) -> str:
        """The flight's name; that of its file if it has none."""
        return self.config.name or self.path.stem

    def gps_ns(self, time_s: npt.ArrayLike) -> Int64:
        """Return GPS times [ns] of seconds of the flight's GPS week."""
        return week_seconds_to_ns(self.config.gps_week, time_s)

    def read(self) -> FlightLogs:
        """Read all logs of the flight and hold them against each other.

        Raises
        ------
        ConfigError : the flight file has no [imu]
        InputError or a subclass : a log is missing, unreadable, or contradicts the flight file
        TimeError : inertial and GNSS log do not overlap in time
        """
        declared = inertial(self.config)
        with ThreadPoolExecutor(2) as beside:  # parsing and hashing leave Python's lock free
            gnss = beside.submit(self._gnss_logs)
            hashes = beside.submit(self._hashes)
            imu, events = read_imu(
                declared, self.config.gps_week, self.imu_grade, self.config.columns_by_file()
            )
            logs = self._checked_logs(imu, gnss.result(), events + gnss.result().events)
            logs = replace(logs, input_hashes=hashes.result())
        pa.default_memory_pool().release_unused()  # what the parsing threads have left there
        return logs

    def _gnss_logs(self) -> GnssLogs:
        """Return the GNSS log and its satellite data; empty where the flight has position fixes alone."""
        if not self.config.gnss.files:
            return without_gnss()
        config = self.config
        return read_gnss_logs(config.gnss, config.gps_week, self.path, config.columns_by_file())

    def _checked_logs(self, imu: ImuTable, logs: GnssLogs, events: list[Event]) -> FlightLogs:
        """Hold both logs against each other and read the reference."""
        config = self.config
        if config.gnss.files:
            check_overlap(imu.t_ns, logs.gnss.t_ns, config)
            events += outside_events(imu.t_ns, logs.gnss.t_ns)
        reference = None
        if config.reference is not None:
            reference, reference_events = read_reference(
                config.reference, config.gps_week, config.columns_by_file()
            )
            events += reference_events
        if config.gnss.lever_b is None and config.gnss.files:
            detail = "gnss.lever_arm_m is not given: zero is assumed; measure the lever arm and give it"
            events.append(Event(None, "lever_arm_not_given", detail))
        further, antenna_events = read_further_antennas(config, logs.gnss)
        sensors, more_events = self._sensors(imu)
        return FlightLogs(
            *(imu, logs.gnss, logs.navigation, reference, _once(events + antenna_events + more_events), {}),
            *(logs.products, logs.antennas, logs.base, further, sensors),
        )

    def _sensors(self, imu: ImuTable) -> tuple[tuple[SensorTable, ...], list[Event]]:
        """Read the logs of the further sensors; a sensor without a log is reported and left out."""
        tables, events = [], []
        for sensor in self.config.sensor:
            if not sensor.files:
                detail = f"sensor '{sensor.label}' names no files: nothing of it is used in a replay"
                events.append(Event(None, "sensor_without_log", detail))
                continue
            table, more_events = read_sensor(sensor, self.config.gps_week, self.config.columns_by_file())
            tables.append(table)
            events += more_events
            events += sensor_outside(imu.t_ns, table, self.config.gps_week)
        return tuple(tables), events

    def files(self) -> tuple[Path, ...]:
        """Return every file the flight reads, the flight file first; an antenna's pattern may be the library's."""
        config, folder = self.config, self.path.absolute().parent
        reference = () if config.reference is None else (config.reference.file,)
        gnss = config.gnss
        antennas = () if gnss.antennas is None else (gnss.antennas,)
        base = () if gnss.base is None else gnss.base.files
        event_files = () if gnss.receiver_events is None else (gnss.receiver_events,)
        others = () if config.attitude is None else config.attitude.antenna
        further = tuple(path for antenna in others for path in antenna.files)
        satellites = (*gnss.files, *gnss.navigation, *gnss.precise, *antennas, *base, *further)
        mounted = (*gnss.antenna, *others)
        patterns = tuple(antenna_file(antenna.pattern, (folder,)) for antenna in mounted)
        hiding = tuple(folder / antenna.obstruction for antenna in mounted if antenna.obstruction)
        sensors = tuple(path for sensor in config.sensor for path in sensor.files)
        files = (self.path, *self.inertial_files(), *satellites, *event_files, *patterns, *hiding)
        return tuple(
            dict.fromkeys((*files, *reference, *sensors))
        )  # two antennas of one type share a pattern

    def inertial_files(self) -> tuple[Path, ...]:
        """Return the files of the inertial log, none without one."""
        imu = self.config.imu
        return () if imu is None else imu.every_file

    def _hashes(self) -> dict[str, str]:
        return {str(path): sha256(path) for path in self.files()}


@dataclass(frozen=True, repr=False)
class FlightInMemory(Flight):
    """A flight whose logs are at hand instead of in files: simulated, or read before."""

    logs: FlightLogs

    def read(self) -> FlightLogs:
        """Return the logs."""
        return self.logs


def _once(events: list[Event]) -> list[Event]:
    """Return the events, that of columns which no log of a file reads only once."""
    unread = dict.fromkeys(event.detail for event in events if event.kind == "columns_not_read")
    return [
        event for event in events if event.kind != "columns_not_read" or unread.pop(event.detail, "") is None
    ]


def _week_of_the_log(config: FlightConfig, grade: ImuGrade, path: Path) -> int:
    """Return the GPS week in which a log begins, if its times state it."""
    t_ns = np.zeros(0, np.int64)
    if config.gnss.files and (config.gnss.format != "csv" or not config.gnss.counts_in_gps_week):
        t_ns = read_receiver(config.gnss, 0).gnss.t_ns
    elif config.imu is not None and not config.imu.counts_in_gps_week:
        t_ns = read_imu(config.imu, 0, grade)[0].t_ns
    if not len(t_ns):
        advice = (
            "give gps_week, the GPS week in which the logs' seconds count; if their times are dates or Unix time, "
            "declare time.origin under [imu] and [gnss] instead"
        )
        raise ConfigError("missing key", file=path, key="gps_week", advice=advice)
    return int(t_ns[0]) // NS_PER_WEEK


def _resolved(config: FlightConfig, folder: Path) -> FlightConfig:
    """Return the settings with paths from the flight file's folder, and the formats that logs state."""
    config = _absolute(config, folder)
    gnss = with_stated_format(config.gnss)
    if gnss.base is not None:
        gnss = gnss.model_copy(update={"base": with_stated_format(gnss.base)})
    update: dict[str, object] = {"gnss": gnss}
    if config.attitude is not None:
        antennas = (with_stated_format_of_antenna(each, config.gnss) for each in config.attitude.antenna)
        update["attitude"] = config.attitude.model_copy(update={"antenna": tuple(antennas)})
    return config.model_copy(update=update)


def _absolute(settings: _Settings, folder: Path) -> _Settings:
    """Return settings whose relative paths, those of the tables within them too, are taken from a folder."""

    def moved(value: object) -> object:
        if isinstance(value, Path):
            return Path(os.path.normpath(folder / value))
        if isinstance(value, StrictModel):
            return _absolute(value, folder)
        return tuple(map(moved, value)) if isinstance(value, tuple) else value

    changed = {name: moved(value) for name, value in settings if moved(value) != value}
    return settings.model_copy(update=changed) if changed else settings
