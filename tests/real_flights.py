"""The flights of the real logs, whole or as far as they are cheap."""

from __future__ import annotations

import pytest

from insgnss.log.flight import Flight, FlightInMemory
from tests.conftest import REPOSITORY
from tests.filter.test_engine import shortened

# Of 132 s: the heading is found after 22 s. At 113 s a knock of the sensor opens a bank of filters, which takes fifteen
# times as long as all before; tests/runs/test_real_logs.py replays the whole.
WALK_S = 110.0


def real_flight(name: str) -> Flight:
    """Return the flight of a real log; skip the test where its files are absent."""
    flight = Flight.load(REPOSITORY / "tests" / "flights" / f"{name}.toml")
    if not flight.config.imu.files[0].is_file():
        pytest.skip(f"{flight.config.imu.files[0]} does not exist: the flight files look beside the checkout")
    return flight


def without_knock(name: str) -> Flight:
    """Return the flight of a real log, the walk without its last seconds."""
    flight = real_flight(name)
    if name != "walk":
        return flight
    logs = shortened(flight.read(), WALK_S)
    return FlightInMemory(flight.path, flight.config, flight.imu_grade, flight.oscillator, logs)
