"""Where every satellite is, at any instant: polynomial pieces built beforehand from messages or precise products.

A piece is 120 s long. Its position is the polynomial of fifth degree with the position, velocity and acceleration of
the orbit at both ends, in the inertial axes that are those of ECEF at the piece's beginning: a satellite there moves
with 4 km/s on a circle and no term of the Earth's turn is needed after. Against the orbit itself the pieces are within
1e-6 m, 1e-8 m/s and 1e-9 m/s^2 for nearly circular orbits from medium height on (20 times that at the perigee of
e = 0.17); most of the position's is the orbit's own rounding. The clock is the cubic with offset and rate at both ends,
within 1e-8 m. Each piece is of one message, the one chosen for its middle: a change of message is at a piece's
border, up to a minute from where ``satellite_state`` changes, and the values step there by what the messages differ
(some 0.1 m, 0.1 mm/s).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.geodesy.rotations import omega_cross
from insgnss.gnss.orbits.broadcast import eccentric_anomaly, orbit_state
from insgnss.gnss.orbits.ephemeris_choice import BroadcastMessages, MessageIndex, choose_message
from insgnss.gnss.orbits.ephemeris_rows import M0, E, N
from insgnss.gnss.orbits.glonass import arc_state
from insgnss.gnss.orbits.plausible_messages import is_satellite
from insgnss.gnss.orbits.precise import clock_between, orbit_between
from insgnss.gnss.orbits.satellite_clock import group_delay, satellite_clock
from insgnss.gnss.orbits.satellite_state import USUAL_FLIGHT_S
from insgnss.gnss.signals import signal_of
from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64, PreciseProducts

PIECE_NS: Final = 120 * NS_PER_S
PIECE_S: Final = PIECE_NS / NS_PER_S
N_POWERS: Final = 6
_N_NODE: Final = 11  # position, velocity, acceleration, clock, drift


class Arcs(NamedTuple):
    """The pieces of all satellites, as the compiled code takes them."""

    start_ns: int  # GPS time at which the first pieces begin
    # (s, p, 4, 6) coefficients of x, y, z, clock [m] in the seconds since the piece's beginning; NaN without a state
    pieces: Float64


@dataclass(frozen=True)
class SatelliteArcs:
    """Satellites, and their pieces over a span of time."""

    sv_names: tuple[str, ...]
    arcs: Arcs

    @property
    def end_ns(self) -> int:
        """GPS time at which the last pieces end."""
        return self.arcs.start_ns + PIECE_NS * int(self.arcs.pieces.shape[1])

    def covers(self, first_ns: int, last_ns: int) -> bool:
        """Return whether every instant of the span lies in a piece."""
        return self.arcs.start_ns <= first_ns and last_ns < self.end_ns

    def joined(self, later: SatelliteArcs) -> SatelliteArcs:
        """Return these pieces and those of ``later``, which begin where these end."""
        pieces = np.concatenate([self.arcs.pieces, later.arcs.pieces], axis=1)
        return SatelliteArcs(self.sv_names, Arcs(self.arcs.start_ns, pieces))

    def since(self, t_ns: int) -> SatelliteArcs:
        """Return the pieces from the one that holds ``t_ns`` on, so that a live run does not keep its past."""
        gone = min(max((t_ns - self.arcs.start_ns) // PIECE_NS, 0), self.arcs.pieces.shape[1])
        pieces = np.ascontiguousarray(self.arcs.pieces[:, gone:])
        return SatelliteArcs(self.sv_names, Arcs(self.arcs.start_ns + PIECE_NS * gone, pieces))


def broadcast_arcs(
    messages: BroadcastMessages, signals: dict[str, str], first_ns: int, last_ns: int
) -> SatelliteArcs:
    """Return the pieces of every satellite that the messages know and whose constellation has a signal.

    Parameters
    ----------
    messages : as sorted for ``satellite_states``
    signals : RINEX code of each constellation ("G": "C1C"): whose group delay the clock holds
    first_ns, last_ns : the span of reception, GPS time
    """
    names = tuple(name for name in messages.satellites if _served(name, signals))
    number = {name: i for i, name in enumerate(messages.satellites)}
    satellite = np.array([number[name] for name in names], np.int64)
    start_ns, count = _grid(first_ns, last_ns)
    begin_ns = start_ns + PIECE_NS * np.arange(count, dtype=np.int64)
    nodes = np.full((len(names), count, 2, _N_NODE), math.nan)
    message_nodes(messages.index, satellite, begin_ns, delay_factors(names, signals), nodes)
    rows = nodes.reshape(-1, _N_NODE)
    rows[~is_satellite(rows, rows[:, 9], rows[:, 10])] = math.nan
    return SatelliteArcs(names, Arcs(start_ns, hermite_pieces(nodes)))


def precise_arcs(
    products: PreciseProducts, signals: dict[str, str], first_ns: int, last_ns: int
) -> SatelliteArcs:
    """Return the pieces by precise products, for their pairs of codes: no group delay (up to 8 m of pseudorange)."""
    names = tuple(name for name in products.sv_names if _served(name, signals))
    start_ns, count = _grid(first_ns, last_ns)
    node_ns = start_ns + PIECE_NS * np.arange(count + 1, dtype=np.int64)
    nodes = np.full((len(names), count, 2, _N_NODE), math.nan)
    for s, name in enumerate(names):
        place = products.sv_names.index(name)
        sat, _ = orbit_between(products, place, node_ns)
        clock_s, rate = clock_between(products, place, node_ns)
        # -2 r.v / c^2 and its derivative
        r_e, v_e, a_e = sat[:, 0:3], sat[:, 3:6], sat[:, 6:9]
        clock = C_MPS * clock_s - 2.0 / C_MPS * np.sum(r_e * v_e, axis=1)
        drift = C_MPS * rate - 2.0 / C_MPS * np.sum(v_e * v_e + r_e * a_e, axis=1)
        whole = np.column_stack([sat, clock, drift])
        nodes[s, :, 0], nodes[s, :, 1] = whole[:-1], whole[1:]
    return SatelliteArcs(names, Arcs(start_ns, hermite_pieces(nodes)))


def _served(name: str, signals: dict[str, str]) -> bool:
    """Return whether the satellite's constellation has a signal that is known."""
    return name[0] in signals and signal_of(name[0], signals[name[0]]) is not None


def _grid(first_ns: int, last_ns: int) -> tuple[int, int]:
    """Return the beginning and the number of the pieces that hold a span; all spans share one grid."""
    start = int(first_ns) // PIECE_NS
    return start * PIECE_NS, int(last_ns) // PIECE_NS - start + 1


def delay_factors(names: tuple[str, ...], signals: dict[str, str]) -> Float64:
    """Return (s, 2, 2) factors of the messages' group delays for each satellite's signal: I/NAV (all), F/NAV."""
    factors = np.zeros((len(names), 2, 2))
    for s, name in enumerate(names):
        signal = signal_of(name[0], signals[name[0]])
        if signal is not None:
            factors[s, 0] = signal.group_delay
            factors[s, 1] = signal.group_delay_fnav or signal.group_delay
    return factors


@kernel
def message_nodes(
    index: MessageIndex, satellite: Int64, begin_ns: Int64, factors: Float64, nodes: Float64
) -> None:
    """Write state, clock [m] and drift [m/s] at both ends of each satellite's pieces; NaN stays without a message.

    Parameters
    ----------
    index : the messages
    satellite : (s,) number of each satellite in the index
    begin_ns : (p,) GPS time at which the pieces begin
    factors : (s, 2, 2) as ``delay_factors``
    nodes : (s, p, 2, 11) output, ECEF of the instant: position, velocity, acceleration, clock, drift
    """
    place = index.first.copy()
    state = np.zeros((1, 9))
    for s in range(len(satellite)):
        for p in range(len(begin_ns)):
            k, _ = choose_message(begin_ns[p] + PIECE_NS // 2, satellite[s], index, place)
            if k < 0:
                continue
            factor = factors[s, index.is_fnav[k]]
            for end in range(2):
                t = (begin_ns[p] + end * PIECE_NS - index.toe_ns[k]) / NS_PER_S
                if k < len(index.rows):
                    mean = index.rows[k, M0] + index.rows[k, N] * t
                    _, sin_E, cos_E = eccentric_anomaly(mean, index.rows[k, E], mean)
                    orbit_state(index.rows, k, t, sin_E, cos_E, state, 0)
                    clock, drift = satellite_clock(index.rows, k, t, sin_E, cos_E)
                    clock -= group_delay(index.rows, k, factor[0], factor[1])
                else:
                    m = k - len(index.rows)
                    arc_state(index.arcs, m, t, state, 0)
                    drift = C_MPS * index.arcs.clock[m, 1]
                    clock = C_MPS * (index.arcs.clock[m, 0] - factor[0] * index.arcs.clock[m, 2]) + drift * t
                for i in range(9):
                    nodes[s, p, end, i] = state[0, i]
                nodes[s, p, end, 9], nodes[s, p, end, 10] = clock, drift


def hermite_pieces(nodes: Float64) -> Float64:
    """Return the polynomials (s, p, 4, 6) with the given ends (s, p, 2, 11), in the pieces' inertial axes."""
    T = PIECE_S
    r0, v0, a0 = _inertial(nodes[:, :, 0], 0.0)
    r1, v1, a1 = _inertial(nodes[:, :, 1], T)
    # the remainder at the end after the second-order part of the beginning
    r = (r1 - r0 - T * (v0 + 0.5 * T * a0)) / T**3
    v = (v1 - v0 - T * a0) / T**2
    a = (a1 - a0) / T
    pieces = np.zeros((*nodes.shape[:2], 4, N_POWERS))
    pieces[:, :, :3, 0], pieces[:, :, :3, 1], pieces[:, :, :3, 2] = r0, v0, 0.5 * a0
    pieces[:, :, :3, 3] = 10.0 * r - 4.0 * v + 0.5 * a
    pieces[:, :, :3, 4] = (-15.0 * r + 7.0 * v - a) / T
    pieces[:, :, :3, 5] = (6.0 * r - 3.0 * v + 0.5 * a) / T**2
    c0, d0, c1, d1 = (nodes[:, :, end, column] for end in (0, 1) for column in (9, 10))
    left = (c1 - c0 - T * d0) / T**2
    bend = (d1 - d0) / T
    pieces[:, :, 3, 0], pieces[:, :, 3, 1] = c0, d0
    pieces[:, :, 3, 2], pieces[:, :, 3, 3] = 3.0 * left - bend, (bend - 2.0 * left) / T
    return pieces


def _inertial(node: Float64, since_s: float) -> tuple[Float64, Float64, Float64]:
    """Return position and its inertial derivatives (s, p, 3), axes those of ECEF ``since_s`` before.

    Equation: V = v + omega x r, A = a + 2 omega x v + omega x (omega x r), turned by R3(-omega t)
    """
    r, v, a = node[..., 0:3], node[..., 3:6], node[..., 6:9]
    V = v + omega_cross(r)
    A = a + 2.0 * omega_cross(v) + omega_cross(omega_cross(r))
    # written out: a product of matrices would round differently with the number of pieces made at once
    angle = WGS84_OMEGA_RADPS * since_s
    sine, cosine = math.sin(angle), math.cos(angle)
    r, V, A = (
        np.stack(
            [cosine * x[..., 0] - sine * x[..., 1], sine * x[..., 0] + cosine * x[..., 1], x[..., 2]], axis=-1
        )
        for x in (r, V, A)
    )
    return r, V, A


def earth_turn_matrix(since_s: npt.ArrayLike) -> Float64:
    """Return (..., 3, 3) the matrix from ECEF to the axes that were ECEF's ``since_s`` before."""
    angle = WGS84_OMEGA_RADPS * np.asarray(since_s, np.float64)
    sine, cosine = np.sin(angle), np.cos(angle)
    turn = np.zeros((*angle.shape, 3, 3))
    turn[..., 0, 0], turn[..., 0, 1] = cosine, -sine
    turn[..., 1, 0], turn[..., 1, 1] = sine, cosine
    turn[..., 2, 2] = 1.0
    return turn


def elevations(arcs: Arcs, t_ns: Int64, r_e: Float64, up_e: Float64) -> Float64:
    """Return the sine of the elevation (n, s) of every satellite at ``n`` times; NaN without a state.

    The light time is taken as 75 ms: within 1e-5 rad.

    Parameters
    ----------
    t_ns : (n,) GPS time, covered by the pieces
    r_e : (n, 3) antenna position, ECEF [m]
    up_e : (n, 3) unit vector up, ECEF
    """
    piece, part = np.divmod(t_ns - arcs.start_ns, PIECE_NS)
    sine = np.full((len(t_ns), arcs.pieces.shape[0]), math.nan)
    for p in np.unique(piece):
        rows = np.flatnonzero(piece == p)
        since_s = part[rows] / NS_PER_S
        powers = np.vander(since_s - USUAL_FLIGHT_S, N_POWERS, increasing=True)
        r_s = np.einsum("nk,sik->nsi", powers, arcs.pieces[:, p, :3])
        turn = earth_turn_matrix(since_s)
        d = r_s - np.einsum("nij,nj->ni", turn, r_e[rows])[:, None]
        up = np.einsum("nij,nj->ni", turn, up_e[rows])
        sine[rows] = np.einsum("nsi,ni->ns", d, up) / np.sqrt(np.einsum("nsi,nsi->ns", d, d))
    return sine


def lines_of_sight(arcs: Arcs, t_ns: Int64, satellite: Int64, r_e: Float64) -> Float64:
    """Return unit vectors (q, 3) from places to satellites, ECEF; NaN without a state.

    The light time is taken as 75 ms, and a satellite's place as seen in the axes of the instant: within 1e-5 rad.

    Parameters
    ----------
    t_ns : (q,) GPS time, covered by the pieces
    satellite : (q,) number of the satellite
    r_e : (q, 3) antenna position, ECEF [m]
    """
    piece, part = np.divmod(t_ns - arcs.start_ns, PIECE_NS)
    sent_s = part / NS_PER_S - USUAL_FLIGHT_S
    r_s = arcs.pieces[satellite, piece, :3, N_POWERS - 1]
    for k in range(N_POWERS - 2, -1, -1):
        r_s = r_s * sent_s[:, None] + arcs.pieces[satellite, piece, :3, k]
    turn = earth_turn_matrix(part / NS_PER_S)
    # back from the piece's axes: by the transpose
    d = np.einsum("qji,qj->qi", turn, r_s) - r_e
    return np.asarray(d / np.linalg.norm(d, axis=1)[:, None])
