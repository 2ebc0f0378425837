"""Rows of a vehicle that moves along its own forward axis: non-holonomic rows and the course, and nose first.

**Non-holonomic** (car, train). With l the axle as seen from the IMU, u = C_be v_e + w_eb x l its velocity in body axes
and C_vb = R_z(yaw) R_y(pitch) the mounting of the IMU, the sideways and the downward component of C_vb u are zero:

    0 = a . u + slip,  a = C_vb^T e_y or C_vb^T e_z
    partials: velocity C_eb a; attitude (C_eb a) x v_e; error of the gyros a x l; mounting (da/dpitch . u, da/dyaw . u)

The slip has the variance s^2 = s_0^2 + (angle |u|)^2 + (tyre w_z |u|^2)^2 + (rate of turn x sigma of the axle)^2: it
grows with the speed and in corners. It is correlated over about a second, so each row is weighted by ``correlated``.
The mounting is a constant state: the heading does not take over its error, and what is known in an outage is their
sum.

**Course** (ship, aircraft). Heading and course differ by an angle of leeway, current or wind that lasts, a Gauss-Markov
state, and by yawing that does not. Without sensor:

    0 = yaw + leeway - atan2(v_E, v_N) + yawing,  modulo 180 deg
    partials: attitude of yaw; velocity (v_E, -v_N) / |v|^2 in north and east; leeway 1

**Nose first.** Both rows are the same for a vehicle that moves backward: of two headings 180 deg apart they choose
neither. A heading under which the vehicle moves backward faster than ``above_mps`` loses weight by the factor ``odds``,
once and not at each tick: one that was right all along is still there, and the accelerations can bring it back. The
other heading loses as much as soon as the vehicle moves the other way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.vehicle_kind import CourseRows, NonHolonomicRows, NoseFirst
from insgnss.filter.layout_names import StateLayout
from insgnss.filter.own_rows.rows import Row
from insgnss.filter.own_rows.state_estimate import StateEstimate
from insgnss.geodesy.rotations import EARTH_RATE_E
from insgnss.geodesy.vectors import cross_product
from insgnss.sensors.body_motion import mean_rate, rate_eb_b
from insgnss.sensors.ticking import PeriodicMeasurement, correlated
from insgnss.tables import Float64

MOUNTING: Final = "vehicle_mounting"  # the block of its pitch and yaw
LEEWAY: Final = "leeway"
_RATE_WINDOW_S: Final = 0.1  # of the rate at the axle: vibration averages out, a corner does not change
_MOST_PITCH_RAD: Final = math.radians(45.0)  # beyond it the nose gives no course
_MOST_ROLL_RAD: Final = math.radians(60.0)


def log_weight(forward_mps: float, limits: NoseFirst | None) -> float:
    """Return the logarithm of the factor by which a heading loses weight whose vehicle moves with ``forward_mps``."""
    if limits is None or not limits.on or forward_mps >= -limits.above_mps:
        return 0.0
    return math.log(limits.odds)


class VehicleMounting(NamedTuple):
    """The IMU's angles against the vehicle, as the flight file gives them [rad]."""

    pitch: float = 0.0
    yaw: float = 0.0

    @classmethod
    def of(cls, settings: NonHolonomicRows | None) -> VehicleMounting:
        """Return the mounting of a flight file, zero where it gives none."""
        if settings is None:
            return NOT_TURNED
        return cls(math.radians(settings.mounting_pitch_deg), math.radians(settings.mounting_yaw_deg))

    def angles(self, state: StateEstimate) -> tuple[float, float]:
        """Return pitch and yaw: those given plus those estimated by the filter [rad]."""
        found = np.zeros(2) + state.optional.get(MOUNTING, 0.0)
        return self.pitch + float(found[0]), self.yaw + float(found[1])


NOT_TURNED: Final = VehicleMounting()


@dataclass(frozen=True)
class NonHolonomic(PeriodicMeasurement):
    """Sideways and downward velocity of the axle are zero."""

    settings: NonHolonomicRows
    nose_first: NoseFirst | None
    name: str = "non_holonomic"
    unit: str = "m/s"

    @cached_property
    def _axle_b(self) -> Float64:
        return np.array(self.settings.axle_m or (0.0, 0.0, 0.0))

    @cached_property
    def _mounting(self) -> VehicleMounting:
        return VehicleMounting.of(self.settings)

    def rows(self, state: StateEstimate, layout: StateLayout) -> list[Row]:
        """Return the lateral and the vertical row."""
        l_b, (pitch, yaw) = self._axle_b, self._mounting.angles(state)
        w, grows = _rate_at_axle(state)
        u = state.C_eb.T @ state.v_e + cross_product(w, l_b)
        ahead, right, down = vehicle_axes(pitch, yaw)
        # of a = C_vb^T e by pitch and yaw
        right_by = (math.sin(yaw) * down, ahead)
        down_by = (np.array([-math.cos(pitch), 0.0, -math.sin(pitch)]), np.zeros(3))
        found = []
        for a, by, s2 in zip((right, down), (right_by, down_by), self._variances(u, w), strict=True):
            a_e = state.C_eb @ a
            partials = {
                "velocity": a_e,
                "attitude": cross_product(a_e, state.v_e),
                **{name: cross_product(a, l_b) @ by for name, by in grows.items()},
            }
            if MOUNTING in layout:
                partials[MOUNTING] = np.array([float(each @ u) for each in by])
            variance = correlated(s2, self.settings.correlation_s, self.period_s)
            found.append(Row(-float(a @ u), partials, variance))
        return found

    def unlikely(self, state: StateEstimate) -> float:
        """Return the charge on a heading under which the vehicle moves backward."""
        ahead, _, _ = vehicle_axes(*self._mounting.angles(state))
        return log_weight(float(ahead @ state.C_eb.T @ state.v_e), self.nose_first)

    def _variances(self, u: Float64, w: Float64) -> tuple[float, float]:
        """Return the variance of the slip sideways and downward, for a velocity and a rate in body axes."""
        own = self.settings
        speed2, axle2, turn2 = float(u @ u), own.axle_sd_m**2, w**2
        tyres = math.radians(own.cornering_deg_per_mps2) ** 2 * float(turn2[2]) * speed2**2
        lateral = own.lateral_mps**2 + math.radians(own.lateral_deg) ** 2 * speed2 + tyres
        vertical = own.vertical_mps**2 + math.radians(own.vertical_deg) ** 2 * speed2
        return lateral + axle2 * float(turn2[0] + turn2[2]), vertical + axle2 * float(turn2[0] + turn2[1])


def vehicle_axes(pitch: float, yaw: float) -> Float64:
    """Return the vehicle's axes forward, right, down (rows) in body axes, (3, 3): C_vb = R_z(yaw) R_y(pitch)."""
    cp, sp, cy, sy = math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    return np.array([[cy * cp, -sy, cy * sp], [sy * cp, cy, sy * sp], [-sp, 0.0, cp]])


def _rate_at_axle(state: StateEstimate) -> tuple[Float64, dict[str, Float64]]:
    """Return the rate against the Earth of the last moments, body axes (3,) [rad/s], and how the gyros' error grows."""
    window = state.recent(_RATE_WINDOW_S)
    if not len(window.t_ns):
        return rate_eb_b(state), state.gyro_error(state.w_ib_b, state.f_b)[1]
    w_ib_b, grows = mean_rate(state, window)
    return w_ib_b - state.C_eb.T @ EARTH_RATE_E, grows


@dataclass(frozen=True)
class Course(PeriodicMeasurement):
    """The nose points along the course, but for an angle that lasts."""

    settings: CourseRows
    nose_first: NoseFirst | None
    name: str = "course"
    unit: str = "rad"

    def rows(self, state: StateEstimate, layout: StateLayout) -> list[Row]:
        """Return the row, or nothing where the vehicle is slow or steep."""
        north, east, _ = state.v_n
        speed2, (roll, pitch, yaw) = float(north**2 + east**2), state.rpy_rad
        if speed2 < self.settings.above_mps**2 or abs(pitch) > _MOST_PITCH_RAD or abs(roll) > _MOST_ROLL_RAD:
            return []
        predicted = yaw + float(state.optional[LEEWAY]) - math.atan2(east, north)
        partials = {
            "attitude": state.rpy_by_attitude[2],
            "velocity": state.C_ne.T @ [east / speed2, -north / speed2, 0.0],
            LEEWAY: 1.0,
        }
        own = correlated(
            math.radians(self.settings.yawing_deg) ** 2, self.settings.correlation_s, self.period_s
        )
        return [Row(-math.remainder(predicted, math.pi), partials, own)]

    def unlikely(self, state: StateEstimate) -> float:
        """Return the charge on a heading under which the vehicle moves backward."""
        north, east, _ = state.v_n
        return log_weight(
            float(north * math.cos(state.yaw_rad) + east * math.sin(state.yaw_rad)), self.nose_first
        )
