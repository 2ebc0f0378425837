"""Barometric height: the height of the pressure port, plus an offset that the weather moves, in a wrong scale.

    altitude = (1 + scale) h + offset + noise,    h = the IMU's height + up . C_eb l

The pressure becomes an altitude by the standard atmosphere when it is read. The offset holds the day's pressure at sea
level and the geoid (30 m are usual, 100 m occur) and wanders as a Gauss-Markov process; a temperature that is not the
standard one makes every difference of height wrong by the same share, the scale. Gusts and draught through a
window are noise while they are short; a longer one is refused and becomes a step of the offset (``own_rows.steps``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from insgnss.config.sensors import Barometer
from insgnss.filter.layout import GaussMarkov, RandomWalk, StateBlock
from insgnss.filter.own_rows.rows import Row
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.geodesy.vectors import cross_product
from insgnss.sensors.readings import Reading
from insgnss.sensors.sensor_measurement import SensorMeasurement, sigma_or, weighted


class BarometerMeasurement(SensorMeasurement[Barometer]):
    """A barometer's rows, its offset and its scale."""

    unit: ClassVar[str] = "m"
    stepping_state: ClassVar[str] = "offset"
    hint: ClassVar[str] = "a window or ventilation that moves the pressure; its unit, time and port"

    def states(self) -> tuple[StateBlock, ...]:
        """Return offset and scale."""
        config, name = self.config, self.name
        weather = GaussMarkov(config.drift_sigma_m, config.drift_time_s)
        share = 100.0 * config.scale_sigma
        return (
            StateBlock(f"{name}_offset", (f"{name}_offset_m",), "m", config.offset_sigma_m, weather),
            StateBlock(
                *(f"{name}_scale", (f"{name}_scale_percent",), "%", share), RandomWalk(), si_per_unit=0.01
            ),
        )

    def rows_of(self, reading: Reading, state: StateEstimate) -> Sequence[Row]:
        """Return the row of an altitude."""
        up = state.up_e
        arm_e = state.C_eb @ np.array(self.config.lever_arm_m)
        height, scale = state.h_m + float(up @ arm_e), self.value_of(state, "scale")
        predicted = (1.0 + scale) * height + self.value_of(state, "offset")
        partials: dict[str, npt.ArrayLike] = {
            "position": (1.0 + scale) * up,
            "attitude": (1.0 + scale) * cross_product(arm_e, up),
            f"{self.name}_offset": 1.0,
            # not the altitude that was measured, whose noise is in the innovation too
            f"{self.name}_scale": height,
        }
        sigma = float(sigma_or(reading.sigma, (self.config.sigma_m,))[0])
        return (weighted(reading.values[0] - predicted, partials, sigma, reading),)
