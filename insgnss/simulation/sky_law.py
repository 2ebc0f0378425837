"""Satellites in the directions of a table: azimuth and elevation linear in time, at the height of GPS.

For scenarios that give a sky instead of orbits. Such a satellite obeys no law of gravity, so no ephemeris describes it:
its states go into the log's own rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from insgnss.constants import C_MPS, WGS84_A_M
from insgnss.geodesy.directions import unit_vectors
from insgnss.geodesy.ellipsoid import geodetic_to_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.simulation.constellation import ConstellationStates
from insgnss.simulation.observations import SignalObservations, SignalPaths, to_table
from insgnss.simulation.sky import SkyTrack
from insgnss.tables import Float64, GnssTable
from insgnss.units import deg_to_rad

GPS_HEIGHT_M = 20_200e3  # above the Earth's equatorial radius; IS-GPS-200N, 20.3.3.4.3: an orbit of 26 560 km


@dataclass(frozen=True)
class SkyLaw:
    """Directions of n satellites from a place, and so where they are."""

    r_e: Float64  # (3,) the place, ECEF [m]
    C_ne: Float64  # (3, 3) its north, east and down
    start: Float64  # (n, 2) azimuth and elevation at t = 0 [rad]
    rate: Float64  # (n, 2) their constant rates [rad/s]

    @classmethod
    def of_tracks(
        cls, place: tuple[float, float, float], tracks: tuple[SkyTrack, ...], duration_s: float
    ) -> SkyLaw:
        """Return the law that leads from the tracks' start to their end within ``duration_s``.

        ``place`` is latitude, longitude [deg] and height [m]. An azimuth goes the way the numbers say: from 350 to 370
        over north.
        """
        r_e, C_ne = np.empty(3), np.empty((3, 3))
        lat, lon = deg_to_rad(place[0]), deg_to_rad(place[1])
        geodetic_to_ecef(lat, lon, place[2], r_e)
        ecef_to_ned_matrix(lat, lon, C_ne)
        ends = np.radians([(track.azimuth_deg, track.elevation_deg) for track in tracks])
        return cls(r_e, C_ne, ends[:, :, 0], (ends[:, :, 1] - ends[:, :, 0]) / duration_s)

    def angles(self, t_s: Float64) -> Float64:
        """Return azimuth and elevation (m, n, 2) [rad] at times (m, n) of each satellite's own [s]."""
        return np.asarray(self.start + self.rate * np.asarray(t_s)[..., None])

    def directions(self, t_s: Float64) -> Float64:
        """Return unit lines of sight from the place (m, n, 3), north-east-down."""
        return unit_vectors(*np.moveaxis(self.angles(t_s), -1, 0))

    def states(self, t_s: Float64) -> ConstellationStates:
        """Return positions and velocities, ECEF, at times (m, n); the clocks are perfect.

        Equation: r = r_p + rho u, rho = -b + sqrt(b^2 + R^2 - |r_p|^2), b = u . r_p;
                  v = rho' u + rho u', rho' = -b' rho / (rho + b), b' = u' . r_p       [the law of cosines]
        """
        azimuth, elevation = np.moveaxis(self.angles(t_s), -1, 0)
        sa, ca, se, ce = np.sin(azimuth), np.cos(azimuth), np.sin(elevation), np.cos(elevation)
        a1, e1 = self.rate.T
        u = np.stack([ce * ca, ce * sa, -se], axis=-1) @ self.C_ne
        u1 = np.stack([-e1 * se * ca - a1 * ce * sa, -e1 * se * sa + a1 * ce * ca, -e1 * ce], axis=-1)
        u1 = u1 @ self.C_ne
        b, b1 = u @ self.r_e, u1 @ self.r_e
        radius = WGS84_A_M + GPS_HEIGHT_M
        root = np.sqrt(b**2 + radius**2 - self.r_e @ self.r_e)
        rho = root - b
        rho1 = -b1 * rho / root
        r_s = self.r_e + rho[..., None] * u
        v_s = rho1[..., None] * u + rho[..., None] * u1
        none = np.zeros_like(rho)
        return ConstellationStates(r_s, v_s, none, none)


def table_with_states(observations: SignalObservations, paths: SignalPaths, start_ns: int) -> GnssTable:
    """Return the tracked observations of one signal as a log whose rows hold the satellites' states at transmission."""
    epoch, column = np.nonzero(observations.tracked)
    satellite = paths.satellite
    clock = C_MPS * np.stack([satellite.clock_s, satellite.clock_rate], axis=-1)
    states = np.concatenate([satellite.r_e, satellite.v_e, clock], axis=-1)
    return replace(to_table(observations, start_ns), sat=np.ascontiguousarray(states[epoch, column]))
