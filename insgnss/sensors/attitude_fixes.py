"""Heading or attitude from outside: angles of the body against north, east, down, each with its own sigma.

    measured = yaw + offset + noise, and roll, pitch without an offset,    differences taken within half a turn

The offset of a heading (how the device is mounted, a compass' deviation) is a constant of which ``offset_sigma_deg`` is
known. Roll and yaw lose their meaning near the vertical: beyond 85 deg of pitch no row is given a value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np

from insgnss.config.sensors import AttitudeSensor, HeadingSensor
from insgnss.filter.layout import StateBlock
from insgnss.filter.own_rows.rows import Row
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.sensors.readings import Reading
from insgnss.sensors.sensor_measurement import SensorMeasurement, sigma_or, weighted
from insgnss.units import RAD_PER_DEG

STEEPEST_RAD: Final = math.radians(85.0)  # of pitch
_NO_ROW: Final = {"attitude": np.zeros(3)}  # of an angle that is not there


class HeadingMeasurement(SensorMeasurement[HeadingSensor]):
    """A heading's rows and its mounting uncertainty."""

    unit: ClassVar[str] = "rad"
    hint: ClassVar[str] = "its unit, sign and mounting; a compass: declination and steel nearby"

    @property
    def tells_heading(self) -> bool:
        """Return True: it measures the heading."""
        return True

    def states(self) -> tuple[StateBlock, ...]:
        """Return the offset."""
        column = (f"{self.name}_offset_deg",)
        sigma = self.config.offset_sigma_deg
        return (StateBlock(f"{self.name}_offset", column, "deg", sigma, si_per_unit=RAD_PER_DEG),)

    def rows_of(self, reading: Reading, state: StateEstimate) -> Sequence[Row]:
        """Return the row of a heading."""
        sigma = float(sigma_or(reading.sigma, (RAD_PER_DEG * self.config.sigma_deg,))[0])
        if abs(state.rpy_rad[1]) > STEEPEST_RAD:
            return (weighted(math.nan, _NO_ROW, sigma, reading),)
        predicted = state.yaw_rad + self.value_of(state, "offset")
        partials = {"attitude": state.rpy_by_attitude[2], f"{self.name}_offset": 1.0}
        return (weighted(_turn(reading.values[0] - predicted), partials, sigma, reading),)


class AttitudeMeasurement(SensorMeasurement[AttitudeSensor]):
    """Rows of roll, pitch and yaw, as many of them as the log has."""

    unit: ClassVar[str] = "rad"
    hint: ClassVar[str] = "its unit, the order and signs of the angles, its mounting and time"

    @property
    def tells_heading(self) -> bool:
        """Return whether the log has the yaw."""
        return self.config.value_columns[2] != "none"

    def rows_of(self, reading: Reading, state: StateEstimate) -> Sequence[Row]:
        """Return the rows of an attitude."""
        sigma = sigma_or(reading.sigma, [RAD_PER_DEG * one for one in self.config.sigma_deg])
        wanted = [k for k, name in enumerate(self.config.value_columns) if name != "none"]
        if abs(state.rpy_rad[1]) > STEEPEST_RAD:
            return [weighted(math.nan, _NO_ROW, float(sigma[k]), reading) for k in wanted]
        return [
            weighted(
                _turn(reading.values[k] - state.rpy_rad[k]),
                {"attitude": state.rpy_by_attitude[k]},
                float(sigma[k]),
                reading,
            )
            for k in wanted
        ]


def _turn(angle: float) -> float:
    """Return an angle within half a turn, NaN of NaN."""
    return math.remainder(angle, 2.0 * math.pi) if math.isfinite(angle) else math.nan
