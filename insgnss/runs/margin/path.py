"""The path of a run at the times of its satellites: position, attitude, acceleration and its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from insgnss.constants import STANDARD_GRAVITY_MPS2
from insgnss.errors import InputError
from insgnss.results.nav_columns import PLACE, VELOCITY
from insgnss.runs.result import Run
from insgnss.tables import Float64

_ANGLES: Final = ["yaw_deg", "pitch_deg", "roll_deg"]
_NEEDED: Final = ["time_s", *PLACE, *VELOCITY, *_ANGLES]
_BIASES: Final = [f"sd_accel_bias_{axis}_mps2" for axis in "xyz"]
_AIDING_TOLERANCE_S: Final = 1  # a sigma of the aiding is computed once a second


@dataclass(frozen=True)
class FlownPath:
    """n times of a run."""

    time_s: Float64  # (n,)
    position: Float64  # (n, 3) latitude, longitude [rad], height [m]
    C_nb: Float64  # (n, 3, 3)
    motion: Float64  # (n, 3, 3) mean of a a^T over the window, north-east-down [m^2/s^4]
    accel_sigma: Float64  # (n,) bound of what the aiding's acceleration is off by, from the filter's own sigmas [m/s^2]


def flown_path(run: Run, step_s: float, window_s: float) -> tuple[FlownPath, pd.DataFrame]:
    """Return the path and the rows of ``run.satellites`` at its times, with the number of each row's time in ``at``.

    Equation: sigma_a^2 = max sd_accel_bias^2 + (g sd_tilt)^2, without the correlation of the two, which makes it less
    Neglects: Earth rate and curvature in the acceleration, the change of velocity in north-east-down (1e-3 m/s^2).

    Parameters
    ----------
    step_s : least time between two rows; 0 takes all
    window_s : over which the acceleration's square is averaged

    Raises
    ------
    InputError : the run lacks columns, or satellites and navigation share no time
    """
    _check_columns(run.nav, _NEEDED, "nav")
    _check_columns(run.satellites, ["time_s", "sv", "az_deg", "el_deg", "gain_dbi"], "satellites")
    nav = run.nav[np.isfinite(run.nav[_NEEDED].to_numpy(np.float64)).all(axis=1)]
    nav = nav.drop_duplicates("time_s").sort_values("time_s")
    satellites = run.satellites
    if len(nav) > 1:
        inside = satellites["time_s"].between(nav["time_s"].iloc[0], nav["time_s"].iloc[-1])
        satellites = satellites[inside & np.isfinite(satellites["el_deg"])]
    if len(nav) < 2 or satellites.empty:
        raise InputError(
            "the run has no time with both a position and a satellite",
            advice="replay a flight whose filter starts and whose log has satellites above the horizon",
        )
    times = _thinned(np.unique(satellites["time_s"].to_numpy(np.float64)), step_s)
    satellites = satellites[satellites["time_s"].isin(times)].reset_index(drop=True)
    satellites["at"] = np.searchsorted(times, satellites["time_s"].to_numpy())
    t = nav["time_s"].to_numpy(np.float64)

    def at_times(values: Any) -> Float64:
        columns = np.asarray(values, np.float64).reshape(len(t), -1)
        return np.column_stack([np.interp(times, t, column) for column in columns.T])

    radians = np.radians(nav[["lat_deg", "lon_deg"]].to_numpy(np.float64))
    radians[:, 1] = np.unwrap(radians[:, 1])
    turns = Rotation.from_euler("ZYX", nav[_ANGLES].to_numpy(np.float64), degrees=True)
    path = FlownPath(
        times,
        np.column_stack([at_times(radians), at_times(nav["h_m"])]),
        Slerp(t, turns)(times).as_matrix(),
        at_times(_motion(t, nav[list(VELOCITY)].to_numpy(np.float64), window_s)).reshape(-1, 3, 3),
        at_times(_accel_sigma(nav))[:, 0],
    )
    return path, satellites


def aiding_sigma(run: Run, satellites: pd.DataFrame) -> Float64:
    """Return the sigma of the aiding's range acceleration for each row of satellites [m/s^2], NaN where unknown.

    It is that of ``run.aiding`` at the nearest output within a second. It holds the white noise of the inertial sample
    that the value rests on, so it bounds from above what lasts.
    """
    nothing = np.full(len(satellites), math.nan)
    aiding = getattr(run, "aiding", None)
    name = "sd_range_acceleration_mps2"
    if aiding is None or name not in aiding.columns or aiding.empty:
        return nothing
    known = aiding[["time_s", "sv", name]].dropna().sort_values("time_s")
    asked = satellites[["time_s", "sv"]].assign(row=np.arange(len(satellites))).sort_values("time_s")
    joined = pd.merge_asof(
        asked.astype({"sv": "str", "time_s": "float64"}),
        known.astype({"sv": "str", "time_s": "float64"}),
        on="time_s",
        by="sv",
        direction="nearest",
        tolerance=_AIDING_TOLERANCE_S,
    )
    nothing[joined["row"].to_numpy()] = joined[name].to_numpy(np.float64)
    return nothing


def _motion(t: Float64, v_n: Float64, window_s: float) -> Float64:
    """Return the mean of a a^T over a window around each time (n, 3, 3)."""
    a = np.gradient(v_n, t, axis=0)
    product = a[:, :, None] * a[:, None, :]
    width = max(1, min(len(t), round(window_s / float(np.median(np.diff(t))))))
    return np.asarray(uniform_filter1d(product, width, axis=0, mode="nearest"))


def _accel_sigma(nav: pd.DataFrame) -> Float64:
    """Return the bound from the sigmas of tilt and accelerometer biases, infinite where the run has none."""
    if not {*_BIASES, "sd_roll_deg", "sd_pitch_deg"} <= set(nav.columns):
        return np.full(len(nav), math.inf)
    tilt = np.radians(nav[["sd_roll_deg", "sd_pitch_deg"]].to_numpy(np.float64)).max(axis=1)
    return np.asarray(np.hypot(nav[_BIASES].to_numpy(np.float64).max(axis=1), STANDARD_GRAVITY_MPS2 * tilt))


def _thinned(times: Float64, step_s: float) -> Float64:
    """Return the first time of each step."""
    if step_s <= 0.0:
        return times
    return times[np.unique(np.floor((times - times[0]) / step_s + 1e-9), return_index=True)[1]]


def _check_columns(table: pd.DataFrame, names: list[str], of: str) -> None:
    for name in names:
        if name not in table.columns:
            raise InputError(
                f"the run's table '{of}' has no such column", column=name, advice="replay the flight again"
            )
