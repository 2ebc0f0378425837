"""The straight paths of signals from satellites to an antenna, in the inertial frame: light time and Earth's turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from insgnss.constants import C_MPS, WGS84_OMEGA_RADPS
from insgnss.geodesy.directions import angles_of
from insgnss.geodesy.local_level import geodetic, ned_axes
from insgnss.geodesy.rotations import EARTH_RATE_E
from insgnss.simulation.constellation import ConstellationStates, satellite_states
from insgnss.simulation.trajectory import Trajectory
from insgnss.tables import EphemerisTable, Float64

LIGHT_TIME_STEPS = 4  # each multiplies the error by (satellite velocity) / c = 1e-5, from 20 ms on


@dataclass(frozen=True)
class AntennaMotion:
    """The antenna at given times, in the axes of ECEF."""

    r_e: Float64  # (m, 3) [m]
    v_e: Float64  # (m, 3) relative to the Earth [m/s]
    C_eb: Float64  # (m, 3, 3)


@dataclass(frozen=True)
class SignalPaths:
    """The signals that arrive at given times, by satellite."""

    range_m: Float64  # (m, n)
    range_rate_mps: Float64  # (m, n) derivative by the time of reception
    satellite: ConstellationStates  # at transmission
    azimuth: Float64  # (m, n) [rad]
    elevation: Float64  # (m, n) above the horizon [rad]
    antenna_elevation: Float64  # (m, n) above the antenna's plane (body x-y) [rad]
    geodetic: Float64  # (m, 3) of the antenna: latitude, longitude [rad], height [m]
    antenna: AntennaMotion

    def sky_at(self, step_s: float) -> tuple[Float64, Float64, Float64]:
        """Return place, azimuth and elevation of the same signals ``step_s`` later, all moved by their velocities."""
        r_e = self.antenna.r_e + step_s * self.antenna.v_e
        satellite_e = self.satellite.r_e + step_s * self.satellite.v_e
        towards = _turned(satellite_e, self.range_m / C_MPS) - r_e[:, None]
        return _sky(r_e, towards / np.linalg.norm(towards, axis=-1, keepdims=True))


def antenna_motion(trajectory: Trajectory, t_s: Float64, lever_arm_b: Sequence[float]) -> AntennaMotion:
    """Return the antenna's motion: ``r_a = r + C_eb l``, ``v_a = v + C_eb (w_eb_b x l)``."""
    motion = trajectory.motion(t_s)
    lever = np.asarray(lever_arm_b, dtype=np.float64)
    r_e = motion.r_e + motion.C_eb @ lever
    v_e = motion.v_e + np.einsum("mij,mj->mi", motion.C_eb, np.cross(motion.w_eb_b, lever))
    return AntennaMotion(r_e, v_e, motion.C_eb)


def signal_paths(antenna: AntennaMotion, eph: EphemerisTable, start_ns: int, t_s: Float64) -> SignalPaths:
    """Return the paths from the satellites of ephemerides; see ``paths_to``."""
    return paths_to(antenna, lambda sent: satellite_states(eph, start_ns, sent), len(eph.sv_names), t_s)


def paths_to(
    antenna: AntennaMotion, states: Callable[[Float64], ConstellationStates], count: int, t_s: Float64
) -> SignalPaths:
    """Return the straight paths in the inertial frame whose axes are those of ECEF at the moment of reception.

    Equation: ``rho = |r_r - R3(w rho/c) r_s(t - rho/c)|``; differentiated with the transmission time's own change,
    ``rho' = u.(v_r - v_s) / (1 - u.v_s / c)``, u from satellite to receiver, both velocities inertial.
    Neglects: the bending and slowing of light by gravity, below 2 cm.

    Parameters
    ----------
    states : where ``count`` satellites are at times (m, n) of their own
    t_s : (m,) times of reception
    """
    tau = np.full((len(t_s), count), 0.07)
    for _ in range(LIGHT_TIME_STEPS):
        satellite = states(t_s[:, None] - tau)
        path = antenna.r_e[:, None] - _turned(satellite.r_e, tau)
        distance = np.linalg.norm(path, axis=-1)
        tau = distance / C_MPS
    u = path / distance[..., None]
    v_s = _turned(satellite.v_e + np.cross(EARTH_RATE_E, satellite.r_e), tau)
    v_r = (antenna.v_e + np.cross(EARTH_RATE_E, antenna.r_e))[:, None]
    rate = np.sum(u * (v_r - v_s), axis=-1) / (1.0 - np.sum(u * v_s, axis=-1) / C_MPS)
    geodetic, azimuth, elevation = _sky(antenna.r_e, -u)
    # body z is down: the antenna looks along -z
    up_b = -np.einsum("mi,mni->mn", antenna.C_eb[:, :, 2], -u)
    return SignalPaths(distance, rate, satellite, azimuth, elevation, np.arcsin(up_b), geodetic, antenna)


def _turned(vector: Float64, tau: Float64) -> Float64:
    """Return R3(w tau) applied to ECEF vectors (m, n, 3) of the moment tau before reception."""
    sine, cosine = np.sin(WGS84_OMEGA_RADPS * tau), np.cos(WGS84_OMEGA_RADPS * tau)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=-1)


def _sky(r_e: Float64, towards: Float64) -> tuple[Float64, Float64, Float64]:
    """Return geodetic place (m, 3), azimuth and elevation (m, n) of unit vectors (m, n, 3) [rad, m]."""
    place = geodetic(r_e)
    return place, *angles_of(np.einsum("mij,mnj->mni", ned_axes(place), towards))
