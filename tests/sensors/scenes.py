"""Simulated flights with further sensors, ready to be replayed."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from insgnss.config.flight import GivenStart
from insgnss.config.library import find
from insgnss.config.sensors import Sensor
from insgnss.config.simulated_sensors import SensorFault, SimulatedSensor
from insgnss.config.simulation import SimulationConfig
from insgnss.config.strict import load_toml
from insgnss.log.flight import FlightInMemory
from insgnss.simulation.assembly import assemble
from insgnss.simulation.flight_text import sensor_lines
from insgnss.simulation.simulated_log import Simulator
from tests.runs.scenes import flight

SIMULATED: TypeAdapter[Any] = TypeAdapter(SimulatedSensor)
FAULT: TypeAdapter[Any] = TypeAdapter(SensorFault)
DECLARED: TypeAdapter[Any] = TypeAdapter(Sensor)


def simulated(kind: str, **more: Any) -> Any:
    return SIMULATED.validate_python({"kind": kind, **more})


def fault(kind: str, from_s: float, to_s: float, **more: Any) -> Any:
    return FAULT.validate_python({"kind": kind, "from_s": from_s, "to_s": to_s, **more})


def with_sensors(base: Simulator, sensors: Sequence[Any], faults: Sequence[Any] = ()) -> Simulator:
    """Return the same flight with further sensors, the truth shared."""
    fitted = copy.copy(base)
    fitted.scenario = replace(base.scenario, sensors=tuple(sensors), sensor_faults=tuple(faults))
    return fitted


def declared(sensor: Any, **otherwise: Any) -> Any:
    """Return the entry of the flight file that goes with a simulated sensor."""
    return DECLARED.validate_python(tomllib.loads("\n".join(sensor_lines(sensor))) | otherwise)


def flown(base: Simulator, seed: int, start: GivenStart | None = None, **otherwise: Any) -> FlightInMemory:
    """Return a drawn flight with its sensors declared as they were drawn; ``otherwise``: keys of all of them."""
    log = base.draw(np.random.default_rng([19, seed]))
    made = flight(base, log, start=start)
    sensors = tuple(declared(sensor, **otherwise) for sensor in base.scenario.sensors)
    gnss = made.config.gnss.model_copy(update={"lever_arm_m": base.scenario.receiver.lever_arm_b})
    config = made.config.model_copy(update={"sensor": sensors, "gnss": gnss})
    return replace(made, config=config, logs=replace(made.logs, sensors=log.sensors))


@cache
def city_car(duration_s: float = 132.0) -> Simulator:
    """Return the library's car in a city: at rest, corners, a stop."""
    config = load_toml(find("scenarios", "city_car"), SimulationConfig)
    config = config.model_copy(update={"gps_week": 2385, "start_s": 293_700.0})
    return Simulator(assemble(config, Path(), duration_s=duration_s))
