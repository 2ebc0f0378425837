"""Phase wind-up between antennas that are tilted against each other: its remainder in a phase difference.

A circularly polarised wave turns with its phase, so an antenna turned about the line of sight by an angle sees the
phase move by as much. It cancels in the difference of antennas with parallel axes, whatever the attitude; only a tilt
between them leaves a part, which depends on the direction of the satellite.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from insgnss.tables import Float64


def wind_up_differences(C_ba: npt.ArrayLike, C_nb: npt.ArrayLike, los_n: npt.ArrayLike) -> Float64:
    """Return the phase by which each antenna's wind-up exceeds that of the first one, (M - 1, N) [rad].

    Equation: D = x - k (k . x) + k x y, the dipole that a crossed pair x, y (antenna axes forward, right) makes across
    the line of sight k; the phase is the angle between two antennas' dipoles          [Wu et al. 1993, (25)-(30)]
    Neglects: its change with attitude in the derivatives, at most 1 rad/rad against 2 pi l / lambda (33 for 1 m).

    Parameters
    ----------
    C_ba : (M, 3, 3) turns antenna components into those of the body
    C_nb : (3, 3) attitude
    los_n : (N, 3) unit vectors, receiver to satellite
    """
    k = np.asarray(los_n, np.float64)
    axes_n = np.asarray(C_nb, np.float64) @ np.asarray(C_ba, np.float64)  # (M, 3, 3), columns x, y, z
    x, y = axes_n[:, None, :, 0], axes_n[:, None, :, 1]
    D = x - k * np.sum(k * x, axis=-1, keepdims=True) + np.cross(k, y)
    first, other = D[:1], D[1:]
    # positive where the antenna is turned against the wave's own sense, right-handed about its travel -k
    turned = np.sum(-k * np.cross(first, other), axis=-1)
    return np.asarray(-np.arctan2(turned, np.sum(first * other, axis=-1)))
