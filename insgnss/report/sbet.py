"""A run as SBET, the binary trajectory of POSPac that lidar and camera software reads, and as its accuracy file.

A record is 17 numbers of 8 bytes, little-endian, without a header; of the accuracy file (smrmsg) 10. The axes of the
velocity are those of a published sample (PDAL, test/data/sbet/2-points.sbet): with a wander angle of 0 they point
north, west and up. Its accelerations are without gravity; body axes are forward, right, down.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.results.nav_columns import VELOCITY
from insgnss.runs.result import Run
from insgnss.tables import Float64

FIELDS: Final = (
    *("time_s", "lat_rad", "lon_rad", "h_m", "v_north_mps", "v_west_mps", "v_up_mps"),
    *("roll_rad", "pitch_rad", "heading_rad", "wander_angle_rad"),
    *("accel_x_mps2", "accel_y_mps2", "accel_z_mps2"),
    *("rate_x_radps", "rate_y_radps", "rate_z_radps"),
)
ACCURACY_FIELDS: Final = (
    *("time_s", "sd_n_m", "sd_e_m", "sd_d_m", "sd_vn_mps", "sd_ve_mps", "sd_vd_mps"),
    *("sd_roll_arcmin", "sd_pitch_arcmin", "sd_heading_arcmin"),
)
_ARCMIN_PER_DEG: Final = 60.0


def as_sbet(run: Run) -> bytes:
    """Return the run as SBET: seconds of the GPS week, radians, height above the ellipsoid, wander angle 0.

    Acceleration and turn rate are those of the rows' own velocities and attitudes: take rows at the IMU's rate where
    they matter (``replay(..., output="imu")``). The turn rate is that against north, east, down, without the
    Earth's rotation of 7.3e-5 rad/s.
    """
    nav = run.nav
    radians = {name: np.radians(nav[f"{name}_deg"]) for name in ("lat", "lon", "roll", "pitch")}
    accel, rate = _body_motion(nav)
    columns = (
        *(nav["time_s"], radians["lat"], radians["lon"], nav["h_m"]),
        *(nav["vn_mps"], -nav["ve_mps"], -nav["vd_mps"]),
        *(radians["roll"], radians["pitch"], np.radians(nav["yaw_deg"] % 360.0)),
        *(np.zeros(len(nav)), *accel.T, *rate.T),
    )
    return _records(FIELDS, columns)


def as_smrmsg(run: Run) -> bytes:
    """Return the sigmas of the run as POSPac's accuracy file: metres, metres per second, minutes of arc."""
    nav = run.nav
    attitude = (_ARCMIN_PER_DEG * nav[f"sd_{name}_deg"] for name in ("roll", "pitch", "yaw"))
    return _records(ACCURACY_FIELDS, (*(nav[name] for name in ACCURACY_FIELDS[:7]), *attitude))


def _records(fields: tuple[str, ...], columns: tuple[npt.ArrayLike, ...]) -> bytes:
    """Return the columns as records of one number each."""
    values = [np.asarray(column, "<f8") for column in columns]
    table: npt.NDArray[Any] = np.zeros(len(values[0]), [(name, "<f8") for name in fields])
    for name, column in zip(fields, values, strict=True):
        table[name] = column
    return table.tobytes()


def _body_motion(nav: pd.DataFrame) -> tuple[Float64, Float64]:
    """Return acceleration over ground [m/s^2] and turn rate [rad/s] in body axes, both (n, 3); 0 for a single row."""
    from scipy.spatial.transform import Rotation

    n, time_s = len(nav), nav["time_s"].to_numpy()
    if n < 2:
        return np.zeros((n, 3)), np.zeros((n, 3))
    C_nb = Rotation.from_euler("ZYX", nav[["yaw_deg", "pitch_deg", "roll_deg"]].to_numpy(), degrees=True)
    a_n = np.gradient(nav[list(VELOCITY)].to_numpy(), time_s, axis=0)
    turns = (C_nb[:-1].inv() * C_nb[1:]).as_rotvec() / np.diff(time_s)[:, None]
    # of a row: the mean of the steps before and after it
    rate = 0.5 * (np.vstack([turns[:1], turns]) + np.vstack([turns, turns[-1:]]))
    return np.asarray(C_nb.inv().apply(a_n)), rate
