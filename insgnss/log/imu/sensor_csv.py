"""Logs of further sensors: a CSV file, or several that follow each other, becomes a ``SensorTable``.

A cell that is empty, unreadable or beyond what the kind can measure is NaN: the reading is in the ledger as
'bad_value'. Rows are sorted by time; of rows with one time the first stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, get_args

import numpy as np

from insgnss.config.log_table import NO_COLUMN
from insgnss.config.sensors import (
    AttitudeSensor,
    Barometer,
    HeadingSensor,
    Magnetometer,
    Odometer,
    PositionSensor,
    Sensor,
    VelocitySensor,
)
from insgnss.constants import NS_PER_S
from insgnss.errors import InputError
from insgnss.geodesy.local_level import geodetic
from insgnss.geodesy.magnetic_dipole import EARTH_FIELD_UT
from insgnss.geodesy.sea_level import geoid_height
from insgnss.geodesy.standard_atmosphere import pressure_altitude
from insgnss.log.csv.columns import NOTHING_SHARED, ColumnSelection, FileColumns
from insgnss.log.csv.table import CsvTable
from insgnss.log.csv.time_tags import continued_times, each_time_once, read_timed_table
from insgnss.log.detect import naming_format
from insgnss.log.events import counted
from insgnss.log.imu.axes import body_rotation, magnetometer_axes
from insgnss.tables import Event, Float64, Int64, SensorTable
from insgnss.units import RAD_PER_DEG, SI_PER_UNIT

_HPA_PER_UNIT: Final = {"hPa": 1.0, "Pa": 0.01, "kPa": 10.0}
UT_PER_UNIT: Final = {"uT": 1.0, "nT": 1e-3, "mG": 0.1, "G": 100.0}
# beyond these, SI units or as in SensorTable, a reading is a fault of unit or sensor: per component, lowest and highest
_POSSIBLE: Final[dict[str, tuple[tuple[float, float], ...]]] = {
    "odometer": ((-350.0, 350.0),),
    "barometer": ((-2_000.0, 40_000.0),),
    "magnetometer": ((-1_000.0, 1_000.0),) * 3,
    "heading": ((-13.0, 13.0),),
    "attitude": ((-13.0, 13.0),) * 3,
    "position": ((-1.5708, 1.5708), (-6.2832, 6.2832), (-1e4, 1e7)),
    "velocity": ((-2e4, 2e4),) * 3,
}
_MANY: Final = 0.1  # of the rows: fewer are glitches, not another unit
_LONGEST_COUNT_NS: Final = 2 * NS_PER_S  # over a longer pause of the counter the mean speed is not a reading


def read_sensor(
    config: Sensor, week: int, shared: FileColumns = NOTHING_SHARED
) -> tuple[SensorTable, list[Event]]:
    """Read a further sensor's log in SI units and body axes.

    Parameters
    ----------
    shared : columns that all logs of the flight read, by file; in a file with those of another log, which may have more
        rows, a row without any value of this sensor holds no reading

    Raises
    ------
    InputError or a subclass : a file or a column is missing, or no row holds a reading
    ConfigError : the axes are left-handed or no rotation
    """
    parts: list[tuple[Int64, Float64, Float64]] = []
    events: list[Event] = []
    units = ""
    for path in config.files:
        elsewhere = shared.get(path, ())
        wanted = replace(_wanted(config), elsewhere=elsewhere)
        with naming_format(path):
            t_ns, table = read_timed_table(path, config, wanted, week)
        if set(elsewhere) - set(config.columns.all_names()):
            t_ns, table = _rows_with_readings(config, t_ns, table)
        t_ns, later = continued_times(t_ns, int(parts[-1][0][-1]) if parts else None, config, str(path))
        values = np.column_stack([table.column_or_nan(name) for name in config.value_columns])
        sigma = [table.column_or_nan(name) for name in config.sigma_columns]
        converted = _CONVERSIONS[type(config)](config, values)
        bad = _bad_values(config, table, converted)
        here = _fitting_units(config, values, converted)
        units = units or here
        events += table.events + later + [replace(event, detail=event.detail + here) for event in bad]
        parts.append((t_ns, converted, np.column_stack(sigma) if sigma else np.zeros((table.n, 0))))
    t_ns, values, sigmas = (np.concatenate(each) for each in zip(*parts, strict=True))
    t_ns, order, reordered = each_time_once(t_ns, config.files[0], "sensor_time_order")
    readings = SensorTable(config.label, t_ns, values[order], _si_sigma(config, sigmas[order]))
    if isinstance(config, Odometer) and config.metres_per_count is not None:
        readings = _speeds_of_counts(readings)
    _require_readings(config, readings, units)
    return readings, events + reordered


def _rows_with_readings(config: Sensor, t_ns: Int64, table: CsvTable) -> tuple[Int64, CsvTable]:
    """Return the rows in which a value of the sensor is written, and an event where others are left out."""
    names = [name for name in config.value_columns if name in table.columns]
    written = np.zeros(table.n, np.bool_)
    for name in names:
        written |= ~np.isnan(table.columns[name])
        written[table.bad_cells.get(name, [])] = True
    if written.all() or not written.any():
        return t_ns, table
    what = f"of {table.n} rows hold no {config.kind} reading, only those of other logs of the file"
    table.events += counted("sensor_rows_without_reading", ~written, what, table.path)
    return t_ns[written], table.take(np.flatnonzero(written))


def _wanted(config: Sensor) -> ColumnSelection:
    needed = tuple(name for name in config.value_columns if name != NO_COLUMN)
    optional = (*needed, *(name for name in config.sigma_columns if name != NO_COLUMN))
    return ColumnSelection(optional=optional, chosen=(*needed, *config.columns.chosen_names()))


def _odometer(config: Any, values: Float64) -> Float64:
    if config.metres_per_count is not None:
        return np.asarray(config.metres_per_count * values)  # a distance, as yet
    return np.asarray(SI_PER_UNIT[config.unit] * values)


def _barometer(config: Any, values: Float64) -> Float64:
    if config.unit in _HPA_PER_UNIT:
        pressure = _HPA_PER_UNIT[config.unit] * values
        return pressure_altitude(np.where(pressure > 0.0, pressure, np.nan))
    return np.asarray(SI_PER_UNIT[config.unit] * values)


def _magnetometer(config: Any, values: Float64) -> Float64:
    return np.asarray(UT_PER_UNIT[config.unit] * values @ magnetometer_axes(config).T)


def _heading(config: Any, values: Float64) -> Float64:
    added = RAD_PER_DEG * (config.declination_deg + config.offset_deg)
    return np.asarray(SI_PER_UNIT[config.unit] * values + added)


def _attitude(config: Any, values: Float64) -> Float64:
    return body_rotation(SI_PER_UNIT[config.unit] * values, config.mounting_rpy_deg)


def _position(config: Any, values: Float64) -> Float64:
    if config.frame == "ecef":
        on_earth = np.linalg.norm(values, axis=1, keepdims=True) > 1e6
        position = geodetic(np.where(on_earth, values, np.nan))
    else:
        position = values * (RAD_PER_DEG, RAD_PER_DEG, 1.0)
    if config.height == "sea_level":
        position[:, 2] += geoid_height(*np.degrees(position[:, :2].T))
    return np.asarray(position)


def _velocity(config: Any, values: Float64) -> Float64:
    down = 1.0 if config.axes == "ned" else -1.0
    return np.asarray(values[:, config.ned] * (1.0, 1.0, down))


_CONVERSIONS: Final[dict[type, Callable[[Any, Float64], Float64]]] = {
    Odometer: _odometer,
    Barometer: _barometer,
    Magnetometer: _magnetometer,
    HeadingSensor: _heading,
    AttitudeSensor: _attitude,
    PositionSensor: _position,
    VelocitySensor: _velocity,
}


def _si_sigma(config: Sensor, sigma: Float64) -> Float64:
    """Return stated sigmas in SI units, NaN where the cell is empty or holds none."""
    factor = 1.0
    if isinstance(config, Odometer | HeadingSensor | AttitudeSensor):
        factor = SI_PER_UNIT[config.unit]
    if isinstance(config, VelocitySensor):
        sigma = sigma[:, config.ned]
    scaled = factor * sigma
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where((scaled > 0.0) & (scaled < 1e6), scaled, np.nan))


def _fitting_units(config: Sensor, values: Float64, converted: Float64) -> str:
    """Return in words the other units that fit values of which many are impossible readings, else nothing."""
    impossible = (np.isnan(converted) & np.isfinite(values)).any(axis=1)
    if not impossible.any() or impossible.mean() < _MANY:
        return ""
    fields = type(config).model_fields
    units = get_args(fields["unit"].annotation) if "unit" in fields else ()
    fitting = [unit for unit in units if unit != getattr(config, "unit", "") and _fits(config, unit, values)]
    return f"; unit = {' or '.join(map(repr, fitting))} would fit" if fitting else ""


def _fits(config: Sensor, unit: str, values: Float64) -> bool:
    """Return whether all values are possible readings in another unit, those of a magnetometer of the Earth's field."""
    low, high = np.array(_POSSIBLE[config.kind]).T
    converted = _CONVERSIONS[type(config)](config.model_copy(update={"unit": unit}), values)
    if config.kind == "magnetometer":
        sizes = np.linalg.norm(converted, axis=1)
        if not np.isfinite(sizes).any():
            return False
        size = float(np.nanmedian(sizes))
        return EARTH_FIELD_UT[0] < size < EARTH_FIELD_UT[1]
    return bool((np.isnan(values) | ((converted >= low) & (converted <= high))).all())


def _bad_values(config: Sensor, table: CsvTable, values: Float64) -> list[Event]:
    """Set impossible values to NaN, in place, and return how many cells hold no reading and where the first is."""
    if not (isinstance(config, Odometer) and config.metres_per_count is not None):
        low, high = np.array(_POSSIBLE[config.kind]).T
        with np.errstate(invalid="ignore"):
            values[(values < low) | (values > high)] = np.nan
    lacking = [name == NO_COLUMN for name in config.value_columns]
    bad = np.isnan(values) & ~np.array(lacking)
    if not bad.any():
        return []
    row, column = (int(each[0]) for each in np.nonzero(bad))
    name = config.value_columns[column] if config.kind != "magnetometer" else "field"
    place = f"{table.path}:{table.line[row]}, column '{name}'"
    rows = f"{int(bad.any(axis=1).sum())} of {table.n} rows have such cells: refused as bad_value"
    return [Event(None, "sensor_bad_values", f"{place}: impossible {config.kind} reading; {rows}")]


def _speeds_of_counts(table: SensorTable) -> SensorTable:
    """Return mean speeds between the rows of a counter, each at the middle of its time.

    A count that falls, by a reset, gives no reading; nor does one after a pause.
    """
    step_ns = np.diff(table.t_ns)
    speed = np.diff(table.values[:, 0]) / (step_ns / NS_PER_S)
    with np.errstate(invalid="ignore"):
        speed[(step_ns > _LONGEST_COUNT_NS) | (speed < 0.0) | (speed > _POSSIBLE["odometer"][0][1])] = np.nan
    return SensorTable(table.name, table.t_ns[:-1] + step_ns // 2, speed[:, None], table.sigma[1:])


def _require_readings(config: Sensor, table: SensorTable, units: str) -> None:
    """Refuse a log without a single reading; ``units`` says which would fit."""
    if not np.isfinite(table.values).any() or (
        config.kind == "magnetometer" and not np.isfinite(table.values).all(axis=1).any()
    ):
        raise InputError(
            f"no row holds a possible {config.kind} reading",
            file=config.files[0],
            column=config.value_columns[0],
            advice=f"check columns and unit of the sensor '{config.label}' in the flight file{units}",
        )
    given = config.sigma_m if isinstance(config, PositionSensor) else (0.0,)
    given = config.sigma_mps if isinstance(config, VelocitySensor) else given
    if given is None and not np.isfinite(table.sigma).any():
        key = "sigma_m" if isinstance(config, PositionSensor) else "sigma_mps"
        raise InputError(
            f"sensor '{config.label}' has no sigmas: neither the flight file nor the log states any",
            file=config.files[0],
            key=f"sensor.{key}",
            advice=f"give {key} = [north, east, down], or name the columns of sigmas",
        )
