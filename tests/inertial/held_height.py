"""A day of inertial navigation with the height held: free, it would diverge (1e65 times in 24 h) and hide the rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from insgnss.geodesy.ellipsoid import ecef_to_geodetic, geodetic_to_ecef
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.geodesy.rotations import matrix_to_quaternion, quaternion_to_matrix
from insgnss.inertial.mechanization import mechanize
from insgnss.kernels.jit import kernel
from tests.inertial.strapdown import EARTH, skew


@kernel
def _stay(
    count: int,
    dt: float,
    w: np.ndarray,
    f: np.ndarray,
    q: np.ndarray,
    r: np.ndarray,
    v: np.ndarray,
    every: int,
    r_out: np.ndarray,
) -> None:
    """Mechanize ``count`` steps of constant input; after each, height and vertical velocity are what they were."""
    C, C_ne, g = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    quaternion_to_matrix(q, C)
    height = ecef_to_geodetic(r)[2]
    for k in range(count):
        mechanize(q, C, r, v, w, f, dt, g)
        lat, lon, h = ecef_to_geodetic(r)
        ecef_to_ned_matrix(lat, lon, C_ne)
        down = C_ne[2]
        falling = v[0] * down[0] + v[1] * down[1] + v[2] * down[2]
        for i in range(3):
            r[i] += (h - height) * down[i]
            v[i] -= falling * down[i]
        if (k + 1) % every == 0:
            r_out[(k + 1) // every - 1] = r


@dataclass(frozen=True)
class Place:
    """A vehicle at rest: where, and what ideal sensors feel there."""

    r_e: np.ndarray  # (3,) [m]
    C_ne: np.ndarray  # (3, 3)
    C_eb: np.ndarray  # (3, 3)
    w_b: np.ndarray  # (3,) [rad/s]
    f_b: np.ndarray  # (3,) [m/s^2]


def place_at_rest(lat_deg: float, lon_deg: float, h_m: float, C_nb: np.ndarray) -> Place:
    """Return a vehicle at rest in the attitude ``C_nb``."""
    r_e, C_ne, g_e = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    geodetic_to_ecef(math.radians(lat_deg), math.radians(lon_deg), h_m, r_e)
    ecef_to_ned_matrix(math.radians(lat_deg), math.radians(lon_deg), C_ne)
    normal_gravity_ecef(r_e, g_e)
    C_eb = C_ne.T @ C_nb
    return Place(r_e, C_ne, C_eb, C_eb.T @ EARTH, -C_eb.T @ g_e)


def stay(
    place: Place,
    duration_s: float,
    dt: float,
    *,
    velocity_n: np.ndarray | None = None,
    tilt_e: np.ndarray | None = None,
    every_s: float = 60.0,
) -> np.ndarray:
    """Return the north-east displacements (n, 2) [m], every minute, from a start with these errors.

    ``tilt_e`` is the small rotation vector of the estimated attitude from the true one, ECEF axes [rad].
    """
    q, r = np.zeros(4), place.r_e.copy()
    v = np.zeros(3) if velocity_n is None else place.C_ne.T @ velocity_n
    C = place.C_eb
    if tilt_e is not None:
        C = (np.eye(3) + skew(tilt_e)) @ C
    matrix_to_quaternion(C, q)
    count, every = round(duration_s / dt), round(every_s / dt)
    out = np.zeros((count // every, 3))
    _stay(count, dt, place.w_b, place.f_b, q, r, v, every, out)
    return np.asarray((out - place.r_e) @ place.C_ne[:2].T)
