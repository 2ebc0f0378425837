"""The same physics in the inertial frame, by a general integrator: no Coriolis, no turning Earth but in the result."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tests.geodesy.normal_field import OMEGA, gravitation

Force = Callable[[float], np.ndarray]  # time [s] -> specific force in the inertial frame (3,) [m/s^2]


def no_force(_: float) -> np.ndarray:
    """Return the specific force of free fall."""
    return np.zeros(3)


def earth_turn(t_s: float) -> np.ndarray:
    """Return C_ie of an inertial frame that is the Earth's at t = 0."""
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, OMEGA * t_s]).as_matrix())


def travel(r_e: np.ndarray, v_e: np.ndarray, force_i: Force, end_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return ECEF position and velocity at ``end_s`` of a start at t = 0, by Dormand-Prince 8(5,3) to 1e-13."""
    spin = np.array([0.0, 0.0, OMEGA])

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], force_i(t) + gravitation(y[:3])])

    start = np.concatenate([r_e, v_e + np.cross(spin, r_e)])
    y = solve_ivp(rate, (0.0, end_s), start, method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]
    r, v = earth_turn(end_s).T @ y[:3], earth_turn(end_s).T @ y[3:]
    return r, v - np.cross(spin, r)
