"""Flights whose errors are drawn from the filter's own model: Monte Carlo of the filter, and its covariance alone.

The flight is ``airborne_turns`` under the paper's eleven satellites. Biases are pure Gauss-Markov processes with the
grade's bias for sigma, scale factors are zero, noise is white with the filter's formula, there is no atmosphere; the
filter is opened at the truth plus a draw from its first covariance. ``noise_factor`` makes the drawn measurements worse
than the filter believes.

One filter's run is compiled and leaves Python's lock free: ``monte_carlo`` shares the runs out among threads.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.config.filter import FilterConfig
from insgnss.config.flight import FlightConfig, Gnss, ImuConfig, ImuGrade
from insgnss.config.library import filter_config, find, imu_grade, oscillator
from insgnss.config.simulation import SimulationConfig
from insgnss.config.slow_errors import NO_SLOW_ERRORS
from insgnss.config.strict import load_toml
from insgnss.constants import NS_PER_WEEK
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import new_output
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, Bank, StateRecord, new_bank
from insgnss.geodesy.local_level import level_axes
from insgnss.geodesy.rotations import matrix_to_quaternion
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.gpstime import week_seconds_to_ns
from insgnss.inertial.sensor_model import sensor_model
from insgnss.kernels.compiled_ahead import usable_cores
from insgnss.log.flight import FlightInMemory, FlightLogs
from insgnss.results.shown import ResultDisplay
from insgnss.simulation.assembly import assemble
from insgnss.simulation.observations import NoiseTerms, SimulatedReceiver
from insgnss.simulation.sample_trajectories import AIRFIELD, airborne_turns
from insgnss.simulation.simulated_log import ClockStart, Scenario, SimulatedLog, Simulator
from insgnss.simulation.sky import PAPER_SKY, constellation_over
from insgnss.simulation.trajectory import Trajectory, reference_table
from insgnss.status import USED
from insgnss.tables import Float64, NavigationData

N_STATES: Final = OFFSETS
BLOCKS: Final[Mapping[str, slice]] = {
    "whole": slice(0, N_STATES),
    "position": slice(DR, DR + 3),
    "velocity": slice(DV, DV + 3),
    "attitude": slice(PSI, PSI + 3),
    "accel_bias": slice(BA, BA + 3),
    "gyro_bias": slice(BG, BG + 3),
    "clock": slice(CLOCK, DRIFT + 1),
}
_WEEK: Final = 2385
_START_NS: Final = int(week_seconds_to_ns(_WEEK, 293_700.0))
_TOE_NS: Final = int(week_seconds_to_ns(_WEEK, 295_200.0))
_FIRST_TAG_S: Final = 1.0
_LEVER_B: Final = (0.8, 0.3, -1.1)
_OPENING: Final = {"position_m": 3.0, "velocity_mps": 0.3, "level_deg": 0.3, "yaw_deg": 1.0}
_OPENING_CLOCK: Final = (10.0, 1.0)  # [m], [m/s]


class FlightRealisation(NamedTuple):
    """One realisation of all errors, as the filter gets it, and the truth."""

    log: SimulatedLog
    imu: ImuSamples
    rows: GnssRows
    bank: Bank


class FilterErrors(NamedTuple):
    """One filter's run, at the epochs looked at."""

    error: Float64  # (k, 17) estimate minus truth
    sd: Float64  # (k, 17) the filter's own
    nees: Float64  # (k, 7) of ``BLOCKS``
    P: Float64  # (k, 17, 17)
    nis: Float64  # (2,) means of pseudoranges and range rates
    n_used: tuple[int, int]
    n_refused: int

    def __repr__(self) -> str:
        return (
            f"FilterErrors({len(self.error)} epochs; {_nees_words(self.nees)}; {self.n_refused} rows refused)"
        )


@dataclass(frozen=True, repr=False)
class MatchedFlight(ResultDisplay):
    """A flight with its truth computed and the filter that knows its errors' model."""

    simulator: Simulator
    setup: FilterSetup
    P0: Float64
    looks: tuple[int, ...]  # epochs after whose update the filter is looked at

    def _about(self) -> Iterator[str]:
        scenario = self.simulator.scenario
        yield f"{scenario.duration_s:g} s at {scenario.imu_rate_hz:g} Hz"
        yield f"{len(self.simulator.tag_s)} GNSS epochs, {len(self.looks)} of them evaluated"

    @classmethod
    def of(
        cls,
        imu: str = "tactical",
        clock: str = "tcxo",
        *,
        scenario: str | None = None,
        duration_s: float = 120.0,
        imu_rate_hz: float = 100.0,
        noise_factor: float = 1.0,
        n_looks: int = 6,
    ) -> MatchedFlight:
        """Return the flight for grades named in the library.

        ``scenario`` names one of ``models/scenarios``, whose motion, place and sky are taken and nothing of its errors;
        None: turns in the air, under the paper's satellites.

        Raises
        ------
        ModelError : the library has no such sensor, oscillator or scenario
        ConfigError : the scenario's motion is not a list of manoeuvres
        """
        config = _config()
        grade, clock_type = _pure(imu_grade(imu)), oscillator(clock)
        trajectory, sky, start_ns, duration_s = _flown(scenario, duration_s)
        receiver = SimulatedReceiver(
            _LEVER_B,
            first_tag_s=_FIRST_TAG_S,
            pseudorange_noise=_drawn_noise(config, "pseudorange_noise_m", noise_factor),
            range_rate_noise=_drawn_noise(config, "range_rate_noise_mps", noise_factor),
        )
        simulator = Simulator(
            Scenario(
                trajectory,
                sky,
                grade,
                clock_type,
                start_ns,
                duration_s,
                imu_rate_hz=imu_rate_hz,
                receiver=receiver,
                clock=ClockStart(bias_m=30.0, drift_mps=5.0),
            )
        )
        setup = FilterSetup(config, grade, clock_type, _LEVER_B, navigation=sky)
        n = len(simulator.tag_s)
        looks = tuple(sorted({int(e) for e in np.linspace(n - 1, 1, n_looks).round()}))
        return cls(simulator, setup, _first_covariance(simulator, grade), looks)

    def draw(self, rng: np.random.Generator | None) -> FlightRealisation:
        """Return one realisation; without a generator, logs and a start without errors."""
        log = self.simulator.draw(rng)
        rows = self.setup.rows(log.gnss, self.setup.navigation)
        imu = ImuSamples(
            log.imu.t_ns, np.ascontiguousarray(log.imu.w_ib_b), np.ascontiguousarray(log.imu.f_b)
        )
        return FlightRealisation(log, imu, rows, self._opened(log, rng))

    def run(self, drawn: FlightRealisation) -> FilterErrors:
        """Run the filter through a realisation, from the second epoch on: the first is in its start."""
        rows, log = drawn.rows, drawn.log
        out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64))
        navigator = Navigator(self.setup)
        navigator.bank = drawn.bank
        navigator.started_ns = int(log.at_gnss.t_ns[0])
        errors, covariances, done = [], [], 1
        for look in self.looks:
            navigator.run(drawn.imu, rows, done, look + 1, out)
            done = look + 1
            assert navigator.bank is not None
            errors.append(error_state(navigator.bank.state[0], log, look))
            covariances.append(navigator.bank.P[0, :N_STATES, :N_STATES].copy())  # it may get further states
        error, P = np.array(errors), np.array(covariances)
        ledger = out.ledger[rows.first[1] :]
        used = ledger["status"] == USED
        with np.errstate(invalid="ignore"):
            nis = ledger["innovation"] ** 2 / ledger["variance"]
        means = np.array([np.mean(nis[used[:, k], k]) for k in (PSEUDORANGE, RANGE_RATE)])
        counts = (int(used[:, PSEUDORANGE].sum()), int(used[:, RANGE_RATE].sum()))
        sd = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
        refused = int(ledger["status"].size - sum(counts))
        return FilterErrors(error, sd, _nees(error, P), P, means, counts, refused)

    def _opened(self, log: SimulatedLog, rng: np.random.Generator | None) -> Bank:
        """Return a filter at the first epoch, its error a draw from its covariance; it takes the biases for zero."""
        truth = log.at_gnss
        white = np.zeros(N_STATES) if rng is None else rng.standard_normal(N_STATES)
        e = np.linalg.cholesky(self.P0) @ white
        bank = new_bank(1, self.setup.layout.n_optional)
        m: StateRecord = bank.state[0]
        m.r_e[:] = truth.r_e[0] + e[DR : DR + 3]
        m.v_e[:] = truth.v_e[0] + e[DV : DV + 3]
        m.C_eb[:] = Rotation.from_rotvec(e[PSI : PSI + 3]).as_matrix() @ truth.C_eb[0]
        matrix_to_quaternion(m.C_eb.copy(), m.q_eb)
        m.clock[:] = log.clock.bias_m[0] + e[CLOCK], log.clock.drift_mps[0] + e[DRIFT]
        bank.P[0] = self.P0
        bank.head["now_ns"] = bank.head["epoch_ns"] = truth.t_ns[0]
        bank.head["next"] = np.searchsorted(log.imu.t_ns, truth.t_ns[0], side="right")
        return bank


def flight_in_memory(flight: MatchedFlight, log: SimulatedLog) -> FlightInMemory:
    """Return a drawn log as a flight with its truth for reference, to be replayed like one from files."""
    simulator, setup = flight.simulator, flight.setup
    config = FlightConfig(
        name="simulated",
        gps_week=simulator.scenario.start_ns // NS_PER_WEEK,
        imu=ImuConfig(files=(Path("imu.csv"),), grade=setup.grade),
        gnss=Gnss(
            files=(Path("gnss.csv"),),
            lever_arm_m=_LEVER_B,
            oscillator=setup.oscillator,
            slow_errors=NO_SLOW_ERRORS,
        ),
    )
    reference = reference_table(simulator.imu_motion, simulator.scenario.start_ns)
    logs = FlightLogs(log.imu, log.gnss, simulator.scenario.navigation, reference, [], {})
    return FlightInMemory(Path("flight.toml"), config, setup.grade, setup.oscillator, logs)


class MonteCarlo(NamedTuple):
    """Many runs of one flight, the first axis that of the runs."""

    error: Float64  # (n, k, 17)
    sd: Float64  # (n, k, 17)
    nees: Float64  # (n, k, 7)
    nis: Float64  # (n, 2)

    def __repr__(self) -> str:
        runs, epochs = self.error.shape[:2]
        return f"MonteCarlo({runs} runs; {epochs} epochs; {_nees_words(self.nees.mean(axis=0))})"


def monte_carlo(flight: MatchedFlight, runs: int, *, seed: int = 1, threads: int | None = None) -> MonteCarlo:
    """Return many runs, each drawn from (seed, number) and so the same whatever the number of threads."""

    def one(number: int) -> FilterErrors:
        return flight.run(flight.draw(np.random.default_rng([seed, number])))

    with ThreadPoolExecutor(threads or usable_cores()) as pool:
        outcomes = list(pool.map(one, range(runs)))
    return MonteCarlo(*(np.array([getattr(o, name) for o in outcomes]) for name in MonteCarlo._fields))


def covariance_analysis(flight: MatchedFlight) -> FilterErrors:
    """Return the result of one run without errors: its covariance is that of a thousand runs with errors.

    Equation: P+ = (I - K H) P-, P- = Phi P Phi^T + Q along the true trajectory; no measurement enters it
    Neglects: the effect of the estimate's error on Phi, H and the gates, of second order in the error.
    """
    return flight.run(flight.draw(None))


def _flown(scenario: str | None, duration_s: float) -> tuple[Trajectory, NavigationData, int, float]:
    """Return motion, satellites, GPS time of the start and duration."""
    if scenario is None:
        sky = constellation_over(AIRFIELD, PAPER_SKY, _START_NS, max(duration_s, 1200.0), _TOE_NS)
        return airborne_turns(duration_s), sky, _START_NS, duration_s
    path = find("scenarios", scenario)
    assembly = assemble(load_toml(path, SimulationConfig), path.parent, duration_s=duration_s)
    return assembly.trajectory, assembly.navigation, assembly.start_ns, assembly.duration_s


def _config() -> FilterConfig:
    """Return the library's filter with white noise, in empty air, not adapting, whose tags are exact."""
    base = filter_config("tight")
    use = base.measurements.model_copy(
        update={"ionosphere": "none", "troposphere": "none", "elevation_mask_deg": 0.0, "carrier": False}
    )
    noise = {
        kind: getattr(base, kind).model_copy(update={"correlation_time_s": 0.0})
        for kind in ("pseudorange_noise_m", "range_rate_noise_mps")
    }
    faults = base.faults.model_copy(update={"reflected_below_db": 0.0})
    adaptation = base.adaptation.model_copy(update={"on": False})
    process = base.process.model_copy(update={"imu_time_sigma_s": 0.0})
    updated = {"measurements": use, "faults": faults, "adaptation": adaptation, "process": process, **noise}
    return base.model_copy(update={"name": "", **updated})


def _drawn_noise(config: FilterConfig, kind: str, factor: float) -> NoiseTerms:
    noise = getattr(config, kind)
    return NoiseTerms(
        floor=noise.floor * factor, elevation=noise.elevation * factor, cn0=noise.cn0_at_45_dbhz * factor
    )


def _pure(grade: ImuGrade) -> ImuGrade:
    """Return a grade of white noise and Gauss-Markov biases with this one's bias for sigma, and of nothing else."""
    return ImuGrade(
        gyro_bias_deg_per_h=0.0,
        gyro_bias_instability_deg_per_h=grade.gyro_bias_deg_per_h,
        gyro_correlation_time_s=grade.gyro_correlation_time_s,
        gyro_arw_deg_per_sqrt_h=grade.gyro_arw_deg_per_sqrt_h,
        accel_bias_mg=0.0,
        accel_bias_instability_mg=grade.accel_bias_mg,
        accel_correlation_time_s=grade.accel_correlation_time_s,
        accel_vrw_mps_per_sqrt_h=grade.accel_vrw_mps_per_sqrt_h,
    )


def _first_covariance(simulator: Simulator, grade: ImuGrade) -> Float64:
    """Return the covariance of the opening; of the biases the stationary one."""
    sensor, sd = sensor_model(grade), np.zeros(N_STATES)
    C_ne = level_axes(simulator.gnss_motion.r_e[0].copy())
    sd[DR : DR + 3], sd[DV : DV + 3] = _OPENING["position_m"], _OPENING["velocity_mps"]
    sd[BA : BA + 3], sd[BG : BG + 3] = sensor.accel_bias.sigma, sensor.gyro_bias.sigma
    sd[CLOCK : DRIFT + 1] = _OPENING_CLOCK
    P = np.diag(sd**2)
    level, yaw = _OPENING["level_deg"], _OPENING["yaw_deg"]
    tilt = C_ne.T @ np.diag(np.radians([level, level, yaw]) ** 2) @ C_ne
    P[PSI : PSI + 3, PSI : PSI + 3] = 0.5 * (tilt + tilt.T)
    return P


def error_state(m: StateRecord, log: SimulatedLog, epoch: int) -> Float64:
    """Return estimate minus truth (17,) of a state at a GNSS tag."""
    truth, e = log.at_gnss, np.zeros(N_STATES)
    e[DR : DR + 3] = m.r_e - truth.r_e[epoch]
    e[DV : DV + 3] = m.v_e - truth.v_e[epoch]
    e[PSI : PSI + 3] = Rotation.from_matrix(m.C_eb @ truth.C_eb[epoch].T).as_rotvec()
    e[BA : BA + 3] = m.b_a - truth.accel_bias[epoch]
    e[BG : BG + 3] = m.b_g - truth.gyro_bias[epoch]
    e[CLOCK] = m.clock[0] - log.clock.bias_m[epoch]
    e[DRIFT] = m.clock[1] - log.clock.drift_mps[epoch]
    return e


def _nees_words(nees: Float64) -> str:
    """Return the last epoch's squared error over sigma, per axis of each block (1 is right)."""
    parts = [
        f"{name} {value / (part.stop - part.start):.2f}"
        for (name, part), value in zip(BLOCKS.items(), nees[-1], strict=True)
    ]
    return f"NEES per axis at the last epoch (1 is right): {', '.join(parts)}"


def _nees(error: Float64, P: Float64) -> Float64:
    """Return e^T P^-1 e (k, 7) of each block, its own part of the covariance inverted."""
    nees = []
    for part in BLOCKS.values():
        e = error[:, part]
        nees.append(np.sum(e * np.linalg.solve(P[:, part, part], e[..., None])[..., 0], axis=1))
    return np.array(nees).T
