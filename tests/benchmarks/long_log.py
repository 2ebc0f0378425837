"""A long log for the benchmarks, with satellite states in its rows: ``python -m tests.benchmarks.long_log FOLDER``.

An aircraft flies circles over the sample flight's airfield, below a constellation dense enough to give 30 satellites in
view; the k highest of each epoch are logged. Truth and errors come from ``insgnss.simulation``, vacuum in place of the
atmosphere: the cost of the filter is asked, not that of the models.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv

from insgnss.config.flight import ImuGrade
from insgnss.config.library import imu_grade, oscillator
from insgnss.constants import C_MPS, NS_PER_S
from insgnss.gpstime import ns_to_week_seconds, week_seconds_to_ns
from insgnss.simulation.imu import accelerometer_model, gyro_model, measure
from insgnss.simulation.observations import (
    SIGNAL,
    WAVELENGTH_M,
    NoiseTerms,
    SignalPaths,
    antenna_motion,
    cardioid_gain_db,
    signal_paths,
)
from insgnss.simulation.oscillator import ClockTruth, simulate_clock
from insgnss.simulation.sample_trajectories import AIRFIELD, circle
from insgnss.simulation.sky import nominal_constellation
from insgnss.simulation.trajectory import Trajectory, reference_table
from insgnss.tables import EphemerisTable, Float64, Int64

WEEK, START_S = 2385, 100_000.0
GRADE, CLOCK = "tactical", "tcxo"
LEVER_ARM_B = (0.8, 0.0, -1.1)
RADIUS_M, SPEED_MPS, BANK_DEG = 2000.0, 60.0, 10.0
CLOCK_BIAS_M, CLOCK_DRIFT_MPS = 3000.0, 0.8
PSEUDORANGE_NOISE, RANGE_RATE_NOISE = NoiseTerms(1.5), NoiseTerms(0.1)
BORESIGHT_CN0_DBHZ = 48.0
PLANES, PER_PLANE = 8, 15  # of the constellation: 38 satellites or more above 5 deg anywhere
MOST_NAMES = 63  # numbers a log may give to GPS satellites
EPOCHS_AT_ONCE = 1000  # of all satellites in view: bounds the memory
ROUTINE_S = 60.0  # satellites are picked out of the constellation by where they stand this often

FLIGHT = """\
name = "benchmark: {hours:g} h, IMU {imu_hz:g} Hz, {satellites} satellites at {gnss_hz:g} Hz"
gps_week = {week}

[imu]
files = ["imu.csv"]
grade = "{grade}"

[gnss]
files = ["gnss.csv"]
lever_arm_m = {lever}
oscillator = "{clock}"

[start]
time_s = {time_s}
lat_deg = {lat!r}
lon_deg = {lon!r}
h_m = {h!r}
v_ned_mps = {v}
rpy_deg = {rpy}
sd_position_m = 1.0
sd_velocity_mps = 0.1
sd_roll_pitch_deg = 0.1
sd_yaw_deg = 0.5
"""


@dataclass(frozen=True)
class LongLog:
    """What to make; the seed fixes every error in it."""

    hours: float = 1.0
    imu_hz: float = 200.0
    gnss_hz: float = 10.0
    satellites: int = 30
    seed: int = 1

    @property
    def duration_s(self) -> float:
        return 3600.0 * self.hours


@dataclass(frozen=True)
class Sky:
    """The k highest satellites of some epochs, ordered by satellite: all arrays (m, k)."""

    sv: npt.NDArray[np.intp]
    pseudorange_m: Float64
    range_rate_mps: Float64
    cn0_dbhz: Float64
    sat: Float64  # (m, k, 8) as the log's columns


def write_log(log: LongLog, folder: Path) -> Path:
    """Write ``imu.csv``, ``gnss.csv`` and ``flight.toml``; return the flight file."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(log.seed)
    trajectory = circle(
        log.duration_s,
        AIRFIELD[0],
        AIRFIELD[1],
        500.0,
        radius_m=RADIUS_M,
        speed_mps=SPEED_MPS,
        bank_deg=BANK_DEG,
    )
    _write_imu(folder / "imu.csv", trajectory, log, imu_grade(GRADE), rng)
    _write_gnss(folder / "gnss.csv", trajectory, log, rng)
    flight = folder / "flight.toml"
    flight.write_text(_flight_text(trajectory, log), encoding="utf-8")
    return flight


def start_ns() -> int:
    """Return the GPS time of the trajectory's t = 0."""
    return int(week_seconds_to_ns(WEEK, START_S))


def _flight_text(trajectory: Trajectory, log: LongLog) -> str:
    first_s = 1.0 / log.imu_hz
    start = reference_table(trajectory.motion(np.array([first_s])), start_ns())
    return FLIGHT.format(
        hours=log.hours,
        imu_hz=log.imu_hz,
        gnss_hz=log.gnss_hz,
        satellites=log.satellites,
        week=WEEK,
        grade=GRADE,
        clock=CLOCK,
        lever=list(LEVER_ARM_B),
        time_s=START_S + first_s,
        lat=float(start.lat_deg[0]),
        lon=float(start.lon_deg[0]),
        h=float(start.h_m[0]),
        v=start.v_n[0].tolist(),
        rpy=start.rpy_deg[0].tolist(),
    )


def _write_imu(
    path: Path, trajectory: Trajectory, log: LongLog, grade: ImuGrade, rng: np.random.Generator
) -> None:
    edges_ns = _times_ns(log.duration_s, log.imu_hz)
    increments = trajectory.increments(edges_ns / NS_PER_S)
    gyro = measure(increments.mean_rate(), 1.0 / log.imu_hz, gyro_model(grade), rng).value
    accel = measure(increments.mean_specific_force(), 1.0 / log.imu_hz, accelerometer_model(grade), rng).value
    columns = {"time_s": _time_column(edges_ns[1:])}
    columns |= {f"gyro_{a}": np.round(gyro[:, i], 8) for i, a in enumerate("xyz")}
    columns |= {f"accel_{a}": np.round(accel[:, i], 6) for i, a in enumerate("xyz")}
    _write_csv(pa.table(columns), path)


def _times_ns(duration_s: float, rate_hz: float) -> Int64:
    return np.rint(np.arange(round(duration_s * rate_hz) + 1) * (NS_PER_S / rate_hz)).astype(np.int64)


def _time_column(since_start_ns: Int64) -> Float64:
    return ns_to_week_seconds(start_ns() + since_start_ns, WEEK)


def _write_csv(table: pa.Table, path: Path) -> None:
    with path.open("wb") as stream:
        stream.write((",".join(table.column_names) + "\n").encode())
        options = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
        pyarrow.csv.write_csv(table, stream, options)


def _write_gnss(path: Path, trajectory: Trajectory, log: LongLog, rng: np.random.Generator) -> None:
    names = pa.array([f"G{number:02d}" for number in range(1, MOST_NAMES + 1)])
    number = np.full(PLANES * PER_PLANE, -1)
    parts = []
    for tag_ns, sky in observed(trajectory, log, rng):
        for sv in np.unique(sky.sv):
            if number[sv] < 0:
                number[sv] = number.max() + 1
        if number.max() >= MOST_NAMES:
            raise SystemExit("so many satellites rise in so long a log that they run out of numbers")
        k = sky.sv.shape[1]
        n = sky.sv.size
        columns = {
            "time_s": np.repeat(_time_column(tag_ns), k),
            "sv": names.take(pa.array(number[sky.sv].ravel())),
            "signal": pa.array([SIGNAL]).take(pa.array(np.zeros(n, np.int8))),
            "pseudorange_m": np.round(sky.pseudorange_m.ravel(), 3),
            "doppler_hz": np.round(-sky.range_rate_mps.ravel() / WAVELENGTH_M, 3),
            "cn0_dbhz": np.round(sky.cn0_dbhz.ravel(), 1),
        }
        decimals = {"sat_x_m": 4, "sat_y_m": 4, "sat_z_m": 4}
        decimals |= {"sat_vx_mps": 6, "sat_vy_mps": 6, "sat_vz_mps": 6}
        decimals |= {"sat_clock_m": 4, "sat_clock_drift_mps": 7}
        for i, (name, digits) in enumerate(decimals.items()):
            columns[name] = np.round(sky.sat[:, :, i].ravel(), digits)
        parts.append(pa.table(columns))
    _write_csv(pa.concat_tables(parts), path)


def observed(
    trajectory: Trajectory, log: LongLog, rng: np.random.Generator | None
) -> Iterator[tuple[Int64, Sky]]:
    """Yield tags [ns since the start] and the sky at them, some epochs at a time; free of noise without ``rng``."""
    ephemerides = nominal_constellation(
        start_ns() + round(0.5 * log.duration_s) * NS_PER_S, PLANES, PER_PLANE
    ).ephemerides
    tag_ns = _times_ns(log.duration_s, log.gnss_hz)[1:]
    clock = simulate_clock(
        oscillator(CLOCK),
        tag_ns / NS_PER_S,
        rng or np.random.default_rng(0),
        bias_m=CLOCK_BIAS_M,
        drift_mps=CLOCK_DRIFT_MPS,
    )
    for first in range(0, len(tag_ns), EPOCHS_AT_ONCE):
        span = slice(first, first + EPOCHS_AT_ONCE)
        part = ClockTruth(clock.tag_s[span], clock.bias_m[span], clock.drift_mps[span])
        near = _in_view(trajectory, ephemerides, part.tag_s)
        yield tag_ns[span], _sky(trajectory, ephemerides, near, part, log.satellites, rng)


def _in_view(trajectory: Trajectory, eph: EphemerisTable, tag_s: Float64) -> npt.NDArray[np.intp]:
    """Return the satellites that stand above the horizon at some time of a span."""
    times = np.append(np.arange(tag_s[0], tag_s[-1], ROUTINE_S), tag_s[-1])
    paths = signal_paths(antenna_motion(trajectory, times, LEVER_ARM_B), eph, start_ns(), times)
    return np.flatnonzero((paths.elevation > 0.0).any(axis=0))


def _of_satellites(eph: EphemerisTable, which: npt.NDArray[np.intp]) -> EphemerisTable:
    """Return some rows of the table."""
    fields = {
        name: value[which] if isinstance(value, np.ndarray) else tuple(value[i] for i in which)
        for name, value in vars(eph).items()
    }
    return replace(eph, **fields)


def _sky(
    trajectory: Trajectory,
    ephemerides: EphemerisTable,
    near: npt.NDArray[np.intp],
    clock: ClockTruth,
    k: int,
    rng: np.random.Generator | None,
) -> Sky:
    eph = _of_satellites(ephemerides, near)
    paths = signal_paths(antenna_motion(trajectory, clock.true_s, LEVER_ARM_B), eph, start_ns(), clock.true_s)
    highest = np.sort(np.argpartition(-paths.elevation, k - 1, axis=1)[:, :k], axis=1)
    pick = (np.arange(len(highest))[:, None], highest)
    sat = _states(paths, eph)[pick]
    pseudorange = paths.range_m[pick] + clock.bias_m[:, None] - sat[:, :, 6]
    ticks = (1.0 + sat[:, :, 7] / C_MPS) * (1.0 - paths.range_rate_mps[pick] / C_MPS)
    rate = C_MPS * (1.0 - ticks * (1.0 - clock.drift_mps[:, None] / C_MPS))
    cn0 = BORESIGHT_CN0_DBHZ + cardioid_gain_db(paths.antenna_elevation[pick])
    if rng is not None:
        white = rng.standard_normal((2, *pseudorange.shape))
        pseudorange += PSEUDORANGE_NOISE.sigma(paths.elevation[pick], cn0) * white[0]
        rate += RANGE_RATE_NOISE.sigma(paths.elevation[pick], cn0) * white[1]
    return Sky(near[highest], pseudorange, rate, cn0, sat)


def _states(paths: SignalPaths, eph: EphemerisTable) -> Float64:
    """Return position, velocity, clock and clock drift (m, n, 8) as the log's columns have them."""
    satellite = paths.satellite
    clock_m = C_MPS * (satellite.clock_s - eph.group_delay_s[:, 0])
    drift_mps = C_MPS * satellite.clock_rate
    return np.concatenate([satellite.r_e, satellite.v_e, clock_m[..., None], drift_mps[..., None]], axis=-1)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe a log."""
    default = LongLog()
    parser.add_argument("--hours", type=float, default=default.hours)
    parser.add_argument("--imu-hz", type=float, default=default.imu_hz)
    parser.add_argument("--gnss-hz", type=float, default=default.gnss_hz)
    parser.add_argument("--satellites", type=int, default=default.satellites)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    arguments(parser)
    options = parser.parse_args()
    log = LongLog(options.hours, options.imu_hz, options.gnss_hz, options.satellites)
    began = time.perf_counter()
    flight = write_log(log, options.folder)
    print(f"wrote {flight} in {time.perf_counter() - began:.1f} s")
    for name in ("imu.csv", "gnss.csv"):
        print(f"  {name}: {(options.folder / name).stat().st_size / 2**20:.1f} MiB")


if __name__ == "__main__":
    main()
