"""Runs whose truth is drawn from the filter's own model: what a consistent filter is measured on.

The flight is ``airborne_turns`` at 100 Hz with one GNSS epoch a second; biases are pure Gauss-Markov processes, the
scale factors are zero, the noise is white with the filter's own formula, the atmosphere is left out on both sides. The
filter is opened at the truth plus a draw from its first covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.config.filter import Adaptation, FilterConfig, HealthConfig, Measurements, NoiseConfig
from insgnss.config.flight import ImuGrade, Oscillator
from insgnss.config.process import Process
from insgnss.filter.loop import ImuSamples
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import Output, new_output
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, PSI, STATE_NAMES, Bank, new_bank
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import matrix_to_quaternion
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows, prepare_rows
from insgnss.inertial.sensor_model import sensor_model
from insgnss.simulation.observations import NoiseTerms, SimulatedReceiver
from insgnss.simulation.sample_trajectories import airborne_turns
from insgnss.simulation.simulated_log import ClockStart, Scenario, SimulatedLog, Simulator
from insgnss.status import USED
from insgnss.studies.matched_flight import error_state as error_state
from insgnss.tables import Float64
from tests.runs.scenes import START_NS, paper_sky

DURATION_S = 120.0
N_STATES = len(STATE_NAMES)
BLOCKS = {
    "whole": slice(0, N_STATES),
    "position": slice(DR, DR + 3),
    "velocity": slice(DV, DV + 3),
    "attitude": slice(PSI, PSI + 3),
    "accelerometer bias": slice(BA, BA + 3),
    "gyro bias": slice(BG, BG + 3),
    "clock": slice(CLOCK, DRIFT + 1),
}
# Correlation times of half the flight: a wrong decay or a wrong driving noise of the biases has time to show.
GRADE = ImuGrade(
    gyro_bias_deg_per_h=0.0,
    gyro_bias_instability_deg_per_h=20.0,
    gyro_correlation_time_s=60.0,
    gyro_arw_deg_per_sqrt_h=0.1,
    accel_bias_mg=0.0,
    accel_bias_instability_mg=2.0,
    accel_correlation_time_s=60.0,
    accel_vrw_mps_per_sqrt_h=0.06,
)
CLOCK_TYPE = Oscillator(h0_s=2e-19, h_minus2_per_s=2e-21)
LEVER_ARM_B = (0.8, 0.3, -1.1)
RANGE_NOISE = NoiseTerms(floor=0.8, elevation=0.3, cn0=0.5)
RATE_NOISE = NoiseTerms(floor=0.05, elevation=0.02, cn0=0.03)
SD_POSITION_M, SD_VELOCITY_MPS, SD_LEVEL_RAD, SD_YAW_RAD = 3.0, 0.3, np.radians(0.3), np.radians(1.0)
SD_CLOCK_M, SD_DRIFT_MPS = 10.0, 1.0


def matched_simulator() -> Simulator:
    """Return the scenario with its truth computed."""
    receiver = SimulatedReceiver(
        LEVER_ARM_B, first_tag_s=1.0, pseudorange_noise=RANGE_NOISE, range_rate_noise=RATE_NOISE
    )
    clock = ClockStart(bias_m=30.0, drift_mps=5.0)
    flight = airborne_turns(DURATION_S)
    return Simulator(
        Scenario(flight, paper_sky(), GRADE, CLOCK_TYPE, START_NS, DURATION_S, receiver=receiver, clock=clock)
    )


def matched_setup() -> FilterSetup:
    """Return a filter that knows exactly what was simulated."""
    config = FilterConfig(
        measurements=Measurements(ionosphere="none", troposphere="none", elevation_mask_deg=0.0),
        pseudorange_noise_m=_noise(RANGE_NOISE),
        range_rate_noise_mps=_noise(RATE_NOISE),
        process=Process(imu_time_sigma_s=0.0),
        adaptation=Adaptation(on=False),
        health=HealthConfig(
            suspicion_sigma=0.0
        ),  # of a filter that believes too much every satellite is a suspect
    )
    return FilterSetup(config, GRADE, CLOCK_TYPE, LEVER_ARM_B, navigation=paper_sky())


def _noise(terms: NoiseTerms) -> NoiseConfig:
    return NoiseConfig(floor=terms.floor, elevation=terms.elevation, cn0_at_45_dbhz=terms.cn0)


@dataclass(frozen=True)
class MatchedRun:
    """One run: error state and covariance after the update of the asked epochs, and the innovations of all."""

    error: Float64  # (k, 17) estimate minus truth
    P: Float64  # (k, 17, 17)
    innovation: Float64  # (2, m, n) over their sigma by kind, epoch and satellite, NaN where not used
    predicted_share: Float64  # (2, m, n) of the innovation's variance that the state's covariance makes


def matched_run(
    log: SimulatedLog, setup: FilterSetup, epochs: tuple[int, ...], rng: np.random.Generator
) -> MatchedRun:
    """Open a filter at the first epoch, which is spent on that, and run it through the log, looking at ``epochs``."""
    use = setup.config.measurements
    rows = prepare_rows(
        log.gnss, setup.navigation, None, clock_groups=setup.clock_groups, signals=dict(use.signals)
    )
    out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64))
    imu = ImuSamples(log.imu.t_ns, log.imu.w_ib_b, log.imu.f_b)
    navigator = Navigator(setup)
    navigator.bank = opened_bank(log, rng)
    navigator.started_ns = int(log.at_gnss.t_ns[0])
    errors, covariances = [], []
    done = 1
    for epoch in (*epochs, len(rows.epoch_ns) - 1):
        navigator.run(imu, rows, done, epoch + 1, out)
        done = epoch + 1
        assert navigator.bank is not None
        errors.append(error_state(navigator.bank.state[0], log, epoch))
        covariances.append(navigator.bank.P[0].copy())
    assert not navigator.events, navigator.events
    kept = slice(0, len(epochs))
    return MatchedRun(np.array(errors[kept]), np.array(covariances[kept]), *innovations(rows, out))


def innovations(rows: GnssRows, out: Output) -> tuple[Float64, Float64]:
    """Return the used innovations over their sigma and the predicted share of their variance, both (2, m, n)."""
    seen = slice(rows.first[1], None)  # the first epoch went into the opening
    ledger = out.ledger[seen]
    epoch = np.repeat(np.arange(len(rows.epoch_ns)), np.diff(rows.first))[seen]
    sv = rows.observation["sv"][seen]
    scaled, share = np.full((2, 2, len(rows.epoch_ns), int(sv.max()) + 1), np.nan)
    for kind in (PSEUDORANGE, RANGE_RATE):
        used = ledger["status"][:, kind] == USED
        entry, at = ledger[used], (kind, epoch[used], sv[used])
        scaled[at] = entry["innovation"][:, kind] / np.sqrt(entry["variance"][:, kind])
        share[at] = entry["predicted"][:, kind] / entry["variance"][:, kind]
    return scaled, share


def opened_bank(log: SimulatedLog, rng: np.random.Generator) -> Bank:
    """Return a filter at the first epoch, its error a draw from its covariance; the biases are estimated as zero."""
    truth, P = log.at_gnss, first_covariance(log)
    e = np.linalg.cholesky(P) @ rng.standard_normal(N_STATES)
    bank = new_bank(1, 0)
    m = bank.state[0]
    m.r_e[:] = truth.r_e[0] + e[DR : DR + 3]
    m.v_e[:] = truth.v_e[0] + e[DV : DV + 3]
    m.C_eb[:] = Rotation.from_rotvec(e[PSI : PSI + 3]).as_matrix() @ truth.C_eb[0]
    matrix_to_quaternion(m.C_eb.copy(), m.q_eb)
    m.clock[:] = log.clock.bias_m[0] + e[CLOCK], log.clock.drift_mps[0] + e[DRIFT]
    bank.P[0] = P
    bank.head["now_ns"] = truth.t_ns[0]
    bank.head["epoch_ns"] = truth.t_ns[0]
    bank.head["next"] = np.searchsorted(log.imu.t_ns, truth.t_ns[0], side="right")
    return bank


def first_covariance(log: SimulatedLog) -> Float64:
    """Return the covariance of the opening; of the biases the stationary one."""
    sensor = sensor_model(GRADE)
    C_ne = np.zeros((3, 3))
    lat, lon, _ = ecef_to_geodetic(log.at_gnss.r_e[0].copy())
    ecef_to_ned_matrix(lat, lon, C_ne)
    sd = np.zeros(N_STATES)
    sd[DR : DR + 3], sd[DV : DV + 3] = SD_POSITION_M, SD_VELOCITY_MPS
    sd[BA : BA + 3], sd[BG : BG + 3] = sensor.accel_bias.sigma, sensor.gyro_bias.sigma
    sd[CLOCK], sd[DRIFT] = SD_CLOCK_M, SD_DRIFT_MPS
    P = np.diag(sd**2)
    P[PSI : PSI + 3, PSI : PSI + 3] = C_ne.T @ np.diag([SD_LEVEL_RAD, SD_LEVEL_RAD, SD_YAW_RAD]) ** 2 @ C_ne
    return P
