"""Orbits given as a state to be integrated: GLONASS, and the quadratic of SBAS; position, velocity, acceleration.

A GLONASS message gives position and velocity at its reference time and the Moon's and Sun's acceleration, taken as
constant. The equations of motion are integrated once for each message, to both sides, over the time it is valid, in
steps of 30 s: at 15 min that is within 0.05 mm and 1e-5 mm/s of steps of 1 s. Between every second step stands a
polynomial of fifth degree with the positions, velocities and accelerations of its ends, within 0.02 mm and 1e-4 mm/s of
the orbit, so a row of the log costs a polynomial.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import (
    GLONASS_A_M,
    GLONASS_J2,
    GLONASS_MU_M3PS2,
    GLONASS_OMEGA_RADPS,
    NS_PER_S,
)
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64, StateVectorTable

PIECE_S: Final = 60.0
_STEPS: Final = 2  # of each piece
_DEGREE: Final = 5


class StateVectorArcs(NamedTuple):
    """The orbits and clocks of all messages, as the compiled code takes them."""

    first: Int64  # (m,) each message's first piece
    n_pieces: Int64  # (m,)
    start_s: Float64  # (m,) where its first piece begins, counted from the reference time
    pieces: Float64  # (p, 6, 3) polynomial coefficients of the position [m] in the time since the piece's beginning
    clock: Float64  # (m, 3) offset [s], rate [s/s], group delay [s]


def state_vector_arcs(table: StateVectorTable, validity_ns: Int64) -> StateVectorArcs:
    """Return the integrated orbits of all messages, each as far to both sides as it is valid.

    Parameters
    ----------
    table : the messages as read
    validity_ns : (m,) largest distance from the reference time [ns]
    """
    reach = np.maximum(np.ceil(validity_ns / (PIECE_S * NS_PER_S)).astype(np.int64), 1)
    is_glonass = np.array([name[0] == "R" for name in table.sv_names], dtype=bool)
    count = np.where(is_glonass, 2 * reach, 1)
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    pieces = np.zeros((first[-1], _DEGREE + 1, 3))
    whole = int(reach[is_glonass].max(initial=0))
    integrated = _integrated(table, np.flatnonzero(is_glonass), whole)
    for place, m in enumerate(np.flatnonzero(is_glonass)):
        middle = slice(whole - reach[m], whole + reach[m])
        pieces[first[m] : first[m + 1]] = integrated[place, middle]
    alone = np.flatnonzero(~is_glonass)
    for power, values in enumerate((table.r_e, table.v_e, 0.5 * table.a_e)):
        pieces[first[alone], power] = values[alone]
    return StateVectorArcs(
        first=first[:-1],
        n_pieces=count.astype(np.int64),
        start_s=np.where(is_glonass, -PIECE_S * reach, 0.0),
        pieces=pieces,
        clock=np.column_stack([table.clock_s, table.clock_rate, np.nan_to_num(table.group_delay_s, nan=0.0)]),
    )


def equations_of_motion(r_e: Float64, v_e: Float64, a_e: Float64) -> Float64:
    """Return the acceleration in the rotating Earth-fixed frame [m/s^2].

    Equation: a = -mu r / r^3 - 3/2 J2 mu A^2 / r^5 (x (1 - 5 z^2/r^2), y (1 - 5 z^2/r^2), z (3 - 5 z^2/r^2))
    + (omega^2 x + 2 omega v_y, omega^2 y - 2 omega v_x, 0) + a_e    [GLONASS ICD 5.1, A.3.1.2]
    Neglects: higher harmonics and the change of the Moon's and Sun's part, 1 m in 15 min.

    Parameters
    ----------
    r_e, v_e : (n, 3) position [m] and velocity [m/s]
    a_e : (n, 3) acceleration by Moon and Sun [m/s^2]
    """
    x, y, z = r_e.T
    square = x * x + y * y + z * z
    central = -GLONASS_MU_M3PS2 / (square * np.sqrt(square))
    oblate = 1.5 * GLONASS_J2 * GLONASS_A_M * GLONASS_A_M / square
    height = 5.0 * z * z / square
    level, upright = central * (1.0 + oblate * (1.0 - height)), central * (1.0 + oblate * (3.0 - height))
    omega = GLONASS_OMEGA_RADPS
    return np.column_stack(
        [
            level * x + omega * omega * x + 2.0 * omega * v_e[:, 1] + a_e[:, 0],
            level * y + omega * omega * y - 2.0 * omega * v_e[:, 0] + a_e[:, 1],
            upright * z + a_e[:, 2],
        ]
    )


def runge_kutta_step(r_e: Float64, v_e: Float64, a_e: Float64, step_s: float) -> tuple[Float64, Float64]:
    """Return position and velocity one step later, by the classical method of fourth order.

    Parameters
    ----------
    r_e, v_e, a_e : as for ``equations_of_motion``
    step_s : the step, negative for the past [s]
    """
    half = 0.5 * step_s
    k1 = equations_of_motion(r_e, v_e, a_e)
    v2 = v_e + half * k1
    k2 = equations_of_motion(r_e + half * v_e, v2, a_e)
    v3 = v_e + half * k2
    k3 = equations_of_motion(r_e + half * v2, v3, a_e)
    v4 = v_e + step_s * k3
    k4 = equations_of_motion(r_e + step_s * v3, v4, a_e)
    sixth = step_s / 6.0
    return (
        r_e + sixth * (v_e + 2.0 * v2 + 2.0 * v3 + v4),
        v_e + sixth * (k1 + 2.0 * k2 + 2.0 * k3 + k4),
    )


def _integrated(table: StateVectorTable, rows: npt.NDArray[np.intp], reach: int) -> Float64:
    """Return the polynomials of the given messages, (rows, 2 reach, 6, 3), from the past to the future."""
    a_e = table.a_e[rows]
    nodes: dict[int, tuple[Float64, Float64]] = {0: (table.r_e[rows], table.v_e[rows])}
    for sign in (-1, 1):
        for k in range(reach):
            r_e, v_e = nodes[sign * k]
            for _ in range(_STEPS):
                r_e, v_e = runge_kutta_step(r_e, v_e, a_e, sign * PIECE_S / _STEPS)
            nodes[sign * (k + 1)] = (r_e, v_e)
    pieces = np.zeros((len(rows), 2 * reach, _DEGREE + 1, 3))
    for k in range(-reach, reach):
        (r0, v0), (r1, v1) = nodes[k], nodes[k + 1]
        a0, a1 = equations_of_motion(r0, v0, a_e), equations_of_motion(r1, v1, a_e)
        pieces[:, k + reach] = _between(r0, v0, a0, r1, v1, a1)
    return pieces


def _between(r0: Float64, v0: Float64, a0: Float64, r1: Float64, v1: Float64, a1: Float64) -> Float64:
    """Return the polynomial of fifth degree with the given ends, one step apart, (n, 6, 3)."""
    T = PIECE_S
    # the remainder of the end's position, velocity and acceleration after the second-order part of the beginning
    r = (r1 - r0 - T * (v0 + 0.5 * T * a0)) / T**3
    v = (v1 - v0 - T * a0) / T**2
    a = (a1 - a0) / T
    c3 = 10.0 * r - 4.0 * v + 0.5 * a
    c4 = (-15.0 * r + 7.0 * v - a) / T
    c5 = (6.0 * r - 3.0 * v + 0.5 * a) / T**2
    return np.stack([r0, v0, 0.5 * a0, c3, c4, c5], axis=1)


@kernel(inline=True)
def arc_state(arcs: StateVectorArcs, m: int, t: float, out: Float64, j: int) -> None:
    """Write position [m], velocity [m/s] and acceleration [m/s^2] in ECEF of message ``m`` into ``out[j, 0:9]``.

    Parameters
    ----------
    arcs : the messages
    m : the message
    t : time since its reference time [s]
    out : (n, >= 9) output
    j : row of ``out``
    """
    since = t - arcs.start_s[m]
    piece = 0  # also for a time that is not a number
    if since > 0.0:
        last = arcs.n_pieces[m] - 1
        piece = int(since / PIECE_S) if since < PIECE_S * last else last
    s = since - PIECE_S * piece
    k = arcs.first[m] + piece
    for axis in range(3):
        r, v, half_a = 0.0, 0.0, 0.0
        for power in range(_DEGREE, -1, -1):
            half_a = half_a * s + v
            v = v * s + r
            r = r * s + arcs.pieces[k, power, axis]
        out[j, axis], out[j, 3 + axis], out[j, 6 + axis] = r, v, 2.0 * half_a
