"""From ``[vehicle]`` of a flight file to its rows and states."""

from __future__ import annotations

import math

from insgnss.config.vehicle_kind import Standstill, VehicleRows
from insgnss.filter.layout import GaussMarkov, StateBlock
from insgnss.filter.own_rows.rows import Measurement
from insgnss.sensors.standstill import ZeroRate, ZeroVelocity
from insgnss.sensors.vehicle_motion import LEEWAY, MOUNTING, Course, NonHolonomic
from insgnss.units import RAD_PER_DEG


def vehicle_states(vehicle: VehicleRows) -> tuple[StateBlock, ...]:
    """Return the states that the rows of a vehicle need."""
    states = []
    along = vehicle.non_holonomic
    if along is not None and along.on and along.mounting_sd_deg > 0.0:
        columns = ("mounting_pitch_deg", "mounting_yaw_deg")
        states.append(StateBlock(MOUNTING, columns, "deg", along.mounting_sd_deg, si_per_unit=RAD_PER_DEG))
    course = vehicle.course
    if course is not None and course.on:
        lasting = GaussMarkov(course.leeway_deg, course.leeway_time_s)
        states.append(
            StateBlock(LEEWAY, ("leeway_deg",), "deg", course.leeway_deg, lasting, si_per_unit=RAD_PER_DEG)
        )
    return tuple(states)


def vehicle_measurements(vehicle: VehicleRows) -> tuple[Measurement, ...]:
    """Return the rows of a vehicle."""
    rows: list[Measurement] = []
    period_s, limits = vehicle.period_s, vehicle.standstill or Standstill()
    if vehicle.non_holonomic is not None and vehicle.non_holonomic.on:
        rows.append(
            NonHolonomic(
                period_s, vehicle.non_holonomic.gate_sigma, vehicle.non_holonomic, vehicle.nose_first
            )
        )
    if vehicle.course is not None and vehicle.course.on:
        rows.append(Course(period_s, vehicle.course.gate_sigma, vehicle.course, vehicle.nose_first))
    still = vehicle.zero_velocity
    if still is not None and still.on:
        rows.append(ZeroVelocity(period_s, still.gate_sigma, still, limits))
    rate = vehicle.zero_rate
    if rate is not None and rate.on and still is not None:
        # windows of rows in a row have no sample in common
        apart_s = period_s * math.ceil(limits.window_s / period_s - 1e-9)
        rows.append(ZeroRate(apart_s, rate.gate_sigma, rate, limits, still.below_mps))
    return tuple(rows)
