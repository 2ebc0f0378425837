"""A log as one flat file of numbers, for a program that measures the filter without its surroundings.

All that the engine corrects on its way is corrected beforehand: satellite clocks, light time, the Earth's turn.

The file holds, little-endian: three 64-bit integers (samples n, epochs m, satellites k of each epoch), then doubles:
time tags (n) [s of the week], increments (n, 6) [rad, m/s], epochs (m) [s of the week], per epoch and satellite (m, k,
10) position, velocity, pseudorange, range rate and their sigmas, the lever arm (3), and the start: position (3),
velocity (3) and C_eb (3, 3), ECEF.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.config.flight import GivenStart
from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.orbits.satellite_state import range_rates
from insgnss.gpstime import ns_to_week_seconds
from insgnss.log.flight import Flight, FlightLogs
from insgnss.tables import Float64, GnssTable

SIGMA_PSEUDORANGE_M, SIGMA_RANGE_RATE_MPS = 1.5, 0.1


def write_limit_log(path: Path, flight: Flight, logs: FlightLogs) -> None:
    """Write the logs of a flight with satellite states in its rows and a given start."""
    week = flight.config.gps_week
    start, imu, gnss = flight.config.start, logs.imu, logs.gnss
    if not isinstance(start, GivenStart):
        raise SystemExit("the flight needs a given start")
    step = np.diff(imu.t_ns, prepend=2 * imu.t_ns[0] - imu.t_ns[1]) / NS_PER_S
    epochs, count = np.unique(gnss.t_ns, return_counts=True)
    k = int(count[0])
    if (count != k).any():
        raise SystemExit("every epoch must have the same number of satellites")
    rows = _corrected(gnss).reshape(len(epochs), k, 10)
    r_e, v_e, C_eb = _start(start)
    with path.open("wb") as stream:
        np.array([len(imu.t_ns), len(epochs), k], np.int64).tofile(stream)
        for values in (
            ns_to_week_seconds(imu.t_ns, week),
            np.column_stack([imu.w_ib_b, imu.f_b]) * step[:, None],
            ns_to_week_seconds(epochs, week),
            rows,
            np.array(flight.config.gnss.lever_arm_m),
            r_e,
            v_e,
            C_eb,
        ):
            np.ascontiguousarray(values, np.float64).tofile(stream)


def _corrected(gnss: GnssTable) -> Float64:
    """Return (n, 10) satellite states in the axes of the reception and observations free of satellite clocks."""
    if gnss.sat is None:
        raise SystemExit("the log needs satellite states in its rows")
    angle = WGS84_OMEGA_RADPS * (gnss.pseudorange_m + gnss.sat[:, 6]) / C_MPS
    turn = Rotation.from_rotvec(np.outer(-angle, [0.0, 0.0, 1.0]))
    return np.column_stack(
        [
            turn.apply(gnss.sat[:, 0:3]),
            turn.apply(gnss.sat[:, 3:6]),
            gnss.pseudorange_m + gnss.sat[:, 6],
            range_rates(gnss) + gnss.sat[:, 7],
            np.full(len(gnss.t_ns), SIGMA_PSEUDORANGE_M),
            np.full(len(gnss.t_ns), SIGMA_RANGE_RATE_MPS),
        ]
    )


def _start(start: GivenStart) -> tuple[Float64, Float64, Float64]:
    """Return the given start in ECEF: position, velocity, C_eb."""
    r_e, C_ne = np.empty(3), np.empty((3, 3))
    lat, lon = np.deg2rad(start.lat_deg), np.deg2rad(start.lon_deg)
    geodetic_to_ecef(lat, lon, start.h_m, r_e)
    ecef_to_ned_matrix(lat, lon, C_ne)
    C_nb = Rotation.from_euler("ZYX", start.rpy_deg[::-1], degrees=True).as_matrix()
    return r_e, C_ne.T @ np.array(start.v_ned_mps), C_ne.T @ C_nb
