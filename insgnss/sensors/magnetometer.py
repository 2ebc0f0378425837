"""The horizontal magnetic field: it points to magnetic north, east of true north by the declination D.

With the field m along body axes, the vehicle's own field b (hard iron) and the horizontal intensity H, in level axes

    n . C_nb (m - b) = H cos D,    e . C_nb (m - b) = H sin D.

The two rows are these in polar coordinates, p and t of C_nb (m - b) against magnetic north: p = H shows whether the
field is the Earth's, whatever the heading; 0 = p t gives the heading, with a sigma of sigma / H, and is linear in it
however far off that is. Both are used or refused together: a motor or a bridge that bends the field past the gate is
refused as a whole. States: b, H and D, each with what is known of it, so that a heading is never better than its
declination and hard iron. The vertical field is not used.
Neglects: soft iron (3 % of the field in a car's cabin, 1 deg) but for what H takes; the Earth field's change with the
place, 1 deg of declination in 100 km.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from insgnss.config.sensors import Magnetometer
from insgnss.filter.layout import RandomWalk, StateBlock
from insgnss.filter.own_rows.rows import Row
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.geodesy.vectors import cross_product
from insgnss.sensors.readings import Reading
from insgnss.sensors.sensor_measurement import SensorMeasurement, weighted
from insgnss.tables import Float64
from insgnss.units import RAD_PER_DEG, SQRT_S_PER_SQRT_H


class MagnetometerMeasurement(SensorMeasurement[Magnetometer]):
    """A magnetometer's rows, its hard iron, and the uncertainty of the field."""

    unit: ClassVar[str] = "uT"
    hint: ClassVar[str] = "motors, currents and steel nearby; its axes and unit, declination and intensity"

    @property
    def tells_heading(self) -> bool:
        """Return True: it measures the heading."""
        return True

    def states(self) -> tuple[StateBlock, ...]:
        """Return hard iron, intensity and declination."""
        config, name = self.config, self.name
        walk = RandomWalk(config.hard_iron_walk_ut_per_sqrt_h / SQRT_S_PER_SQRT_H)
        iron = tuple(f"{name}_iron_{axis}_ut" for axis in "xyz")
        strength = config.horizontal_share * config.horizontal_ut
        declination = (f"{name}_declination_deg",)
        return (
            StateBlock(f"{name}_iron", iron, "uT", config.hard_iron_sigma_ut, walk),
            StateBlock(f"{name}_strength", (f"{name}_strength_ut",), "uT", strength),
            StateBlock(
                *(f"{name}_declination", declination, "deg", config.declination_sigma_deg),
                si_per_unit=RAD_PER_DEG,
            ),
        )

    def rows_of(self, reading: Reading, state: StateEstimate) -> Sequence[Row]:
        """Return the rows of the horizontal field's direction and size."""
        config, name = self.config, self.name
        strength = config.horizontal_ut + self.value_of(state, "strength")
        D = RAD_PER_DEG * config.declination_deg + self.value_of(state, "declination")
        field_b = reading.values - np.asarray(state.optional[f"{name}_iron"])
        north_e, east_e = self._directions(state, D)
        field_e = state.C_eb @ field_b
        north, east = float(north_e @ field_e), float(east_e @ field_e)
        size, turn = math.hypot(north, east), math.atan2(east, north)
        along_e = math.cos(turn) * north_e + math.sin(turn) * east_e
        # d (p t) = t dp + p dt
        arc_e = math.cos(turn) * east_e - math.sin(turn) * north_e + turn * along_e

        # predicted is the right side less C_nb (m - b), measured is zero
        def partials(
            direction_e: Float64, of_strength: float, of_declination: float
        ) -> dict[str, npt.ArrayLike]:
            return {
                "attitude": -cross_product(field_e, direction_e),
                f"{name}_iron": state.C_eb.T @ direction_e,
                f"{name}_strength": of_strength,
                f"{name}_declination": of_declination,
            }

        return (
            weighted(
                size * turn, partials(arc_e, 0.0, size), config.sigma_ut * math.hypot(1.0, turn), reading
            ),
            weighted(size - strength, partials(along_e, 1.0, 0.0), config.sigma_ut, reading),
        )

    @staticmethod
    def _directions(state: StateEstimate, D: float) -> tuple[Float64, Float64]:
        """Return the horizontal unit vectors to magnetic north and east, ECEF."""
        north, east = state.C_ne[0], state.C_ne[1]
        along = math.cos(D) * north + math.sin(D) * east
        return along, -math.sin(D) * north + math.cos(D) * east
