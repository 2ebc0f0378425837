"""A replay's events about the readings: readings left out, and a sensor stuck while the vehicle moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import OwnMeasurements
from insgnss.sensors.readings import Readings
from insgnss.sensors.sensor_measurement import SensorMeasurement
from insgnss.tables import Event, stretches_of

_FROZEN_S: Final = 10.0  # shorter repeats occur, of a coarse sensor
_FROZEN_READINGS: Final = 10
_MOVED_SIGMAS: Final = 6.0  # by which the prediction has moved against a value that does not


def reading_events(own: OwnMeasurements | None, entries: Sequence[OwnEntry]) -> list[Event]:
    """Return the events of the further sensors' readings, from the status of their rows."""
    sources = () if own is None else tuple(kind.source for kind in own.kinds)
    events = []
    for source in sources:
        if isinstance(source, SensorMeasurement) and isinstance(source.readings, Readings):
            events += _left_out(source, source.readings)
            events += _frozen(source, source.readings, [e for e in entries if e.kind == source.name])
    return events


def _left_out(source: SensorMeasurement[Any], readings: Readings) -> list[Event]:
    if not readings.left_out:
        return []
    detail = (
        f"'{source.name}': {readings.left_out} of {readings.left_out + len(readings.times_ns)} readings follow another"
        f" within interval_s = {source.config.interval_s:g}: left out"
    )
    return [Event(None, "sensor_readings_left_out", detail)]


def _frozen(source: SensorMeasurement[Any], readings: Readings, entries: Sequence[OwnEntry]) -> list[Event]:
    """Return an event for each stretch of equal readings within which the measured quantity has moved.

    What moved is the prediction: the reading stays, so the innovation's change is the prediction's.
    """
    # of several rows of a time the last one represents all
    last = {e.t_ns: e for e in entries if np.isfinite(e.innovation) and e.variance > 0.0}
    events = []
    for a, b in stretches_of(readings.same).tolist():
        t = readings.times_ns[a : b + 1]
        found = [last[t_ns] for t_ns in t.tolist() if t_ns in last]
        if t[-1] - t[0] < _FROZEN_S * NS_PER_S or len(found) < _FROZEN_READINGS:
            continue
        innovation = np.array([e.innovation for e in found])
        sigma = float(np.sqrt(np.median([e.variance for e in found])))
        if np.ptp(innovation) > _MOVED_SIGMAS * sigma:
            seconds = (int(t[-1]) - int(t[0])) / NS_PER_S
            detail = (
                f"'{source.name}' repeats one value for {seconds:.0f} s while its prediction moves by"
                f" {np.ptp(innovation) / sigma:.0f} sigma: the sensor or its log stands still"
            )
            events.append(Event(int(t[0]), "sensor_frozen", detail))
    return events
