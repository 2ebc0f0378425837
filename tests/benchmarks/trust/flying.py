"""One run of a row: the scenario drawn with a seed, spoilt, and replayed in memory."""

from __future__ import annotations

import json
import tempfile
import tomllib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import insgnss
from insgnss.config.flight import FlightConfig, GivenStart, Gnss, ImuConfig, ImuGrade, MountedAntenna
from insgnss.config.library import find
from insgnss.config.simulation import SimulationConfig
from insgnss.config.slow_errors import NO_SLOW_ERRORS, SlowErrorSizes
from insgnss.config.strict import load_toml
from insgnss.constants import NS_PER_S
from insgnss.log.flight import FlightInMemory, FlightLogs
from insgnss.log.imu.csv_log import read_imu
from insgnss.runs.result import Run
from insgnss.simulation.assembly import assemble
from insgnss.simulation.flight_text import slow_errors_of
from insgnss.simulation.log_files import write_imu
from insgnss.simulation.sample_flight import sample_scenario
from insgnss.simulation.simulated_log import Scenario, SimulatedLog, Simulator
from insgnss.simulation.trajectory import reference_table
from insgnss.tables import Event, Float64, ImuTable, ReferenceTable
from tests.benchmarks.trust.rows import Case, Row

SAMPLE_FLIGHT = "sample flight"  # a scenario that is made by the package without a file
WEEK = 2385
_REFERENCE_RATE_HZ = 10.0


@dataclass(frozen=True)
class Prepared:
    """A row's scenario with its truth computed: what all its seeds share."""

    simulator: Simulator
    reference: ReferenceTable
    antennas: tuple[MountedAntenna, ...]
    slow_errors: SlowErrorSizes  # that the simulation makes


@dataclass(frozen=True)
class Flown:
    """A run and the truth behind it."""

    row: Row
    seed: int
    run: Run
    ready: Prepared
    log: SimulatedLog
    case: Case
    origin_s: float  # after the simulation's start

    @property
    def start_s(self) -> float:
        """Seconds of the week of the simulation's start."""
        return (self.case.start_ns - WEEK * 604_800 * NS_PER_S) / NS_PER_S

    def since(self, time_s: Float64) -> Float64:
        """Return times of the week as seconds after the row's origin."""
        return np.asarray(time_s, dtype=np.float64) - self.start_s - self.origin_s


@lru_cache(maxsize=8)
def prepared(text: str, grade: str, rate: tuple[float | None, ...]) -> Prepared:
    """Return a scenario with its truth, which rows of the same one share; ``rate`` is (IMU, GNSS, duration)."""
    made, antennas, slow_errors = _scenario(text, grade, rate)
    simulator = Simulator(made)
    t_s = np.arange(int(made.duration_s * _REFERENCE_RATE_HZ + 1e-9) + 1) / _REFERENCE_RATE_HZ
    reference = reference_table(made.trajectory.motion(t_s), made.start_ns)
    return Prepared(simulator, reference, antennas, slow_errors)


def _scenario(
    text: str, grade: str, rate: tuple[float | None, ...]
) -> tuple[Scenario, tuple[MountedAntenna, ...], SlowErrorSizes]:
    """Return the scenario, and what its flight file would say of antennas and errors that last."""
    imu_hz, gnss_hz, duration_s = rate
    if text == SAMPLE_FLIGHT:
        whole = sample_scenario(duration_s or 1200.0)
        whole = whole if imu_hz is None else replace(whole, imu_rate_hz=imu_hz)
        return whole, (), NO_SLOW_ERRORS
    folder = Path()
    if "\n" in text:
        data = json.dumps(tomllib.loads(text))
        config = SimulationConfig.model_validate_json(data, strict=True)
    else:
        path = find("scenarios", text)
        config, folder = load_toml(path, SimulationConfig), path.parent
    imu = {"rate_hz": imu_hz or config.imu.rate_hz, "grade": grade or config.imu.grade, "values": "rates"}
    gnss = {"rate_hz": gnss_hz or config.gnss.rate_hz}
    config = config.model_copy(
        update={"imu": config.imu.model_copy(update=imu), "gnss": config.gnss.model_copy(update=gnss)}
    )
    made = assemble(config, folder, duration_s=duration_s)
    return made, config.gnss.antenna, slow_errors_of(config.gnss)


def ready_and_drawn(row: Row, seed: int) -> tuple[Prepared, SimulatedLog]:
    """Return a row's scenario and one realisation of its logs."""
    rate = (row.rate_hz, row.gnss_rate_hz, row.duration_s)
    ready = prepared(row.scenario, row.grade, rate)
    return ready, ready.simulator.draw(np.random.default_rng(seed))


def drawn(row: Row, seed: int) -> tuple[Prepared, SimulatedLog, FlightInMemory]:
    """Return a row's scenario, its logs drawn with a seed, and the flight made of them, unspoilt."""
    ready, log = ready_and_drawn(row, seed)
    case = Case(log.imu, log.gnss, log.navigation, ready.simulator.scenario.start_ns)
    return ready, log, _flight(row, ready, case, seed)


def fly(row: Row, seed: int) -> Flown:
    """Return one run of a row."""
    ready, log = ready_and_drawn(row, seed)
    case = Case(log.imu, log.gnss, log.navigation, ready.simulator.scenario.start_ns)
    origin_s = row.origin(seed)
    rng = np.random.default_rng([seed, 15])
    if row.cut:
        origin_s = float(rng.uniform(0.0, 0.75 * ready.simulator.scenario.duration_s))
        case = _cut(case, origin_s)
    if row.spoil is not None:
        case = row.spoil(case, origin_s, rng)
    flight = _flight(row, ready, case, seed)
    output = "gnss" if row.output is None else row.output
    run = insgnss.replay(flight, settings=row.settings, output=output, integrity=row.integrity)
    return Flown(row, seed, run, ready, log, case, origin_s)


def _cut(case: Case, from_s: float) -> Case:
    """Return the logs from a time on."""
    from_ns = case.start_ns + round(from_s * NS_PER_S)
    kept = case.imu.t_ns >= from_ns
    imu = ImuTable(case.imu.t_ns[kept], case.imu.w_ib_b[kept], case.imu.f_b[kept])
    return replace(case, imu=imu, gnss=case.gnss.take(np.flatnonzero(case.gnss.t_ns >= from_ns)))


def _flight(row: Row, ready: Prepared, case: Case, seed: int) -> FlightInMemory:
    made = ready.simulator.scenario
    start = _given(ready, case, seed) if row.start == "given" else None
    imu, events = _read_again(case, made.grade) if case.through_file else (case.imu, [])
    config = FlightConfig(
        name=row.name,
        gps_week=WEEK,
        imu=ImuConfig(files=(Path("imu.csv"),), grade=made.grade),
        gnss=Gnss(
            files=(Path("gnss.csv"),),
            lever_arm_m=tuple((np.array(made.receiver.lever_arm_b) + row.lever_off_m).tolist()),
            oscillator=made.oscillator,
            antenna=ready.antennas,
            slow_errors=ready.slow_errors,
        ),
        start=start or "automatic",
        vehicle=row.vehicle,
    )
    logs = FlightLogs(
        imu=imu,
        gnss=case.gnss,
        navigation=case.navigation,
        reference=ready.reference,
        events=events,
        input_hashes={},
    )
    return FlightInMemory(Path("flight.toml"), config, made.grade, made.oscillator, logs)


def _given(ready: Prepared, case: Case, seed: int) -> GivenStart:
    """Return a start state that is off by a draw from the sigmas it states."""
    rng = np.random.default_rng([seed, 16])
    at_s = 2.0
    made = ready.simulator.scenario
    truth = reference_table(made.trajectory.motion(np.array([at_s])), made.start_ns)
    sd_position, sd_velocity, sd_level, sd_yaw = 3.0, 0.1, 0.05, 0.2
    off_m, off_mps = sd_position * rng.standard_normal(3), sd_velocity * rng.standard_normal(3)
    metres_per_deg = 111_200.0
    lat = float(truth.lat_deg[0])
    rpy = truth.rpy_deg[0] + rng.standard_normal(3) * [sd_level, sd_level, sd_yaw]
    return GivenStart(
        time_s=(case.start_ns - WEEK * 604_800 * NS_PER_S) / NS_PER_S + at_s,
        lat_deg=lat + off_m[0] / metres_per_deg,
        lon_deg=float(truth.lon_deg[0]) + off_m[1] / (metres_per_deg * np.cos(np.radians(lat))),
        h_m=float(truth.h_m[0]) - off_m[2],
        v_ned_mps=tuple((truth.v_n[0] + off_mps).tolist()),
        rpy_deg=tuple(((rpy + 180.0) % 360.0 - 180.0).tolist()),
        sd_position_m=sd_position,
        sd_velocity_mps=sd_velocity,
        sd_roll_pitch_deg=sd_level,
        sd_yaw_deg=sd_yaw,
    )


def _read_again(case: Case, grade: ImuGrade) -> tuple[ImuTable, list[Event]]:
    """Return the inertial log and the reader's events, written as a file and read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "imu.csv"
        write_imu(path, case.imu, WEEK)
        return read_imu(ImuConfig(files=(path,), grade=grade), WEEK, grade)
