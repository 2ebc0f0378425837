"""Inertial logs: CSV files become one table of mean rates and specific forces in body axes.

The declared units, axes, kind of values and time scale are applied as declared; numbers that contradict the declaration
are an error (``imu_units``), damaged samples are events (``imu_time``, ``imu_faults``,
``imu_frozen``).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insgnss.config.flight import FlightConfig, ImuConfig, ImuGrade
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.errors import ColumnError, ConfigError, InputError
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.csv.columns import NOTHING_SHARED, ColumnSelection, FileColumns
from insgnss.log.csv.table import read_csv_table
from insgnss.log.csv.time_tags import continued_times, read_timed_table, wanted_with_time
from insgnss.log.detect import naming_format
from insgnss.log.imu.axes import gyro_mounting_matrix, mounting_matrix, to_body_axes
from insgnss.log.imu.faults import SensorTriad, fault_events, frozen_events
from insgnss.log.imu.increment_steps import increment_intervals
from insgnss.log.imu.time import gap_events, increasing_samples
from insgnss.log.imu.units import check_units
from insgnss.log.sensor_pairs import paired
from insgnss.tables import Event, Float64, ImuTable, Int64
from insgnss.units import RAD_PER_DEG, SI_PER_UNIT


@dataclass
class _RawColumns:
    """The columns of an inertial log as logged, sensor axes."""

    t_ns: Int64
    gyro: list[Float64]
    accel: list[Float64]

    def take(self, rows: Int64) -> _RawColumns:
        return _RawColumns(self.t_ns[rows], [c[rows] for c in self.gyro], [c[rows] for c in self.accel])


def read_imu(
    config: ImuConfig, week: int, grade: ImuGrade | None = None, shared: FileColumns = NOTHING_SHARED
) -> tuple[ImuTable, list[Event]]:
    """Read an inertial log of one or several files.

    Parameters
    ----------
    config : the flight file's entry, paths resolved
    week : GPS week that the seconds of the week count from
    grade : the sensor's error model, for its measuring ranges

    Raises
    ------
    InputError or a subclass : a file or column is missing, or the numbers contradict the declared units
    ConfigError : impossible axes
    """
    mounting_matrix(config)
    file = ", ".join(map(str, config.every_file))
    raw, events = _increasing(config, week, file, shared)
    step = np.diff(raw.t_ns)
    median_ns = float(np.median(step))
    events += gap_events(raw.t_ns, step, median_ns, file)
    sensors = _axes(raw, config, grade, median_ns)
    for axes in sensors:
        events += fault_events(raw.t_ns, axes, file)
    events += frozen_events(raw.t_ns, sensors, file)
    table, converted = _to_table(raw, step, config, file)
    del raw
    return table, events + converted + check_units(table, config, grade, median_ns, file)


def read_imu_as_logged(config: ImuConfig, week: int) -> ImuTable:
    """Read an inertial log in the sensor's own axes and its declared units, without checks.

    Raises
    ------
    InputError or a subclass : a file or column is missing or unreadable
    """
    file = ", ".join(map(str, config.every_file))
    raw, _ = _increasing(config, week, file)
    own = config.model_copy(update={"axes": ("+x", "+y", "+z"), "gyro_axes": None, "mounting_matrix": None})
    return _to_table(raw, np.diff(raw.t_ns), own, file)[0]


def _increasing(
    config: ImuConfig, week: int, file: str, shared: FileColumns = NOTHING_SHARED
) -> tuple[_RawColumns, list[Event]]:
    """Return the samples of all files whose time increases, at least two."""
    names = config.columns
    if config.accel_files:
        gyro, events = _read_files(config, config.files, (names.gyro, ()), week, shared)
        accel, accel_events = _read_files(config, config.accel_files, ((), names.accel), week, shared)
        raw, more_events = _at_the_gyros_times(gyro, accel, week, file)
        events += accel_events + more_events
    else:
        raw, events = _read_files(config, config.files, (names.gyro, names.accel), week, shared)
    if len(raw.t_ns) < 2:
        raise InputError("an inertial log needs at least two samples", file=file)
    return raw, events


def _at_the_gyros_times(
    gyro: _RawColumns, accel: _RawColumns, week: int, file: str
) -> tuple[_RawColumns, list[Event]]:
    """Return the gyros' samples with the specific force interpolated to their times, as ``paired`` does."""
    table, events = paired(
        gyro.t_ns, np.column_stack(gyro.gyro), accel.t_ns, np.column_stack(accel.accel), file
    )
    if table is None:
        spans = [ns_to_week_seconds(each.t_ns[[0, -1]], week) for each in (gyro, accel)]
        gyros, others = (f"{first:.3f} to {last:.3f} s" for first, last in spans)
        raise InputError(
            f"gyros ({gyros}) and accelerometers ({others}) do not overlap in time",
            file=file,
            key="imu.accel_files",
            advice="name files of one recording; [imu.time] applies to both",
        )
    return _RawColumns(table.t_ns, list(table.w_ib_b.T.copy()), list(table.f_b.T.copy())), events


def _in_order(raw: _RawColumns, file: str) -> tuple[_RawColumns, list[Event]]:
    rows, refused = increasing_samples(raw.t_ns, file)
    return (raw if rows is None else raw.take(rows)), refused


def _axes(
    raw: _RawColumns, config: ImuConfig, grade: ImuGrade | None, median_ns: float
) -> tuple[SensorTriad, SensorTriad]:
    """Return the sensor axes as logged, with their units and ranges."""
    per_step = NS_PER_S / median_ns if config.values == "increments" else 1.0
    gyro_unit, accel_unit = (SI_PER_UNIT[unit] * per_step for unit in (config.gyro_unit, config.accel_unit))
    gyro_range, accel_range = (
        None if grade is None or (limit := getattr(grade, name)) is None else limit * unit
        for name, unit in (("gyro_range_deg_per_s", RAD_PER_DEG), ("accel_range_g", STANDARD_GRAVITY_MPS2))
    )
    return (
        SensorTriad("gyro", raw.gyro, config.columns.gyro, gyro_unit, gyro_range),
        SensorTriad("accel", raw.accel, config.columns.accel, accel_unit, accel_range),
    )


def _read_files(
    config: ImuConfig,
    files: tuple[Path, ...],
    names: tuple[tuple[str, ...], tuple[str, ...]],
    week: int,
    shared: FileColumns,
) -> tuple[_RawColumns, list[Event]]:
    """Return the samples of all files with the columns that they hold, the files ordered by their first time."""
    events: list[Event] = []
    parts: list[_RawColumns] = []
    for path in files:
        previous = int(parts[-1].t_ns[-1]) if parts else None
        part, more_events = _read_file(config, path, names, (week, previous), shared.get(path, ()))
        parts.append(part)
        events += more_events
    if len(parts) == 1:
        return parts[0], events
    parts.sort(key=lambda part: int(part.t_ns[0]))
    joined = _RawColumns(
        np.concatenate([part.t_ns for part in parts]),
        [np.concatenate(columns) for columns in zip(*(part.gyro for part in parts), strict=True)],
        [np.concatenate(columns) for columns in zip(*(part.accel for part in parts), strict=True)],
    )
    raw, refused = _in_order(joined, ", ".join(map(str, files)))
    return raw, events + refused


def _read_file(
    config: ImuConfig,
    path: Path,
    names: tuple[tuple[str, ...], tuple[str, ...]],
    after: tuple[int, int | None],
    elsewhere: Sequence[str],
) -> tuple[_RawColumns, list[Event]]:
    """Return the samples of a file.

    Parameters
    ----------
    names : columns of gyros and accelerometers, empty where it has none
    after : GPS week of the log, and the last time [ns] of the file before, if there is one
    elsewhere : columns that other logs of the flight read from the file
    """
    (gyro, accel), (week, previous_ns) = names, after
    wanted = ColumnSelection(numeric=(*gyro, *accel), elsewhere=elsewhere)
    try:
        with naming_format(path):
            t_ns, table = read_timed_table(path, config, wanted, week)
    except ColumnError as error:
        if not gyro or not accel or not _has_one_sensor(config, path):
            raise
        advice = (
            "the file holds one of the two sensors: name the gyros' files in files, the others in accel_files"
        )
        raise ColumnError(
            error.message,
            file=error.file,
            line=error.line,
            column=error.column,
            advice=f"{advice}; or {error.advice}",
        ) from error
    columns = [table.columns[name] for name in (*gyro, *accel)]
    raw, refused = _in_order(_RawColumns(t_ns, columns[: len(gyro)], columns[len(gyro) :]), str(path))
    raw.t_ns, continued = continued_times(raw.t_ns, previous_ns, config, str(path))
    return raw, table.events + refused + continued


def _has_one_sensor(config: ImuConfig, path: Path) -> bool:
    """Return whether a file has all columns of one of the two sensors and none of the other."""
    gyro, accel = config.columns.gyro, config.columns.accel
    for own, other in ((gyro, accel), (accel, gyro)):
        with suppress(InputError):
            table = read_csv_table(
                path, wanted_with_time(config, ColumnSelection(numeric=own, optional=other))
            )
            return not any(name in table.columns for name in other)
    return False


def _to_table(raw: _RawColumns, step: Int64, config: ImuConfig, file: str) -> tuple[ImuTable, list[Event]]:
    """Return the samples in SI units and body axes, as means over the interval that ends at each tag."""
    factor: float | Float64 = 1.0
    events: list[Event] = []
    if config.values == "increments":
        dv = (raw.accel[0], raw.accel[1], raw.accel[2])
        interval_ns, events = increment_intervals(raw.t_ns, step, dv, file)
        factor = NS_PER_S / interval_ns
    w_ib_b = to_body_axes(raw.gyro, gyro_mounting_matrix(config), factor * SI_PER_UNIT[config.gyro_unit])
    f_b = to_body_axes(raw.accel, mounting_matrix(config), factor * SI_PER_UNIT[config.accel_unit])
    if config.sampling == "instant" and config.values == "rates":
        w_ib_b, f_b = _trapezoid(w_ib_b), _trapezoid(f_b)
    return ImuTable(raw.t_ns, w_ib_b, f_b), events


def _trapezoid(values: Float64) -> Float64:
    """Return the mean over each interval from the values at its two ends."""
    mean = np.empty_like(values)
    mean[0] = values[0]
    np.add(values[:-1], values[1:], out=mean[1:])
    mean[1:] *= 0.5
    return mean


def inertial(config: FlightConfig) -> ImuConfig:
    """Return the entry of a flight's inertial log.

    Raises
    ------
    ConfigError : the flight file has none
    """
    if config.imu is None:
        raise ConfigError(
            "the flight has no inertial log",
            key="imu",
            advice="describe it under [imu]; without one, 'insgnss point' solves each GNSS epoch",
        )
    return config.imu
