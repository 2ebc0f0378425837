"""A solution against a reference trajectory: errors in north, east, down and attitude, each with its sigma."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pymap3d

from insgnss.gpstime import week_seconds_to_ns
from insgnss.results.nav_columns import ATTITUDE, COMPONENTS, PLACE, VELOCITY
from insgnss.runs.result_tables import interpolated
from insgnss.tables import Float64, Int64, ReferenceTable

_LONGEST_STEP = 1.5  # times the reference's median step: beyond, there is nothing to interpolate


def errors_against(
    nav: pd.DataFrame, reference: ReferenceTable, week: int, lever_arm_m: tuple[float, float, float] | None
) -> pd.DataFrame:
    """Return estimate minus reference at the navigation rows that lie within the reference.

    Parameters
    ----------
    lever_arm_m : IMU to antenna in body axes, when the reference is the antenna's; None when it is the IMU's.
        Only the position is carried over; the antenna's velocity differs by (rate x lever arm), which is left in.
    """
    t_ns = week_seconds_to_ns(week, nav["time_s"].to_numpy())
    inside = _covered(t_ns, reference.t_ns)
    nav, t_ns = nav[inside], t_ns[inside]
    r_e = _reference_positions(reference, t_ns)
    lat, lon, h = (nav[c].to_numpy() for c in PLACE)
    estimate = np.column_stack(pymap3d.geodetic2ecef(lat, lon, h))
    n, e, d = pymap3d.ecef2nedv(*(estimate - r_e).T, lat, lon)
    position = np.column_stack([n, e, d])
    if lever_arm_m is not None:
        position += _lever_in_ned(nav, lever_arm_m)
    velocity = nav[list(VELOCITY)].to_numpy() - interpolated(reference.t_ns, t_ns, reference.v_n)
    rpy = np.column_stack([_without_turns(column) for column in reference.rpy_deg.T])
    attitude = nav[list(ATTITUDE)].to_numpy() - interpolated(reference.t_ns, t_ns, rpy)
    attitude = (attitude + 180.0) % 360.0 - 180.0
    nearest = np.clip(np.searchsorted(reference.t_ns, t_ns), 0, len(reference.t_ns) - 1)
    table = pd.DataFrame({"time_s": nav["time_s"].to_numpy(), "quality": reference.quality[nearest]})
    for i, name in enumerate(COMPONENTS):
        table[f"d_{name}"] = np.column_stack([position, velocity, attitude])[:, i]
        table[f"sd_{name}"] = nav[f"sd_{name}"].to_numpy()
    if reference.sigma is not None:
        sigma = interpolated(reference.t_ns, t_ns, reference.sigma)
        for i, name in enumerate(COMPONENTS):
            table[f"sd_reference_{name}"] = sigma[:, i]
    for name in nav.columns.intersection([f"sd_slow_{name}" for name in COMPONENTS]):
        table[name] = nav[name].to_numpy()
    return table


def noise_variance(errors: pd.DataFrame, name: str) -> pd.Series:
    """Return the variance of a component of errors without that of the errors that last for minutes."""
    slow = errors[f"sd_slow_{name}"] if f"sd_slow_{name}" in errors else 0.0
    return errors[f"sd_{name}"] ** 2 - slow**2


def trajectory_of(nav: pd.DataFrame, week: int) -> ReferenceTable:
    """Return navigation rows as the trajectory that others are measured against."""
    return ReferenceTable(
        t_ns=week_seconds_to_ns(week, nav["time_s"].to_numpy()),
        lat_deg=nav["lat_deg"].to_numpy(),
        lon_deg=nav["lon_deg"].to_numpy(),
        h_m=nav["h_m"].to_numpy(),
        v_n=nav[list(VELOCITY)].to_numpy(),
        rpy_deg=nav[list(ATTITUDE)].to_numpy(),
        quality=np.ones(len(nav)),
    )


def _without_turns(angle_deg: Float64) -> Float64:
    """Return angles (n,) without jumps of a whole turn; a missing one stays missing, and alone."""
    known = np.isfinite(angle_deg)
    smooth = angle_deg.copy()
    smooth[known] = np.degrees(np.unwrap(np.radians(angle_deg[known])))
    return smooth


def _covered(t_ns: Int64, ref_ns: Int64) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which times have a reference row on either side, near enough to interpolate."""
    if len(ref_ns) < 2:
        return np.zeros(len(t_ns), np.bool_)
    longest = _LONGEST_STEP * float(np.median(np.diff(ref_ns)))
    after = np.searchsorted(ref_ns, t_ns)
    inside = (t_ns >= ref_ns[0]) & (t_ns <= ref_ns[-1])
    after = np.clip(after, 1, len(ref_ns) - 1)
    return np.asarray(inside & (ref_ns[after] - ref_ns[after - 1] <= longest))


def _reference_positions(reference: ReferenceTable, t_ns: Int64) -> Float64:
    """Return the reference's ECEF positions (n, 3) at the given times."""
    r_e = np.column_stack(pymap3d.geodetic2ecef(reference.lat_deg, reference.lon_deg, reference.h_m))
    return interpolated(reference.t_ns, t_ns, r_e)


def _lever_in_ned(nav: pd.DataFrame, lever_arm_m: tuple[float, float, float]) -> Float64:
    """Return the lever arm in north, east, down (n, 3) at each navigation row."""
    roll, pitch, yaw = (np.radians(nav[c].to_numpy()) for c in ATTITUDE)
    sr, cr, sp, cp, sy, cy = (
        np.sin(roll),
        np.cos(roll),
        np.sin(pitch),
        np.cos(pitch),
        np.sin(yaw),
        np.cos(yaw),
    )
    x, y, z = lever_arm_m
    ahead = cp * x + sp * (sr * y + cr * z)
    right = cr * y - sr * z
    return np.column_stack(
        [cy * ahead - sy * right, sy * ahead + cy * right, -sp * x + cp * (sr * y + cr * z)]
    )
