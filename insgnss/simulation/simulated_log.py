"""A whole flight in memory: logs with errors, and the truth behind them.

The expensive part, the inertial truth, is computed once per ``Simulator``; each ``draw`` then costs only random numbers
and the geometry of the GNSS epochs, which depends on the drawn clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.simulated_sensors import SensorFault, SimulatedSensor
from insgnss.constants import NS_PER_S
from insgnss.simulation.further_receivers import FurtherReceivers
from insgnss.simulation.imu import (
    ImuRecord,
    SensorOutput,
    VibrationSpectrum,
    accelerometer_model,
    gyro_model,
    measure,
    vibration,
)
from insgnss.simulation.observations import Fault, SimulatedReceiver, observe, to_table
from insgnss.simulation.oscillator import ClockTruth, simulate_clock, with_clock_jump
from insgnss.simulation.sensors import draw_sensor
from insgnss.simulation.trajectory import Trajectory, TrajectoryState
from insgnss.tables import Bool, Float64, GnssTable, ImuTable, Int64, NavigationData, SensorTable


@dataclass(frozen=True)
class ClockStart:
    """The receiver clock at its first tag, and how the receiver treats it."""

    bias_m: float = 0.0
    drift_mps: float = 0.0
    jump_beyond_m: float | None = None  # steps of whole milliseconds keep the bias inside this bound
    jumps: tuple[tuple[float, float], ...] = ()  # (tag [s], size [m]) each


@dataclass(frozen=True)
class Scenario:
    """The truth of a simulated flight."""

    trajectory: Trajectory
    navigation: NavigationData
    grade: ImuGrade
    oscillator: Oscillator
    start_ns: int  # GPS time of the trajectory's t = 0, where the IMU's first interval begins
    duration_s: float
    imu_rate_hz: float = 100.0
    gyro_resolution_rad: float | None = None  # of an increment
    accel_resolution_mps: float | None = None  # of an increment
    receiver: SimulatedReceiver = field(default_factory=SimulatedReceiver)
    clock: ClockStart = ClockStart()
    faults: Sequence[Fault] = ()
    gyro_vibration: VibrationSpectrum | None = None  # [rad/s]
    accel_vibration: VibrationSpectrum | None = None  # [m/s^2]
    record: ImuRecord = field(default_factory=ImuRecord)
    further: FurtherReceivers = field(default_factory=FurtherReceivers)
    sensors: tuple[SimulatedSensor, ...] = ()
    sensor_faults: tuple[SensorFault, ...] = ()


@dataclass(frozen=True)
class TrueStates:
    """The IMU's true motion and its hidden biases at given times."""

    t_ns: Int64  # (n,)
    r_e: Float64  # (n, 3) [m]
    v_e: Float64  # (n, 3) [m/s]
    C_eb: Float64  # (n, 3, 3)
    gyro_bias: Float64  # (n, 3) [rad/s]
    accel_bias: Float64  # (n, 3) [m/s^2]

    def take(self, rows: slice | Bool) -> TrueStates:
        """Return the given rows."""
        return TrueStates(
            *(getattr(self, name)[rows] for name in ("t_ns", "r_e", "v_e", "C_eb", "gyro_bias", "accel_bias"))
        )


@dataclass(frozen=True)
class SimulatedLog:
    """The logs, and the truth at the tags of both."""

    imu: ImuTable
    gnss: GnssTable
    navigation: NavigationData
    at_imu: TrueStates  # at each IMU sample's tag
    at_gnss: TrueStates  # at each GNSS tag, also where no satellite is tracked
    clock: ClockTruth  # at each GNSS tag
    gyro_scale_factor: Float64  # (3,) [-]
    accel_scale_factor: Float64  # (3,) [-]
    further: tuple[GnssTable, ...] = ()  # of the further antennas
    sensors: tuple[SensorTable, ...] = ()  # of the further sensors


class Simulator:
    """A scenario with its truth computed; ``draw`` gives one realisation of all errors."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        count = round(scenario.duration_s * scenario.imu_rate_hz)
        self.edges_ns = np.rint(np.arange(count + 1) * (NS_PER_S / scenario.imu_rate_hz)).astype(np.int64)
        edges_s = self.edges_ns / NS_PER_S
        increments = scenario.trajectory.increments(edges_s)
        self.rate_b = increments.mean_rate()
        self.force_b = increments.mean_specific_force()
        self.imu_motion = scenario.trajectory.motion(edges_s[1:])
        receiver = scenario.receiver
        epochs = int((scenario.duration_s - receiver.first_tag_s) * receiver.rate_hz + 1e-9) + 1
        self.tag_s = receiver.first_tag_s + np.arange(epochs) / receiver.rate_hz
        self.gnss_motion = scenario.trajectory.motion(self.tag_s)

    def draw(self, rng: np.random.Generator | None) -> SimulatedLog:
        """Return one realisation; without a generator, logs free of errors (the clock runs straight on)."""
        gyro, accel = self._sensors(rng)
        clock = self._clock(rng)
        s = self.scenario
        observations = observe(
            s.trajectory, s.navigation.ephemerides, s.start_ns, clock, s.receiver, rng, s.faults
        )
        imu = ImuTable(s.start_ns + self.edges_ns[1:], gyro.value, accel.value)
        imu, kept = (imu, slice(None)) if rng is None else s.record.log(imu, rng)
        return SimulatedLog(
            imu=imu,
            gnss=to_table(observations, s.start_ns),
            navigation=s.navigation,
            at_imu=self._states(self.imu_motion, gyro, accel).take(kept),
            at_gnss=self._states(self.gnss_motion, gyro, accel),
            clock=clock,
            gyro_scale_factor=gyro.scale_factor,
            accel_scale_factor=accel.scale_factor,
            # drawn last: a scenario's other numbers are the same with and without further antennas
            further=s.further.draw(
                s.trajectory,
                s.navigation.ephemerides,
                s.start_ns,
                clock,
                lambda bias_m: self._clock(rng, bias_m),
                rng,
            ),
            sensors=tuple(
                draw_sensor(sensor, s.trajectory, s.duration_s, s.start_ns, rng, s.sensor_faults)
                for sensor in s.sensors
            ),
        )

    def _sensors(self, rng: np.random.Generator | None) -> tuple[SensorOutput, SensorOutput]:
        if rng is None:
            nothing = np.zeros_like(self.rate_b)
            return (
                SensorOutput(self.rate_b, nothing, np.zeros(3)),
                SensorOutput(self.force_b, nothing, np.zeros(3)),
            )
        s = self.scenario
        step_s = 1.0 / s.imu_rate_hz
        count = len(self.rate_b)
        turning, shaking = (
            None if spectrum is None else vibration(count, step_s, spectrum, rng)
            for spectrum in (s.gyro_vibration, s.accel_vibration)
        )
        model = gyro_model(s.grade, s.gyro_resolution_rad)
        gyro = measure(self.rate_b, step_s, model, rng, force=self.force_b, shaking=turning)
        accelerometer = accelerometer_model(s.grade, s.accel_resolution_mps)
        return gyro, measure(self.force_b, step_s, accelerometer, rng, shaking=shaking)

    def _clock(self, rng: np.random.Generator | None, more_bias_m: float = 0.0) -> ClockTruth:
        start = self.scenario.clock
        oscillator = self.scenario.oscillator
        if rng is None:
            oscillator, rng = Oscillator(h0_s=0.0, h_minus2_per_s=0.0), np.random.default_rng(0)
        clock = simulate_clock(
            oscillator,
            self.tag_s,
            rng,
            bias_m=start.bias_m + more_bias_m,
            drift_mps=start.drift_mps,
            jump_beyond_m=start.jump_beyond_m,
        )
        for at_s, size_m in start.jumps:
            clock = with_clock_jump(clock, at_s, size_m)
        return clock

    def _states(self, motion: TrajectoryState, gyro: SensorOutput, accel: SensorOutput) -> TrueStates:
        """Return the truth at the times of ``motion``; biases between IMU tags are interpolated."""
        t_ns = np.rint(motion.t_s * NS_PER_S).astype(np.int64)
        tags = self.edges_ns[1:].astype(np.float64)

        def at(bias: Float64) -> Float64:
            return np.column_stack([np.interp(t_ns, tags, bias[:, axis]) for axis in range(3)])

        gyro_bias, accel_bias = at(gyro.bias), at(accel.bias)
        return TrueStates(
            self.scenario.start_ns + t_ns, motion.r_e, motion.v_e, motion.C_eb, gyro_bias, accel_bias
        )


def simulate(scenario: Scenario, rng: np.random.Generator | None) -> SimulatedLog:
    """Return one realisation of a scenario; for many, keep a ``Simulator`` and draw from it."""
    return Simulator(scenario).draw(rng)
