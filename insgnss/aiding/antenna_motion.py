"""The motion of the antenna's phase centre at an instant: from the IMU's state and samples, in inertial axes.

In axes that are ECEF's of some instant:

    R = r + C l                      V = v + omega x r + C (w x l)
    A = C f + gamma(r) + C (w' x l + w x (w x l))
    J = C (f' + w x f) + gamma' + C (w' x (w x l) + 2 w x (w' x l) + w x (w x (w x l)))

with w = w_ib, f = f_b, l the lever arm, primes derivatives by time, omega the Earth's rate. [Groves 2013, 2.3.4, 2.5.5]
J leaves out C (w'' x l), which samples cannot give.

Rates at an instant come from samples that are means over intervals: with x_k the mean over the last interval dt_k and
x_j that n samples before it, the slope is x' = (x_k - x_j) / D, D the time between the intervals' middles, and
x(t_k) = x_k + x' dt_k / 2. White sample noise s becomes s sqrt((1 + a)^2 + a^2), a = dt / 2D, of x(t) and sqrt(2) s / D
of the slope; the slope is that of (D + dt) / 2 ago. At 200 Hz and 0.06 m/s/sqrt h: n = 1 gives 0.022 m/s^2, 4.0 m/s^3,
5 ms; n = 2 gives 0.018, 2.0, 7.5 ms; n = 10 gives 0.015, 0.40, 27.5 ms.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from insgnss.aiding.satellite_arcs import PIECE_NS, Arcs
from insgnss.aiding.trace import Trace, TraceSamples
from insgnss.constants import NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.geodesy.gravity import normal_gravity_ecef
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64

_WIDEST_STEP_NS: Final = 100_000_000  # samples farther apart are a gap: no slope across it

# Rows of the work space (20, 3): the antenna's R, V, A, J at 0 to 3, the rates at the instant, l and its derivatives
RATE: Final = 4  # w_ib_b [rad/s]
RATE_SLOPE: Final = 5  # [rad/s^2]
FORCE: Final = 6  # f_b [m/s^2]
FORCE_SLOPE: Final = 7  # [m/s^3]
ARM: Final = 8  # and three more
_SPARE: Final = 12  # and five more; 18 and 19 hold a line of sight


@kernel(inline=True)
def instant_rates(imu: TraceSamples, k: int, slope_samples: int, work: Float64) -> tuple[float, float]:
    """Write angular rate, specific force and their slopes at the end of sample ``k``, biases still in; return a, 1/D.

    The module's text has the equations and what they cost; without a usable sample before, slopes are zero.

    Parameters
    ----------
    k : the sample, at least 0
    slope_samples : n
    work : rows RATE, RATE_SLOPE, FORCE, FORCE_SLOPE are written
    """
    j = k
    while j > 1 and k - j < slope_samples:
        step_ns = max(imu.t_ns[j] - imu.t_ns[j - 1], imu.t_ns[j - 1] - imu.t_ns[j - 2])
        if step_ns > _WIDEST_STEP_NS:
            break
        j -= 1
    per_d, half = 0.0, 0.0
    if 0 < j < k:
        half = 0.5e-9 * (imu.t_ns[k] - imu.t_ns[k - 1])
        per_d = 1.0 / (1e-9 * (imu.t_ns[k] - imu.t_ns[j]) - half + 0.5e-9 * (imu.t_ns[j] - imu.t_ns[j - 1]))
    for i in range(3):
        work[RATE_SLOPE, i] = (imu.w_ib_b[k, i] - imu.w_ib_b[j, i]) * per_d
        work[FORCE_SLOPE, i] = (imu.f_b[k, i] - imu.f_b[j, i]) * per_d
        work[RATE, i] = imu.w_ib_b[k, i] + half * work[RATE_SLOPE, i]
        work[FORCE, i] = imu.f_b[k, i] + half * work[FORCE_SLOPE, i]
    return half * per_d, per_d


@kernel(inline=True)
def cross_rows(work: Float64, x: int, y: int, out: int) -> None:
    """Write the cross product of two rows into a third: without cutting rows out, which costs more than the product."""
    a, b, c = work[x, 0], work[x, 1], work[x, 2]
    d, e, f = work[y, 0], work[y, 1], work[y, 2]
    work[out, 0], work[out, 1], work[out, 2] = b * f - c * e, c * d - a * f, a * e - b * d


@kernel(inline=True)
def lever_motion(lever_b: Float64, work: Float64) -> None:
    """Write what force and lever arm give in body axes into rows ARM to ARM + 3.

    They are l, w x l, f + lever's acceleration, and its derivative: that of C p is C (p' + w x p), applied three times
    to C l and once to C f; w'' is left out.
    """
    for i in range(3):
        work[ARM, i] = lever_b[i]
    cross_rows(work, RATE, ARM, ARM + 1)  # w x l
    cross_rows(work, RATE_SLOPE, ARM, _SPARE)  # w' x l
    cross_rows(work, RATE, ARM + 1, _SPARE + 1)  # w x (w x l)
    cross_rows(work, RATE_SLOPE, ARM + 1, _SPARE + 2)  # w' x (w x l)
    cross_rows(work, RATE, _SPARE, _SPARE + 3)  # w x (w' x l)
    for i in range(3):
        work[ARM + 2, i] = work[FORCE, i] + work[_SPARE, i] + work[_SPARE + 1, i]
    cross_rows(work, RATE, ARM + 2, _SPARE + 4)
    for i in range(3):
        moved = work[FORCE_SLOPE, i] + work[_SPARE + 2, i] + work[_SPARE + 3, i]
        work[ARM + 3, i] = moved + work[_SPARE + 4, i]


@kernel(inline=True)
def antenna_motion(trace: Trace, i: int, g: Float64, work: Float64) -> None:
    """Write position and its three inertial derivatives of the phase centre, in ECEF axes of the instant.

    Equation: the module's R, V, A, J; gamma' = -(|gamma| / r) (V - 3 r (r.V) / r^2), of a point mass: within 1e-3.

    Parameters
    ----------
    trace, i : the IMU's position [m], velocity [m/s] and attitude
    g : (3,) scratch
    work : rows 0 to 3 are written, from ARM on as ``lever_motion`` writes them
    """
    omega, C = WGS84_OMEGA_RADPS, trace.C_eb
    normal_gravity_ecef(trace.r_e[i], g)
    x, y, z = trace.r_e[i, 0], trace.r_e[i, 1], trace.r_e[i, 2]
    # gravitation: without the centrifugal acceleration
    gx, gy, gz = g[0] - omega * omega * x, g[1] - omega * omega * y, g[2]
    for a in range(3):
        c0, c1, c2 = C[i, a, 0], C[i, a, 1], C[i, a, 2]
        for row in range(4):
            work[row, a] = c0 * work[ARM + row, 0] + c1 * work[ARM + row, 1] + c2 * work[ARM + row, 2]
    vx, vy, vz = trace.v_e[i, 0] - omega * y, trace.v_e[i, 1] + omega * x, trace.v_e[i, 2]
    square = x * x + y * y + z * z
    along = (x * vx + y * vy + z * vz) * 3.0 / square
    pull = math.sqrt((gx * gx + gy * gy + gz * gz) / square)
    work[0, 0], work[0, 1], work[0, 2] = work[0, 0] + x, work[0, 1] + y, work[0, 2] + z
    work[1, 0], work[1, 1], work[1, 2] = work[1, 0] + vx, work[1, 1] + vy, work[1, 2] + vz
    work[2, 0], work[2, 1], work[2, 2] = work[2, 0] + gx, work[2, 1] + gy, work[2, 2] + gz
    work[3, 0] -= pull * (vx - along * x)
    work[3, 1] -= pull * (vy - along * y)
    work[3, 2] -= pull * (vz - along * z)


@kernel(inline=True)
def turn_about_axis(vectors: Float64, first: int, last: int, angle: float) -> None:
    """Turn rows of vectors (n, 3) about the Earth's axis by ``angle`` [rad], below 0.01 as within a piece, in place."""
    square = angle * angle
    # the next terms of both series are below 1e-17
    sine = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    cosine = 1.0 - 0.5 * square * (1.0 - square / 12.0 * (1.0 - square / 30.0))
    for row in range(first, last):
        x, y = vectors[row, 0], vectors[row, 1]
        vectors[row, 0], vectors[row, 1] = cosine * x - sine * y, sine * x + cosine * y


class VehicleTrace(NamedTuple):
    """The inputs of the antenna's motion."""

    trace: Trace
    imu: TraceSamples
    lever_b: Float64  # (3,) IMU to phase centre [m]
    slope_samples: int  # n of the module's text


@kernel
def place_motion(vehicle: VehicleTrace, i: int, arcs: Arcs, work: Float64) -> tuple[int, float, float, float]:
    """Write the antenna's motion at trace row ``i``, in the piece's axes.

    Returns the piece, the time in it [s], and the slopes' weights a and 1/D of the last and the first sample.

    Parameters
    ----------
    work : (20, 3) output and scratch: the rows are named at the module's top
    """
    trace = vehicle.trace
    a, per_d = instant_rates(vehicle.imu, trace.sample[i], vehicle.slope_samples, work)
    for axis in range(3):
        work[RATE, axis] -= trace.b_g[i, axis]
        work[FORCE, axis] -= trace.b_a[i, axis]
    lever_motion(vehicle.lever_b, work)
    antenna_motion(trace, i, work[_SPARE], work)
    since_ns = trace.t_ns[i] - arcs.start_ns
    piece = since_ns // PIECE_NS
    since_s = (since_ns - piece * PIECE_NS) / NS_PER_S
    turn_about_axis(work, 0, 4, WGS84_OMEGA_RADPS * since_s)
    return piece, since_s, a, per_d
