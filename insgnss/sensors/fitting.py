"""From a flight file to the rows and states of everything fitted beside IMU and GNSS."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, NamedTuple

from insgnss.config.flight import FlightConfig
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
from insgnss.filter.layout import StateBlock
from insgnss.filter.own_rows.rows import Measurement
from insgnss.log.flight import FlightLogs
from insgnss.sensors.attitude_fixes import AttitudeMeasurement, HeadingMeasurement
from insgnss.sensors.barometer import BarometerMeasurement
from insgnss.sensors.magnetometer import MagnetometerMeasurement
from insgnss.sensors.odometer import OdometerMeasurement
from insgnss.sensors.position_fixes import PositionMeasurement, VelocityMeasurement
from insgnss.sensors.readings import LiveReadings, readings_of
from insgnss.sensors.sensor_measurement import SensorMeasurement
from insgnss.sensors.vehicle_motion import VehicleMounting
from insgnss.sensors.vehicle_rows import vehicle_measurements, vehicle_states

KINDS: Final[dict[type, type[SensorMeasurement[Any]]]] = {
    Odometer: OdometerMeasurement,
    Barometer: BarometerMeasurement,
    Magnetometer: MagnetometerMeasurement,
    HeadingSensor: HeadingMeasurement,
    AttitudeSensor: AttitudeMeasurement,
    PositionSensor: PositionMeasurement,
    VelocitySensor: VelocityMeasurement,
}

_FIXES: Final = (PositionMeasurement, VelocityMeasurement)


class SensorFitting(NamedTuple):
    """The equipment fitted besides IMU and GNSS."""

    states: tuple[StateBlock, ...] = ()
    measurements: tuple[Measurement, ...] = ()


def fitted(config: FlightConfig, logs: FlightLogs | None) -> SensorFitting:
    """Return the equipment that a flight file declares.

    Parameters
    ----------
    logs : None where the logs are still to come, as in the streaming engine
    """
    sensors = further_sensors(config.sensor, logs)
    if config.vehicle is not None:
        mounting = VehicleMounting.of(config.vehicle.non_holonomic)
        sensors = [
            replace(one, mounting=mounting) if isinstance(one, OdometerMeasurement) else one
            for one in sensors
        ]
    if not config.gnss.files:  # fixes carry the filter
        sensors = [replace(one, carrying=isinstance(one, _FIXES)) for one in sensors]
    states = tuple(block for one in sensors for block in one.states())
    if config.vehicle is None:
        return SensorFitting(states, tuple(sensors))
    of_vehicle = vehicle_measurements(config.vehicle)
    return SensorFitting((*vehicle_states(config.vehicle), *states), (*of_vehicle, *sensors))


def further_sensors(declared: tuple[Sensor, ...], logs: FlightLogs | None) -> list[SensorMeasurement[Any]]:
    """Return the measurements of the further sensors: all of them without logs, else those that have a log."""
    if logs is None:
        return [KINDS[type(sensor)](sensor, LiveReadings(sensor)) for sensor in declared]
    tables = {table.name: table for table in logs.sensors}
    return [
        KINDS[type(sensor)](sensor, readings_of(sensor, tables[sensor.label]))
        for sensor in declared
        if sensor.label in tables
    ]
