"""Strapdown mechanization in ECEF: attitude, velocity, position over an interval of constant rates, compiled."""

from __future__ import annotations

import math

from insgnss.constants import WGS84_OMEGA_RADPS
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.geodesy.rotations import quaternion_to_matrix, rotation_vector_quaternion
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

# the series' fractions, so that they need no division
_6TH, _24TH, _30TH, _42ND, _56TH, _72ND, _120TH = (
    1.0 / n for n in (6.0, 24.0, 30.0, 42.0, 56.0, 72.0, 120.0)
)


@kernel(inline=True)
def rotation_integral(phi_x: float, phi_y: float, phi_z: float) -> tuple[float, float]:
    """Return a = (1 - cos phi)/phi^2 and b = (phi - sin phi)/phi^3 of the rotation vector's length phi [rad].

    They turn a specific force that is constant in a turning body into the velocity increment in its starting frame:
    dv = (I + a [phi x] + b [phi x]^2) f dt.
    """
    p2 = phi_x * phi_x + phi_y * phi_y + phi_z * phi_z
    if p2 < 0.04:
        a = 0.5 - _24TH * p2 * (1.0 - _30TH * p2 * (1.0 - _56TH * p2))
        b = _6TH - _120TH * p2 * (1.0 - _42ND * p2 * (1.0 - _72ND * p2))
        return a, b
    p = math.sqrt(p2)
    return (1.0 - math.cos(p)) / p2, (p - math.sin(p)) / (p2 * p)


@kernel(inline=True)
def turn_attitude(q_eb: Float64, C_eb: Float64, w: Float64, dt: float) -> None:
    """Turn ``q_eb`` (4,) and ``C_eb`` (3, 3) over ``dt`` [s] by the body's rate ``w`` = w_ib_b [rad/s] and the Earth's.

    Equation: q_eb <- dq(-w_ie dt) (x) q_eb (x) dq(w_ib dt), exact for constant rates.
    """
    b0, b1, b2, b3 = rotation_vector_quaternion(w[0] * dt, w[1] * dt, w[2] * dt)
    half = 0.5 * WGS84_OMEGA_RADPS * dt
    c = 1.0 - 0.5 * half * half  # cos and sin of half the Earth's turn: 1e-7 rad per ms, the series ends here
    s = half
    q0, q1, q2, q3 = q_eb[0], q_eb[1], q_eb[2], q_eb[3]
    p0 = q0 * b0 - q1 * b1 - q2 * b2 - q3 * b3
    p1 = q0 * b1 + q1 * b0 + q2 * b3 - q3 * b2
    p2 = q0 * b2 - q1 * b3 + q2 * b0 + q3 * b1
    p3 = q0 * b3 + q1 * b2 - q2 * b1 + q3 * b0
    r0 = c * p0 + s * p3
    r1 = c * p1 + s * p2
    r2 = c * p2 - s * p1
    r3 = c * p3 - s * p0
    # one Newton step towards unit norm: the deviation is rounding only
    n = 1.5 - 0.5 * (r0 * r0 + r1 * r1 + r2 * r2 + r3 * r3)
    q_eb[0] = r0 * n
    q_eb[1] = r1 * n
    q_eb[2] = r2 * n
    q_eb[3] = r3 * n
    quaternion_to_matrix(q_eb, C_eb)


@kernel
def mechanize(
    q_eb: Float64,
    C_eb: Float64,
    r_e: Float64,
    v_e: Float64,
    w: Float64,
    f: Float64,
    dt: float,
    g_e: Float64,
) -> tuple[float, float, float]:
    """Carry attitude, velocity and position over ``dt`` with constant effective body rates.

    Returns the velocity increment of the specific force in ECEF axes [m/s].

    Equation: v' = C_eb f_b + g(r_e) - 2 w_ie x v_e,  r' = v_e  [Groves 2013, 5.2]; gravity and Coriolis at
              mid-interval, position by the mean velocity
    Neglects: third order in dt: |w x f| dt^3 / 12 of position per step, bounded in sum; 0.3 mm in an hour of an orbit
              at 7 km/s and 10 ms.

    Parameters
    ----------
    q_eb, C_eb : (4,), (3, 3) attitude, body to ECEF, changed in place
    r_e, v_e : (3,) position [m] and velocity [m/s] in ECEF, changed in place
    w, f : (3,) effective rate w_ib_b [rad/s] and specific force [m/s^2] of the interval
    dt : length of the interval [s]
    g_e : (3,) scratch
    """
    px, py, pz = w[0] * dt, w[1] * dt, w[2] * dt
    a, b = rotation_integral(px, py, pz)
    fx, fy, fz = f[0] * dt, f[1] * dt, f[2] * dt
    # phi x f and phi x (phi x f)
    cx, cy, cz = py * fz - pz * fy, pz * fx - px * fz, px * fy - py * fx
    ux = fx + a * cx + b * (py * cz - pz * cy)
    uy = fy + a * cy + b * (pz * cx - px * cz)
    uz = fz + a * cz + b * (px * cy - py * cx)
    ex = C_eb[0, 0] * ux + C_eb[0, 1] * uy + C_eb[0, 2] * uz
    ey = C_eb[1, 0] * ux + C_eb[1, 1] * uy + C_eb[1, 2] * uz
    ez = C_eb[2, 0] * ux + C_eb[2, 1] * uy + C_eb[2, 2] * uz
    # the Earth turns under the increment: (I - w_ie dt / 2 x)
    half_turn = 0.5 * WGS84_OMEGA_RADPS * dt
    dv_x = ex + half_turn * ey
    dv_y = ey - half_turn * ex
    turn_attitude(q_eb, C_eb, w, dt)

    vx, vy, vz = v_e[0], v_e[1], v_e[2]
    half = 0.5 * dt
    r_e[0] += half * vx  # mid-interval position for gravity
    r_e[1] += half * vy
    r_e[2] += half * vz
    normal_gravity_ecef(r_e, g_e)
    # mid-interval velocity for Coriolis, itself turned by it: without that a drift of 2 w^2 v dt remains
    turn = 2.0 * half_turn
    mx = vx + 0.5 * (dv_x + g_e[0] * dt) + turn * vy
    my = vy + 0.5 * (dv_y + g_e[1] * dt) - turn * vx
    v_e[0] = vx + dv_x + (g_e[0] + 2.0 * WGS84_OMEGA_RADPS * my) * dt
    v_e[1] = vy + dv_y + (g_e[1] - 2.0 * WGS84_OMEGA_RADPS * mx) * dt
    v_e[2] = vz + ez + g_e[2] * dt
    r_e[0] += half * v_e[0]  # half a step with the old velocity, half with the new one
    r_e[1] += half * v_e[1]
    r_e[2] += half * v_e[2]
    return dv_x, dv_y, ez
