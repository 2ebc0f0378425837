"""Small logs for the tests of the readers, written as a recorder would write them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from insgnss.config.flight import Gnss, ImuConfig, ImuGrade

Float64 = npt.NDArray[np.float64]

WEEK = 2268
G_MPS2 = 9.80665
IMU_HEADER = "time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
GNSS_HEADER = "time_s,sv,signal,pseudorange_m,doppler_hz,cn0_dbhz"
RANGE_RATES_MPS = (-600.0, -250.0, 350.0, 500.0)
GRADE = ImuGrade(
    gyro_bias_deg_per_h=10.0,
    gyro_bias_instability_deg_per_h=3.0,
    gyro_correlation_time_s=600.0,
    gyro_arw_deg_per_sqrt_h=0.3,
    accel_bias_mg=3.0,
    accel_bias_instability_mg=0.3,
    accel_correlation_time_s=600.0,
    accel_vrw_mps_per_sqrt_h=0.12,
)


def rest(rng: np.random.Generator, n: int = 1000, rate_hz: float = 100.0, start_s: float = 1000.0) -> Float64:
    """Return (n, 7) rows of a level sensor at rest in forward-right-down axes: time, rates, specific force."""
    rows = np.empty((n, 7))
    rows[:, 0] = start_s + np.arange(n) / rate_hz
    rows[:, 1:4] = rng.normal(0.0, 1e-3, (n, 3))
    rows[:, 4:7] = rng.normal((0.0, 0.0, -G_MPS2), 1e-2, (n, 3))
    return rows


def lines_of(rows: Float64) -> list[str]:
    """Return inertial rows as text, nine digits behind the point."""
    return [",".join(f"{value:.9f}" for value in row) for row in rows]


def write_lines(path: Path, lines: Sequence[str], end: str = "\n") -> Path:
    """Write lines, each with its end, without any translation."""
    path.write_bytes("".join(line + end for line in lines).encode())
    return path


def write_imu(path: Path, rows: Float64) -> Path:
    """Write inertial rows under the default header."""
    return write_lines(path, [IMU_HEADER, *lines_of(rows)])


def imu_config(*files: Path, **settings: object) -> ImuConfig:
    """Return the settings of an inertial log with the default columns."""
    return ImuConfig.model_validate({"files": files, "grade": GRADE, **settings})


def gnss_config(*files: Path, **settings: object) -> Gnss:
    """Return the settings of a GNSS log with the default columns."""
    return Gnss.model_validate({"files": files, **settings})


def gnss_lines(n_epochs: int = 20, satellites: Sequence[str] = ("G05", "G07", "G13", "G30")) -> list[str]:
    """Return GNSS rows of 1 Hz from 1000 s on: straight pseudoranges and the Doppler that belongs to them."""
    lines = []
    for k in range(n_epochs):
        for i, name in enumerate(satellites):
            rate = RANGE_RATES_MPS[i % 4]
            doppler = -rate / 0.190293672798365
            lines.append(f"{1000 + k:.3f},{name},C1C,{2.2e7 + 1e5 * i + rate * k:.3f},{doppler:.4f},45.0")
    return lines


def write_gnss(path: Path, lines: Sequence[str]) -> Path:
    """Write GNSS rows under the default header."""
    return write_lines(path, [GNSS_HEADER, *lines])


def tabbed(text: str) -> str:
    """Return a text with a tab for the blanks before every eighth column, as an editor saves it."""
    cut = [[line[k : k + 8] for k in range(0, len(line), 8)] for line in text.split("\n")]
    with_tabs = [
        "".join(f"{part.rstrip()}\t" if part.endswith("  ") else part for part in line[:-1])
        + "".join(line[-1:])
        for line in cut
    ]
    return "\n".join(with_tabs)
