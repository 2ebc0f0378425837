"""The normal gravity field of WGS-84, written for these tests alone: potential and gradient by Legendre polynomials."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre

GM, A, OMEGA = 3.986004418e14, 6_378_137.0, 7.292115e-5  # NGA.STND.0036, table 3.1
# J2 ... J10 of the normal field as published with EGM96 (program F477, constants of WGS-84 (G873)), J0 = -1 for the centre
J = {
    0: -1.0,
    2: 0.108262982131e-2,
    4: -0.237091120053e-5,
    6: 0.608346498882e-8,
    8: -0.142681087920e-10,
    10: 0.121439275882e-13,
}


def _series(s: float, ratio: float, degrees_factor: bool) -> np.ndarray:
    """Return the Legendre coefficients of sum J_n ratio^n (n + 1 or 1) P_n(s)."""
    c = np.zeros(max(J) + 1)
    for n, j in J.items():
        c[n] = j * ratio**n * ((n + 1) if degrees_factor else 1)
    return c


def potential(r_e: np.ndarray) -> float:
    """Return gravitational and centrifugal potential at ``r_e`` (3,) [m^2/s^2], rising towards the centre."""
    r = float(np.linalg.norm(r_e))
    gravitation = -GM / r * legendre.legval(r_e[2] / r, _series(r_e[2] / r, A / r, False))
    return float(gravitation + 0.5 * OMEGA**2 * (r_e[0] ** 2 + r_e[1] ** 2))


def gravitation(r_i: np.ndarray) -> np.ndarray:
    """Return gravitation at ``r_i`` (3,) [m/s^2], in ECEF or inertial axes: the field does not depend on longitude.

    Equation: V = -GM/r sum J_n (a/r)^n P_n(s), s = z/r; grad V = dV/dr u + dV/ds (k - s u) / r
    """
    r = float(np.linalg.norm(r_i))
    u, s = r_i / r, r_i[2] / r
    radial = GM / r**2 * legendre.legval(s, _series(s, A / r, True))
    across = -GM / r**2 * legendre.legval(s, legendre.legder(_series(s, A / r, False)))
    return np.asarray(radial * u + across * (np.array([0.0, 0.0, 1.0]) - s * u))
