"""What a receiver at the antenna's phase centre observes of a satellite, and how it changes, exactly with light time.

Everything is formed in inertial axes, those of ECEF at the beginning of the satellites' piece (``satellite_arcs``), where
neither the Earth's turn nor Coriolis' acceleration appears. Of the receiver, at the instant t of reception:

    R = r + C l                      V = v + omega x r + C (w x l)
    A = C f + gamma(r) + C (w' x l + w x (w x l))
    J = C (f' + w x f) + gamma' + C (w' x (w x l) + 2 w x (w' x l) + w x (w x (w x l)))

with w = w_ib, f = f_b, l the lever arm, primes derivatives by time, omega the Earth's rate. [Groves 2013, 2.3.4, 2.5.5]
J leaves out C (w'' x l), which samples cannot give. Of the satellite at t - tau, c tau = rho: S, its derivatives and
d = S - R, W = V_s - V, k = 1 - rho'/c the rate of the time of transmission, u = d / rho, q = 1 + u.V_s / c:

    rho'   q = u.W
    rho''  q = u.(A_s k^2 - A) + (|d'|^2 - rho'^2) / rho,                       d'  = V_s k - V
    rho''' q = u.(J_s k^3 - 3 A_s k rho''/c - J) + 3 (d'.d'' - rho' rho'') / rho, d'' = A_s k^2 - V_s rho''/c - A

These are the successive derivatives of rho(t) = |S(t - rho/c) - R(t)|, nothing left out but general relativity
(1e-5 m/s). The instant t is GPS time, not the receiver's tag.

Rates at an instant come from samples that are means over intervals: with x_k the mean over the last interval dt_k and
x_j that n samples before it, the slope is x' = (x_k - x_j) / D, D the time between the intervals' middles, and
x(t_k) = x_k + x' dt_k / 2. White sample noise s becomes s sqrt((1 + a)^2 + a^2), a = dt/2D, of x(t) and sqrt(2) s / D of
the slope; the slope is that of (D + dt) / 2 ago. At 200 Hz and 0.06 m/s/sqrt h: n = 1 gives 0.022 m/s^2, 4.0 m/s^3,
5 ms; n = 2 gives 0.018, 2.0, 7.5 ms; n = 10 gives 0.015, 0.40, 27.5 ms.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from insgnss.aiding.satellite_arcs import PIECE_NS, Arcs
from insgnss.aiding.trace import Samples, Trace
from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.jit import inlined, kernel
from insgnss.tables import Float64, Int64

_USUAL_FLIGHT_S: Final = 0.075  # where the Taylor series of the satellite's motion stands: 67 to 140 ms are in use
_WIDEST_STEP_NS: Final = 100_000_000  # samples farther apart are a gap: no slope across it

# rows of a motion (4, 3): position, velocity, acceleration, jerk
POSITION: Final = 0
VELOCITY: Final = 1
ACCELERATION: Final = 2
JERK: Final = 3
# rows of instantaneous rates (4, 3)
RATE: Final = 0  # w_ib_b [rad/s]
RATE_SLOPE: Final = 1  # [rad/s^2]
FORCE: Final = 2  # f_b [m/s^2]
FORCE_SLOPE: Final = 3  # [m/s^3]


class Spans(NamedTuple):
    """Which rows share satellites, air delays and sigma: span i holds times first_time[i] to first_time[i + 1]."""

    first_time: Int64  # (m + 1,)
    first_satellite: Int64  # (m + 1,) its satellites in ``satellite``
    satellite: Int64  # (q,) number in the arcs
    delay_m: Float64  # (q,) of the air and of the satellite's clock group


class Values(NamedTuple):
    """One entry per output time and satellite of its span, in that order."""

    range_rate: Float64  # [m/s]
    acceleration: Float64  # [m/s^2]
    jerk: Float64  # [m/s^3]
    pseudorange: Float64  # [m]
    clock_rate: Float64  # of receiver (as asked) less satellite [m/s]


@inlined
def instant_rates(imu: Samples, k: int, slope_samples: int, x: Float64) -> tuple[float, float]:
    """Write angular rate, specific force and their slopes at the end of sample ``k``, biases still in; return a, 1/D.

    The module's text has the equations and what they cost; without a usable sample before, slopes are zero.

    Parameters
    ----------
    imu : the samples
    k : the sample, at least 0
    slope_samples : n
    x : (4, 3) output, rows RATE, RATE_SLOPE, FORCE, FORCE_SLOPE
    """
    j = k
    while j > 1 and k - j < slope_samples:
        if imu.t_ns[j] - imu.t_ns[j - 1] > _WIDEST_STEP_NS or imu.t_ns[j - 1] - imu.t_ns[j - 2] > _WIDEST_STEP_NS:
            break
        j -= 1
    per_d, half = 0.0, 0.0
    if 0 < j < k:
        half = 0.5e-9 * (imu.t_ns[k] - imu.t_ns[k - 1])
        per_d = 1.0 / (1e-9 * (imu.t_ns[k] - imu.t_ns[j]) - half + 0.5e-9 * (imu.t_ns[j] - imu.t_ns[j - 1]))
    for i in range(3):
        x[1, i] = (imu.w_ib_b[k, i] - imu.w_ib_b[j, i]) * per_d
        x[3, i] = (imu.f_b[k, i] - imu.f_b[j, i]) * per_d
        x[0, i] = imu.w_ib_b[k, i] + half * x[1, i]
        x[2, i] = imu.f_b[k, i] + half * x[3, i]
    return half * per_d, per_d


@inlined
def cross(x: Float64, y: Float64, out: Float64) -> None:
    """Write x cross y."""
    out[0] = x[1] * y[2] - x[2] * y[1]
    out[1] = x[2] * y[0] - x[0] * y[2]
    out[2] = x[0] * y[1] - x[1] * y[0]


@kernel
def lever_motion(x: Float64, lever_b: Float64, b: Float64, s: Float64) -> None:
    """Write what force and lever arm give in body axes, (4, 3): l, w x l, f + lever's acceleration, and its derivative.

    Equation: the derivative of C p is C (p' + w x p), applied three times to C l and once to C f; w'' is left out.

    Parameters
    ----------
    x : (4, 3) instantaneous rates, biases removed
    lever_b : (3,) IMU to phase centre [m]
    b : (4, 3) output
    s : (5, 3) scratch
    """
    w, w1 = x[0], x[1]
    cross(w, lever_b, s[0])  # w x l
    cross(w1, lever_b, s[1])  # w' x l
    cross(w, s[0], s[2])  # w x (w x l)
    for i in range(3):
        s[2, i] += s[1, i]  # a_l = w' x l + w x (w x l)
    cross(w1, s[0], s[3])
    cross(w, s[1], s[4])
    for i in range(3):
        b[0, i], b[1, i] = lever_b[i], s[0, i]
        b[2, i] = x[2, i] + s[2, i]
        b[3, i] = x[3, i] + s[3, i] + s[4, i]  # (f + a_l)' in body axes
    cross(w, b[2], s[3])
    for i in range(3):
        b[3, i] += s[3, i]


@kernel
def antenna_motion(r_e: Float64, v_e: Float64, C_eb: Float64, b: Float64, g: Float64, motion: Float64) -> None:
    """Write position and its three inertial derivatives of the phase centre, in ECEF axes of the instant, (4, 3).

    Equation: the module's R, V, A, J; gamma' = -(|gamma| / r) (V - 3 r (r.V) / r^2), of a point mass: within 1e-3 of it.

    Parameters
    ----------
    r_e, v_e, C_eb : the IMU's position [m], velocity [m/s] and attitude
    b : (4, 3) as ``lever_motion`` writes it
    g : (3,) scratch
    motion : (4, 3) output
    """
    omega = WGS84_OMEGA_RADPS
    normal_gravity_ecef(r_e, g)
    g[0] -= omega * omega * r_e[0]  # gravitation: without the centrifugal acceleration
    g[1] -= omega * omega * r_e[1]
    square, along, gamma2 = 0.0, 0.0, 0.0
    for i in range(3):
        for row in range(4):
            motion[row, i] = C_eb[i, 0] * b[row, 0] + C_eb[i, 1] * b[row, 1] + C_eb[i, 2] * b[row, 2]
        square += r_e[i] * r_e[i]
        gamma2 += g[i] * g[i]
    vx, vy, vz = v_e[0] - omega * r_e[1], v_e[1] + omega * r_e[0], v_e[2]
    along = (r_e[0] * vx + r_e[1] * vy + r_e[2] * vz) * 3.0 / square
    pull = math.sqrt(gamma2 / square)
    motion[3, 0] -= pull * (vx - along * r_e[0])
    motion[3, 1] -= pull * (vy - along * r_e[1])
    motion[3, 2] -= pull * (vz - along * r_e[2])
    motion[1, 0] += vx
    motion[1, 1] += vy
    motion[1, 2] += vz
    for i in range(3):
        motion[0, i] += r_e[i]
        motion[2, i] += g[i]


@kernel
def turn_about_axis(vectors: Float64, angle: float) -> None:
    """Turn vectors (n, 3) about the Earth's axis by ``angle`` [rad], in place."""
    sine, cosine = math.sin(angle), math.cos(angle)
    for row in range(vectors.shape[0]):
        x, y = vectors[row, 0], vectors[row, 1]
        vectors[row, 0], vectors[row, 1] = cosine * x - sine * y, sine * x + cosine * y


@inlined
def polynomial(c: Float64, x: float) -> tuple[float, float, float, float]:
    """Return a polynomial of fifth degree, (6,) coefficients, with three derivatives."""
    c2, c3, c4, c5 = c[2], c[3], c[4], c[5]
    value = ((((c5 * x + c4) * x + c3) * x + c2) * x + c[1]) * x + c[0]
    first = (((5.0 * c5 * x + 4.0 * c4) * x + 3.0 * c3) * x + 2.0 * c2) * x + c[1]
    second = ((20.0 * c5 * x + 12.0 * c4) * x + 6.0 * c3) * x + 2.0 * c2
    return value, first, second, (60.0 * c5 * x + 24.0 * c4) * x + 6.0 * c3


@inlined
def observe_satellite(
    piece: Float64, since_s: float, motion: Float64, line: Float64
) -> tuple[float, float, float, float, float]:
    """Return range, its three derivatives, and the time of transmission [s of the piece]; write u and W.

    The time of transmission is found by one step of Newton's method from 75 ms of light time: within 1e-11 s of a
    geostationary satellite's, 1e-12 s of the others', 1e-8 m of range.

    Parameters
    ----------
    piece : (4, 6) of one satellite
    since_s : time of reception since the piece's beginning [s]
    motion : (4, 3) of the antenna, in the piece's axes
    line : (2, 3) output, u and W = V_s - V in the piece's axes
    """
    t = since_s - _USUAL_FLIGHT_S
    x, vx, ax, jx = polynomial(piece[0], t)
    y, vy, ay, jy = polynomial(piece[1], t)
    z, vz, az, jz = polynomial(piece[2], t)
    dx, dy, dz = x - motion[0, 0], y - motion[0, 1], z - motion[0, 2]
    rho = math.sqrt(dx * dx + dy * dy + dz * dz)
    # |S(t) - R| = c (since - t): what is left over divided by its slope
    h = (C_MPS * _USUAL_FLIGHT_S - rho) / (C_MPS + (dx * vx + dy * vy + dz * vz) / rho)
    t += h
    # S and its derivatives h later: the fourth derivative is below 1e-9 m
    hh, hhh = 0.5 * h * h, h * h * h / 6.0
    dx += h * vx + hh * ax + hhh * jx
    dy += h * vy + hh * ay + hhh * jy
    dz += h * vz + hh * az + hhh * jz
    vx += h * ax + hh * jx
    vy += h * ay + hh * jy
    vz += h * az + hh * jz
    ax += h * jx
    ay += h * jy
    az += h * jz
    rho = math.sqrt(dx * dx + dy * dy + dz * dz)
    per_rho = 1.0 / rho
    ux, uy, uz = dx * per_rho, dy * per_rho, dz * per_rho
    line[0, 0], line[0, 1], line[0, 2] = ux, uy, uz
    Vx, Vy, Vz = motion[1, 0], motion[1, 1], motion[1, 2]
    line[1, 0], line[1, 1], line[1, 2] = vx - Vx, vy - Vy, vz - Vz
    per_q = 1.0 / (1.0 + (ux * vx + uy * vy + uz * vz) / C_MPS)
    rate = (ux * (vx - Vx) + uy * (vy - Vy) + uz * (vz - Vz)) * per_q
    k = 1.0 - rate / C_MPS
    # d' and the part of d'' that does not hold rho''
    ex, ey, ez = vx * k - Vx, vy * k - Vy, vz * k - Vz
    kk = k * k
    fx, fy, fz = ax * kk - motion[2, 0], ay * kk - motion[2, 1], az * kk - motion[2, 2]
    bend = (ex * ex + ey * ey + ez * ez - rate * rate) * per_rho
    acceleration = (ux * fx + uy * fy + uz * fz + bend) * per_q
    slowing = acceleration / C_MPS
    mixed = ex * (fx - vx * slowing) + ey * (fy - vy * slowing) + ez * (fz - vz * slowing)
    kkk, side = kk * k, 3.0 * k * slowing
    jerk = ux * (jx * kkk - side * ax - motion[3, 0]) + uy * (jy * kkk - side * ay - motion[3, 1])
    jerk += uz * (jz * kkk - side * az - motion[3, 2]) + 3.0 * (mixed - rate * acceleration) * per_rho
    return rho, rate, acceleration, jerk * per_q, t


@kernel
def place_motion(
    trace: Trace,
    imu: Samples,
    i: int,
    lever_b: Float64,
    slope_samples: int,
    arcs: Arcs,
    work: Float64,
) -> tuple[int, float, float, float]:
    """Write the antenna's motion at trace row ``i``, in the piece's axes.

    Returns the piece, the time in it [s], and the slopes' weights a and 1/D of the last and the first sample.

    Parameters
    ----------
    work : (20, 3) output and scratch: rows 0 to 3 the motion, 4 to 7 the rates, 8 to 11 as ``lever_motion``
    """
    x = work[4:8]
    a, per_d = instant_rates(imu, trace.sample[i], slope_samples, x)
    for axis in range(3):
        x[0, axis] -= trace.b_g[i, axis]
        x[2, axis] -= trace.b_a[i, axis]
    lever_motion(x, lever_b, work[8:12], work[12:17])
    antenna_motion(trace.r_e[i], trace.v_e[i], trace.C_eb[i], work[8:12], work[17], work[0:4])
    since_ns = trace.t_ns[i] - arcs.start_ns
    piece = since_ns // PIECE_NS
    since_s = (since_ns - piece * PIECE_NS) / NS_PER_S
    turn_about_axis(work[0:4], WGS84_OMEGA_RADPS * since_s)
    return piece, since_s, a, per_d


@kernel
def fill_values(
    trace: Trace,
    imu: Samples,
    arcs: Arcs,
    spans: Spans,
    lever_b: Float64,
    slope_samples: int,
    receiver_clock: float,
    work: Float64,
    out: Values,
) -> None:
    """Write the values of all satellites of each span at its times.

    Parameters
    ----------
    trace, imu, arcs, spans : the filter's states, the inertial samples, the satellites, and which are wanted when
    lever_b : (3,) IMU to phase centre [m]
    slope_samples : n of the module's text
    receiver_clock : 1.0 with the receiver's clock and drift, 0.0 without
    work : (20, 3) scratch
    out : as many entries as times and satellites say
    """
    line = work[18:20]
    row = 0
    for span in range(len(spans.first_time) - 1):
        first, last = spans.first_satellite[span], spans.first_satellite[span + 1]
        for i in range(spans.first_time[span], spans.first_time[span + 1]):
            p, since_s, _, _ = place_motion(trace, imu, i, lever_b, slope_samples, arcs, work)
            bias, drift = receiver_clock * trace.clock[i, 0], receiver_clock * trace.clock[i, 1]
            for j in range(first, last):
                piece = arcs.pieces[spans.satellite[j], p]
                rho, rate, acceleration, jerk, t = observe_satellite(piece, since_s, work[0:4], line)
                c = piece[3]
                clock = ((c[3] * t + c[2]) * t + c[1]) * t + c[0]
                out.range_rate[row] = rate
                out.acceleration[row] = acceleration
                out.jerk[row] = jerk
                out.pseudorange[row] = rho + spans.delay_m[j] + bias - clock
                out.clock_rate[row] = drift - ((3.0 * c[3] * t + 2.0 * c[2]) * t + c[1])
                row += 1
