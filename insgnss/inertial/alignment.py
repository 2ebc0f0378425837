"""Coarse alignment: rest detection, levelling, and the gyros' readings at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.geodesy.rotations import euler_to_matrix
from insgnss.tables import Float64, Int64

LARGEST_BIAS_RADPS: Final = math.radians(10.0)  # of a phone's gyro without its calibration
# No body with a navigation receiver turns faster (a shell in its spin: 2000 rad/s) or stands more than 10 000 g
_FASTEST_TURN_RADPS: Final = 1e4
_LARGEST_FORCE_MPS2: Final = 1e6


@dataclass(frozen=True)
class AlignmentWindow:
    """The statistics of a short window of inertial samples."""

    length_s: float
    f_b: Float64  # (3,) mean specific force, in the body axes at the window's end [m/s^2]
    still_f_b: Float64  # (3,) the same of a body that has not turned, whatever its gyros read
    tilting_b: Float64  # (3,) rate at which the body has turned against the specific force, by that [rad/s]
    w_ib_b: Float64  # (3,) mean rate [rad/s]
    spread_f: float  # root mean square about the mean, largest axis [m/s^2]
    spread_w: float  # [rad/s]
    sd_tilting: float  # of ``tilting_b``, each axis, if the accelerometers' spread is white [rad/s]

    def without(self, accel: Float64, gyro: Float64) -> AlignmentWindow:
        """Return the window of sensors without these errors (3,) [m/s^2], [rad/s]."""
        return replace(
            self, f_b=self.f_b - accel, still_f_b=self.still_f_b - accel, w_ib_b=self.w_ib_b - gyro
        )


def _mean_in_last_axes(step_s: Float64, w: Float64, f: Float64) -> Float64:
    """Return the mean specific force of samples (k, 3), each turned into the body axes at the end of the last one."""
    C = np.eye(3)
    total = np.zeros(3)
    for dt, w_k, f_k in zip(step_s[::-1], w[::-1], f[::-1], strict=True):
        x, y, z = dt * w_k
        phi = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        # a mean is in the axes of mid-interval: half of the turn leads to those of its end
        total += dt * (C @ (f_k - 0.5 * phi @ f_k))
        # C takes the axes before the sample to the last ones: exp(-[phi x]) to second order, enough to level coarsely
        C = C @ (np.eye(3) - phi + 0.5 * phi @ phi)
    return np.asarray(total / step_s.sum())


def _tilting(f: Float64, length_s: float) -> Float64:
    """Return the rate (3,) of a turn that explains how the direction of f (k, 3) changes, none about f [rad/s].

    Equation: w = -u x u' / (T / 2), u and u' the directions of the means over both halves of the time T
    """
    half = len(f) // 2
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        first, second = (
            mean / np.linalg.norm(mean) for mean in (f[:half].mean(axis=0), f[-half:].mean(axis=0))
        )
        return np.asarray(-np.cross(first, second) / (0.5 * length_s))


def inertial_window(
    t_ns: Int64, w_ib_b: Float64, f_b: Float64, from_ns: int, to_ns: int
) -> AlignmentWindow | None:
    """Return the window (from_ns, to_ns] of a log, None when the log does not reach back to its start.

    None, too, if a sample is not a number, or so large that it hides the others: neither gives an attitude.
    """
    first, last = np.searchsorted(t_ns, [from_ns, to_ns], side="right")
    first = max(int(first), 1)
    if last - first < 4 or t_ns[first - 1] > from_ns:
        return None
    w, f = w_ib_b[first:last], f_b[first:last]
    if not (np.abs(w).max() < _FASTEST_TURN_RADPS and np.abs(f).max() < _LARGEST_FORCE_MPS2):
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        mean_f = _mean_in_last_axes(np.diff(t_ns[first - 1 : last]) * 1e-9, w, f)
    if not np.isfinite(mean_f).all():
        return None
    length_s = (int(t_ns[last - 1]) - int(t_ns[first - 1])) * 1e-9
    spread_f = float(f.std(axis=0).max())
    sd_half = spread_f / math.sqrt(len(f) // 2) / max(float(np.linalg.norm(f.mean(axis=0))), 1e-9)
    return AlignmentWindow(
        length_s=length_s,
        f_b=mean_f,
        still_f_b=f.mean(axis=0),
        tilting_b=_tilting(f, length_s),
        w_ib_b=w.mean(axis=0),
        spread_f=spread_f,
        spread_w=float(w.std(axis=0).max()),
        sd_tilting=math.sqrt(2.0) * sd_half / (0.5 * length_s),
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
