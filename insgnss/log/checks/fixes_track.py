"""The way of a vehicle without raw GNSS data: position fixes, and the velocities that come with them."""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.config.quantities import LeverArm
from insgnss.config.sensors import PositionSensor, VelocitySensor
from insgnss.constants import NS_PER_S
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import level_axes
from insgnss.log.checks.track import VELOCITY_FLOOR_MPS, GnssTrack, velocities_by_positions
from insgnss.log.flight import Flight
from insgnss.log.imu.sensor_csv import read_sensor
from insgnss.tables import Float64, Int64

_SAME_TIME_S: Final = 0.2
_UNSTATED_MPS: Final = 0.1  # sigma of a velocity where neither log nor flight file has one


def fixes_track(flight: Flight) -> tuple[GnssTrack, LeverArm] | None:
    """Return the track of a flight's first log of position fixes and the lever arm of its point; None without one.

    Raises
    ------
    InsGnssError : a log cannot be read
    """
    positions = next((s for s in flight.config.sensor if isinstance(s, PositionSensor) and s.files), None)
    if positions is None:
        return None
    table, _ = read_sensor(positions, flight.config.gps_week)
    found = np.isfinite(table.values).all(axis=1)
    t_ns, n = table.t_ns[found], int(found.sum())
    if n < 3:
        return None
    r_e = np.zeros((n, 3))
    for at, (lat, lon, h) in zip(r_e, table.values[found], strict=True):
        geodetic_to_ecef(lat, lon, h, at)
    t_s = (t_ns - t_ns[0]) / NS_PER_S
    v_e, sd = _velocities(flight, t_ns, r_e)
    if not np.isfinite(v_e).all(axis=1).any():
        v_e, sd = velocities_by_positions(t_s, r_e, np.ones(n, np.bool_))
    used = np.isfinite(v_e).all(axis=1)
    sd = np.maximum(sd[used], VELOCITY_FLOOR_MPS)
    unknown = np.full(int(used.sum()), np.nan)
    track = GnssTrack(t_s[used], r_e[used], v_e[used], sd, 0.0 * unknown, unknown, int(t_ns[0]), n, n, n)
    return track, positions.lever_arm_m


def _velocities(flight: Flight, t_ns: Int64, r_e: Float64) -> tuple[Float64, Float64]:
    """Return the velocities (m, 3) of their first log at the fixes' times, NaN where there is none, and sigmas (m,)."""
    config = next((s for s in flight.config.sensor if isinstance(s, VelocitySensor) and s.files), None)
    if config is None:
        return np.full(r_e.shape, np.nan), np.full(len(t_ns), np.nan)
    table, _ = read_sensor(config, flight.config.gps_week)
    at = np.clip(np.searchsorted(table.t_ns, t_ns), 1, len(table.t_ns) - 1)
    at -= np.abs(table.t_ns[at - 1] - t_ns) < np.abs(table.t_ns[at] - t_ns)
    near = np.abs(table.t_ns[at] - t_ns) < _SAME_TIME_S * NS_PER_S
    v_e = np.array([level_axes(place).T @ v_n for place, v_n in zip(r_e, table.values[at], strict=True)])
    v_e[~near] = np.nan
    sd = np.full(len(t_ns), float(np.max(config.sigma_mps)) if config.sigma_mps else _UNSTATED_MPS)
    stated = table.sigma[at].max(axis=1) if table.sigma.size else np.full(len(t_ns), np.nan)
    return v_e, np.where(np.isfinite(stated), stated, sd)
