"""Time-differenced carrier phase: how far the antenna has come since the epoch before, to millimetres, compiled.

The carrier's ambiguity is the same in both epochs and falls out of the difference
    phi_k - phi_k-1 = [rho + clock - satellite clock + troposphere - ionosphere]_k - [the same]_k-1 + noise,
which depends on the antenna's position and clock now and then. Then is a part of the filter's state: after each epoch
antenna position and clock are cloned, with their correlations to all that they were made of, and the clone's error is
constant until the next epoch (stochastic cloning) [Roumeliotis & Burdick 2002]. So the difference is weighed exactly
against what the filter knows of both ends, and corrects both.

Neglects: two differences that follow each other share the phase noise of the epoch between them, correlation -1/2;
taken as independent, the sum over many epochs is believed less than it deserves.
"""

from __future__ import annotations

from insgnss.apart import apart
from insgnss.fusion.lines import N_RANGE, Antenna, Epoch, Line
from insgnss.fusion.parameters import Parameters
from insgnss.fusion.state import CLOCK, DR, N_CLONE, PSI, StateRecord
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.gnss.observation_rows import CARRIER, Rows
from insgnss.gnss.range_model import Air
from insgnss.jit import inlined
from insgnss.tables import Float64


@inlined
def carrier_row(m: StateRecord, rows: Rows, i: int, distance: float, s: Epoch, line: Line) -> float:
    """Write the row of H of a carrier difference; return its prediction without the air's part, ``carrier_delay`` [m].

    Position now -u, attitude now u x l_e, clock now 1; position then u', clock then -1.

    Parameters
    ----------
    distance : geometric range of now [m]
    """
    a = s.antenna[0]
    u, then, l_e = a.u, a.u_before, a.l_e
    before = line_of_sight_range(rows.before, i, m.r_clone, then)
    h = line.h[CARRIER]
    h[0], h[1], h[2] = -u[0], -u[1], -u[2]
    h[3] = u[1] * l_e[2] - u[2] * l_e[1]
    h[4] = u[2] * l_e[0] - u[0] * l_e[2]
    h[5] = u[0] * l_e[1] - u[1] * l_e[0]
    h[6] = 1.0
    for k in range(3):
        h[N_RANGE + k] = then[k]
    h[N_RANGE + 3] = -1.0
    clocks = m.clock[0] - m.clock_clone - (rows.sat[i, 6] - rows.before[i, 6])
    return float(distance - before + clocks)


@apart
def clone_epoch(m: StateRecord, P: Float64, par: Parameters, a: Antenna, air: Air, t_ns: int) -> None:
    """Make the epoch just processed the one that the next carrier differences count from.

    Equation: d r_a = d r_e + psi x l_e, so the clone is J dx with J = [I, -[l_e x]] in (position, attitude) and 1 in
    the clock; P_cx = J P, P_cc = J P J^T.

    Parameters
    ----------
    m : the state after the update, with its antenna in ``a``
    air : of the epoch; its zenith delays are kept
    t_ns : the epoch's time tag
    """
    n, c = P.shape[0], par.at_clone
    m.clone_ns = t_ns
    m.clock_clone = m.clock[0]
    m.air_clone[0], m.air_clone[1] = air.dry, air.wet
    l_e = a.l_e
    for i in range(3):
        m.r_clone[i] = a.r_a[i]
    for j in range(n - N_CLONE):
        for i in range(3):
            # (psi x l)_i = psi_p l_q - psi_q l_p with i, p, q cyclic
            p, q = (i + 1) % 3, (i + 2) % 3
            P[j, c + i] = P[DR + i, j] + P[PSI + p, j] * l_e[q] - P[PSI + q, j] * l_e[p]
            P[c + i, j] = P[j, c + i]
        P[j, c + 3] = P[CLOCK, j]
        P[c + 3, j] = P[CLOCK, j]
    for i in range(N_CLONE):
        for k in range(3):
            p, q = (k + 1) % 3, (k + 2) % 3
            P[c + i, c + k] = P[c + i, DR + k] + P[c + i, PSI + p] * l_e[q] - P[c + i, PSI + q] * l_e[p]
        P[c + i, c + 3] = P[c + i, CLOCK]
    for i in range(N_CLONE):
        for k in range(i):
            P[c + i, c + k] = P[c + k, c + i]
