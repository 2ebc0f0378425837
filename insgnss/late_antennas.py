"""Several antennas, loaded where a flight has them: they are seldom, and take as long to load as half of all else."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import pandas as pd

from insgnss.filter.setup import FilterSetup
from insgnss.gnss.observation_rows import Rows
from insgnss.log.flight import Flight, FlightLogs
from insgnss.tables import Event

Record = Callable[[pd.DataFrame, int], pd.DataFrame]


def with_aid(setup: FilterSetup, flight: Flight) -> FilterSetup:
    """Return the setup with the attitude stage of the flight's antennas, as yet without phases."""
    if flight.config.attitude is None:
        return setup
    return replace(setup, aid=_module().attitude_aid(setup, flight))


def with_antennas(
    setup: FilterSetup, logs: FlightLogs, flight: Flight, rows: Rows
) -> tuple[FilterSetup, Record | None, list[Event]]:
    """Return what ``several_antennas.with_antennas`` does; the setup alone where the flight has one antenna."""
    if flight.config.attitude is None:
        return setup, None, []
    found: tuple[FilterSetup, Record | None, list[Event]] = _module().with_antennas(setup, logs, flight, rows)
    return found


def _module() -> ModuleType:
    return importlib.import_module("insgnss.several_antennas")
