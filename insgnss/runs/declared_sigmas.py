"""Errors of further sensors that a run finds larger than the flight file allows.

A heading that is magnetic in place of true, a wheel counted with the wrong circumference: the sensor's own state takes
the error, and what its declared sigma does not allow it to take, attitude and velocity take. An estimate beyond four
declared sigmas (``PLAUSIBLE``) is rarer than a wrong declaration: an event names it, once for each state.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from insgnss.constants import NS_PER_S
from insgnss.filter.layout import GaussMarkov, StateBlock
from insgnss.filter.own_rows.rows import OwnMeasurements
from insgnss.gpstime import week_seconds_to_ns
from insgnss.runs.installation import PLAUSIBLE
from insgnss.sensors.sensor_measurement import SensorMeasurement
from insgnss.tables import Bool, Event, Float64, Int64


class _SensorState(NamedTuple):
    """A state of a further sensor, and what the flight file says of it."""

    name: str  # of the sensor
    hint: str
    block: StateBlock

    def sigma(self, since_s: Float64 | float) -> Float64:
        """Return the declared sigma after so many seconds."""
        process = self.block.process
        if isinstance(process, GaussMarkov):
            return np.full_like(since_s, max(self.block.sigma, process.sigma), dtype=np.float64)
        return np.asarray(np.sqrt(self.block.sigma**2 + process.variance_per_s * np.asarray(since_s)))

    def is_beyond(self, value: Float64 | float, since_s: Float64 | float, n_hypotheses: Int64 | int) -> Bool:
        """Return whether an estimate is beyond four declared sigmas, with one heading left."""
        return np.asarray((np.abs(value) > PLAUSIBLE * self.sigma(since_s)) & (np.asarray(n_hypotheses) == 1))

    def event(self, t_ns: int, column: str, value: float, since_s: float) -> Event:
        """Return the event of an estimate beyond its sigma."""
        sigmas = abs(value) / float(self.sigma(since_s))
        detail = (
            f"'{self.name}' is off by more than declared: {column} is {value:+.3g}, {sigmas:.0f} times the"
            f" sigma of the flight file; attitude, position or velocity may be wrong with it; look for: {self.hint}"
        )
        return Event(t_ns, "sensor_beyond_sigma", detail)


def _states(own: OwnMeasurements | None) -> dict[str, _SensorState]:
    """Return the states of the further sensors by their columns in ``nav``."""
    sources = () if own is None else tuple(kind.source for kind in own.kinds)
    return {
        column: _SensorState(source.name, source.hint, block)
        for source in sources
        if isinstance(source, SensorMeasurement)
        for block in source.states()
        for column in block.columns
    }


def beyond_declared(nav: pd.DataFrame, own: OwnMeasurements | None, week: int) -> list[Event]:
    """Return an event for each state of a sensor that a run finds beyond its declared sigma, with one heading left."""
    events = []
    for column, state in _states(own).items():
        if column not in nav or not len(nav):
            continue
        time_s, value = nav["time_s"].to_numpy(), nav[column].to_numpy()
        since_s = time_s - time_s[0]
        beyond = state.is_beyond(value, since_s, nav["n_hypotheses"].to_numpy())
        if beyond.any():
            k = int(np.argmax(beyond))
            t_ns = int(week_seconds_to_ns(week, float(time_s[k])))
            events.append(state.event(t_ns, column, float(value[k]), float(since_s[k])))
    return events


class LiveDeclaredSigmas:
    """The same events of a streaming engine."""

    def __init__(self, own: OwnMeasurements | None) -> None:
        """Take the declared sigmas from the states of the sensors."""
        self._open = _states(own)
        self._first_ns: int | None = None

    def events(self, t_ns: int, values: Mapping[str, Any], n_hypotheses: int) -> list[Event]:
        """Return the events of an epoch; ``values`` has the estimates by their columns in ``nav``."""
        self._first_ns = t_ns if self._first_ns is None else self._first_ns
        new_events = []
        for column, state in list(self._open.items()):
            since_s, value = (t_ns - self._first_ns) / NS_PER_S, float(values.get(column, math.nan))
            if state.is_beyond(value, since_s, n_hypotheses):
                del self._open[column]
                new_events.append(state.event(t_ns, column, value, since_s))
        return new_events
