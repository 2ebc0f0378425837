"""Where a filter without raw GNSS data starts: at a given state, or at position fixes.

Two fixes at least half a second apart are taken. Position: the second fix. Velocity: that of a velocity sensor at its
time, else the way between the fixes over their time, an acceleration of 1 m/s^2 in its sigma. Roll and pitch: the mean
specific force of the last second. Heading: open, around the course where there is one; the fixes and other information
on heading decide.

Where velocities and samples show rest, the start is that of an automatic start at rest: levelled with the sigma of the
accelerometers' biases, and with the gyros' biases from their mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import GivenStart
from insgnss.config.imu import ImuGrade
from insgnss.config.sensors import PositionSensor, VelocitySensor
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.rest import (
    MeasuredVelocity,
    samples_show_rest,
    slight_acceleration,
    velocities_show_rest,
)
from insgnss.filter.start.start import StartAttitude, attitudes_at_start, open_headings
from insgnss.filter.start.without_gnss import TimedStart
from insgnss.geodesy.local_level import ecef_to_ned_matrix, level_axes
from insgnss.inertial.alignment import inertial_window
from insgnss.log.flight import Flight, FlightLogs
from insgnss.sensors.position_fixes import fix_ecef
from insgnss.tables import Float64, SensorTable

_LEVELLING_NS: Final = NS_PER_S
_SHORTEST_PAIR_NS: Final = NS_PER_S // 2  # their way is then longer than the fixes' own errors
_LONGEST_PAIR_NS: Final = 10 * NS_PER_S
_ACCELERATION_MPS2: Final = 1.0  # of what drives and flies, one sigma
_COURSE_MPS: Final = 3.0
_SD_LEVEL_DEG: Final = (2.0, 6.0)  # at rest, in motion
_REST_MPS: Final = 0.5


@dataclass(frozen=True)
class StartFromFixes:
    """The start of each stretch of inertial samples."""

    given: TimedStart | None
    positions: tuple[PositionSensor, SensorTable]
    velocities: tuple[VelocitySensor, SensorTable] | None
    config: FilterConfig
    grade: ImuGrade

    def __call__(self, imu: ImuSamples) -> TimedStart | None:
        """Return the start of a stretch: the given one inside it, else that of the first two fixes; None without."""
        if self.given is not None and imu.t_ns[0] < self.given.t_ns < imu.t_ns[-1]:
            return self.given
        _, table = self.positions
        inside = (table.t_ns > imu.t_ns[0] + _LEVELLING_NS) & (table.t_ns < imu.t_ns[-1])
        good = np.flatnonzero(inside & np.isfinite(table.values).all(axis=1))
        t_ns = table.t_ns[good]
        # of each fix the last that is early enough before it
        earlier = np.searchsorted(t_ns, t_ns - _SHORTEST_PAIR_NS, side="right") - 1
        pairs = np.flatnonzero((earlier >= 0) & (t_ns - t_ns[earlier] <= _LONGEST_PAIR_NS))
        if not len(pairs):
            return None
        return self._start(imu, int(good[earlier[pairs[0]]]), int(good[pairs[0]]))

    def _start(self, imu: ImuSamples, first: int, second: int) -> TimedStart:
        config, table = self.positions
        t_ns, place = int(table.t_ns[second]), table.values[second]
        sigma = _sigma(table.sigma[second], config.sigma_m)
        way = self._way(first, second)
        read = self._velocity_read(t_ns, way)
        v_n, sd_v = (way.v, _sd(way)) if read is None else (read.v, math.hypot(_sd(read), 0.3))
        speed = float(np.linalg.norm(v_n))
        samples = (imu.t_ns > t_ns - _LEVELLING_NS) & (imu.t_ns <= t_ns)
        f = imu.f_b[samples].mean(axis=0)
        roll, pitch = math.atan2(-f[1], -f[2]), math.atan2(f[0], math.hypot(f[1], f[2]))
        moving = math.hypot(v_n[0], v_n[1]) > max(_COURSE_MPS, 3.0 * sd_v)
        yaw = math.atan2(v_n[1], v_n[0]) if moving else 0.0
        state = GivenStart(
            lat_deg=math.degrees(place[0]),
            lon_deg=math.degrees(place[1]),
            h_m=float(place[2]),
            v_ned_mps=(float(v_n[0]), float(v_n[1]), float(v_n[2])),
            rpy_deg=(math.degrees(roll), math.degrees(pitch), math.degrees(yaw)),
            sd_position_m=math.hypot(sigma, float(np.linalg.norm(config.lever_arm_m))),
            sd_velocity_mps=sd_v,
            sd_roll_pitch_deg=_SD_LEVEL_DEG[speed > _REST_MPS],
            sd_yaw_deg=90.0 if moving else 180.0,
        )
        attitudes = self._at_rest(imu, place, int(table.t_ns[first]), way)
        how = "at rest" if attitudes else f"at {speed:.1f} m/s"
        return TimedStart(
            t_ns, state, f"from two fixes of '{config.label}', {how}; heading unknown", attitudes
        )

    def _at_rest(
        self, imu: ImuSamples, place: Float64, first_ns: int, way: MeasuredVelocity
    ) -> tuple[StartAttitude, ...]:
        """Return the attitudes of a vehicle that stands, with the gyros' biases; nothing if that is not shown.

        Velocities at both fixes and the samples before the second have to show it, as for an automatic start.
        """
        begin_ns = way.t_ns - round(self.config.start.window_s * NS_PER_S)
        window = inertial_window(*imu[:3], begin_ns, way.t_ns)
        before, now = (self._velocity_read(each, way) for each in (first_ns, way.t_ns))
        if window is None or before is None or now is None:
            return ()
        slow = velocities_show_rest(now, before, self.config)
        if not (slow and samples_show_rest(window, self.config, self.grade)):
            return ()
        r_e = fix_ecef(place, 0.0)
        v_e, sd_a = level_axes(r_e).T @ now.v, slight_acceleration(now, before)
        headings = open_headings(r_e, v_e, now.P, self.config)
        return tuple(attitudes_at_start(window, r_e, v_e, None, sd_a, self.config, self.grade, headings))

    def _velocity_read(self, t_ns: int, way: MeasuredVelocity) -> MeasuredVelocity | None:
        """Return a velocity north, east, down read near a time, components that it lacks by the way; else None."""
        if self.velocities is None:
            return None
        config, found = self.velocities
        values, stated = (each[0] for each in found.at_times(np.array([t_ns])))
        lacking = np.array(config.lacking)
        if np.isnan(values[~lacking]).any():
            return None
        P = _sigma(stated, config.sigma_mps) ** 2 * np.eye(3)
        P[lacking] = way.P[lacking]
        return MeasuredVelocity(t_ns, np.where(lacking, way.v, values), P)

    def _way(self, first: int, second: int) -> MeasuredVelocity:
        """Return the velocity north, east, down at the second fix by the way since the first."""
        config, table = self.positions
        C_ne = np.zeros((3, 3))
        ecef_to_ned_matrix(table.values[second, 0], table.values[second, 1], C_ne)
        dt = float(table.t_ns[second] - table.t_ns[first]) / NS_PER_S
        way = fix_ecef(table.values[second], 0.0) - fix_ecef(table.values[first], 0.0)
        sigma = _sigma(table.sigma[second], config.sigma_m)
        sd = math.hypot(math.sqrt(2.0) * sigma / dt, _ACCELERATION_MPS2 * dt)
        return MeasuredVelocity(int(table.t_ns[second]), C_ne @ way / dt, sd**2 * np.eye(3))


def started_without_gnss(setup: FilterSetup, flight: Flight, logs: FlightLogs) -> FilterSetup:
    """Return the setup of a flight without raw GNSS data, which its position fixes start and carry."""
    given = None
    if setup.start is not None:
        t_ns = int(logs.imu.t_ns[1]) if setup.start_ns is None else setup.start_ns
        given = TimedStart(t_ns, setup.start, "from the given state")
    kinds: dict[type, Any] = {}
    by_name = {table.name: table for table in logs.sensors}
    for sensor in flight.config.sensor:
        if sensor.label in by_name:
            kinds.setdefault(type(sensor), (sensor, by_name[sensor.label]))
    positions = kinds.get(PositionSensor)
    alone = None
    if positions is not None:
        velocities = kinds.get(VelocitySensor)
        alone = StartFromFixes(given, positions, velocities, setup.config, setup.grade)
    return replace(setup, start=None, start_ns=None, start_alone=alone)


def refuse_live_without_gnss(flight: Flight) -> None:
    """Refuse a streaming engine that would wait for ever.

    Raises
    ------
    ConfigError : the flight has position fixes alone
    """
    if not flight.config.gnss.files:
        raise ConfigError(
            "the streaming engine starts with raw GNSS epochs, and the flight has position fixes alone",
            key="gnss.files",
            advice="give [gnss] for the engine; replay runs on position fixes alone",
        )


def _sd(velocity: MeasuredVelocity) -> float:
    """Return the sigma of a velocity's components across."""
    return math.sqrt(velocity.P[0, 0])


def _sigma(stated: Float64, given: Sequence[float] | None) -> float:
    """Return the largest of a reading's sigmas."""
    known = np.where(np.isfinite(stated), stated, np.nan if given is None else np.array(given))
    return float(np.nanmax(known)) if np.isfinite(known).any() else 10.0
