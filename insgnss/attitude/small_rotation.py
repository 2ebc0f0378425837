"""Matrices of rotation vectors and back, Euler angles of a matrix: one attitude at a time, for the filters here."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from insgnss.geodesy.rotations import (
    matrix_to_euler,
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_vector_quaternion,
)
from insgnss.tables import Float64


def rotation_matrix(phi: npt.ArrayLike) -> Float64:
    """Return exp([phi x]), (3, 3), of a rotation vector (3,) [rad]."""
    x, y, z = np.asarray(phi, np.float64)
    C = np.empty((3, 3))
    quaternion_to_matrix(np.array(rotation_vector_quaternion(x, y, z)), C)
    return C


def rotation_vector(C: npt.ArrayLike) -> Float64:
    """Return the rotation vector (3,) of a matrix (3, 3), at most pi long [rad]."""
    q = np.empty(4)
    matrix_to_quaternion(np.ascontiguousarray(C, np.float64), q)
    size = float(np.linalg.norm(q[1:]))
    if size < np.finfo(float).tiny:
        return np.zeros(3)
    return np.asarray(2.0 * math.atan2(size, q[0]) / size * q[1:])


def to_euler(C_nb: npt.ArrayLike) -> Float64:
    """Return roll, pitch, yaw (3,) [rad] of C_nb (3, 3)."""
    return np.array(matrix_to_euler(np.ascontiguousarray(C_nb, np.float64)))
