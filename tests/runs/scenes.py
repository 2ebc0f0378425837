"""Simulated flights in memory, ready to be replayed, and what a replay must show whatever was wrong with its logs."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from insgnss.config.flight import FlightConfig, GivenStart, Gnss, ImuConfig, ImuGrade, Oscillator
from insgnss.config.slow_errors import NO_SLOW_ERRORS
from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.flight import Flight, FlightInMemory, FlightLogs
from insgnss.runs.reference_errors import errors_against
from insgnss.runs.result import Run
from insgnss.simulation.atmosphere import broadcast_atmosphere
from insgnss.simulation.observations import Fault, NoiseTerms, SimulatedReceiver
from insgnss.simulation.sample_trajectories import AIRFIELD, airborne_turns
from insgnss.simulation.signal_errors import Disturbance
from insgnss.simulation.simulated_log import ClockStart, Scenario, SimulatedLog, Simulator
from insgnss.simulation.sky import PAPER_SKY, constellation_over, nominal_constellation
from insgnss.simulation.trajectory import Trajectory, reference_table
from insgnss.tables import GnssTable, ImuTable, NavigationData

WEEK = 2385
START_S = 293_700.0
START_NS = int(week_seconds_to_ns(WEEK, START_S))
TOE_NS = int(week_seconds_to_ns(WEEK, START_S + 1500.0))
LEVER_ARM_B = (0.8, 0.0, -1.1)
TACTICAL = ImuGrade(
    gyro_bias_deg_per_h=1.0,
    gyro_bias_instability_deg_per_h=0.3,
    gyro_correlation_time_s=1000.0,
    gyro_arw_deg_per_sqrt_h=0.1,
    gyro_scale_factor_ppm=100.0,
    accel_bias_mg=1.0,
    accel_bias_instability_mg=0.2,
    accel_correlation_time_s=1000.0,
    accel_vrw_mps_per_sqrt_h=0.06,
    accel_scale_factor_ppm=100.0,
)
TCXO = Oscillator(h0_s=2e-19, h_minus2_per_s=2e-20)
PREDICTED = ("used", "gated")  # statuses whose ledger entries hold an innovation


@cache
def paper_sky() -> NavigationData:
    """Return the 11 satellites over the airfield."""
    return constellation_over(AIRFIELD, PAPER_SKY, START_NS, 1200.0, TOE_NS)


@cache
def even_sky(toe_ns: int = TOE_NS) -> NavigationData:
    """Return a constellation that gives 8 to 12 satellites anywhere on the Earth."""
    return nominal_constellation(toe_ns)


def receiver(
    navigation: NavigationData, *, first_tag_s: float = 1.0, rate_hz: float = 1.0
) -> SimulatedReceiver:
    """Return the sample flight's receiver: noise as the filter has it, the atmosphere of the broadcast models."""
    return SimulatedReceiver(
        LEVER_ARM_B,
        rate_hz=rate_hz,
        first_tag_s=first_tag_s,
        boresight_cn0_dbhz=45.0,
        pseudorange_noise=NoiseTerms(floor=0.5, elevation=0.6, cn0=0.7),
        range_rate_noise=NoiseTerms(floor=0.03, elevation=0.02, cn0=0.03),
        atmosphere=broadcast_atmosphere(navigation.klobuchar),
    )


def simulator(
    trajectory: Trajectory,
    duration_s: float,
    *,
    navigation: NavigationData | None = None,
    grade: ImuGrade = TACTICAL,
    imu_rate_hz: float = 100.0,
    first_tag_s: float = 1.0,
    start_ns: int = START_NS,
) -> Simulator:
    """Return a scenario with its truth computed; a receiver clock 0.3 ms ahead that drifts by 50 m/s."""
    sky = navigation or paper_sky()
    return Simulator(
        Scenario(
            trajectory,
            sky,
            grade,
            TCXO,
            start_ns,
            duration_s,
            imu_rate_hz=imu_rate_hz,
            receiver=receiver(sky, first_tag_s=first_tag_s),
            clock=ClockStart(bias_m=90_000.0, drift_mps=50.0),
        )
    )


@cache
def turns(duration_s: float = 120.0, first_tag_s: float = 1.0, imu_rate_hz: float = 100.0) -> Simulator:
    """Return an aircraft in the air over the airfield, 10 s straight and then turns of 35 deg of bank."""
    return simulator(airborne_turns(duration_s), duration_s, first_tag_s=first_tag_s, imu_rate_hz=imu_rate_hz)


def with_faults(base: Simulator, faults: Sequence[Fault] = (), clock: ClockStart | None = None) -> Simulator:
    """Return the same flight with faults of the receiver, the truth shared."""
    faulty = copy.copy(base)
    faulty.scenario = replace(base.scenario, faults=tuple(faults), clock=clock or base.scenario.clock)
    return faulty


def flight(
    base: Simulator,
    log: SimulatedLog | None = None,
    *,
    imu: ImuTable | None = None,
    gnss: GnssTable | None = None,
    navigation: NavigationData | None = None,
    grade: ImuGrade | None = None,
    start: GivenStart | None = None,
    seed: int = 1,
) -> FlightInMemory:
    """Return a drawn flight with its truth as the reference, any of its logs replaced."""
    scenario = base.scenario
    log = log or base.draw(np.random.default_rng(seed))
    grade = grade or scenario.grade
    config = FlightConfig(
        name="simulated",
        gps_week=WEEK,
        imu=ImuConfig(files=(Path("imu.csv"),), grade=grade),
        gnss=Gnss(
            files=(Path("gnss.csv"),),
            lever_arm_m=LEVER_ARM_B,
            oscillator=scenario.oscillator,
            slow_errors=NO_SLOW_ERRORS,
        ),
        start=start or "automatic",
    )
    logs = FlightLogs(
        imu=imu or log.imu,
        gnss=gnss or log.gnss,
        navigation=navigation or scenario.navigation,
        reference=reference_table(base.imu_motion, scenario.start_ns),
        events=[],
        input_hashes={},
    )
    return FlightInMemory(Path("flight.toml"), config, grade, scenario.oscillator, logs)


def disturbed(disturbance: Disturbance, seed: int = 3, **logs: Any) -> FlightInMemory:
    """Return a minute of turns with satellites or air disturbed."""
    base = with_faults(turns(60.0))
    receiver = replace(base.scenario.receiver, disturbances=(disturbance,))
    base.scenario = replace(base.scenario, receiver=receiver)
    return flight(base, seed=seed, **logs)


def true_start(base: Simulator, at_s: float) -> GivenStart:
    """Return the truth ``at_s`` after the start as a given state."""
    truth = reference_table(base.scenario.trajectory.motion(np.array([at_s])), base.scenario.start_ns)
    seconds = (base.scenario.start_ns - int(week_seconds_to_ns(WEEK, 0.0))) / 1e9 + at_s
    return GivenStart(
        time_s=seconds,
        lat_deg=float(truth.lat_deg[0]),
        lon_deg=float(truth.lon_deg[0]),
        h_m=float(truth.h_m[0]),
        v_ned_mps=tuple(truth.v_n[0].tolist()),
        rpy_deg=tuple(truth.rpy_deg[0].tolist()),
    )


def without_samples(imu: ImuTable, from_s: float, to_s: float, start_ns: int = START_NS) -> ImuTable:
    """Return the inertial log without the samples in (from, to)."""
    t = (imu.t_ns - start_ns) / 1e9
    keep = ~((t > from_s + 1e-6) & (t < to_s - 1e-6))
    return ImuTable(imu.t_ns[keep], imu.w_ib_b[keep], imu.f_b[keep])


def rows_where(gnss: GnssTable, keep: np.ndarray) -> GnssTable:
    """Return the rows of a GNSS log that ``keep`` (bool) marks."""
    return gnss.take(np.flatnonzero(keep))


def filters_errors(smoothed: Run, flown: Flight) -> pd.DataFrame:
    """Return the errors that the filter had, of a smoothed run: to the bit those of a run that is not smoothed."""
    reference, week = flown.read().reference, flown.config.gps_week
    assert smoothed.filtered is not None and reference is not None and week is not None
    return errors_against(smoothed.filtered, reference, week, None)


def after(run: Run, seconds: float) -> pd.DataFrame:
    """Return the errors from ``seconds`` after the simulation's start on."""
    assert run.errors is not None
    return run.errors[run.errors["time_s"] >= START_S + seconds - 1e-6]


def ratios(errors: pd.DataFrame) -> pd.DataFrame:
    """Return |error| over its own sigma, one column for each component."""
    names = [c[2:] for c in errors.columns if c.startswith("d_")]
    return pd.DataFrame({name: (errors[f"d_{name}"] / errors[f"sd_{name}"]).abs() for name in names})


def position_error_m(errors: pd.DataFrame) -> np.ndarray:
    """Return the distance from the truth [m], one for each row."""
    return np.linalg.norm(errors[["d_n_m", "d_e_m", "d_d_m"]].to_numpy(), axis=1)


def assert_sound(run: Run, flown: FlightInMemory) -> None:
    """Fail on a NaN, a sigma that is none, a measurement lost or an innovation missing."""
    nav = run.nav.to_numpy(dtype=np.float64)
    assert len(nav) and np.isfinite(nav).all(), "NaN in the solution"
    assert run.nav.filter(regex="^sd_(?!slow_)").to_numpy().min() > 0.0
    assert np.all(np.diff(run.nav["time_s"]) > 0.0)
    gnss = flown.logs.gnss
    counts = run.measurements.groupby("kind", observed=False).size()
    assert counts["pseudorange"] == np.isfinite(gnss.pseudorange_m).sum()
    assert counts["range_rate"] == (np.isfinite(gnss.range_rate_mps) | np.isfinite(gnss.doppler_hz)).sum()
    predicted = run.measurements[run.measurements["status"].isin(PREDICTED)]
    assert np.isfinite(predicted[["innovation", "sd_innovation", "nis"]].to_numpy()).all()
    assert run.events["detail"].str.len().min() > 0


def row_at(run: Run, seconds: float) -> pd.Series:
    """Return the navigation row ``seconds`` after the simulation's start."""
    found = run.nav[(run.nav["time_s"] - START_S - seconds).abs() < 1e-6]
    assert len(found) == 1, f"{len(found)} rows at {seconds} s"
    return found.iloc[0]


def kinds(run: Run) -> list[str]:
    """Return the kinds of the events in their order."""
    return list(run.events["kind"])


# one in two million for one component of one row; what a broken filter shows is ten and more
HONEST_SIGMAS = 5.0


def assert_honest(run: Run, from_s: float, to_s: float = np.inf, sigmas: float = HONEST_SIGMAS) -> None:
    """Fail unless every component of every row in the window lies within ``sigmas`` of its own sigma of the truth."""
    errors = after(run, from_s)
    errors = errors[errors["time_s"] <= START_S + to_s + 1e-6]
    assert len(errors), "no row in the window"
    worst = ratios(errors).max()
    assert worst.max() <= sigmas, f"beyond {sigmas} sigma: {worst[worst > sigmas].round(1).to_dict()}"
