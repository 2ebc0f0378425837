"""A scenario file in, a simulated flight out: logs as receiver and sensor would have written them, and the truth."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.config.flight import Reference
from insgnss.config.library import find
from insgnss.config.simulation import LoggedReference, RinexSky, SimulationConfig, YumaSky
from insgnss.config.strict import load_toml
from insgnss.config.toml_lines import key_lines, line_of
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError
from insgnss.gpstime import ns_to_datetime, week_seconds_to_ns
from insgnss.log.reference import read_reference
from insgnss.log.rinex.navigation import read_navigation
from insgnss.log.yuma import read_yuma
from insgnss.results.saving import check_replaceable, saving, writing
from insgnss.results.shown import ResultDisplay
from insgnss.runs.first_run import compiled
from insgnss.simulation.assembly import Inputs, assemble, missing_messages
from insgnss.simulation.chosen_messages import without
from insgnss.simulation.flight_text import (
    FLIGHT_FILE,
    GNSS_FILE,
    IMU_FILE,
    NAVIGATION_FILE,
    REFERENCE_FILE,
    antenna_file_name,
    antenna_files,
    flight_text,
)
from insgnss.simulation.itinerary import ManoeuvreError
from insgnss.simulation.log_files import (
    sensor_file_name,
    write_gnss,
    write_imu,
    write_increments,
    write_reference,
    write_sensor,
)
from insgnss.simulation.rinex_nav import write_rinex_navigation
from insgnss.simulation.simulated_log import Scenario, SimulatedLog, Simulator
from insgnss.simulation.trajectory import reference_table
from insgnss.tables import ReferenceTable

_KIND: Final = "simulation"  # what the files are together


@dataclass(frozen=True, repr=False)
class Simulation(ResultDisplay):
    """A simulated flight in memory: the scenario, the logs with their errors, and the truth."""

    config: SimulationConfig
    folder: Path  # of the scenario file
    scenario: Scenario
    log: SimulatedLog

    def _about(self) -> Iterator[str]:
        yield repr(self.config.name)
        yield f"{self.scenario.duration_s:g} s"
        yield f"{len(self.log.imu.t_ns)} inertial samples"
        yield f"{len(self.log.gnss.t_ns)} GNSS measurements of {len(self.log.at_gnss.t_ns)} epochs"

    def reference(self) -> ReferenceTable:
        """Return the true motion of the IMU at the file's ``reference_rate_hz``."""
        rate = self.config.reference_rate_hz
        t_s = np.arange(int(self.scenario.duration_s * rate + 1e-9) + 1) / rate
        return reference_table(self.scenario.trajectory.motion(t_s), self.scenario.start_ns)

    def save(self, folder: str | Path) -> list[Path]:
        """Write IMU and GNSS CSV, RINEX navigation, reference and flight file; return their paths.

        Raises
        ------
        ResultError : the folder cannot be written, or another program's file has one of the names
        """
        folder = Path(folder)
        with writing("the logs", folder):
            copied = antenna_files(self.config, self.folder, folder)
            logs = _log_names(self.config)
            names = [*logs, *(path.name for path in copied)]
            with saving(folder, names, _KIND) as new:
                self._write([new / name for name in logs])
                for path in copied:
                    shutil.copyfile(path, new / path.name)
        return [folder / name for name in names]

    def _write(self, paths: list[Path]) -> None:
        week, imu = self.config.gps_week, self.config.imu
        if imu.values == "increments":
            write_increments(paths[0], self.log.imu, week, 1.0 / imu.rate_hz)
        else:
            write_imu(paths[0], self.log.imu, week)
        write_gnss(paths[1], self.log.gnss, week)
        sent = without(self.log.navigation, missing_messages(self.config))
        write_rinex_navigation(paths[2], sent, ns_to_datetime(self.scenario.start_ns))
        write_reference(paths[3], self.reference(), week)
        paths[4].write_bytes(flight_text(self.config, self.scenario).encode("utf-8"))
        n_further = len(self.log.further)
        for path, log in zip(paths[5 : 5 + n_further], self.log.further, strict=True):
            write_gnss(path, log, week)
        of_sensors = zip(paths[5 + n_further :], self.config.sensor, self.log.sensors, strict=True)
        for path, sensor, readings in of_sensors:
            write_sensor(path, sensor.kind, readings, week)


def simulate(
    scenario: str | Path,
    seed: int = 1,
    *,
    noise: bool = True,
    duration_s: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> Simulation:
    """Return one realisation of a scenario: a file (a path ending in .toml) or a name in ``models/scenarios``.

    The same scenario and seed give the same numbers.

    Parameters
    ----------
    seed : of all random numbers
    noise : without it sensors and signals have no errors at all, and the clock runs straight on; faults stay
    duration_s : the first part alone
    progress : called with a message while the compiler runs

    Raises
    ------
    ConfigError, ModelError : the file is wrong: unknown key or manoeuvre, impossible turn, negative noise; with line
    InputError or a subclass : a file that the scenario names is missing or wrong
    """
    path, config = _load(scenario)
    if seed < 0:
        raise ConfigError(f"invalid seed {seed}", key="seed", advice="give a whole number, 0 or above")
    if duration_s is not None and not duration_s > 0.0:
        raise ConfigError(
            f"invalid duration {duration_s} s", key="duration_s", advice="give seconds, above 0"
        )
    folder = path.absolute().parent
    try:
        with compiled(progress or (lambda _: None)):
            inputs = _inputs(config, folder)
        assembly = assemble(config, folder, inputs, duration_s)
    except ManoeuvreError as error:
        key = ("manoeuvre", error.entry)
        line = line_of(key, key_lines(path.read_text(encoding="utf-8-sig")))
        kind = config.manoeuvre[error.entry].kind
        message = f"manoeuvre {error.entry + 1} ({kind}): {error.message}"
        raise ConfigError(message, file=path, line=line, key="manoeuvre", advice=error.advice) from None
    except ConfigError as error:
        if error.file is None:
            error = _in_file(error, path)
        raise error from None
    log = Simulator(assembly).draw(np.random.default_rng(seed) if noise else None)
    return Simulation(config, folder, assembly, log)


def check_output(scenario: str | Path, folder: Path) -> None:
    """Refuse a folder in which a file of another program has the name of one that ``Simulation.save`` writes.

    Raises
    ------
    ResultError : there is such a file, or nothing can be written there
    ConfigError, ModelError : the scenario's file is wrong
    """
    path, config = _load(scenario)
    copied = antenna_files(config, path.absolute().parent, folder)
    check_replaceable(folder, [*_log_names(config), *(file.name for file in copied)], _KIND)


def _load(scenario: str | Path) -> tuple[Path, SimulationConfig]:
    path = Path(scenario) if str(scenario).endswith(".toml") else _in_library(str(scenario))
    return path, load_toml(path, SimulationConfig)


def _log_names(config: SimulationConfig) -> list[str]:
    """Return the names of the files, those of further antennas and sensors last."""
    further = () if config.attitude is None else config.attitude.antenna
    names = (IMU_FILE, GNSS_FILE, NAVIGATION_FILE, REFERENCE_FILE, FLIGHT_FILE)
    sensors = (sensor_file_name(sensor.label) for sensor in config.sensor)
    return [*names, *(antenna_file_name(a.name) for a in further), *sensors]


def _in_library(name: str) -> Path:
    """Return the library's scenario of this name, if it is one to fly and not that of a study."""
    path = find("scenarios", name)
    if not {"manoeuvre", "follow"} & tomllib.loads(path.read_text(encoding="utf-8")).keys():
        raise ConfigError(
            "the scenario belongs to a study: it has no manoeuvres to simulate",
            file=path,
            advice=f"run it with insgnss.studies.masking_study('{name}')",
        )
    return path


def _in_file(error: ConfigError, path: Path) -> ConfigError:
    """Return the error with the file and the line of its key."""
    keys = tuple((error.key or "").split("."))
    line = line_of(keys, key_lines(path.read_text(encoding="utf-8-sig")))
    return ConfigError(
        error.message, advice=error.advice, file=path, line=line, key=error.key, satellite=error.satellite
    )


def _inputs(config: SimulationConfig, folder: Path) -> Inputs:
    """Read the scenario's other files."""
    reference = None if config.follow is None else _reference(config.follow, config.gps_week, folder)
    sky = config.sky
    if isinstance(sky, RinexSky):
        navigation, _ = read_navigation([folder / file for file in sky.files])
        return Inputs(navigation, reference)
    if isinstance(sky, YumaSky):
        return Inputs(read_yuma(folder / sky.file, config.gps_week), reference)
    return Inputs(None, reference)


def _reference(follow: LoggedReference, week: int, folder: Path) -> ReferenceTable:
    declared = Reference(
        file=folder / follow.file, columns=follow.columns, time=follow.time, decimal=follow.decimal
    )
    reference, _ = read_reference(declared, week)
    first, last = (
        np.iinfo(np.int64).min if follow.from_s is None else int(week_seconds_to_ns(week, follow.from_s)),
        np.iinfo(np.int64).max if follow.to_s is None else int(week_seconds_to_ns(week, follow.to_s)),
    )
    rows = np.flatnonzero((reference.t_ns >= first) & (reference.t_ns <= last))
    if not len(rows):
        span = (reference.t_ns[[0, -1]] - int(week_seconds_to_ns(week, 0.0))) / NS_PER_S
        raise ConfigError(
            "no row of the reference lies in the span",
            key="follow.from_s",
            advice=f"it covers {span[0]:.1f} to {span[1]:.1f} s",
        )
    names = ("t_ns", "lat_deg", "lon_deg", "h_m", "v_n", "rpy_deg", "quality")
    return replace(reference, **{name: getattr(reference, name)[rows] for name in names})
