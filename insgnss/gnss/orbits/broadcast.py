"""The broadcast orbit: Keplerian elements with second harmonics -> position, velocity, acceleration in ECEF.

One algorithm serves GPS (IS-GPS-200N, table 20-IV), Galileo (OS SIS ICD 2.1, table 60), QZSS, NavIC and BeiDou
(B1I ICD 3.0, table 5-12); geostationary BeiDou satellites end with two rotations more. Velocity and acceleration are
the analytic derivatives of the same expressions. The frame is Earth-fixed at the instant of transmission.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from insgnss.constants import BEIDOU_GEO_TILT_DEG
from insgnss.gnss.orbits.ephemeris_rows import (
    CIC,
    CIS,
    COS_OMEGA,
    CRC,
    CRS,
    CUC,
    CUS,
    EARTH_RATE,
    I0,
    IDOT,
    NODE,
    NODE_RATE,
    ROOT_1_E2,
    SIN_OMEGA,
    A,
    E,
    N,
)
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_SIN_TILT: Final = math.sin(math.radians(BEIDOU_GEO_TILT_DEG))
_COS_TILT: Final = math.cos(math.radians(BEIDOU_GEO_TILT_DEG))
# bisection alone halves the bracket to the last bit in less; Newton needs 2 to 4 for e < 0.1
_MAX_STEPS: Final = 100


@kernel
def eccentric_anomaly(mean: float, e: float, start: float) -> tuple[float, float, float]:
    """Return the eccentric anomaly, its sine and cosine, to machine precision for any 0 <= e < 1.

    Equation: E - e sin E = M, by Newton's method inside the bracket M - e <= E <= M + e.
    ``start`` is a first guess (``mean`` itself will do); the result does not depend on it beyond rounding.
    """
    low, high = mean - e, mean + e
    anomaly = min(max(start, low), high)
    for _ in range(_MAX_STEPS):
        sine, cosine = math.sin(anomaly), math.cos(anomaly)
        excess = anomaly - e * sine - mean
        slope = 1.0 - e * cosine
        step = -excess / slope
        if abs(step) <= 1e-8 * slope:
            # after this step the error is of order step^2 / slope < 1e-16; sine and cosine follow by their series
            half = 0.5 * step * step
            return anomaly + step, sine + cosine * step - sine * half, cosine - sine * step - cosine * half
        if excess > 0.0:
            high = anomaly
        else:
            low = anomaly
        anomaly += step
        if anomaly <= low or anomaly >= high:
            anomaly = 0.5 * (low + high)
    return anomaly, math.sin(anomaly), math.cos(anomaly)


PlaneMotion: TypeAlias = tuple[float, float, float, float, float, float]  # x, y and their two derivatives


@kernel
def _harmonic(
    cs: float, cc: float, s2: float, c2: float, rate: float, rate_change: float
) -> tuple[float, float, float]:
    """Return cs sin 2phi + cc cos 2phi and its first two time derivatives; phi has the given derivatives."""
    value = cs * s2 + cc * c2
    turned = 2.0 * (cs * c2 - cc * s2)
    return value, turned * rate, turned * rate_change - 4.0 * value * rate * rate


@kernel
def _turn(sine: float, cosine: float, rate: float, motion: PlaneMotion) -> PlaneMotion:
    """Return a motion in a plane, turned by an angle that grows at a constant rate."""
    x, y, vx, vy, ax, ay = motion
    # v + rate x r ; a + 2 rate x v + rate x (rate x r), in the frame that turns
    ux, uy = vx - rate * y, vy + rate * x
    bx, by = ax - rate * (2.0 * vy + rate * x), ay + rate * (2.0 * vx - rate * y)
    return (
        cosine * x - sine * y,
        sine * x + cosine * y,
        cosine * ux - sine * uy,
        sine * ux + cosine * uy,
        cosine * bx - sine * by,
        sine * bx + cosine * by,
    )


@kernel
def _in_orbital_plane(
    rows: Float64, k: int, t: float, sin_E: float, cos_E: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return x, y in the orbital plane (x to the node) with two derivatives, then inclination with two."""
    e, n, a = rows[k, E], rows[k, N], rows[k, A]
    # q = r / a = 1 - e cos E ; E' = n / q
    q = 1.0 - e * cos_E
    E1 = n / q
    q1 = e * sin_E * E1
    E2 = -E1 * q1 / q
    q2 = e * (cos_E * E1 * E1 + sin_E * E2)
    # true anomaly nu: sin nu = sqrt(1 - e^2) sin E / q, cos nu = (cos E - e) / q, nu' = sqrt(1 - e^2) E' / q
    sin_nu = rows[k, ROOT_1_E2] * sin_E / q
    cos_nu = (cos_E - e) / q
    nu1 = rows[k, ROOT_1_E2] * E1 / q
    nu2 = -2.0 * nu1 * q1 / q
    # phi = nu + omega, the argument of latitude
    sin_phi = sin_nu * rows[k, COS_OMEGA] + cos_nu * rows[k, SIN_OMEGA]
    cos_phi = cos_nu * rows[k, COS_OMEGA] - sin_nu * rows[k, SIN_OMEGA]
    s2 = 2.0 * sin_phi * cos_phi
    c2 = 1.0 - 2.0 * sin_phi * sin_phi
    du, du1, du2 = _harmonic(rows[k, CUS], rows[k, CUC], s2, c2, nu1, nu2)
    dr, dr1, dr2 = _harmonic(rows[k, CRS], rows[k, CRC], s2, c2, nu1, nu2)
    di, di1, di2 = _harmonic(rows[k, CIS], rows[k, CIC], s2, c2, nu1, nu2)
    # u = phi + du, r = a q + dr
    sin_du, cos_du = math.sin(du), math.cos(du)
    sin_u = sin_phi * cos_du + cos_phi * sin_du
    cos_u = cos_phi * cos_du - sin_phi * sin_du
    u1, u2 = nu1 + du1, nu2 + du2
    r, r1, r2 = a * q + dr, a * q1 + dr1, a * q2 + dr2
    # polar to plane: radial acceleration r'' - r u'^2, transverse 2 r' u' + r u''
    radial, transverse = r2 - r * u1 * u1, 2.0 * r1 * u1 + r * u2
    return (
        r * cos_u,
        r * sin_u,
        r1 * cos_u - r * u1 * sin_u,
        r1 * sin_u + r * u1 * cos_u,
        radial * cos_u - transverse * sin_u,
        radial * sin_u + transverse * cos_u,
        rows[k, I0] + rows[k, IDOT] * t + di,
        rows[k, IDOT] + di1,
        di2,
    )


@kernel
def orbit_state(rows: Float64, k: int, t: float, sin_E: float, cos_E: float, out: Float64, j: int) -> None:
    """Write position [m], velocity [m/s] and acceleration [m/s^2] in ECEF at transmission into ``out[j, 0:9]``.

    Equation: r = R3(-Omega) R1(-i) r_plane    [IS-GPS-200N, table 20-IV]; a geostationary BeiDou satellite:
    r = R3(omega_e t) R1(-5 deg) r    [BDS-SIS-ICD B1I 3.0, table 5-12].

    Parameters
    ----------
    rows : (m, N_COLUMNS) messages, see ``ephemeris_rows``
    k : the message's row
    t : time since toe [s]
    sin_E, cos_E : of the eccentric anomaly at ``t``
    out : (n, >= 9) output
    j : row of ``out``
    """
    x, y, vx, vy, ax, ay, i, i1, i2 = _in_orbital_plane(rows, k, t, sin_E, cos_E)
    # the plane tilted by the inclination: p = y cos i, z = y sin i
    sin_i, cos_i = math.sin(i), math.cos(i)
    p, z = y * cos_i, y * sin_i
    p1, z1 = vy * cos_i - z * i1, vy * sin_i + p * i1
    p2 = ay * cos_i - z * i2 - i1 * (2.0 * vy * sin_i + p * i1)
    z2 = ay * sin_i + p * i2 + i1 * (2.0 * vy * cos_i - z * i1)
    node = rows[k, NODE] + rows[k, NODE_RATE] * t
    level = x, p, vx, p1, ax, p2
    x, p, vx, p1, ax, p2 = _turn(math.sin(node), math.cos(node), rows[k, NODE_RATE], level)
    if rows[k, EARTH_RATE] != 0.0:
        p, z = _COS_TILT * p + _SIN_TILT * z, _COS_TILT * z - _SIN_TILT * p
        p1, z1 = _COS_TILT * p1 + _SIN_TILT * z1, _COS_TILT * z1 - _SIN_TILT * p1
        p2, z2 = _COS_TILT * p2 + _SIN_TILT * z2, _COS_TILT * z2 - _SIN_TILT * p2
        turned = -rows[k, EARTH_RATE] * t
        rate = -rows[k, EARTH_RATE]
        level = x, p, vx, p1, ax, p2
        x, p, vx, p1, ax, p2 = _turn(math.sin(turned), math.cos(turned), rate, level)
    out[j, 0], out[j, 1], out[j, 2] = x, p, z
    out[j, 3], out[j, 4], out[j, 5] = vx, p1, z1
    out[j, 6], out[j, 7], out[j, 8] = ax, p2, z2
