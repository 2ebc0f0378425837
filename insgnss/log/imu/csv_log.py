"""Inertial logs: CSV files become one table of mean rates and specific forces in body axes.

The declared units, axes, kind of values and time scale are applied as declared; numbers that contradict the declaration
are an error (``imu_units``), damaged samples are events (``imu_time``, ``imu_faults``,
``imu_frozen``).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from insgnss.config.flight import FlightConfig, ImuConfig, ImuGrade
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.errors import ConfigError, InputError
from insgnss.log.csv.columns import ColumnSelection
from insgnss.log.csv.table import read_csv_table
from insgnss.log.csv.time_tags import continued_week, gps_times, wanted_with_time
from insgnss.log.imu.axes import gyro_mounting_matrix, mounting_matrix, to_body_axes
from insgnss.log.imu.faults import SensorTriad, fault_events
from insgnss.log.imu.frozen import frozen_events
from insgnss.log.imu.increment_steps import increment_intervals
from insgnss.log.imu.time import gap_events, increasing_samples
from insgnss.log.imu.units import check_units
from insgnss.tables import Event, Float64, ImuTable, Int64
from insgnss.units import RAD_PER_DEG, SI_PER_UNIT


@dataclass
class _RawColumns:
    """The columns of an inertial log as logged, sensor axes."""

    t_ns: Int64
    gyro: list[Float64]
    accel: list[Float64]

    def take(self, kept: Int64) -> _RawColumns:
        return _RawColumns(self.t_ns[kept], [c[kept] for c in self.gyro], [c[kept] for c in self.accel])


def read_imu(config: ImuConfig, week: int, grade: ImuGrade | None = None) -> tuple[ImuTable, list[Event]]:
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
    file = ", ".join(str(path) for path in config.files)
    raw, events = _increasing(config, week, file)
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
    """Read an inertial log in the sensor's own axes, by its declared units, held against nothing.

    Raises
    ------
    InputError or a subclass : a file or column is missing or unreadable
    """
    file = ", ".join(str(path) for path in config.files)
    raw, _ = _increasing(config, week, file)
    step = np.diff(raw.t_ns)
    own = config.model_copy(update={"axes": ("+x", "+y", "+z"), "gyro_axes": None, "mounting_matrix": None})
    return _to_table(raw, step, own, file)[0]


def _increasing(config: ImuConfig, week: int, file: str) -> tuple[_RawColumns, list[Event]]:
    """Return the samples of all files whose time increases, at least two."""
    parts, events = _read_files(config, week)
    raw = parts[0]
    if len(parts) > 1:
        raw, refused = _in_order(_joined(parts), file)
        events += refused
    if len(raw.t_ns) < 2:
        raise InputError("an inertial log needs at least two samples", file=file)
    return raw, events


def _in_order(raw: _RawColumns, file: str) -> tuple[_RawColumns, list[Event]]:
    kept, refused = increasing_samples(raw.t_ns, file)
    return (raw if kept is None else raw.take(kept)), refused


def _axes(
    raw: _RawColumns, config: ImuConfig, grade: ImuGrade | None, median_ns: float
) -> tuple[SensorTriad, SensorTriad]:
    """Return the sensor axes as logged, with their units and ranges."""
    per_step = NS_PER_S / median_ns if config.values == "increments" else 1.0
    gyro_range = None if grade is None else grade.gyro_range_deg_per_s
    accel_range = None if grade is None else grade.accel_range_g
    return (
        SensorTriad(
            "gyro",
            raw.gyro,
            config.columns.gyro,
            SI_PER_UNIT[config.gyro_unit] * per_step,
            None if gyro_range is None else gyro_range * RAD_PER_DEG,
        ),
        SensorTriad(
            "accel",
            raw.accel,
            config.columns.accel,
            SI_PER_UNIT[config.accel_unit] * per_step,
            None if accel_range is None else accel_range * STANDARD_GRAVITY_MPS2,
        ),
    )


def _read_files(config: ImuConfig, week: int) -> tuple[list[_RawColumns], list[Event]]:
    """Return the samples of each file, in order, the files ordered by their first time."""
    events: list[Event] = []
    parts: list[_RawColumns] = []
    for path in config.files:
        previous = int(parts[-1].t_ns[-1]) if parts else None
        part, found = _read_file(config, path, week, previous)
        parts.append(part)
        events += found
    return sorted(parts, key=lambda part: int(part.t_ns[0])), events


def _joined(parts: list[_RawColumns]) -> _RawColumns:
    return _RawColumns(
        np.concatenate([part.t_ns for part in parts]),
        [np.concatenate([part.gyro[axis] for part in parts]) for axis in range(3)],
        [np.concatenate([part.accel[axis] for part in parts]) for axis in range(3)],
    )


def _read_file(
    config: ImuConfig, path: Path, week: int, previous_ns: int | None
) -> tuple[_RawColumns, list[Event]]:
    names = config.columns
    wanted = wanted_with_time(config, ColumnSelection(numeric=(*names.gyro, *names.accel)))
    table = read_csv_table(path, wanted)
    t_ns, rows, events = gps_times(table, config, week)
    columns = [
        table.columns[name] if rows is None else table.columns[name][rows]
        for name in (*names.gyro, *names.accel)
    ]
    raw, refused = _in_order(_RawColumns(t_ns, columns[:3], columns[3:]), str(path))
    raw.t_ns, continued = continued_week(raw.t_ns, previous_ns, str(path))
    return raw, table.events + events + refused + continued


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
