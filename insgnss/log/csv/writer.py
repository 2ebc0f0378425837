"""Writes our CSV files (GNSS observations, samples of sensors, a reference); reading them gives the same numbers.

Numbers are written with as many digits as it takes to get the same float64 back; an empty cell is a missing value.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from pyarrow import csv

from insgnss.config.flight import GnssColumns, ReferenceColumns
from insgnss.errors import ResultError
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.further_samples import FurtherSamples
from insgnss.tables import Float64, GnssTable, ImuTable, ReferenceTable

IMU_COLUMNS: Final = ("time_s", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
_GNSS: Final = GnssColumns()
_STATE_COLUMNS: Final = (*_GNSS.sat_position, *_GNSS.sat_velocity, _GNSS.sat_clock, _GNSS.sat_clock_drift)


def write_gnss_csv(path: Path, gnss: GnssTable, week: int) -> None:
    """Write one row for each epoch, satellite and signal; columns that the table has not are left out."""
    columns: dict[str, Any] = {
        "time_s": pa.array(ns_to_week_seconds(gnss.t_ns, week)),
        "sv": pa.array(np.array(gnss.sv_names, dtype=object)[gnss.sv], pa.string()),
        "signal": pa.array(np.array(gnss.signal_names, dtype=object)[gnss.signal], pa.string()),
        "pseudorange_m": _nullable(gnss.pseudorange_m),
        "doppler_hz": _nullable(gnss.doppler_hz),
    }
    optional: dict[str, Float64 | None] = {
        "range_rate_mps": None if np.isnan(gnss.range_rate_mps).all() else gnss.range_rate_mps,
        "cn0_dbhz": gnss.cn0_dbhz,
        "carrier_phase_cycles": gnss.carrier_cycles,
        "sigma_pseudorange_m": gnss.sigma_pseudorange_m,
        "sigma_range_rate_mps": gnss.sigma_range_rate_mps,
    }
    columns |= {name: _nullable(values) for name, values in optional.items() if values is not None}
    if gnss.lli is not None:
        columns["lli"] = pa.array(gnss.lli)
    if gnss.sat is not None:
        columns |= {name: _nullable(values) for name, values in zip(_STATE_COLUMNS, gnss.sat.T, strict=True)}
    _write(path, columns)


def write_imu_csv(path: Path, imu: ImuTable, week: int) -> None:
    """Write one row for each sample: rates in rad/s, specific forces in m/s^2, in the sensor's axes."""
    values = [ns_to_week_seconds(imu.t_ns, week), *imu.w_ib_b.T, *imu.f_b.T]
    _write(
        path, {name: pa.array(np.ascontiguousarray(v)) for name, v in zip(IMU_COLUMNS, values, strict=True)}
    )


def write_samples_csv(path: Path, samples: FurtherSamples, week: int) -> None:
    """Write one row for each sample of a further sensor; columns without a number are left out."""
    columns = {"time_s": pa.array(ns_to_week_seconds(samples.t_ns, week))}
    for name, values in zip(samples.columns, samples.values.T, strict=True):
        if np.isfinite(values).any():
            columns[name] = _nullable(values)
    _write(path, columns)


def write_reference_csv(path: Path, reference: ReferenceTable, week: int) -> None:
    """Write one row for each time of a reference; columns without a number are left out."""
    columns = {"time_s": pa.array(ns_to_week_seconds(reference.t_ns, week))}
    names = ReferenceColumns()
    parts: list[tuple[tuple[str, ...], Float64]] = [
        (names.position, np.array([reference.lat_deg, reference.lon_deg, reference.h_m])),
        (names.velocity, reference.v_n.T),
        (names.attitude, reference.rpy_deg.T),
        ((names.quality,), reference.quality[None]),
    ]
    if reference.sigma is not None:
        sigmas = (*names.sigma_position, *names.sigma_velocity, *names.sigma_attitude)
        parts.append((sigmas, reference.sigma.T))
    for group, numbers in parts:
        for name, values in zip(group, numbers, strict=True):
            if np.isfinite(values).any():
                columns[name] = _nullable(values)
    _write(path, columns)


def write_fixes_csv(path: Path, fixes: ReferenceTable, week: int) -> None:
    """Write fixes as sensors of position and velocity read them: without attitude, and without a quality.

    A reference has a quality for its errors' table; a sensor's rows are weighted by their sigmas alone.
    """
    sigma = None
    if fixes.sigma is not None:
        sigma = np.full_like(fixes.sigma, np.nan)
        sigma[:, :3] = fixes.sigma[:, :3]
        sigma[:, 3:6] = np.where(np.isfinite(fixes.v_n).any(axis=0), fixes.sigma[:, 3:6], np.nan)
    no_attitude, no_quality = np.full_like(fixes.rpy_deg, np.nan), np.full_like(fixes.quality, np.nan)
    write_reference_csv(path, replace(fixes, rpy_deg=no_attitude, quality=no_quality, sigma=sigma), week)


def _nullable(values: Float64) -> Any:
    return pa.array(np.ascontiguousarray(values), mask=np.isnan(values))


def _write(path: Path, columns: dict[str, Any]) -> None:
    table = pa.table(columns)
    options = csv.WriteOptions(include_header=False, quoting_style="none")
    try:
        with path.open("wb") as stream:
            stream.write((",".join(columns) + "\n").encode())
            csv.write_csv(table, stream, options)
    except OSError as error:
        raise ResultError(f"cannot be written: {error}", file=path) from error
