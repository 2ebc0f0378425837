"""A plain strapdown integration in the inertial frame, written for these tests alone, from exact increments."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.simulation.trajectory import InertialIncrements, Trajectory

EARTH = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])


def position_i(trajectory: Trajectory, t_s: np.ndarray) -> np.ndarray:
    """Return positions in the inertial frame, r_i = R(omega t) r_e (n, 3) [m]."""
    return np.asarray(Rotation.from_rotvec(np.outer(t_s, EARTH)).apply(trajectory.position_e(t_s)))


def rotation_ib(trajectory: Trajectory, t_s: np.ndarray) -> Rotation:
    """Return the attitudes C_ib = R(omega t) C_eb (n rotations)."""
    return Rotation.from_rotvec(np.outer(t_s, EARTH)) * trajectory.rotation_eb(t_s)


def gravitation_i(r_i: np.ndarray, t_s: float) -> np.ndarray:
    """Return gravitation at an inertial position: normal gravity there, without the centrifugal part."""
    c, s = np.cos(WGS84_OMEGA_RADPS * t_s), np.sin(WGS84_OMEGA_RADPS * t_s)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    r_e = turn.T @ r_i
    g_e = np.empty(3)
    normal_gravity_ecef(r_e, g_e)
    return turn @ (g_e - WGS84_OMEGA_RADPS**2 * np.array([r_e[0], r_e[1], 0.0]))


def _turns_and_kicks(increments: InertialIncrements) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return steps, rotations and the first two time integrals of specific force of each pair of increments.

    Within a pair rate and force are straight lines through the two increments; with them ``phi' = w + phi x w / 2`` is
    integrated exactly and ``C(phi) f`` by three Gauss nodes, all in body axes of the step's start.
    """
    step = np.diff(increments.edges_s[::2])[:, None]

    def line(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slope = 4.0 * (values[1::2] - values[0::2]) / step**2
        return (values[0::2] + values[1::2]) / step - 0.5 * slope * step, slope

    w, w_slope = line(increments.angle)
    f, f_slope = line(increments.velocity)

    def turn(t: np.ndarray) -> Rotation:
        return Rotation.from_rotvec(w * t + w_slope * t**2 / 2.0 + np.cross(w, w_slope) * t**3 / 12.0)

    kick, shift = np.zeros_like(f), np.zeros_like(f)
    for node, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        t = 0.5 * step * (1.0 + node)
        force = 0.5 * step * weight * turn(t).apply(f + f_slope * t)
        kick += force
        shift += (step - t) * force
    return step[:, 0], turn(step).as_matrix(), kick, shift


def integrate(
    trajectory: Trajectory, increments: InertialIncrements
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return every second edge, the integrated inertial positions there, and the final attitude C_ib."""
    edges = increments.edges_s
    start = edges[:1]
    r = position_i(trajectory, start)[0]
    C_ib = rotation_ib(trajectory, start).as_matrix()[0]
    v_e, r_e = trajectory.velocity_e(start)[0], trajectory.position_e(start)[0]
    v = Rotation.from_rotvec(EARTH * edges[0]).apply(v_e + np.cross(EARTH, r_e))
    places = [r]
    for k, (step, turn, kick, shift) in enumerate(zip(*_turns_and_kicks(increments), strict=True)):
        g = gravitation_i(r + 0.5 * step * v, edges[2 * k] + 0.5 * step)
        r = r + step * v + C_ib @ shift + 0.5 * step**2 * g
        v = v + C_ib @ kick + step * g
        C_ib = C_ib @ turn
        places.append(r)
    return edges[::2], np.array(places), C_ib
