"""The one-stage receiver with an inertial system, 17 states, by the linear theory: its covariance along a manoeuvre.

The 11 states of ``one_stage_model`` take the error of the INS for an acceleration. Here the errors of its attitude and
the biases of its sensors are states: position, velocity, attitude, biases of accelerometers and gyros, clock. They make
a velocity error in proportion to the specific force, so the covariance has no steady state; it is carried along a
flown motion by the package's error dynamics and corrected by the phases of all satellites, every T, with the filter's
scalar update. Phases are pseudo-coordinates, ``phi_i = k (-u_i . x + b)``, white noise of the discriminator.

    trajectory = course_of([RandomMotion(...)], 200.0).lay(55.0, 37.0, 2e4, 0.0, knot_s=0.02)
    receiver = ManoeuvringReceiver.of(trajectory, imu_grade("industrial"), 100.0, 1.6e9, sky)
    receiver.errors(loop, 40.0).velocity_mps              # 0.0042; attitude 0.82'
    receiver.threshold(loop).js_db

Neglects: scale factors and misalignments of the sensors, the motion of the satellites, and what sampling and latency of
the INS cost. Biases are Gauss-Markov of the grade's constant bias and correlation time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from insgnss.config.flight import ImuGrade
from insgnss.errors import ConfigError
from insgnss.filter.update.scalar_update import predicted_variance, scalar_update
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.inertial.error_dynamics import (
    COUPLING_DTYPE,
    Couplings,
    StepSpace,
    carry_covariance,
    step_space,
    transition_step,
)
from insgnss.inertial.error_state import BA, BG, CLOCK, DR, DRIFT, DV, FURTHER, PSI
from insgnss.inertial.sensor_model import sensor_model
from insgnss.interference.checks import positive
from insgnss.interference.discriminators import equivalent_noise
from insgnss.interference.drift import per_mps
from insgnss.interference.linear_threshold import require_cn0, threshold_cn0_dbhz
from insgnss.interference.margin import PhaseLoop, db, ratio
from insgnss.interference.phase_models import checked_directions
from insgnss.kernels.jit import kernel
from insgnss.simulation.trajectory import Trajectory
from insgnss.tables import Float64, Int64
from insgnss.units import deg_per_h_to_radps, mg_to_mps2

_COLUMNS: Final = np.array([DR, DR + 1, DR + 2, CLOCK])
# one sigma of each axis [m], [m/s], [rad]; forgotten within seconds
_START: Final = {DR: 1.0, DV: 0.1, PSI: 0.01}
_HIGHEST_CN0_DBHZ: Final = 60.0
_PRECISION_DB: Final = 0.002


class Drive(NamedTuple):
    """Driving noise of the covariance in a step of the filter."""

    step_s: float
    noise: Float64  # (17,) variance that half a step adds to each state
    keep: Float64  # (17,) factor of a step on each state of first order
    r_e: Float64  # (3,) place [m]
    rows: Float64  # (m, 4) of the phases: position and clock [rad/m]
    columns: Int64  # (4,) where the entries of a row stand


class ManoeuvringErrors(NamedTuple):
    """Rms along the motion, before the updates."""

    velocity_mps: float  # 3-D
    attitude_rad: float  # 3-D
    phase_rms_rad: Float64  # (m,)


class ManoeuvringThreshold(NamedTuple):
    """Where the largest phase rms reaches the discriminator's threshold."""

    cn0_dbhz: float
    js_db: float


@kernel
def carry_along(
    drive: Drive,
    force_e: Float64,
    sums_C: Float64,
    variance: float,
    couplings: Couplings,
    P: Float64,
    scratch: tuple[StepSpace, Float64],
    variances: Float64,
) -> None:
    """Propagate a covariance along a motion and write the variances before each step's updates.

    Parameters
    ----------
    force_e, sums_C : (n, 3) specific forces [m/s^2] and (n, 3, 3) attitudes of the steps, times their length [s]
    variance : of one phase [rad^2]
    couplings : (0,) of ``COUPLING_DTYPE``
    P : (17, 17) in and out
    scratch : of a step, and (3, 17) of an update
    variances : (n, 2 + m) of velocity and attitude, summed over the axes, and of the phases, out
    """
    dt, (space, gain) = drive.step_s, scratch
    for k in range(len(force_e)):
        f = force_e[k]
        step = transition_step(dt, f[0] * dt, f[1] * dt, f[2] * dt, drive.r_e)
        for i in range(P.shape[0]):
            P[i, i] += drive.noise[i]
        carry_covariance(step, sums_C[k], couplings, drive.keep, P, space)
        for i in range(P.shape[0]):
            P[i, i] += drive.noise[i]
        variances[k, 0] = P[DV, DV] + P[DV + 1, DV + 1] + P[DV + 2, DV + 2]
        variances[k, 1] = P[PSI, PSI] + P[PSI + 1, PSI + 1] + P[PSI + 2, PSI + 2]
        for c in range(len(drive.rows)):
            variances[k, 2 + c] = predicted_variance(P, drive.rows[c], drive.columns)
        for c in range(len(drive.rows)):
            scalar_update(P, drive.rows[c], drive.columns, 0.0, variance, gain)


@dataclass(frozen=True)
class ManoeuvringReceiver:
    """A one-stage receiver of 17 states on a motion."""

    drive: Drive
    P0: Float64  # (17, 17)
    force_e: Float64  # (n, 3)
    C_eb: Float64  # (n, 3, 3)

    @classmethod
    def of(
        cls,
        trajectory: Trajectory,
        grade: ImuGrade,
        drift: float,
        carrier_hz: float,
        directions: Float64,
        step_s: float = 5e-3,
    ) -> ManoeuvringReceiver:
        """Return the receiver that flies a whole trajectory.

        Parameters
        ----------
        drift : S of the oscillator, one-sided [rad^2/s^3]
        directions : (m, 3) unit vectors from user to satellites, north-east-down at the trajectory's begin
        step_s : between two updates

        Raises
        ------
        ConfigError : directions, drift, carrier or step make no sense
        """
        u, k = checked_directions(directions), per_mps(carrier_hz)
        T = float(positive("step_s", step_s, "give the time between two updates in seconds"))
        S = float(positive("drift", drift, "the oscillator's one-sided density in rad^2/s^3 is above zero"))
        t = np.arange(trajectory.first_s + 0.5 * T, trajectory.last_s - 0.5 * T, T)
        if len(t) < 1:
            raise ConfigError(
                "the trajectory is shorter than a step", key="step_s", advice="take a smaller one"
            )
        C_eb = np.ascontiguousarray(trajectory.rotation_eb(t).as_matrix())
        force = np.einsum("nij,nj->ni", C_eb, trajectory.specific_force_b(t))
        r_e = np.ascontiguousarray(trajectory.position_e(t[:1])[0])
        C_ne = ned_axes(geodetic(r_e[None]))[0]
        rows = np.column_stack([-k * u @ C_ne, np.full(len(u), k)])
        noise, keep, P0 = _sensors(grade, 0.5 * S / k**2, T)
        return cls(
            Drive(T, noise, keep, r_e, np.ascontiguousarray(rows), _COLUMNS),
            P0,
            np.ascontiguousarray(force),
            C_eb,
        )

    def errors(self, loop: PhaseLoop, cn0_dbhz: float, settle_s: float = 60.0) -> ManoeuvringErrors:
        """Return the rms errors at a C/N0, those of the first ``settle_s`` left out.

        Raises
        ------
        ConfigError : C/N0 out of range, or nothing left of the motion
        """
        first = round(settle_s / self.drive.step_s) if math.isfinite(settle_s) else -1
        if not 0 <= first < len(self.force_e):
            raise ConfigError(
                f"no motion remains after {settle_s:g} s",
                key="settle_s",
                advice="give less, or a longer motion",
            )
        require_cn0(cn0_dbhz, _HIGHEST_CN0_DBHZ)
        noise = float(equivalent_noise(loop.discriminator, ratio(-cn0_dbhz), loop.accumulation_s))
        variances = np.empty((len(self.force_e), 2 + len(self.drive.rows)))
        carry_along(
            self.drive,
            self.force_e,
            self.C_eb * self.drive.step_s,
            0.5 * noise / self.drive.step_s,
            np.zeros(0, COUPLING_DTYPE),
            self.P0.copy(),
            (step_space(FURTHER), np.zeros((3, FURTHER))),
            variances,
        )
        rms = np.sqrt(variances[first:].mean(axis=0))
        return ManoeuvringErrors(float(rms[0]), float(rms[1]), rms[2:])

    def threshold(self, loop: PhaseLoop, settle_s: float = 60.0) -> ManoeuvringThreshold:
        """Return the C/N0 at which the largest phase rms reaches A_d C_A, and J/S, to 0.002 dB.

        Raises
        ------
        ConfigError : lock holds at -10 dBHz, or goes at 60 dBHz
        """
        cn0 = threshold_cn0_dbhz(
            lambda cn0_dbhz: self.errors(loop, cn0_dbhz, settle_s).phase_rms_rad,
            loop,
            _HIGHEST_CN0_DBHZ,
            _PRECISION_DB,
        )
        return ManoeuvringThreshold(cn0, float(db(loop.bandwidth_hz)) - cn0)


def _sensors(grade: ImuGrade, drift_density: float, step_s: float) -> tuple[Float64, Float64, Float64]:
    """Return half a step's noise (17,), the decays (17,) and P0 of a grade and a clock drift's density [m^2/s^3]."""
    sensor = sensor_model(grade)
    noise, keep, start = np.zeros(FURTHER), np.ones(FURTHER), np.ones(FURTHER)
    biases = (
        (BA, mg_to_mps2(grade.accel_bias_mg), grade.accel_correlation_time_s),
        (BG, deg_per_h_to_radps(grade.gyro_bias_deg_per_h), grade.gyro_correlation_time_s),
    )
    for at, sigma, time_s in biases:
        noise[at : at + 3] = 2.0 * sigma**2 / time_s
        keep[at : at + 3] = math.exp(-step_s / time_s)
        start[at : at + 3] = sigma
    for at, sigma in _START.items():
        start[at : at + 3] = sigma
    noise[DV : DV + 3], noise[PSI : PSI + 3] = sensor.accel_density, sensor.gyro_density
    noise[DRIFT] = drift_density
    return 0.5 * step_s * noise, keep, np.diag(start**2)
