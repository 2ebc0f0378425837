"""Simulated tables as the CSV files that a flight file names; the same table gives the same bytes."""

from __future__ import annotations

import gzip
import io
from pathlib import Path
from typing import Final

import numpy as np

from insgnss.geodesy.standard_atmosphere import standard_pressure
from insgnss.gpstime import ns_to_week_seconds
from insgnss.tables import Float64, GnssTable, ImuTable, Int64, ReferenceTable, SensorTable
from insgnss.units import RAD_PER_DEG

GYRO_DECIMALS = 7  # rad/s: a thousandth of a tactical gyro's noise at 100 Hz
ACCEL_DECIMALS = 5  # m/s^2: a thousandth of a tactical accelerometer's noise at 100 Hz

ANGLE_DECIMALS = 11  # rad: a tenth of a navigation grade's noise at 1 kHz
VELOCITY_DECIMALS = 9  # m/s: the same
_GZIP_LEVEL: Final = 7  # the highest takes four times as long for files that are 0.8 % smaller


def write_imu(path: Path, imu: ImuTable, week: int) -> None:
    """Write mean rates [rad/s] and specific forces [m/s^2], one row per sample; gzipped when the name ends in .gz."""
    _write_samples(path, imu.t_ns, week, (imu.w_ib_b, imu.f_b), (GYRO_DECIMALS, ACCEL_DECIMALS))


def write_increments(path: Path, imu: ImuTable, week: int, step_s: float) -> None:
    """Write angle [rad] and velocity [m/s] increments over the nominal step, one row per sample."""
    increments = step_s * imu.w_ib_b, step_s * imu.f_b
    _write_samples(path, imu.t_ns, week, increments, (ANGLE_DECIMALS, VELOCITY_DECIMALS))


def _write_samples(
    path: Path, t_ns: Int64, week: int, triads: tuple[Float64, Float64], decimals: tuple[int, int]
) -> None:
    header = "time_s,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
    formats = [f"%.{_time_decimals(t_ns)}f", *(f"%.{d}f" for d in decimals for _ in range(3))]
    rounded = [np.round(triad, d) for triad, d in zip(triads, decimals, strict=True)]
    _write(path, header, formats, np.column_stack([ns_to_week_seconds(t_ns, week), *rounded]))


def _time_decimals(t_ns: Int64) -> int:
    """Return how many decimals of a second the tags need to be written exactly, at least two."""
    return next(d for d in range(2, 10) if not np.any(t_ns % 10 ** (9 - d)))


def write_gnss(path: Path, gnss: GnssTable, week: int) -> None:
    """Write one row per signal and epoch: pseudorange [m], Doppler [Hz], C/N0 [dBHz]; carrier phase where there is one.

    Phases have three decimals, as in RINEX: 0.1 mm, a tenth of their noise.
    """
    phase, lli = gnss.carrier_cycles, gnss.lli
    lines = ["time_s,sv,signal,pseudorange_m,doppler_hz,cn0_dbhz"]
    if phase is not None and lli is not None:
        lines[0] += ",carrier_phase_cycles,lli"
    time_s = ns_to_week_seconds(gnss.t_ns, week)
    for k in range(len(gnss.t_ns)):
        name, signal = gnss.sv_names[gnss.sv[k]], gnss.signal_names[gnss.signal[k]]
        numbers = f"{gnss.pseudorange_m[k]:.3f},{gnss.doppler_hz[k]:.3f},{gnss.cn0_dbhz[k]:.1f}"
        if phase is not None and lli is not None:
            numbers += f",{phase[k]:.3f},{lli[k]}"
        lines.append(f"{time_s[k]:.3f},{name},{signal},{numbers}")
    path.write_bytes(("\n".join(lines) + "\n").encode("ascii"))


def write_reference(path: Path, reference: ReferenceTable, week: int) -> None:
    """Write the truth: degrees, metres, metres per second."""
    header = "time_s,lat_deg,lon_deg,h_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg,quality"
    decimals = [3, 9, 9, 3, 4, 4, 4, 4, 4, 4, 0]
    columns = [
        ns_to_week_seconds(reference.t_ns, week),
        reference.lat_deg,
        reference.lon_deg,
        reference.h_m,
        *reference.v_n.T,
        *reference.rpy_deg.T,
        reference.quality,
    ]
    rounded = [np.round(column, d) for column, d in zip(columns, decimals, strict=True)]
    _write(path, header, [f"%.{d}f" for d in decimals], np.column_stack(rounded))


def sensor_file_name(name: str) -> str:
    """Return the file of a further sensor's log."""
    return f"sensor_{name}.csv"


# names, factors from the units of ``SensorTable`` and decimals of the columns of each kind
_SENSOR_COLUMNS: Final = {
    "odometer": (("speed",), (1.0,), (4,)),
    "barometer": (("pressure_hpa",), (1.0,), (4,)),  # of the pressure, see below
    "magnetometer": (("mag_x", "mag_y", "mag_z"), (1.0,) * 3, (3,) * 3),
    "heading": (("heading_deg",), (1.0 / RAD_PER_DEG,), (4,)),
    "attitude": (("roll_deg", "pitch_deg", "yaw_deg"), (1.0 / RAD_PER_DEG,) * 3, (4,) * 3),
    "position": (("lat_deg", "lon_deg", "h_m"), (1.0 / RAD_PER_DEG, 1.0 / RAD_PER_DEG, 1.0), (9, 9, 3)),
    "velocity": (("vn_mps", "ve_mps", "vd_mps"), (1.0,) * 3, (4,) * 3),
}


def write_sensor(path: Path, kind: str, sensor: SensorTable, week: int) -> None:
    """Write a further sensor's readings, a barometer's as pressures [hPa]; a reading that is not there is empty."""
    names, factors, decimals = _SENSOR_COLUMNS[kind]
    values = standard_pressure(sensor.values) if kind == "barometer" else sensor.values * factors
    time_s, digits = ns_to_week_seconds(sensor.t_ns, week), _time_decimals(sensor.t_ns)
    lines = [",".join(("time_s", *names))]
    for t, row in zip(time_s, values, strict=True):
        cells = ["" if np.isnan(v) else f"{v + 0.0:.{d}f}" for v, d in zip(row, decimals, strict=True)]
        lines.append(",".join((f"{t:.{digits}f}", *cells)))
    path.write_bytes(("\n".join(lines) + "\n").encode("ascii"))


def _write(path: Path, header: str, formats: list[str], rows: Float64) -> None:
    """Write rounded numbers as CSV; adding zero turns -0 into 0."""
    text = io.BytesIO()
    np.savetxt(text, rows + 0.0, fmt=formats, delimiter=",", header=header, comments="")
    data = text.getvalue()
    # no time and no name in the gzip header: the same log gives the same bytes
    packed = gzip.compress(data, _GZIP_LEVEL, mtime=0) if path.suffix == ".gz" else data
    path.write_bytes(packed)
