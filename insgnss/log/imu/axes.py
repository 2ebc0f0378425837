"""Axes of the inertial sensors and of further ones become body axes: a signed permutation or a checked rotation."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.config.flight import ImuConfig
from insgnss.config.quantities import Angles
from insgnss.config.sensors import Magnetometer
from insgnss.errors import ConfigError
from insgnss.geodesy.rotations import euler_to_matrix, matrix_to_euler
from insgnss.tables import Float64

# A matrix written with four digits passes, one of misalignments of 0.1 deg too
ORTHONORMAL_TOLERANCE: Final = 1e-3


def mounting_matrix(config: ImuConfig) -> Float64:
    """Return C_bs, (3, 3), sensor axes to body axes (forward-right-down): ``f_b = C_bs @ f_s``.

    Raises
    ------
    ConfigError : the matrix is not orthonormal to 1e-3, or the axes are left-handed
    """
    if config.mounting_matrix is not None:
        C_bs = np.array(config.mounting_matrix, dtype=np.float64)
        error = float(np.abs(C_bs @ C_bs.T - np.eye(3)).max())
        if not error <= ORTHONORMAL_TOLERANCE:
            raise ConfigError(
                f"the rows are not orthonormal: C C^T differs from the unit matrix by {error:.2g}",
                key="imu.mounting_matrix",
                advice="give the rotation from sensor to body axes with at least four digits, one row per body axis",
            )
        key = "imu.mounting_matrix"
    else:
        C_bs = signed_permutation(config.axes)
        key = "imu.axes"
        if config.gyro_axes is not None:
            return C_bs  # each sensor's axes are stated for themselves: nothing need be a rotation
    if np.linalg.det(C_bs) < 0.0:
        raise ConfigError(
            "the axes are left-handed: no rotation turns the sensor into forward-right-down",
            key=key,
            advice="one sign is wrong, or two axes are exchanged; a left-handed sensor needs imu.gyro_axes too",
        )
    return C_bs


def gyro_mounting_matrix(config: ImuConfig) -> Float64:
    """Return the (3, 3) matrix that turns the gyros' columns into body axes: ``w_b = C @ w_s``.

    Raises
    ------
    ConfigError : as ``mounting_matrix``
    """
    return mounting_matrix(config) if config.gyro_axes is None else signed_permutation(config.gyro_axes)


def signed_permutation(axes: tuple[str, str, str]) -> Float64:
    """Return the (3, 3) matrix whose rows pick the named sensor axes: ("-y", "+x", "+z") -> rows -y, x, z."""
    C_bs = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        C_bs[row, "xyz".index(axis[1])] = -1.0 if axis[0] == "-" else 1.0
    return C_bs


def to_body_axes(columns: list[Float64], C_bs: Float64, factor: float | Float64) -> Float64:
    """Return (n, 3) body components of three sensor columns, scaled; each column is read once, nothing is copied twice.

    Parameters
    ----------
    columns : three (n,) arrays, sensor axes
    C_bs : (3, 3) sensor axes to body axes
    factor : to SI units; one number, or (n,) for increments over uneven steps
    """
    body = np.empty((len(columns[0]), 3))
    for row in range(3):
        used = np.flatnonzero(C_bs[row])
        np.multiply(columns[used[0]], factor * C_bs[row, used[0]], out=body[:, row])
        for column in used[1:]:
            body[:, row] += columns[column] * (factor * C_bs[row, column])
    return body


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
