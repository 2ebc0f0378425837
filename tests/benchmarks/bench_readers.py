"""How long the readers take against pandas' C engine on the same files: ``python -m tests.benchmarks.bench_readers``.

One hour of inertial data at 200 Hz (720 000 rows, 7 columns) is to be read, checked and turned into a table in at
most twice the time that ``pandas.read_csv(engine="c")`` needs to parse it. The two take turns, so that both see the
same load of the machine; the medians are compared.
"""

from __future__ import annotations

import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from insgnss.config.library import imu_grade
from insgnss.log.gnss_csv import read_gnss
from insgnss.log.imu.csv_log import read_imu
from tests.log.writing import GNSS_HEADER, IMU_HEADER, WEEK, gnss_config, imu_config, rest

LIMIT = 2.0
REPETITIONS = 7
STATES = "sat_x_m,sat_y_m,sat_z_m,sat_vx_mps,sat_vy_mps,sat_vz_mps,sat_clock_m,sat_clock_drift_mps"


def write_imu_hour(path: Path) -> None:
    """Write one hour at 200 Hz of a sensor at rest."""
    rows = rest(np.random.default_rng(1), n=720_000, rate_hz=200.0, start_s=10_000.0)
    formats = ["%.4f"] + ["%.8f"] * 3 + ["%.6f"] * 3
    np.savetxt(path, rows, fmt=formats, delimiter=",", header=IMU_HEADER, comments="")


def write_imu_hour_of_dates(path: Path, hour: Path) -> None:
    """Write the same hour with its times as ISO 8601 dates in UTC."""
    frame = pd.read_csv(hour)
    start = np.datetime64("2025-08-28T17:30:22.960", "ms")
    frame["time_s"] = np.datetime_as_string(start + 5 * np.arange(len(frame)), timezone="UTC")
    frame.to_csv(path, index=False, float_format="%.8f")


def write_gnss_million(path: Path) -> None:
    """Write a million GNSS rows of 14 columns, satellite states in the row."""
    rng = np.random.default_rng(2)
    n, satellites = 1_000_000, 25
    frame = pd.DataFrame({"time_s": np.round(1000.0 + np.arange(n) // satellites * 0.1, 3)})
    frame["sv"] = [f"G{1 + k % satellites:02d}" for k in range(n)]
    frame["signal"] = "C1C"
    frame["pseudorange_m"] = np.round(rng.uniform(2.0e7, 2.5e7, n), 3)
    frame["doppler_hz"] = np.round(rng.uniform(-4e3, 4e3, n), 3)
    frame["cn0_dbhz"] = rng.integers(25, 50, n)
    for name in STATES.split(","):
        frame[name] = np.round(rng.uniform(-2e7, 2e7, n), 3)
    assert ",".join(frame.columns) == f"{GNSS_HEADER},{STATES}"
    frame.to_csv(path, index=False)


def seconds(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def compare(name: str, path: Path, read: Callable[[], object]) -> float:
    """Print and return the time of the reader over that of pandas."""
    pandas_s, ours_s = [], []
    for _ in range(REPETITIONS):
        pandas_s.append(seconds(lambda: pd.read_csv(path, engine="c")))
        ours_s.append(seconds(read))
    ratio = float(np.median(ours_s) / np.median(pandas_s))
    tracemalloc.start()
    read()
    peak = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    print(
        f"{name}: {path.stat().st_size / 2**20:.0f} MiB, pandas {np.median(pandas_s):.3f} s, ours"
        f" {np.median(ours_s):.3f} s, ratio {ratio:.2f} (limit {LIMIT:.0f}), NumPy peak {peak:.0f} MiB"
    )
    return ratio


def main() -> int:
    """Return 0 when both ratios are within the limit."""
    with tempfile.TemporaryDirectory() as folder:
        imu, dates, gnss = (Path(folder) / name for name in ("imu.csv", "dates.csv", "gnss.csv"))
        write_imu_hour(imu)
        write_imu_hour_of_dates(dates, imu)
        write_gnss_million(gnss)
        settings = imu_config(imu)
        of_dates = imu_config(dates, time={"origin": "calendar", "scale": "utc"})
        grade = imu_grade("tactical")
        ratios = [
            compare("IMU, 720 000 rows", imu, lambda: read_imu(settings, WEEK, grade)),
            compare("IMU, ISO 8601 times", dates, lambda: read_imu(of_dates, WEEK, grade)),
            compare("GNSS, 1 000 000 rows", gnss, lambda: read_gnss(gnss_config(gnss), WEEK)),
        ]
    return 0 if max(ratios) <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
