"""From a flight file to the rows and states of everything fitted beside IMU and GNSS."""

from __future__ import annotations

from typing import NamedTuple

from insgnss.config.flight import FlightConfig
from insgnss.filter.layout import StateBlock
from insgnss.filter.own_rows.rows import Measurement
from insgnss.log.flight import FlightLogs
from insgnss.sensors.vehicle_rows import vehicle_measurements, vehicle_states


class Fitted(NamedTuple):
    """What is fitted beside IMU and GNSS."""

    states: tuple[StateBlock, ...] = ()
    measurements: tuple[Measurement, ...] = ()


def fitted(config: FlightConfig, logs: FlightLogs | None) -> Fitted:
    """Return what a flight file says to be fitted.

    Parameters
    ----------
    logs : None where the logs are still to come, as in the streaming engine
    """
    vehicle = config.vehicle
    if vehicle is None:
        return Fitted()
    return Fitted(vehicle_states(vehicle), vehicle_measurements(vehicle))
