"""Wheel speed: the velocity of a point of the body along its forward axis, times an unknown scale factor.

    measured = (1 + s) x . (C_be v_e + w_eb x l) + noise,    variance sigma^2 + (sigma_share v)^2

with x the forward axis of the vehicle and l from the IMU to a wheel that does not steer. The scale factor s (tyre,
pressure, calibration) is a random walk. The forward axis is that of [vehicle.non_holonomic], with the angles that it
gives and that the filter estimates: along the axis of an IMU mounted 30 deg off, a wheel reads 13 % too little. Without
that table it is the body's; an error of 3 deg is 0.15 %, which s takes. In an outage neither heading nor the velocity
across the way is known well; their product moves the forward speed by decimetres per second. It is a second-order term,
which the update counts as noise. A reading without a sign is compared with the speed's size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from insgnss.config.sensors import Odometer
from insgnss.filter.layout import RandomWalk, StateBlock
from insgnss.filter.own_rows.rows import Row
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.geodesy.rotations import cross_matrix
from insgnss.geodesy.vectors import cross_product
from insgnss.sensors.body_motion import velocity_of
from insgnss.sensors.readings import Reading
from insgnss.sensors.sensor_measurement import SensorMeasurement, sigma_or, weighted
from insgnss.sensors.vehicle_motion import MOUNTING, NOT_TURNED, VehicleMounting, vehicle_axes
from insgnss.units import SQRT_S_PER_SQRT_H


@dataclass(frozen=True)
class OdometerMeasurement(SensorMeasurement[Odometer]):
    """An odometer's rows and its scale factor."""

    mounting: VehicleMounting = NOT_TURNED

    unit: ClassVar[str] = "m/s"
    hint: ClassVar[str] = "a wheel that slips or locks; its unit, sign, time and forward axis"

    @property
    def tells_heading(self) -> bool:
        """While headings are open it tells them apart, by where the vehicle goes."""
        return True

    def states(self) -> tuple[StateBlock, ...]:
        """Return the scale factor."""
        walk = RandomWalk(100.0 * self.config.scale_walk_per_sqrt_h / SQRT_S_PER_SQRT_H)
        sigma = 100.0 * self.config.scale_sigma
        column = f"{self.name}_scale_percent"
        return (StateBlock(f"{self.name}_scale", (column,), "%", sigma, walk, si_per_unit=0.01),)

    def rows_of(self, reading: Reading, state: StateEstimate) -> Sequence[Row]:
        """Return the row of a speed."""
        config = self.config
        lever, (pitch, yaw) = np.array(config.lever_arm_m), self.mounting.angles(state)
        forward_b, right_b, down_b = vehicle_axes(pitch, yaw)
        forward_e = state.C_eb @ forward_b
        v_e, turning = velocity_of(state, lever)
        speed, scale = float(forward_e @ v_e), 1.0 + self.value_of(state, "scale")
        sign = -1.0 if speed < 0.0 and not config.signed else 1.0
        predicted = sign * scale * speed
        sigma = float(sigma_or(reading.sigma, (config.sigma_mps,))[0])
        sigma = math.hypot(sigma, config.sigma_share * speed)
        if abs(reading.values[0]) < config.least_speed_mps:  # it says only that the speed is less
            sigma = math.hypot(sigma, config.least_speed_mps)
        gain = sign * scale
        partials: dict[str, npt.ArrayLike] = {
            "velocity": gain * forward_e,
            # forward turns with the body against v_e; the turn of the lever about the IMU turns with it
            "attitude": gain * cross_product(forward_e, v_e - turning),
            "gyro_bias": -gain * cross_product(lever, forward_b),
            f"{self.name}_scale": sign * speed,
        }
        if MOUNTING in state.optional:
            v_b = state.C_eb.T @ v_e
            by_pitch, by_yaw = math.cos(yaw) * float(down_b @ v_b), -float(right_b @ v_b)
            partials[MOUNTING] = np.array([gain * by_pitch, gain * by_yaw])
        v_imu = v_e - turning
        second = {
            ("attitude", "velocity"): gain * cross_matrix(forward_e),
            # of (psi x (psi x forward)) . v / 2
            ("attitude", "attitude"): 0.5
            * gain
            * (
                0.5 * (np.outer(forward_e, v_imu) + np.outer(v_imu, forward_e))
                - float(forward_e @ v_imu) * np.eye(3)
            ),
        }
        row = weighted(reading.values[0] - predicted, partials, sigma, reading)
        return (row._replace(second=second),)
