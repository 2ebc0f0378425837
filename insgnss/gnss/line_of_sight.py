"""The line of sight from the antenna to a satellite: range, range rate, direction, and their derivatives.

Everything is expressed in the axes of the ECEF frame at the instant of reception. While the signal travels,
for tau = rho / c, the Earth turns by omega tau, so the satellite's state at transmission, given in the ECEF
frame of the transmission, is turned by R3(omega tau) (the Sagnac effect, up to 40 m of range on the ground).
"""

from __future__ import annotations

import math

from insgnss.constants import C_MPS, WGS84_OMEGA_RADPS
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64


@kernel
def _turned_satellite(sat: Float64, k: int, r_e: Float64, u: Float64) -> tuple[float, float, float]:
    """Write the unit vector into ``u``; return range [m], sin(omega tau) and 1 - cos(omega tau)."""
    x, y, z = sat[k, 0], sat[k, 1], sat[k, 2]
    dx, dy, dz = x - r_e[0], y - r_e[1], z - r_e[2]
    # rho ~ |r_s - r_e| + omega / c (x_s y_e - y_s x_e): within 1 mm, so omega tau r_s is within 1e-8 m
    straight = math.sqrt(dx * dx + dy * dy + dz * dz)
    sagnac = WGS84_OMEGA_RADPS / C_MPS * (x * r_e[1] - y * r_e[0])
    angle = WGS84_OMEGA_RADPS / C_MPS * (straight + sagnac)
    # the next terms of both series are below 1e-13 m for a satellite at 42 000 km
    sine = angle * (1.0 - angle * angle / 6.0)
    versine = 0.5 * angle * angle
    # R3(omega tau) r_s - r_e
    dx += sine * y - versine * x
    dy -= sine * x + versine * y
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    u[0], u[1], u[2] = dx / distance, dy / distance, dz / distance
    return distance, sine, versine


@kernel
def line_of_sight_range(sat: Float64, k: int, r_e: Float64, u: Float64) -> float:
    """Return the geometric range [m] to satellite row ``k``; write the unit vector receiver to satellite.

    Equation: rho = |R3(omega tau) r_s - r_e|, tau = rho / c    [IS-GPS-200N, 20.3.3.4.3.4]
    Neglects: the error of tau, 1e-8 m in the range; d rho / d r_e = -u to 2e-6 (the turn depends on r_e).

    Parameters
    ----------
    sat : (n, >= 3) satellites, ECEF at transmission, position [m] first
    k : row of ``sat``
    r_e : (3,) antenna position, ECEF at reception [m]
    u : (3,) output, unit line of sight receiver to satellite [-]
    """
    distance, _, _ = _turned_satellite(sat, k, r_e, u)
    return distance


@kernel
def line_of_sight(
    sat: Float64, k: int, r_e: Float64, v_e: Float64, u: Float64, g: Float64
) -> tuple[float, float]:
    """Return range [m] and range rate [m/s] to row ``k``; write the unit vector and the rate's gradient.

    Equation: rho_dot = u.(v_s - v_r) / (1 + u.v_s / c), the derivative of c (t_reception - t_transmission)
    with respect to the time of reception, exactly; v_s = R3(omega tau) (v_sat + omega x r_sat) and
    v_r = v_e + omega x r_e are velocities in the inertial frame whose axes are those of ECEF at reception.
    The rotation terms cancel in the gradient: g = -(I - u u^T) w / rho with w = R3(omega tau) v_sat - v_e.

    Derivatives: d rho / d r_e = -u, d rho_dot / d v_e = -u, d rho_dot / d r_e = g, each within 2e-5 of its
    size (left out: the Doppler factor 1 + u.v_s / c and the dependence of tau on r_e).
    Neglects: general relativity along the path (Shapiro delay below 2 cm, its rate below 1e-5 m/s); the
    product of clock drift and range rate (receiver drift 300 m/s = 1 ppm: up to 0.8 mm/s).

    Parameters
    ----------
    sat : (n, >= 6) satellites, ECEF at transmission: position [m], velocity [m/s], further columns ignored
    k : row of ``sat``
    r_e, v_e : (3,) antenna position [m] and velocity [m/s], ECEF at reception
    u : (3,) output, unit line of sight receiver to satellite [-]
    g : (3,) output, derivative of the range rate by the antenna position [1/s]
    """
    distance, sine, versine = _turned_satellite(sat, k, r_e, u)
    # w = R3(omega tau) v_sat - v_e
    vx, vy, vz = sat[k, 3], sat[k, 4], sat[k, 5]
    wx = vx + sine * vy - versine * vx - v_e[0]
    wy = vy - sine * vx - versine * vy - v_e[1]
    wz = vz - v_e[2]
    along = u[0] * wx + u[1] * wy + u[2] * wz
    g[0] = (u[0] * along - wx) / distance
    g[1] = (u[1] * along - wy) / distance
    g[2] = (u[2] * along - wz) / distance
    # u.(omega x (R3 r_s - r_e)) = rho u.(omega x u) = 0, so u.(v_s - v_r) = u.w
    # u.v_s = u.w + u.(v_e + omega x r_e)
    doppler = (
        along
        + u[0] * (v_e[0] - WGS84_OMEGA_RADPS * r_e[1])
        + u[1] * (v_e[1] + WGS84_OMEGA_RADPS * r_e[0])
        + u[2] * v_e[2]
    ) / C_MPS
    return distance, along / (1.0 + doppler)
