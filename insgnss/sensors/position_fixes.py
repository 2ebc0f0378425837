"""Position and velocity fixes: loose coupling, of any point of the body.

    r = r_e + C_eb l,    v = v_e + C_eb (w_eb x l),    rows along north, east, down, each with its own sigma

The fixes of a receiver are the output of a filter over errors that last: their noise is hardly less after ten readings
than after one. ``correlation_time_s`` says for how long, 5 s for positions when nothing is given; what persists longer
(orbits, atmosphere, multipath at rest) is in no sigma here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np

from insgnss.config.sensors import PositionSensor, VelocitySensor
from insgnss.filter.own_rows.rows import Row
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.vectors import cross_product
from insgnss.sensors.body_motion import velocity_of
from insgnss.sensors.readings import Reading
from insgnss.sensors.sensor_measurement import SensorMeasurement, sigma_or, weighted
from insgnss.tables import Float64

_MOVED: Final = 3.0  # sigmas from a fix to the next, which a vehicle at rest does not move
_UNKNOWN = (np.nan,) * 3  # sigmas that neither settings nor log state: the reading is refused


class PositionMeasurement(SensorMeasurement[PositionSensor]):
    """The rows of position fixes."""

    unit: ClassVar[str] = "m"
    hint: ClassVar[str] = "its time, datum and heights (ellipsoid or sea level), its lever arm and sigmas"

    def repeats(self, t_ns: int) -> bool:
        """Return whether a fix repeats the one before although the vehicle was moving.

        At rest a receiver may hold its position; there a repeat shows that the vehicle stands.
        """
        repeated = self.readings.repeated(t_ns)
        if repeated is None or repeated[1] is None:
            return False
        here, before = (fix_ecef(value, 0.0) for value in (repeated[0], repeated[1]))
        sigma = sigma_or(self.readings.at(t_ns).sigma, self.config.sigma_m or _UNKNOWN)
        return bool(np.linalg.norm(here - before) > _MOVED * math.sqrt(2.0) * np.nanmax(sigma[:2]))

    def rows_of(self, reading: Reading, state: StateEstimate) -> Sequence[Row]:
        """Return the rows of a fix; a missing height refuses the row of the height alone."""
        lever_b = np.array(self.config.lever_arm_m)
        arm_e = state.C_eb @ lever_b
        r_a = state.r_e + arm_e
        apart_n = state.C_ne @ (fix_ecef(reading.values, state.h_m) - r_a)
        if np.isnan(reading.values[2]):
            apart_n[2] = np.nan
        sigma = sigma_or(reading.sigma, self.config.sigma_m or _UNKNOWN)
        axes = [k for k in range(3) if k < 2 or self.config.columns.position[2] != "none"]
        return [
            _row(
                apart_n[k],
                sigma[k],
                reading,
                position=state.C_ne[k],
                attitude=cross_product(arm_e, state.C_ne[k]),
            )
            for k in axes
        ]


class VelocityMeasurement(SensorMeasurement[VelocitySensor]):
    """The rows of velocities."""

    unit: ClassVar[str] = "m/s"
    hint: ClassVar[str] = "its axes and their signs, its time, lever arm and sigmas"

    def repeats(self, t_ns: int) -> bool:
        """Return whether a velocity other than zero repeats the one before."""
        repeated = self.readings.repeated(t_ns)
        return repeated is not None and bool(np.nan_to_num(repeated[0]).any())

    def rows_of(self, reading: Reading, state: StateEstimate) -> Sequence[Row]:
        """Return the rows of a velocity."""
        lever_b = np.array(self.config.lever_arm_m)
        v_a, turning = velocity_of(state, lever_b)
        apart_n = reading.values - state.C_ne @ v_a
        given = self.config.sigma_mps or _UNKNOWN
        sigma = sigma_or(reading.sigma, [given[k] for k in self.config.ned])
        return [
            _row(
                *(apart_n[k], sigma[k], reading),
                velocity=state.C_ne[k],
                attitude=cross_product(turning, state.C_ne[k]),
                # the rate is the gyro's less its bias, and b . (l x n) = n . (b x l)
                gyro_bias=-cross_product(lever_b, state.C_eb.T @ state.C_ne[k]),
            )
            for k in self._measured
        ]

    @property
    def _measured(self) -> list[int]:
        """The components that the log has, of north, east, down."""
        return [k for k, lacking in enumerate(self.config.lacking) if not lacking]


def fix_ecef(values: Float64, h_m: float) -> Float64:
    """Return a fix (latitude, longitude, height) in ECEF, at the height ``h_m`` where it has none."""
    r_e = np.zeros(3)
    lat, lon, h = values
    if np.isfinite([lat, lon]).all():
        geodetic_to_ecef(lat, lon, h if np.isfinite(h) else h_m, r_e)
    else:
        r_e[:] = np.nan
    return r_e


def _row(apart: float, sigma: float, reading: Reading, **partials: Float64) -> Row:
    """Return one row of a fix; without a sigma it has no value."""
    if not np.isfinite(sigma):
        apart, sigma = np.nan, 1.0
    return weighted(apart, partials, float(sigma), reading)
