"""Coarse alignment: is the vehicle at rest, which way is up, and what the gyros read at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.geodesy.rotations import euler_to_matrix, quaternion_to_matrix, rotation_vector_quaternion
from insgnss.jit import kernel
from insgnss.tables import Float64, Int64


@dataclass(frozen=True)
class Window:
    """What a short window of inertial samples says."""

    length_s: float
    f_b: Float64  # (3,) mean specific force, in the body axes at the window's end [m/s^2]
    w_ib_b: Float64  # (3,) mean rate [rad/s]
    spread_f: float  # root mean square about the mean, largest axis [m/s^2]
    spread_w: float  # [rad/s]


@kernel
def _mean_in_last_axes(t_ns: Int64, w: Float64, f: Float64, first: int, last: int, mean_f: Float64) -> None:
    """Write the mean specific force of samples first .. last - 1, each turned into the body axes at the end."""
    C = np.eye(3)
    step = np.zeros((3, 3))
    q = np.zeros(4)
    turned = np.zeros((3, 3))
    total = 0.0
    mean_f[:] = 0.0
    for k in range(last - 1, first - 1, -1):
        dt = (t_ns[k] - t_ns[k - 1]) * 1e-9
        for i in range(3):
            mean_f[i] += dt * (C[i, 0] * f[k, 0] + C[i, 1] * f[k, 1] + C[i, 2] * f[k, 2])
        total += dt
        # C takes the axes before sample k to the last ones: transposed step, from the left of it
        q[0], q[1], q[2], q[3] = rotation_vector_quaternion(-w[k, 0] * dt, -w[k, 1] * dt, -w[k, 2] * dt)
        quaternion_to_matrix(q, step)
        for i in range(3):
            for j in range(3):
                turned[i, j] = C[i, 0] * step[0, j] + C[i, 1] * step[1, j] + C[i, 2] * step[2, j]
        C[:, :] = turned
    for i in range(3):
        mean_f[i] /= total


def inertial_window(t_ns: Int64, w_ib_b: Float64, f_b: Float64, from_ns: int, to_ns: int) -> Window | None:
    """Return the window (from_ns, to_ns] of a log, None when the log does not reach back to its start."""
    first, last = np.searchsorted(t_ns, [from_ns, to_ns], side="right")
    first = max(int(first), 1)
    if last - first < 4 or t_ns[first - 1] > from_ns:
        return None
    mean_f = np.zeros(3)
    _mean_in_last_axes(t_ns, w_ib_b, f_b, first, int(last), mean_f)
    w, f = w_ib_b[first:last], f_b[first:last]
    return Window(
        length_s=(int(t_ns[last - 1]) - int(t_ns[first - 1])) * 1e-9,
        f_b=mean_f,
        w_ib_b=w.mean(axis=0),
        spread_f=float(f.std(axis=0).max()),
        spread_w=float(w.std(axis=0).max()),
    )


def level(f_b: Float64, f_n: Float64, yaw: float) -> tuple[float, float]:
    """Return the roll and pitch [rad] that turn the measured ``f_b`` (3,) into ``f_n`` (3,) at a given yaw.

    Equation: f_h = Rz(-yaw) f_n = Ry(pitch) Rx(roll) f_b: roll from the second component, pitch from the others; with
    f_n = (0, 0, -g) the usual roll = atan2(-f_y, -f_z), pitch = atan2(f_x, sqrt(f_y^2 + f_z^2)).
    """
    f_n = f_n * (float(np.linalg.norm(f_b)) / float(np.linalg.norm(f_n)))
    ahead = math.cos(yaw) * f_n[0] + math.sin(yaw) * f_n[1]
    right = -math.sin(yaw) * f_n[0] + math.cos(yaw) * f_n[1]
    across = math.hypot(f_b[1], f_b[2])
    roll = math.asin(min(1.0, max(-1.0, right / max(across, 1e-12)))) - math.atan2(f_b[1], -f_b[2])
    down = f_b[1] * math.sin(roll) + f_b[2] * math.cos(roll)
    pitch = math.atan2(ahead, f_n[2]) - math.atan2(f_b[0], down)
    # pitch beyond 90 deg is the same attitude seen from behind; at rest it cannot come out of atan2(f_x, |.|)
    return math.remainder(roll, 2.0 * math.pi), math.remainder(pitch, 2.0 * math.pi)


def earth_rate_in_body(lat: float, roll: float, pitch: float, yaw: float) -> Float64:
    """Return the Earth's rate in body axes (3,) [rad/s]."""
    C_nb = np.zeros((3, 3))
    euler_to_matrix(roll, pitch, yaw, C_nb)
    w_n = WGS84_OMEGA_RADPS * np.array([math.cos(lat), 0.0, -math.sin(lat)])
    return np.asarray(C_nb.T @ w_n)
