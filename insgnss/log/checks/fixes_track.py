"""The way of a vehicle without raw GNSS data: position fixes, and the velocities that come with them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from insgnss.config.quantities import LeverArm
from insgnss.config.sensors import PositionSensor, VelocitySensor
from insgnss.constants import NS_PER_S
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import level_axes
from insgnss.log.checks.sensor_findings import SensorLogRead
from insgnss.log.checks.track import VELOCITY_FLOOR_MPS, GnssTrack, velocities_by_positions
from insgnss.tables import Float64, Int64, SensorTable

_UNSTATED_MPS: Final = 0.1  # sigma of a velocity where neither log nor flight file has one


def fixes_track(logs: Iterable[SensorLogRead]) -> tuple[GnssTrack, LeverArm] | None:
    """Return the track of the first log of position fixes and the lever arm of its point; None without one."""
    read = [(log.config, log.table) for log in logs if log.table is not None]
    positions = next(((config, table) for config, table in read if isinstance(config, PositionSensor)), None)
    if positions is None:
        return None
    config, table = positions
    found = np.isfinite(table.values).all(axis=1)
    t_ns, n = table.t_ns[found], int(found.sum())
    if n < 3:
        return None
    r_e = np.zeros((n, 3))
    for at, (lat, lon, h) in zip(r_e, table.values[found], strict=True):
        geodetic_to_ecef(lat, lon, h, at)
    t_s = (t_ns - t_ns[0]) / NS_PER_S
    velocities = next(((config, table) for config, table in read if isinstance(config, VelocitySensor)), None)
    v_e, sd = np.full(r_e.shape, np.nan), np.full(n, np.nan)
    if velocities is not None:
        v_e, sd = _velocities(*velocities, t_ns, r_e)
    if not np.isfinite(v_e).all(axis=1).any():
        v_e, sd = velocities_by_positions(t_s, r_e, np.ones(n, np.bool_))
    used = np.isfinite(v_e).all(axis=1)
    sd = np.maximum(sd[used], VELOCITY_FLOOR_MPS)
    clock_m, drift_mps = np.zeros(len(sd)), np.full(len(sd), np.nan)
    track = GnssTrack(t_s[used], r_e[used], v_e[used], sd, clock_m, drift_mps, int(t_ns[0]), n, n, n)
    return track, config.lever_arm_m


def _velocities(
    config: VelocitySensor, table: SensorTable, t_ns: Int64, r_e: Float64
) -> tuple[Float64, Float64]:
    """Return the velocities (m, 3) at the fixes' times, NaN where there is none, and their sigmas (m,)."""
    v_n, stated = table.at_times(t_ns)
    v_e = np.array([level_axes(place).T @ v for place, v in zip(r_e, v_n, strict=True)])
    given = float(np.max(config.sigma_mps)) if config.sigma_mps else _UNSTATED_MPS
    sd = stated.max(axis=1)
    return v_e, np.where(np.isfinite(sd), sd, given)
