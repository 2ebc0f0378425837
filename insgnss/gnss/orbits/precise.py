"""Satellite states from orbits and clocks computed afterwards (SP3, RINEX clock), in place of the broadcast ones.

Orbit: a polynomial of degree 10 through the 11 nodes around the time, in the inertial axes that coincide with ECEF at a
reference time, so that the Earth's turn (15 deg an hour) is not in it. Nodes 15 min apart: within 0.1 mm of the orbit
where the nodes lie on both sides, 2 mm in the first and last interval of a file; the nodes themselves are good to 2 cm.
Clock: linear between neighbouring nodes (0.1 ns at 30 s, 1 ns at 15 min for older clocks). Nothing is
extrapolated and no gap above 22.5 min is bridged: such rows have the status STALE_EPHEMERIS, satellites without any
product NO_EPHEMERIS.

The clocks hold for an ionosphere-free pair of codes (``CLOCK_PAIRS``), without the periodic relativity -2 r.v / c^2,
which is added here. A single signal needs its group delay against that pair, which the products do not have: it is
taken from the broadcast message when there is one (``message`` says which) and is zero elsewhere: up to 8 m
off. The broadcast delays refer to another combination (signals.py), so the pair's own is subtracted:
d(signal) - [g1 d(1) - g2 d(2)], g1 = f1^2 / (f1^2 - f2^2), g2 = g1 - 1.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.geodesy.rotations import omega_cross
from insgnss.gnss.orbits.ephemeris_choice import BroadcastMessages
from insgnss.gnss.orbits.satellite_state import (
    SatelliteStates,
    flight_times,
    leave_out_impossible,
    no_states,
    satellite_states,
)
from insgnss.gnss.phase_centre import SatelliteAntennas, phase_centre_offsets
from insgnss.gnss.signals import signal_of
from insgnss.status import STALE_EPHEMERIS, UNKNOWN_SIGNAL, USED
from insgnss.tables import Bool, EphemerisTable, Float64, GnssTable, Int64, PreciseProducts

N_NODES: Final = 11
# one and a half of the usual 15 min: a node missing there ends an arc
WIDEST_STEP_NS: Final = 1350 * NS_PER_S
# The codes of the pair whose ionosphere-free combination the analysis centres' clocks refer to (IGS; MGEX for the rest)
CLOCK_PAIRS: Final = {
    "G": ("C1W", "C2W"),
    "R": ("C1P", "C2P"),
    "E": ("C1C", "C5Q"),
    "C": ("C2I", "C6I"),
    "J": ("C1C", "C2L"),
    "I": ("C5A", "C9A"),
}
# a group delay is looked up once in this time: messages change once an hour
_DELAY_PERIOD_NS: Final = 900 * NS_PER_S

Rows = npt.NDArray[np.intp]


class _Orbit(NamedTuple):
    """A satellite's usable nodes and where unbroken arcs of them begin."""

    t_ns: Int64  # (k,)
    r_i: Float64  # (k, 3) inertial axes, those of ECEF at ``reference_ns`` [m]
    arc: Int64  # (k,) number of the arc


def precise_states(
    gnss: GnssTable,
    products: PreciseProducts,
    nav: EphemerisTable | BroadcastMessages | None = None,
    *,
    antennas: SatelliteAntennas | None = None,
) -> SatelliteStates:
    """Return the satellite state of every row of a log by precise products, at the time of transmission.

    ``age_s`` is the distance to the nearest orbit node, ``message`` the broadcast message that gave the group delay.

    Parameters
    ----------
    gnss : the log
    products : orbits and clocks
    nav : broadcast messages for the group delays
    antennas : phase-centre offsets; none: the products' positions are taken for those of the antennas
    """
    n = len(gnss.t_ns)
    states = no_states(n)
    tau = np.empty(n)
    t_ns = np.require(gnss.t_ns, np.int64, ("C", "W"))
    flight_times(t_ns, np.require(gnss.pseudorange_m, np.float64, ("C", "W")), tau)
    sent_ns = t_ns - np.rint(tau * NS_PER_S).astype(np.int64)
    place = {name: i for i, name in enumerate(products.sv_names)}
    for s, name in enumerate(gnss.sv_names):
        rows = np.flatnonzero(gnss.sv == s)
        if name in place and len(rows):
            _fill(states, rows, sent_ns[rows], products, place[name], antennas)
    known = np.array(
        [[signal_of(sv[0], code) is not None for code in gnss.signal_names] for sv in gnss.sv_names]
    )
    if n and nav is not None:
        delay, states.message[:] = pair_delays(gnss, nav)
        states.clock_m[:] -= delay
    leave_out_impossible(states)
    if n:
        states.status[~known[gnss.sv, gnss.signal]] = UNKNOWN_SIGNAL
    return states


def _fill(
    states: SatelliteStates,
    rows: Rows,
    sent_ns: Int64,
    products: PreciseProducts,
    satellite: int,
    antennas: SatelliteAntennas | None,
) -> None:
    """Write the states of one satellite's rows; ``sent_ns`` is the time of transmission by the satellite's clock."""
    states.status[rows] = STALE_EPHEMERIS
    clock_s, rate = clock_between(products, satellite, sent_ns)
    t_ns = sent_ns - np.rint(np.nan_to_num(clock_s) * NS_PER_S).astype(np.int64)
    sat, age_s = orbit_between(products, satellite, t_ns)
    good = np.isfinite(sat[:, 0]) & np.isfinite(clock_s)
    sat, rows = sat[good], rows[good]
    r_e, v_e, a_e = sat[:, 0:3], sat[:, 3:6], sat[:, 6:9]
    # -2 r.v / c^2 and its derivative; r.v is the same in inertial and in rotating axes
    relativity_m = -2.0 / C_MPS * np.sum(r_e * v_e, axis=1)
    relativity_mps = -2.0 / C_MPS * np.sum(v_e * v_e + r_e * a_e, axis=1)
    states.clock_m[rows] = C_MPS * clock_s[good] + relativity_m
    states.drift_mps[rows] = C_MPS * rate[good] + relativity_mps
    if antennas is not None:
        r_e += phase_centre_offsets(antennas, products.sv_names[satellite], t_ns[good], r_e)
    states.sat[rows] = sat
    states.age_s[rows] = age_s[good]
    states.status[rows] = USED


def clock_between(products: PreciseProducts, satellite: int, t_ns: Int64) -> tuple[Float64, Float64]:
    """Return clock [s] and rate [-] of a satellite (its number in the products) at (n,) times, NaN across gaps.

    Equation: linear between the satellite's own neighbouring nodes.
    """
    good = np.isfinite(products.clock_s[satellite])
    node_ns, clock_s = products.clock_ns[good], products.clock_s[satellite][good]
    clock, rate = np.full(len(t_ns), math.nan), np.full(len(t_ns), math.nan)
    if len(node_ns) < 2:
        return clock, rate
    k = np.clip(np.searchsorted(node_ns, t_ns, side="right") - 1, 0, len(node_ns) - 2)
    step_ns = node_ns[k + 1] - node_ns[k]
    within = (t_ns >= node_ns[0]) & (t_ns <= node_ns[-1]) & (step_ns <= WIDEST_STEP_NS)
    slope = (clock_s[k + 1] - clock_s[k]) / (step_ns / NS_PER_S)
    value = clock_s[k] + slope * ((t_ns - node_ns[k]) / NS_PER_S)
    return np.where(within, value, math.nan), np.where(within, slope, math.nan)


def orbit_between(products: PreciseProducts, satellite: int, t_ns: Int64) -> tuple[Float64, Float64]:
    """Return position, velocity, acceleration (n, 9) in ECEF and the distance to the nearest node [s]; NaN in gaps.

    Equation: r_e = R3(omega t) sum c_k u^k, the polynomial of degree 10 through 11 nodes in inertial axes;
    v_e = v_i - omega x r_e, a_e = a_i - 2 omega x v_e - omega x (omega x r_e)

    Parameters
    ----------
    products : orbits
    satellite : its number in them
    t_ns : (n,) GPS time
    """
    sat, age_s = np.full((len(t_ns), 9), math.nan), np.full(len(t_ns), math.nan)
    reference_ns = int(products.orbit_ns[0]) if len(products.orbit_ns) else 0
    orbit = _nodes(products, satellite, reference_ns)
    start, within = _windows(orbit, t_ns)
    for first in np.unique(start[within]):
        rows = np.flatnonzero(within & (start == first))
        window = slice(first, first + N_NODES)
        node_ns = orbit.t_ns[window]
        sat[rows] = _interpolated(node_ns, orbit.r_i[window], t_ns[rows], reference_ns)
        age_s[rows] = np.min(np.abs(t_ns[rows, None] - node_ns), axis=1) / NS_PER_S
    return sat, age_s


def _nodes(products: PreciseProducts, satellite: int, reference_ns: int) -> _Orbit:
    """Return a satellite's nodes in inertial axes, parted into arcs where a step is too wide."""
    good = np.isfinite(products.r_e[satellite]).all(axis=1)
    t_ns = products.orbit_ns[good]
    angle = WGS84_OMEGA_RADPS * ((t_ns - reference_ns) / NS_PER_S)
    arc = np.concatenate([[0], np.cumsum(np.diff(t_ns) > WIDEST_STEP_NS)]) if len(t_ns) else np.zeros(0)
    return _Orbit(t_ns, _turned(products.r_e[satellite][good], angle), arc.astype(np.int64))


def _windows(orbit: _Orbit, t_ns: Int64) -> tuple[Int64, Bool]:
    """Return the first node of each time's window, and whether there is one: within an arc that is long enough."""
    if len(orbit.t_ns) < N_NODES:
        return np.zeros(len(t_ns), np.int64), np.zeros(len(t_ns), np.bool_)
    last = len(orbit.t_ns) - 1
    before = np.clip(np.searchsorted(orbit.t_ns, t_ns, side="right") - 1, 0, last)
    # at the last node of an arc the interval behind it counts
    after = np.minimum(before + (t_ns > orbit.t_ns[before]), last)
    inside = (t_ns >= orbit.t_ns[0]) & (t_ns <= orbit.t_ns[-1]) & (orbit.arc[before] == orbit.arc[after])
    first_of = np.searchsorted(orbit.arc, orbit.arc[before], side="left")
    end_of = np.searchsorted(orbit.arc, orbit.arc[before], side="right")
    # the window is centred on the nearer of the two nodes, as far as the arc's ends allow
    nearer = np.where(t_ns - orbit.t_ns[before] <= orbit.t_ns[after] - t_ns, before, after)
    start = np.clip(nearer - N_NODES // 2, first_of, np.maximum(end_of - N_NODES, first_of))
    return start.astype(np.int64), inside & (end_of - first_of >= N_NODES)


def _interpolated(node_ns: Int64, r_i: Float64, t_ns: Int64, reference_ns: int) -> Float64:
    """Return position, velocity, acceleration (n, 9) in ECEF by the polynomial through one window's nodes."""
    middle_ns = int(node_ns[N_NODES // 2])
    half_s = max(node_ns[-1] - middle_ns, middle_ns - node_ns[0]) / NS_PER_S
    # u within +-1 keeps the system of the powers well conditioned: 1e-9 of rounding, 1e-7 m
    u = (t_ns - middle_ns) / NS_PER_S / half_s
    coefficients = np.linalg.solve(np.vander((node_ns - middle_ns) / NS_PER_S / half_s, increasing=True), r_i)
    order = np.arange(N_NODES)
    powers = np.vander(u, N_NODES, increasing=True)
    position = powers @ coefficients
    velocity = powers[:, :-1] @ (order[1:, None] * coefficients[1:]) / half_s
    second = (order[2:] * (order[2:] - 1))[:, None]
    acceleration = powers[:, :-2] @ (second * coefficients[2:]) / half_s**2
    angle = -WGS84_OMEGA_RADPS * ((t_ns - reference_ns) / NS_PER_S)
    r_e, v, a = _turned(position, angle), _turned(velocity, angle), _turned(acceleration, angle)
    v_e = v - omega_cross(r_e)
    a_e = a - 2.0 * omega_cross(v_e) - omega_cross(omega_cross(r_e))
    return np.hstack([r_e, v_e, a_e])


def _turned(vectors: Float64, angle: Float64) -> Float64:
    """Return vectors (n, 3) turned about z by the angles (n,)."""
    sine, cosine = np.sin(angle), np.cos(angle)
    x, y, z = vectors.T
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y, z])


def pair_delays(gnss: GnssTable, nav: EphemerisTable | BroadcastMessages) -> tuple[Float64, Int64]:
    """Return each row's group delay [m] against the pair of ``CLOCK_PAIRS``, and its message (-1: none, 0 m).

    The delay of a signal is the broadcast clock without it less the broadcast clock with it, so every rule of
    ``satellite_state`` holds here too. It is looked up once in a quarter of an hour.
    """
    few, of_row = _one_in_each_period(gnss)
    names = gnss.sv_names
    own = satellite_states(few, nav)
    without = satellite_states(replace(few, signal_names=("",) * len(gnss.signal_names)), nav).clock_m
    delay = without - own.clock_m
    for system, (first, second) in CLOCK_PAIRS.items():
        rows = np.array([name[0] == system for name in names], np.bool_)[few.sv]
        one, two = signal_of(system, first), signal_of(system, second)
        if one is None or two is None or not rows.any():
            continue
        g1 = one.carrier_hz**2 / (one.carrier_hz**2 - two.carrier_hz**2)
        pair = [
            without
            - satellite_states(replace(few, signal_names=(code,) * len(gnss.signal_names)), nav).clock_m
            for code in (first, second)
        ]
        delay[rows] -= (g1 * pair[0] - (g1 - 1.0) * pair[1])[rows]
    message = np.where(np.isfinite(delay), own.message, -1)
    return np.nan_to_num(delay)[of_row], message[of_row]


def _one_in_each_period(gnss: GnssTable) -> tuple[GnssTable, Rows]:
    """Return one row of each satellite and signal in each period, and for every row of the log its place there."""
    signals = max(len(gnss.signal_names), 1)
    pair = gnss.sv.astype(np.int64) * signals + gnss.signal
    key = (gnss.t_ns // _DELAY_PERIOD_NS) * (signals * max(len(gnss.sv_names), 1)) + pair
    _, first, of_row = np.unique(key, return_index=True, return_inverse=True)
    few = gnss.take(np.asarray(first, dtype=np.intp))
    # the pseudorange moves the time of transmission by 0.1 s only, which does not change the message
    return replace(few, pseudorange_m=np.full(len(first), math.nan), sat=None), of_row
