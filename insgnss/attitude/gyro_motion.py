"""Attitude from gyros between epochs: the quaternion, and what errors of the gyros do to it.

q_k = dm* (x) q_(k-1) (x) dlambda(w), dm the Earth's rotation in a step                          [Shatilov 2007]
with w the rate of the body against inertial space in body axes (the thesis's words have it the other way round).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from insgnss.geodesy.rotations import quaternion_to_matrix, rotation_vector_quaternion, turn_left
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

N_GYRO_ERRORS: Final = 12  # three biases and nine elements of M, by columns


@kernel
def turn_right(q: Float64, x: float, y: float, z: float) -> None:
    """Turn ``q`` (4,) by the rotation vector (x, y, z) [rad] of its own body: q <- q (x) dq."""
    b0, b1, b2, b3 = rotation_vector_quaternion(x, y, z)
    p0, p1, p2, p3 = q[0], q[1], q[2], q[3]
    q[0] = p0 * b0 - p1 * b1 - p2 * b2 - p3 * b3
    q[1] = p0 * b1 + p1 * b0 + p2 * b3 - p3 * b2
    q[2] = p0 * b2 - p1 * b3 + p2 * b0 + p3 * b1
    q[3] = p0 * b3 + p1 * b2 - p2 * b1 + p3 * b0


@kernel
def advance(
    q_nb: Float64,
    w_meas: Float64,
    bias: Float64,
    A: Float64,
    dt: float,
    w_ie_n: Float64,
    last: Float64,
    coupling: Float64,
) -> None:
    """Turn ``q_nb`` by gyro samples, and write how errors of the gyros turn it meanwhile.

    Equation: w = A (w_meas - b), A = (I + M)^-1; rotation vector = w dt + (last x w dt) / 12, the second term the
    coning between two samples; d psi / d [b, vec M] = -sum C_nb A [I, w^T (x) I] dt
    Neglects: the change of C_nb within a sample in the last sum, its second order.

    Parameters
    ----------
    q_nb : (4,) changed in place
    w_meas : (k, 3) mean rates over each sample [rad/s]
    bias, A : (3,), (3, 3) of the gyros as estimated
    dt : length of a sample [s]
    w_ie_n : (3,) Earth's rate in the reference frame, which is fixed to the Earth [rad/s]
    last : (3,) increment of the sample before, changed in place [rad]
    coupling : (3, 12) result: derivatives of the attitude error by bias and by M, by columns
    """
    C = quaternion_matrix(q_nb)
    coupling[:] = 0.0
    turned = coupling[:, :3].copy()
    increment = last.copy()
    for k in range(w_meas.shape[0]):
        for i in range(3):
            increment[i] = 0.0
            for j in range(3):
                increment[i] += A[i, j] * (w_meas[k, j] - bias[j]) * dt
        x = increment[0] + (last[1] * increment[2] - last[2] * increment[1]) / 12.0
        y = increment[1] + (last[2] * increment[0] - last[0] * increment[2]) / 12.0
        z = increment[2] + (last[0] * increment[1] - last[1] * increment[0]) / 12.0
        before = C
        turn_right(q_nb, x, y, z)
        turn_left(q_nb, -w_ie_n[0] * dt, -w_ie_n[1] * dt, -w_ie_n[2] * dt)
        C = quaternion_matrix(q_nb)
        for i in range(3):
            for j in range(3):
                turned[i, j] = 0.0
                for m in range(3):
                    turned[i, j] -= 0.5 * (before[i, m] + C[i, m]) * A[m, j]
        for i in range(3):
            for j in range(3):
                coupling[i, j] += turned[i, j] * dt
                for column in range(3):
                    coupling[i, 3 + 3 * column + j] += turned[i, j] * increment[column]
        last[:] = increment


@kernel
def quaternion_matrix(q: Float64) -> Float64:
    """Return the rotation matrix (3, 3) of unit quaternion ``q`` (4,)."""
    C = np.empty((3, 3))
    quaternion_to_matrix(q, C)
    return C
