"""From the covariance in ECEF to the sigmas of a navigation row, in the local level of its own place, compiled.

A wrong place has a wrong local level: 1 km of it turns down by 0.009 deg, and north by tan(latitude) of that. What a
user reads (velocity north, east, down, roll, pitch, yaw) is wrong by what the state is, less that turn.
"""

from __future__ import annotations

import math

import numpy as np

from insgnss.filter.state import DR, DV, PSI
from insgnss.geodesy.ellipsoid import radii
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

# of the pitch, at +-90 deg: roll and yaw are not separately defined there, and their sigmas reach half a circle before
_SMALLEST_COSINE = 1e-9
# of the latitude, 6 m from a pole: an aircraft flies that far in a few hundredths of a second
_POLAR_COSINE = 1e-6


@kernel(inline=True)
def rotated_variances(P: Float64, at: int, C: Float64, out: Float64, to: int) -> None:
    """Write the three standard deviations of the block at ``at``, turned by ``C``, from ``to`` on."""
    for i in range(3):
        total = 0.0
        for j in range(3):
            for k in range(3):
                total += C[i, j] * P[at + j, at + k] * C[i, k]
        out[to + i] = math.sqrt(max(total, 0.0))


@kernel(inline=True)
def level_turn(lat: float, h: float, C_ne: Float64, T: Float64) -> None:
    """Write how the local level at the estimated place is turned by the place's own error: theta_n = ``T`` d r_e.

    Equation: C_ne(r + d r) = (I - [theta x]) C_ne(r), theta_n = (d r_E / (N + h), -d r_N / (M + h),
              -d r_E tan lat / (N + h)), from the derivatives of C_ne(lat, lon)
    The meridian of a place turns fast near a pole: 1 m by 0.6 deg at a distance of 100 m, which turns a velocity of
    250 m/s by 2.5 m/s. The turn stops growing at ``_POLAR_COSINE`` of latitude.
    """
    meridian, prime = radii(lat)
    cosine = max(math.cos(lat), _POLAR_COSINE)
    for j in range(3):
        T[0, j] = C_ne[1, j] / (prime + h)
        T[1, j] = -C_ne[0, j] / (meridian + h)
        T[2, j] = -C_ne[1, j] * math.sin(lat) / (cosine * (prime + h))


@kernel(inline=True)
def deviation_of(P: Float64, a: Float64, b: Float64, at: int) -> float:
    """Return the standard deviation of a . d r + b . x, x the three states from ``at`` on, ``a``, ``b`` (3,)."""
    total = 0.0
    for j in range(3):
        for k in range(3):
            total += a[j] * P[DR + j, DR + k] * a[k] + b[j] * P[at + j, at + k] * b[k]
            total += 2.0 * a[j] * P[DR + j, at + k] * b[k]
    return math.sqrt(max(total, 0.0))


@kernel(inline=True)
def velocity_deviations(P: Float64, C_ne: Float64, T: Float64, out: Float64, to: int) -> None:
    """Write the standard deviations of the velocity north, east, down from ``to`` on; it is at 3 of ``out``.

    Equation: d v_n = C_ne d v_e + v_n x theta, theta = ``T`` d r_e of ``level_turn``
    """
    a = np.empty(3)
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            a[j] = out[3 + p] * T[q, j] - out[3 + q] * T[p, j]
        out[to + i] = deviation_of(P, a, C_ne[i], DV)


@kernel(inline=True)
def attitude_deviations(
    P: Float64, C_ne: Float64, T: Float64, pitch: float, yaw: float, out: Float64, to: int
) -> None:
    """Write the standard deviations of roll, pitch and yaw [deg] from ``to`` on, in the local level of the estimate.

    Equation: phi = C_ne psi_e - theta, theta = ``T`` d r_e of ``level_turn``;
              d roll = (phi_N cos y + phi_E sin y)/cos p, d pitch = phi_E cos y - phi_N sin y,
              d yaw = phi_D + tan p (phi_N cos y + phi_E sin y)
    """
    sy, cy = math.sin(yaw), math.cos(yaw)
    cp = math.cos(pitch)
    cp = math.copysign(max(abs(cp), _SMALLEST_COSINE), cp)
    tp = math.sin(pitch) / cp
    rows = ((cy / cp, sy / cp, 0.0), (-sy, cy, 0.0), (tp * cy, tp * sy, 1.0))
    a, b = np.empty(3), np.empty(3)
    for i in range(3):
        x, y, z = rows[i]
        for j in range(3):
            a[j] = -(x * T[0, j] + y * T[1, j] + z * T[2, j])
            b[j] = x * C_ne[0, j] + y * C_ne[1, j] + z * C_ne[2, j]
        out[to + i] = min(math.degrees(deviation_of(P, a, b, PSI)), 180.0)
