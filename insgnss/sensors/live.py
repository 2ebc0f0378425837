"""The further sensors of a streaming engine, found by their names."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from insgnss.errors import MeasurementError
from insgnss.filter.own_rows.live_times import LiveTimes
from insgnss.filter.own_rows.rows import OwnMeasurements
from insgnss.filter.setup import FilterSetup
from insgnss.sensors.readings import LiveReadings
from insgnss.sensors.sensor_measurement import SensorMeasurement


def live_sensor(own: OwnMeasurements | None, name: str) -> SensorMeasurement[Any]:
    """Return the sensor whose readings come live.

    Raises
    ------
    MeasurementError : the settings have no such sensor, or its readings are those of a log
    """
    kinds = () if own is None else own.kinds
    live = {
        kind.name: kind.source
        for kind in kinds
        if isinstance(kind.source, SensorMeasurement) and kind.source.live
    }
    if name not in live:
        known = ", ".join(live) or "none"
        raise MeasurementError(
            f"no sensor '{name}' is fed live",
            advice=f"declare it as [[sensor]] in the flight file that engine_settings is given; it has: {known}",
        )
    return live[name]


def with_own_readings(setup: FilterSetup) -> FilterSetup:
    """Return a setup whose live sensors have no readings yet and share them with no other engine."""
    if setup.own is None:
        return setup
    kinds = []
    for kind in setup.own.kinds:
        source = kind.source
        if isinstance(source, SensorMeasurement) and source.live:
            kind = replace(kind, source=replace(source, readings=LiveReadings(source.config)))
        kinds.append(kind)
    return replace(setup, own=replace(setup.own, kinds=tuple(kinds), arrived=LiveTimes()))


def forget_before(own: OwnMeasurements, t_ns: int) -> None:
    """Let go of live readings before a time, which nothing asks for any more."""
    own.arrived.forget_before(t_ns)
    for kind in own.kinds:
        if isinstance(kind.source, SensorMeasurement) and isinstance(kind.source.readings, LiveReadings):
            kind.source.readings.forget_before(t_ns)
