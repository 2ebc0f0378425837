"""Directions of the satellites in the local level frame, at the times of an attitude history."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pymap3d

from insgnss.errors import NavigationDataError
from insgnss.geodesy.directions import unit_vectors
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.gpstime import week_seconds_to_ns
from insgnss.runs.visibility.attitude_history import AttitudeHistory
from insgnss.status import NO_CHANNEL, UNKNOWN_SIGNAL, USED
from insgnss.tables import Float64, GnssTable, NavigationData


@dataclass(frozen=True)
class SatelliteDirections:
    """Directions of s satellites at n times; NaN where a satellite's place is not known."""

    sv_names: tuple[str, ...]
    azimuth: Float64  # (n, s) from north, clockwise [rad]
    elevation: Float64  # (n, s) [rad]

    def directions(self) -> Float64:
        """Return unit lines of sight (n, s, 3), north-east-down."""
        return unit_vectors(self.azimuth, self.elevation)


def sky_of_navigation(attitude: AttitudeHistory, navigation: NavigationData) -> SatelliteDirections:
    """Return the direction of every satellite with a healthy broadcast message valid at the time.

    Neglects: the flight time's difference from 75 ms and the Earth's turn meanwhile (1e-5 rad).

    Raises
    ------
    NavigationDataError : the messages are of another time
    """
    states = navigation.state_vectors
    named = [*navigation.ephemerides.sv_names, *(states.sv_names if states is not None else ())]
    names = tuple(sorted(set(named)))
    n, s = len(attitude.t_ns), len(names)
    nothing = np.full(n * s, math.nan)
    asked = GnssTable(
        t_ns=np.repeat(attitude.t_ns, s),
        sv=np.tile(np.arange(s, dtype=np.int16), n),
        signal=np.zeros(n * s, np.int16),
        pseudorange_m=nothing,
        doppler_hz=nothing,
        range_rate_mps=nothing,
        cn0_dbhz=nothing,
        sv_names=names,
        signal_names=("C1C",),
    )
    satellites = satellite_states(asked, navigation)
    place = satellites.position.copy()
    # which signal is looked at does not matter to where the satellite is
    place[~np.isin(satellites.status, (USED, UNKNOWN_SIGNAL, NO_CHANNEL))] = math.nan
    lat, lon, h = (np.repeat(column, s) for column in attitude.position.T)
    azimuth, elevation, _ = pymap3d.ecef2aer(*place.T, lat, lon, h, deg=False)
    if not np.isfinite(elevation).any():
        raise NavigationDataError(
            "no navigation message covers the time of the trajectory",
            advice="check gps_week and the date of the navigation files",
        )
    return SatelliteDirections(names, np.asarray(azimuth).reshape(n, s), np.asarray(elevation).reshape(n, s))


def sky_of_table(
    attitude: AttitudeHistory, table: pd.DataFrame, week: int, longest_gap_s: float = math.inf
) -> SatelliteDirections:
    """Return the sky of a table with the columns time_s, sv, az_deg, el_deg, linearly between its rows.

    A satellite is not known before its first and after its last row, nor within a gap longer than ``longest_gap_s``.

    Parameters
    ----------
    table : such as ``run.satellites``; ``time_s`` counts from ``week``
    """
    groups = [(str(sv), rows) for sv, rows in table.groupby("sv", observed=True)]
    shape = (len(attitude.t_ns), len(groups))
    azimuth, elevation = np.full(shape, math.nan), np.full(shape, math.nan)
    for k, (_, rows) in enumerate(groups):
        rows = rows.sort_values("time_s", kind="stable").drop_duplicates("time_s")
        t_ns = week_seconds_to_ns(week, rows["time_s"].to_numpy())
        since = (attitude.t_ns - t_ns[0]) * 1e-9
        at = (t_ns - t_ns[0]) * 1e-9
        turned = np.unwrap(np.radians(rows["az_deg"].to_numpy(np.float64)))
        azimuth[:, k] = np.interp(since, at, turned, left=math.nan, right=math.nan) % (2.0 * math.pi)
        height = np.radians(rows["el_deg"].to_numpy(np.float64))
        elevation[:, k] = np.interp(since, at, height, left=math.nan, right=math.nan)
        after = np.clip(np.searchsorted(at, since), 1, max(len(at) - 1, 1))
        if len(at) > 1:
            in_gap = (at[after] - at[after - 1] > longest_gap_s) & ~np.isin(since, at)
            azimuth[in_gap, k] = elevation[in_gap, k] = math.nan
    return SatelliteDirections(tuple(sv for sv, _ in groups), azimuth, elevation)
