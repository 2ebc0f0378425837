"""The flight of a scenario as truth: straight, a coordinated turn that hides satellites, straight; its errors drawn.

The logs are made by ``insgnss.simulation``, which knows nothing of the filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.flight import GivenStart, ImuGrade, Oscillator
from insgnss.config.library import imu_grade, oscillator
from insgnss.config.scenario import ScenarioConfig
from insgnss.constants import NS_PER_S
from insgnss.gpstime import week_seconds_to_ns
from insgnss.simulation.course import ManoeuvreSequence
from insgnss.simulation.imu import accelerometer_model, gyro_model, measure
from insgnss.simulation.observations import (
    NoiseTerms,
    SignalObservations,
    SignalPaths,
    SimulatedReceiver,
    antenna_motion,
    observe_paths,
    paths_to,
)
from insgnss.simulation.oscillator import simulate_clock
from insgnss.simulation.sky_law import SkyLaw
from insgnss.simulation.trajectory import Trajectory, reference_table
from insgnss.studies.saved_study import MOMENT_DECIMALS
from insgnss.studies.scenario_equipment import sky_of
from insgnss.tables import Float64, ImuTable, ReferenceTable, stretches_of
from insgnss.units import deg_to_rad

# of no meaning: the scenario begins with the week, so that seconds of the week are its own
SCENARIO_WEEK: Final = 2385
START_NS: Final = int(week_seconds_to_ns(SCENARIO_WEEK, 0.0))
_TURN_STEP_S: Final = 0.01  # of the integral of the turn rate; it changes over ``roll_s``
_LOOK_S: Final = 0.01  # resolution of the true moments of loss and return
_REFERENCE_HZ: Final = 10.0
_M_PER_RAD: Final = 6.37e6  # to shift a start by some metres


class Spell(NamedTuple):
    """A time span in which the airframe blocks a satellite completely."""

    sv: str
    from_s: float
    until_s: float


@dataclass(frozen=True)
class FlightDraw:
    """One realisation of all errors but those of false locks: every satellite observed all the time."""

    imu: ImuTable
    observations: SignalObservations
    paths: SignalPaths
    start: GivenStart


@dataclass(frozen=True)
class BankedFlight:
    """A scenario's flight with its truth computed; ``draw`` gives one realisation of the errors."""

    scenario: ScenarioConfig
    grade: ImuGrade
    oscillator: Oscillator
    sky: SkyLaw
    trajectory: Trajectory
    edges_s: Float64  # of the inertial samples' intervals
    rate_b: Float64  # true means over them
    force_b: Float64
    reference: ReferenceTable
    spells: tuple[Spell, ...]

    @classmethod
    def of(cls, scenario: ScenarioConfig, imu: str, clock: str) -> BankedFlight:
        """Return the flight with its inertial truth, which is most of the work."""
        flight, sky = scenario.flight, sky_of(scenario)
        trajectory = course_of(scenario).lay(
            scenario.place.lat_deg, scenario.place.lon_deg, scenario.place.h_m, first_heading_deg(scenario)
        )
        edges_s = np.arange(round(flight.duration_s * flight.imu_rate_hz) + 1) / flight.imu_rate_hz
        increments = trajectory.increments(edges_s)
        t_s = np.arange(round(flight.duration_s * _REFERENCE_HZ) + 1) / _REFERENCE_HZ
        return cls(
            scenario,
            imu_grade(imu),
            oscillator(clock),
            sky,
            trajectory,
            edges_s,
            increments.mean_rate(),
            increments.mean_specific_force(),
            reference_table(trajectory.motion(t_s), START_NS),
            true_spells(scenario, sky, trajectory),
        )

    def draw(self, rng: np.random.Generator) -> FlightDraw:
        """Return one realisation of sensors, clock, measurement noise and start."""
        flight, step_s = self.scenario.flight, 1.0 / self.scenario.flight.imu_rate_hz
        gyro = measure(self.rate_b, step_s, gyro_model(self.grade), rng)
        accel = measure(self.force_b, step_s, accelerometer_model(self.grade), rng)
        t_ns = START_NS + np.rint(self.edges_s[1:] * NS_PER_S).astype(np.int64)
        rate_hz = self.scenario.measurements.rate_hz
        tags = 1.0 + np.arange(int((flight.duration_s - 1.0) * rate_hz + 1e-9) + 1) / rate_hz
        clock = simulate_clock(
            self.oscillator, tags, rng, bias_m=flight.clock_bias_m, drift_mps=flight.clock_drift_mps
        )
        antenna = antenna_motion(self.trajectory, clock.true_s, (0.0, 0.0, 0.0))
        names = self.scenario.sv_names
        paths = paths_to(antenna, self.sky.states, len(names), clock.true_s)
        observations = observe_paths(
            paths, names, np.zeros(len(names)), START_NS, clock, receiver_of(self.scenario), rng
        )
        imu = ImuTable(t_ns, gyro.value, accel.value)
        return FlightDraw(imu, observations, paths, self._start(float(tags[0]), rng))

    def _start(self, at_s: float, rng: np.random.Generator) -> GivenStart:
        """Return the true state, off by one draw of the scenario's sigmas."""
        truth, sigma = (
            reference_table(self.trajectory.motion(np.array([at_s])), START_NS),
            self.scenario.start,
        )
        dn, de, dd = sigma.sd_position_m * rng.standard_normal(3)
        v_n = truth.v_n[0] + sigma.sd_velocity_mps * rng.standard_normal(3)
        level, heading = sigma.sd_roll_pitch_deg, sigma.sd_heading_deg
        rpy = truth.rpy_deg[0] + np.array([level, level, heading]) * rng.standard_normal(3)
        lat = float(truth.lat_deg[0])
        return GivenStart(
            time_s=at_s,
            lat_deg=lat + float(np.degrees(dn / _M_PER_RAD)),
            lon_deg=float(truth.lon_deg[0] + np.degrees(de / (_M_PER_RAD * np.cos(np.radians(lat))))),
            h_m=float(truth.h_m[0] - dd),
            v_ned_mps=(float(v_n[0]), float(v_n[1]), float(v_n[2])),
            rpy_deg=(float(rpy[0]), float(rpy[1]), float(rpy[2])),
            sd_position_m=sigma.sd_position_m,
            sd_velocity_mps=sigma.sd_velocity_mps,
            sd_roll_pitch_deg=level,
            sd_yaw_deg=heading,
        )


def course_of(scenario: ScenarioConfig) -> ManoeuvreSequence:
    """Return straight flight, the bank held from the outage's beginning to its end, straight flight.

    The turn is coordinated, rate = g tan(bank) / speed; rolling in ends when the outage begins.
    """
    flight, outage = scenario.flight, scenario.outage
    roll, roll_s = deg_to_rad(scenario.bank.roll_deg), flight.roll_s
    course = ManoeuvreSequence(flight.speed_mps)
    course.bank.steps += [(outage.from_s - roll_s, roll_s, roll), (outage.until_s, roll_s, -roll)]
    return course.hold(flight.duration_s)


def first_heading_deg(scenario: ScenarioConfig) -> float:
    """Return the heading to begin with so that half-way through the outage it is that of the scenario."""
    middle = 0.5 * (scenario.outage.from_s + scenario.outage.until_s)
    t_s = np.arange(0.0, middle, _TURN_STEP_S) + 0.5 * _TURN_STEP_S
    turned = float(np.sum(course_of(scenario).turn_rate(t_s)) * _TURN_STEP_S)
    return scenario.bank.heading_deg - float(np.degrees(turned))


def receiver_of(scenario: ScenarioConfig) -> SimulatedReceiver:
    """Return a receiver at the IMU with the scenario's white noise; its C/N0 follows the cardioid."""
    m = scenario.measurements
    return SimulatedReceiver(
        rate_hz=m.rate_hz,
        first_tag_s=1.0,
        horizon_mask_deg=-90.0,
        boresight_cn0_dbhz=m.cn0_dbhz,
        pseudorange_noise=NoiseTerms(m.range_variance_m2**0.5),
        range_rate_noise=NoiseTerms(m.rate_variance_m2ps2**0.5),
    )


def body_elevation(sky: SkyLaw, trajectory: Trajectory, t_s: Float64) -> Float64:
    """Return the true elevations (m, n) of the satellites over the body's own plane [rad].

    Neglects: the light time, 4e-5 rad of a satellite's motion.
    """
    motion = trajectory.motion(t_s)
    r_s = sky.states(np.broadcast_to(t_s[:, None], (len(t_s), len(sky.start)))).r_e
    towards = r_s - motion.r_e[:, None]
    towards /= np.linalg.norm(towards, axis=-1)[..., None]
    up_b = -np.einsum("mi,mni->mn", motion.C_eb[:, :, 2], towards)
    return np.asarray(np.arcsin(up_b))


def true_spells(scenario: ScenarioConfig, sky: SkyLaw, trajectory: Trajectory) -> tuple[Spell, ...]:
    """Return the true time spans in which the airframe hides each satellite."""
    t_s = np.arange(0.0, scenario.flight.duration_s, _LOOK_S)
    hidden = body_elevation(sky, trajectory, t_s) < deg_to_rad(scenario.antenna.body_mask_deg)
    spells = []
    for i, sv in enumerate(scenario.sv_names):
        for first, last in stretches_of(hidden[:, i]):
            # rounded, so that a tag at the border lies on one side of it wherever it is looked at
            ends = (round(float(t_s[k]), MOMENT_DECIMALS) for k in (first, min(last, len(t_s) - 1)))
            spells.append(Spell(sv, *ends))
    return tuple(spells)
