"""The observables of a satellite at the antenna's phase centre, and their rates, exactly with light time.

Everything is formed in inertial axes, those of ECEF at the beginning of the satellites' piece (``satellite_arcs``),
where neither the Earth's turn nor Coriolis' acceleration appears. Of the antenna: R, V, A, J (``antenna_motion``). Of
the satellite at t - tau, c tau = rho: S and its derivatives, and d = S - R, W = V_s - V, k = 1 - rho'/c the rate of the
time of transmission, u = d / rho, q = 1 + u.V_s / c:

    rho'   q = u.W
    rho''  q = u.(A_s k^2 - A) + (|d'|^2 - rho'^2) / rho,                       d'  = V_s k - V
    rho''' q = u.(J_s k^3 - 3 A_s k rho''/c - J) + 3 (d'.d'' - rho' rho'') / rho, d'' = A_s k^2 - V_s rho''/c - A

These are the successive derivatives of rho(t) = |S(t - rho/c) - R(t)|, nothing left out but general relativity
(1e-5 m/s). The instant t is GPS time, not the receiver's tag.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.aiding.antenna_motion import VehicleTrace, place_motion
from insgnss.aiding.satellite_arcs import Arcs
from insgnss.constants import C_MPS
from insgnss.gnss.orbits.satellite_state import USUAL_FLIGHT_S
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64

_PER_C: Final = 1.0 / C_MPS

# The results for up to LANES satellites at once are in one array, one row of LANES numbers for each
# quantity. Rows 0 to 16 are a satellite's expansion: S, V_s, A_s, J_s at 0, 3, 6, 9, then these; 17 to 21 what comes
# of it
LANES: Final = 64
_RANGE0: Final = 12
_K0: Final = 13
_CLOCK0: Final = 14
_CLOCK1: Final = 15
_CLOCK2: Final = 16
RANGE: Final = 17
RANGE_RATE: Final = 18
RANGE_ACCELERATION: Final = 19
RANGE_JERK: Final = 20
SATELLITE_CLOCK: Final = 21
N_LANE_ROWS: Final = 22
Float32 = npt.NDArray[np.float32]


class Spans(NamedTuple):
    """Which rows share satellites, air delays and sigma: span i holds times first_time[i] to first_time[i + 1]."""

    first_time: Int64  # (m + 1,)
    first_satellite: Int64  # (m + 1,) its satellites in ``satellite``
    satellite: Int64  # (q,) number in the arcs
    delay_m: Float64  # (q,) of the air and of the satellite's clock group
    drift_mps: Float64  # (q,) rate of the satellite's clock at the span's beginning; it changes by 1e-6 m/s in a span


class Values(NamedTuple):
    """One entry per output time and satellite of its span, in that order."""

    range_rate: Float64  # [m/s]
    pseudorange: Float64  # [m]
    acceleration: Float32  # [m/s^2], within 1e-6 of 30 m/s^2
    jerk: Float32  # [m/s^3]


@kernel(inline=True)
def polynomial(c: Float64, x: float) -> tuple[float, float, float, float]:
    """Return a polynomial of fifth degree, (6,) coefficients, with three derivatives."""
    c2, c3, c4, c5 = c[2], c[3], c[4], c[5]
    value = ((((c5 * x + c4) * x + c3) * x + c2) * x + c[1]) * x + c[0]
    first = (((5.0 * c5 * x + 4.0 * c4) * x + 3.0 * c3) * x + 2.0 * c2) * x + c[1]
    second = ((20.0 * c5 * x + 12.0 * c4) * x + 6.0 * c3) * x + 2.0 * c2
    return value, first, second, (60.0 * c5 * x + 24.0 * c4) * x + 6.0 * c3


@kernel
def expand_satellite(piece: Float64, since_s: float, motion: Float64, e: Float64, j: int) -> None:
    """Write a satellite's motion and clock about the transmission time of the present signal, in lane ``j``.

    The time of transmission is found by Newton's method from 75 ms of light time: after two steps the rest is rounding.

    Parameters
    ----------
    piece : (4, 6) of one satellite
    since_s : time of reception since the piece's beginning [s]
    motion : (4, 3) of the antenna, in the piece's axes
    e : (N_LANE_ROWS * LANES,) output, rows 0 to 16: S and three derivatives, range, k, clock [m] with rate and half of
        its derivative
    j : lane
    """
    t = since_s - USUAL_FLIGHT_S
    rho, along = 0.0, 0.0
    for turn in range(3):
        square, along = 0.0, 0.0
        for i in range(3):
            r, v, a, jerk = polynomial(piece[i], t)
            e[i * LANES + j], e[(3 + i) * LANES + j] = r, v
            e[(6 + i) * LANES + j], e[(9 + i) * LANES + j] = a, jerk
            d = r - motion[0, i]
            square += d * d
            along += d * v
        rho = math.sqrt(square)
        along /= rho
        if turn < 2:
            # |S(t) - R| = c (since - t): what is left over divided by its slope
            t += (C_MPS * (since_s - t) - rho) / (C_MPS + along)
    back = 0.0
    for i in range(3):
        back += (e[i * LANES + j] - motion[0, i]) / rho * motion[1, i]
    e[_RANGE0 * LANES + j] = rho
    e[_K0 * LANES + j] = 1.0 - (along - back) / (C_MPS + along)  # 1 - rho' / c
    c = piece[3]
    e[_CLOCK0 * LANES + j] = ((c[3] * t + c[2]) * t + c[1]) * t + c[0]
    e[_CLOCK1 * LANES + j] = (3.0 * c[3] * t + 2.0 * c[2]) * t + c[1]
    e[_CLOCK2 * LANES + j] = 3.0 * c[3] * t + c[2]


@kernel(inline=True)
def towards(e: Float64, j: int, motion: Float64, line: Float64) -> float:
    """Return the range at the expansion's time; write u and W = V_s - V in the piece's axes, (2, 3)."""
    rho: float = e[_RANGE0 * LANES + j]
    for i in range(3):
        line[0, i] = (e[i * LANES + j] - motion[0, i]) / rho
        line[1, i] = e[(3 + i) * LANES + j] - motion[1, i]
    return rho


@kernel
def observe_satellites(e: Float64, count: int, dt: float, motion: Float64) -> None:
    """Write range, its three derivatives and the satellite's clock of the first ``count`` lanes into rows 17 to 21.

    The satellite moves by its third-order series: a second from where it was expanded within 5e-10 m, 2e-9 m/s and
    6e-9 m/s^2. The time of transmission goes with k, and is mended once by the range that this gives: the line of sight
    is then that of a time wrong by as much as the antenna's acceleration makes, 1.6e-7 s for 100 m/s^2 and a second:
    4e-11 rad, 1.2e-7 m/s.
    All lanes are one array, so that the compiler sees that they do not overlap and computes several at once.

    Parameters
    ----------
    e : (N_LANE_ROWS * LANES,) as ``expand_satellite`` writes it, and output
    count : satellites, at most LANES
    dt : time of reception since the expansion's [s]
    motion : (4, 3) of the antenna, in the piece's axes
    """
    Rx, Ry, Rz = motion[0, 0], motion[0, 1], motion[0, 2]
    Vx, Vy, Vz = motion[1, 0], motion[1, 1], motion[1, 2]
    Ax, Ay, Az = motion[2, 0], motion[2, 1], motion[2, 2]
    Jx, Jy, Jz = motion[3, 0], motion[3, 1], motion[3, 2]
    # whole registers: the lanes beyond hold unused numbers
    for j in range(min((max(count, 0) + 7) // 8 * 8, LANES)):
        h = e[_K0 * LANES + j] * dt
        hh = 0.5 * h * h
        third = hh * h * (1.0 / 3.0)
        jx, jy, jz = e[9 * LANES + j], e[10 * LANES + j], e[11 * LANES + j]
        bx, by, bz = e[6 * LANES + j], e[7 * LANES + j], e[8 * LANES + j]
        wx, wy, wz = e[3 * LANES + j], e[4 * LANES + j], e[5 * LANES + j]
        dx = e[j] - Rx + h * wx + hh * bx + third * jx
        dy = e[LANES + j] - Ry + h * wy + hh * by + third * jy
        dz = e[2 * LANES + j] - Rz + h * wz + hh * bz + third * jz
        rho = math.sqrt(dx * dx + dy * dy + dz * dz)
        per_rho = 1.0 / rho
        ux, uy, uz = dx * per_rho, dy * per_rho, dz * per_rho
        sent = dt - (rho - e[_RANGE0 * LANES + j]) * _PER_C
        late = sent - h
        ax, ay, az = bx + h * jx, by + h * jy, bz + h * jz
        vx = wx + h * bx + hh * jx + late * ax
        vy = wy + h * by + hh * jy + late * ay
        vz = wz + h * bz + hh * jz + late * az
        along = ux * vx + uy * vy + uz * vz
        per_q = 1.0 / (1.0 + along * _PER_C)
        rate = (along - (ux * Vx + uy * Vy + uz * Vz)) * per_q
        k = 1.0 - rate * _PER_C
        # d' and the part of d'' that does not hold rho''
        ex, ey, ez = vx * k - Vx, vy * k - Vy, vz * k - Vz
        kk = k * k
        fx, fy, fz = ax * kk - Ax, ay * kk - Ay, az * kk - Az
        bend = (ex * ex + ey * ey + ez * ez - rate * rate) * per_rho
        acceleration = (ux * fx + uy * fy + uz * fz + bend) * per_q
        slowing = acceleration * _PER_C
        mixed = ex * (fx - vx * slowing) + ey * (fy - vy * slowing) + ez * (fz - vz * slowing)
        kkk, side = kk * k, 3.0 * k * slowing
        jerk = ux * (jx * kkk - side * ax - Jx) + uy * (jy * kkk - side * ay - Jy)
        jerk += uz * (jz * kkk - side * az - Jz) + 3.0 * (mixed - rate * acceleration) * per_rho
        e[RANGE * LANES + j] = rho + late * along
        e[RANGE_RATE * LANES + j] = rate
        e[RANGE_ACCELERATION * LANES + j] = acceleration
        e[RANGE_JERK * LANES + j] = jerk * per_q
        clock = e[_CLOCK0 * LANES + j] + sent * (e[_CLOCK1 * LANES + j] + sent * e[_CLOCK2 * LANES + j])
        e[SATELLITE_CLOCK * LANES + j] = clock


@kernel
def fill_values(vehicle: VehicleTrace, arcs: Arcs, spans: Spans, receiver_clock: float, out: Values) -> None:
    """Write the values of all satellites of each span at its times.

    They are expanded at the span's first time: a value depends on nothing that comes after it.

    Parameters
    ----------
    vehicle, arcs, spans : the antenna's motion, the satellites, and which are wanted when
    receiver_clock : 1.0 with the receiver's clock, 0.0 without
    out : as many entries as times and satellites say
    """
    work, e = np.zeros((20, 3)), np.zeros(N_LANE_ROWS * LANES)
    motion = work[0:4]
    row = 0
    for span in range(len(spans.first_time) - 1):
        first = spans.first_satellite[span]
        count = spans.first_satellite[span + 1] - first
        begin = spans.first_time[span]
        p, begin_s, _, _ = place_motion(vehicle, begin, arcs, work)
        for j in range(count):
            expand_satellite(arcs.pieces[spans.satellite[first + j], p], begin_s, motion, e, j)
        for i in range(spans.first_time[span], spans.first_time[span + 1]):
            _, since_s, _, _ = place_motion(vehicle, i, arcs, work)
            bias = receiver_clock * vehicle.trace.clock[i, 0]
            observe_satellites(e, count, since_s - begin_s, motion)
            for j in range(count):
                out.range_rate[row + j] = e[RANGE_RATE * LANES + j]
                out.acceleration[row + j] = e[RANGE_ACCELERATION * LANES + j]
                out.jerk[row + j] = e[RANGE_JERK * LANES + j]
                distance = e[RANGE * LANES + j] + spans.delay_m[first + j]
                out.pseudorange[row + j] = distance + bias - e[SATELLITE_CLOCK * LANES + j]
            row += count
        for j in range(count):
            spans.drift_mps[first + j] = e[_CLOCK1 * LANES + j]
