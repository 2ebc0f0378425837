"""Rotations: quaternion (scalar first, Hamilton), matrix (target first) and Euler angles (roll, pitch, yaw), compiled.

``q_nb`` and ``C_nb`` turn body components into n: ``C_nb @ f_b = f_n``.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

EARTH_RATE_E: Final = np.array([0.0, 0.0, WGS84_OMEGA_RADPS])  # w_ie in e (and i) axes [rad/s]

# the series' fractions: a compiler may not turn a division into a product, which takes a quarter of its time
_6TH, _12TH, _20TH, _30TH, _42ND, _56TH, _72ND = (1.0 / n for n in (6.0, 12.0, 20.0, 30.0, 42.0, 56.0, 72.0))


@kernel
def quaternion_to_matrix(q: Float64, C: Float64) -> None:
    """Write the rotation matrix of unit quaternion ``q`` (4,) into ``C`` (3, 3)."""
    a = q[0]
    b = q[1]
    c = q[2]
    d = q[3]
    C[0, 0] = a * a + b * b - c * c - d * d
    C[0, 1] = 2.0 * (b * c - a * d)
    C[0, 2] = 2.0 * (b * d + a * c)
    C[1, 0] = 2.0 * (b * c + a * d)
    C[1, 1] = a * a - b * b + c * c - d * d
    C[1, 2] = 2.0 * (c * d - a * b)
    C[2, 0] = 2.0 * (b * d - a * c)
    C[2, 1] = 2.0 * (c * d + a * b)
    C[2, 2] = a * a - b * b - c * c + d * d


@kernel
def matrix_to_quaternion(C: Float64, q: Float64) -> None:
    """Write the unit quaternion of rotation matrix ``C`` (3, 3) into ``q`` (4,), scalar not negative.

    The largest of the four components is found first, so no attitude loses digits  [Shepperd 1978].
    """
    trace = C[0, 0] + C[1, 1] + C[2, 2]
    four = (
        1.0 + trace,
        1.0 + 2.0 * C[0, 0] - trace,
        1.0 + 2.0 * C[1, 1] - trace,
        1.0 + 2.0 * C[2, 2] - trace,
    )
    largest = 0
    for i in range(1, 4):
        if four[i] > four[largest]:
            largest = i
    s = 0.5 / math.sqrt(four[largest])
    x = (C[2, 1] - C[1, 2]) * s
    y = (C[0, 2] - C[2, 0]) * s
    z = (C[1, 0] - C[0, 1]) * s
    xy = (C[1, 0] + C[0, 1]) * s
    xz = (C[0, 2] + C[2, 0]) * s
    yz = (C[2, 1] + C[1, 2]) * s
    own = four[largest] * s
    if largest == 0:
        q[0], q[1], q[2], q[3] = own, x, y, z
    elif largest == 1:
        q[0], q[1], q[2], q[3] = x, own, xy, xz
    elif largest == 2:
        q[0], q[1], q[2], q[3] = y, xy, own, yz
    else:
        q[0], q[1], q[2], q[3] = z, xz, yz, own
    if q[0] < 0.0:
        for i in range(4):
            q[i] = -q[i]


@kernel
def euler_to_matrix(roll: float, pitch: float, yaw: float, C: Float64) -> None:
    """Write C_nb (3, 3) of roll, pitch, yaw [rad]: yaw about down, then pitch about right, then roll about forward."""
    sr, cr = math.sin(roll), math.cos(roll)
    sp, cp = math.sin(pitch), math.cos(pitch)
    sy, cy = math.sin(yaw), math.cos(yaw)
    C[0, 0] = cp * cy
    C[0, 1] = sr * sp * cy - cr * sy
    C[0, 2] = cr * sp * cy + sr * sy
    C[1, 0] = cp * sy
    C[1, 1] = sr * sp * sy + cr * cy
    C[1, 2] = cr * sp * sy - sr * cy
    C[2, 0] = -sp
    C[2, 1] = sr * cp
    C[2, 2] = cr * cp


@kernel
def matrix_to_euler(C: Float64) -> tuple[float, float, float]:
    """Return roll, pitch, yaw [rad] of C_nb (3, 3).

    At pitch +-90 deg only yaw minus (plus) roll is defined: roll is then zero by convention. Near it the three angles
    together stay right to rounding: pitch by its tangent, and yaw as what is left after the roll that was found.
    """
    level = math.hypot(C[2, 1], C[2, 2])
    roll = math.atan2(C[2, 1], C[2, 2]) if level > 1e-9 else 0.0
    sr, cr = math.sin(roll), math.cos(roll)
    yaw = math.atan2(sr * C[0, 2] - cr * C[0, 1], cr * C[1, 1] - sr * C[1, 2])
    return roll, math.atan2(-C[2, 0], level), yaw


@kernel
def turn_left(q: Float64, x: float, y: float, z: float) -> None:
    """Turn ``q`` (4,) by the rotation vector (x, y, z) [rad] of its target frame: q <- dq (x) q, of length one."""
    a0, a1, a2, a3 = rotation_vector_quaternion(x, y, z)
    p0, p1, p2, p3 = q[0], q[1], q[2], q[3]
    r0 = a0 * p0 - a1 * p1 - a2 * p2 - a3 * p3
    r1 = a0 * p1 + a1 * p0 + a2 * p3 - a3 * p2
    r2 = a0 * p2 - a1 * p3 + a2 * p0 + a3 * p1
    r3 = a0 * p3 + a1 * p2 - a2 * p1 + a3 * p0
    s = 1.0 / math.sqrt(r0 * r0 + r1 * r1 + r2 * r2 + r3 * r3)
    q[0], q[1], q[2], q[3] = r0 * s, r1 * s, r2 * s, r3 * s


@kernel
def rotation_vector_quaternion(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the quaternion of the rotation vector (x, y, z) [rad]: (cos(phi/2), sin(phi/2)/phi (x, y, z)).

    Below 0.2 rad the series to sixth order is exact to rounding and costs no trigonometry.
    """
    h2 = 0.25 * (x * x + y * y + z * z)
    if h2 < 0.01:
        s = 0.5 * (1.0 - _6TH * h2 * (1.0 - _20TH * h2 * (1.0 - _42ND * h2 * (1.0 - _72ND * h2))))
        c = 1.0 - 0.5 * h2 * (1.0 - _12TH * h2 * (1.0 - _30TH * h2 * (1.0 - _56TH * h2)))
    else:
        half = math.sqrt(h2)
        s = 0.5 * math.sin(half) / half
        c = math.cos(half)
    return c, s * x, s * y, s * z


def to_scipy_quaternion(q: npt.ArrayLike) -> Float64:
    """Return quaternions (..., 4) in SciPy's order, scalar last: the one place where the order changes."""
    return np.asarray(np.roll(np.asarray(q, dtype=np.float64), -1, axis=-1))


def cross_matrix(v: Float64) -> Float64:
    """Return [v x] (..., 3, 3) of vectors (..., 3)."""
    matrix = np.zeros((*v.shape, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def omega_cross(vectors: Float64) -> Float64:
    """Return w_ie x r of vectors (..., 3) in e axes."""
    x, y = vectors[..., 0], vectors[..., 1]
    return WGS84_OMEGA_RADPS * np.stack([-y, x, np.zeros_like(x)], axis=-1)


def rotation_matrix(phi: npt.ArrayLike) -> Float64:
    """Return exp([phi x]), (3, 3), of a rotation vector (3,) [rad]."""
    x, y, z = np.asarray(phi, np.float64)
    C = np.empty((3, 3))
    quaternion_to_matrix(np.array(rotation_vector_quaternion(x, y, z)), C)
    return C


@kernel
def write_rotations(phi: Float64, q: Float64, C: Float64) -> None:
    """Write exp([phi x]) of rotation vectors (k, 3) [rad] into ``C`` (k, 3, 3); ``q`` (4,) is scratch."""
    for k in range(len(phi)):
        q[0], q[1], q[2], q[3] = rotation_vector_quaternion(phi[k, 0], phi[k, 1], phi[k, 2])
        quaternion_to_matrix(q, C[k])


def rotation_matrices(phi: npt.ArrayLike) -> Float64:
    """Return exp([phi x]), (k, 3, 3), of rotation vectors (k, 3) [rad]."""
    vectors = np.ascontiguousarray(phi, np.float64)
    C = np.empty((len(vectors), 3, 3))
    write_rotations(vectors, np.empty(4), C)
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
