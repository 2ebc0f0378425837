"""The axes of further sensors, turned into those of the body."""

from __future__ import annotations

import math

import numpy as np

from insgnss.config.quantities import Angles
from insgnss.config.sensors import Magnetometer
from insgnss.errors import ConfigError
from insgnss.geodesy.rotations import euler_to_matrix, matrix_to_euler
from insgnss.log.imu.axes import ORTHONORMAL_TOLERANCE, signed_permutation
from insgnss.tables import Float64


def magnetometer_axes(config: Magnetometer) -> Float64:
    """Return C_bs (3, 3), sensor axes to body axes.

    Raises
    ------
    ConfigError : the axes are left-handed, or the matrix is not a rotation
    """
    if config.mounting_matrix is not None:
        C_bs = np.array(config.mounting_matrix, np.float64)
    else:
        x, y, z = (a if a[:1] in "+-" else f"+{a}" for a in config.axes)
        C_bs = signed_permutation((x, y, z))
    if np.abs(C_bs @ C_bs.T - np.eye(3)).max() > ORTHONORMAL_TOLERANCE or np.linalg.det(C_bs) < 0.0:
        raise ConfigError(
            f"the axes of '{config.label}' are not a rotation into forward, right, down",
            key="sensor.axes" if config.mounting_matrix is None else "sensor.mounting_matrix",
            advice="one sign is wrong, or two axes are exchanged",
        )
    return C_bs


def body_rotation(rpy: Float64, mounting_rpy_deg: Angles) -> Float64:
    """Return roll, pitch, yaw of the body (n, 3) [rad] from those of a device mounted at an angle.

    Equation: C_nb = C_ns C_bs^T
    """
    if mounting_rpy_deg == (0.0, 0.0, 0.0):
        return rpy
    C_bs = np.zeros((3, 3))
    roll, pitch, yaw = (math.radians(angle) for angle in mounting_rpy_deg)
    euler_to_matrix(roll, pitch, yaw, C_bs)
    turned, C_ns = np.full(rpy.shape, np.nan), np.zeros((3, 3))
    for k in np.flatnonzero(np.isfinite(rpy).all(axis=1)):
        euler_to_matrix(rpy[k, 0], rpy[k, 1], rpy[k, 2], C_ns)
        turned[k] = matrix_to_euler(C_ns @ C_bs.T)
    return turned
