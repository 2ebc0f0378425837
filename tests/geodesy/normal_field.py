"""The normal gravity field of WGS-84, written for these tests alone: potential and gradient by Legendre polynomials."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre

GM, A, OMEGA = 3.986004418e14, 6_378_137.0, 7.292115e-5  # NGA.STND.0036, table 3.1
# J2 ... J10 of the normal field as published with EGM96 (program F477, constants of WGS-84 (G873)); J0 is the centre
J = {
    0: -1.0,
    2: 0.108262982131e-2,
    4: -0.237091120053e-5,
    6: 0.608346498882e-8,
    8: -0.142681087920e-10,
    10: 0.121439275882e-13,
}


def _coefficients(ratio: np.ndarray, degree_factor: bool) -> np.ndarray:
    """Return (11, ...) Legendre coefficients of sum J_n ratio^n (n + 1 or 1) P_n(s)."""
    c = np.zeros((max(J) + 1, *np.shape(ratio)))
    for n, j in J.items():
        c[n] = j * ratio**n * ((n + 1) if degree_factor else 1)
    return c


def potential(r_e: np.ndarray) -> np.ndarray:
    """Return gravitational and centrifugal potential at ``r_e`` (..., 3) [m^2/s^2], rising towards the centre."""
    r = np.linalg.norm(r_e, axis=-1)
    series = legendre.legval(r_e[..., 2] / r, _coefficients(A / r, False), tensor=False)
    return np.asarray(-GM / r * series + 0.5 * OMEGA**2 * (r_e[..., 0] ** 2 + r_e[..., 1] ** 2))


def gravitation(r: np.ndarray) -> np.ndarray:
    """Return gravitation at ``r`` (..., 3) [m/s^2], in ECEF or inertial axes: the field does not depend on longitude.

    Equation: V = -GM/r sum J_n (a/r)^n P_n(s), s = z/r; grad V = dV/dr u + dV/ds (k - s u) / r
    """
    size = np.linalg.norm(r, axis=-1)
    u, s = r / size[..., None], r[..., 2] / size
    derivative = legendre.legder(_coefficients(A / size, False))
    radial = GM / size**2 * legendre.legval(s, _coefficients(A / size, True), tensor=False)
    across = -GM / size**2 * legendre.legval(s, derivative, tensor=False)
    return np.asarray(radial[..., None] * u + across[..., None] * (np.eye(3)[2] - s[..., None] * u))
