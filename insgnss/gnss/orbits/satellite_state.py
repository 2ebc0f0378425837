"""Satellite states of a whole log: position, velocity, acceleration and clock at each row's time of transmission.

The time of transmission is exact without knowing the receiver's clock: tag - pseudorange / c - satellite clock. A
row without a usable pseudorange takes its epoch's median; flight times differ by up to 10 ms from it, so the state is
then 40 m and 6 mm/s off at most, and its range rate by 1 cm/s.
Positions are in the Earth-fixed frame of the transmission; ``line_of_sight`` turns them to the reception.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_S, WGS84_GM_M3PS2, WGS84_OMEGA_RADPS
from insgnss.gnss.median import median_of
from insgnss.gnss.orbits.broadcast import eccentric_anomaly, orbit_state
from insgnss.gnss.orbits.ephemeris_choice import (
    BroadcastMessages,
    MessageIndex,
    broadcast_messages,
    choose_message,
)
from insgnss.gnss.orbits.ephemeris_rows import M0, E, N
from insgnss.gnss.orbits.glonass import StateVectorArcs, arc_state
from insgnss.gnss.orbits.plausible_messages import is_inter_signal, is_satellite
from insgnss.gnss.orbits.satellite_clock import group_delay, satellite_clock
from insgnss.gnss.signals import inter_signal_index, signal_of, wavelength_m
from insgnss.kernels.jit import kernel
from insgnss.status import BAD_VALUE, NO_CHANNEL, NO_EPHEMERIS, UNKNOWN_SIGNAL, USED
from insgnss.tables import EphemerisTable, Float64, GnssTable, Int16, Int64, NavigationData

UInt8 = npt.NDArray[np.uint8]

USUAL_FLIGHT_S = 0.075  # of an epoch without any pseudorange: 20 200 km (GPS, zenith) to 25 800 km (horizon)
# A flight time this far from the epoch's median is a wrong pseudorange, not a satellite: from low orbit to
# geostationary orbit they differ by 0.08 s.
WIDEST_SPREAD_S = 0.1
_LONGEST_FLIGHT_S = 10.0  # a longer pseudorange is left out of the median, whatever the clock
_NEAREST_SATELLITE_M = 6.0e6  # from the Earth's centre: a state in the log nearer than this is an empty cell


class SatelliteStates(NamedTuple):
    """One row per observation; NaN where there is no state, with the reason in ``status``."""

    sat: Float64  # (n, 9) position [m], velocity [m/s], acceleration [m/s^2], ECEF at transmission
    # (n,) satellite clock with relativity, less the signal's group delay: to be added to a range
    clock_m: Float64
    drift_mps: Float64  # (n,) its rate: to be added to a range rate
    age_s: Float64  # (n,) time of transmission minus toe; negative when the message lies ahead
    status: UInt8  # (n,) USED (0), NO_EPHEMERIS, STALE_EPHEMERIS, UNHEALTHY, UNKNOWN_SIGNAL, NO_CHANNEL, BAD_VALUE
    message: Int64  # (n,) row of the ephemeris table, then of the states' (counted on), -1 without

    @property
    def position(self) -> Float64:
        """(n, 3) position [m], a view."""
        return self.sat[:, 0:3]

    @property
    def velocity(self) -> Float64:
        """(n, 3) velocity [m/s], a view."""
        return self.sat[:, 3:6]

    @property
    def acceleration(self) -> Float64:
        """(n, 3) acceleration [m/s^2], a view."""
        return self.sat[:, 6:9]


def satellite_states(
    gnss: GnssTable,
    nav: EphemerisTable | NavigationData | BroadcastMessages | None,
    *,
    max_age_s: float | None = None,
    galileo_message: str = "INAV",
) -> SatelliteStates:
    """Return the satellite state of every row of a log.

    The message is chosen by the rule of ``ephemeris_choice``: nearest toe among the healthy ones within their
    validity. States in the log itself are passed through, clock included, without group delay; rows that have none
    take the messages. A row whose signal is unknown keeps its orbit and a clock without group delay, and the status
    UNKNOWN_SIGNAL; a GLONASS row whose channel neither the messages nor the log state keeps both, and the status
    NO_CHANNEL.

    Parameters
    ----------
    gnss : the log
    nav : broadcast messages, as read or already sorted (then the two settings below are ignored)
    max_age_s : largest distance from toe [s], in place of the messages' own validity
    galileo_message : "INAV" or "FNAV", the one preferred
    """
    given = None if gnss.sat is None else _passed_through(gnss.sat)
    if given is not None and (nav is None or not (given.status == NO_EPHEMERIS).any()):
        return given
    if nav is None:
        return no_states(len(gnss.t_ns))
    if not isinstance(nav, BroadcastMessages):
        nav = broadcast_messages(nav, max_age_s=max_age_s, galileo_message=galileo_message)
    number = {name: i for i, name in enumerate(nav.satellites)}
    of_sv = np.array([number.get(name, -1) for name in gnss.sv_names], dtype=np.int64)
    signals = signal_facts(gnss, nav)
    states = no_states(len(gnss.t_ns))
    tau = np.empty(len(gnss.t_ns))
    # one kind of array, writable, so that the kernels are compiled once whatever reader made the table
    t_ns = np.require(gnss.t_ns, np.int64, ("C", "W"))
    sv, signal = np.require(gnss.sv, np.int16, ("C", "W")), np.require(gnss.signal, np.int16, ("C", "W"))
    flight_times(t_ns, np.require(gnss.pseudorange_m, np.float64, ("C", "W")), tau)
    broadcast_states(t_ns, sv, signal, tau, of_sv, signals, nav.index, states)
    leave_out_impossible(states)
    if given is not None:
        own = given.status != NO_EPHEMERIS
        states.sat[own], states.status[own], states.message[own] = given.sat[own], given.status[own], -1
        states.clock_m[own], states.drift_mps[own] = given.clock_m[own], given.drift_mps[own]
        states.age_s[own] = math.nan
    return states


def leave_out_impossible(states: SatelliteStates) -> None:
    """Turn rows with an impossible satellite state into rows without a state."""
    possible = is_satellite(states.sat, states.clock_m, states.drift_mps)
    stated = (states.status == USED) | (states.status == NO_CHANNEL) | np.isfinite(states.age_s)
    wrong = stated & ~possible
    if wrong.any():
        states.sat[wrong] = math.nan
        for column in (states.clock_m, states.drift_mps, states.age_s):
            column[wrong] = math.nan
        states.status[wrong] = NO_EPHEMERIS
        states.message[wrong] = -1


def glonass_channels(gnss: GnssTable, nav: BroadcastMessages | None = None) -> dict[str, int]:
    """Return the channel of each GLONASS satellite ("R07"), from the messages, else from the log's own header."""
    return gnss.glonass_channels | ({} if nav is None else nav.channels)


def row_wavelengths(gnss: GnssTable, channels: Mapping[str, int] | None = None) -> Float64:
    """Return the carrier's wavelength of every row [m], NaN where the signal or the channel is not known.

    ``channels`` : GLONASS channels (``glonass_channels``); those of the log when None
    """
    channels = gnss.glonass_channels if channels is None else channels
    wavelength = np.full((max(len(gnss.sv_names), 1), max(len(gnss.signal_names), 1)), math.nan)
    for i, name in enumerate(gnss.sv_names):
        for j, code in enumerate(gnss.signal_names):
            wavelength[i, j] = wavelength_m(name[0], code, channels.get(name))
    return np.asarray(wavelength[gnss.sv, gnss.signal])


def range_rates(gnss: GnssTable, channels: Mapping[str, int] | None = None) -> Float64:
    """Return the range rate of every row [m/s]: as logged, else -wavelength * Doppler, NaN where neither is known.

    Parameters
    ----------
    gnss : the log
    channels : GLONASS channels (``glonass_channels``); those of the log when None
    """
    from_doppler = -row_wavelengths(gnss, channels) * gnss.doppler_hz
    return np.where(np.isnan(gnss.range_rate_mps), from_doppler, gnss.range_rate_mps)


def no_states(n: int) -> SatelliteStates:
    """Return ``n`` rows without a state."""
    return SatelliteStates(
        sat=np.full((n, 9), math.nan),
        clock_m=np.full(n, math.nan),
        drift_mps=np.full(n, math.nan),
        age_s=np.full(n, math.nan),
        status=np.full(n, NO_EPHEMERIS, np.uint8),
        message=np.full(n, -1, np.int64),
    )


def _passed_through(sat: Float64) -> SatelliteStates:
    """Return the states of the log; the acceleration is that of a point-mass Earth (5e-5 m/s^2)."""
    states = no_states(len(sat))
    states.status[:] = status_of_given(sat)
    good = states.status == USED
    r_e, v_e = sat[good, 0:3], sat[good, 3:6]
    states.position[good], states.velocity[good] = r_e, v_e
    distance = np.linalg.norm(r_e, axis=1)
    # a = -mu r / |r|^3 - 2 omega x v - omega x (omega x r)
    gravity = -WGS84_GM_M3PS2 * (r_e.T / distance**3).T
    coriolis = 2.0 * WGS84_OMEGA_RADPS * np.stack([v_e[:, 1], -v_e[:, 0], np.zeros(len(v_e))], axis=1)
    centrifugal = WGS84_OMEGA_RADPS**2 * r_e * np.array([1.0, 1.0, 0.0])
    states.acceleration[good] = gravity + coriolis + centrifugal
    states.clock_m[good], states.drift_mps[good] = sat[good, 6], sat[good, 7]
    return states


def status_of_given(sat: Float64) -> UInt8:
    """Return USED for each row of a log's own satellite states (n, 8) that holds a satellite.

    NO_EPHEMERIS where cells are empty, position zero or inside the Earth; BAD_VALUE where what they hold is none.
    Without a velocity or a drift the satellite's range rate is unknown.
    """
    known = np.nan_to_num(sat[:, 3:8], nan=0.0, posinf=math.inf, neginf=-math.inf)
    good = is_satellite(
        np.column_stack([sat[:, :3], known[:, :3]]), sat[:, 6], known[:, 4], _NEAREST_SATELLITE_M
    )
    with np.errstate(over="ignore", invalid="ignore"):
        square = sat[:, 0] ** 2 + sat[:, 1] ** 2 + sat[:, 2] ** 2
    empty = np.isnan(square) | np.isnan(sat[:, 6]) | (square <= _NEAREST_SATELLITE_M**2)
    return np.where(good, USED, np.where(empty, NO_EPHEMERIS, BAD_VALUE)).astype(np.uint8)


class _SignalFacts(NamedTuple):
    """The properties of the log's signals for each of its satellites, (sv, signal)."""

    status: UInt8  # USED, UNKNOWN_SIGNAL or NO_CHANNEL
    factors: Float64  # (sv, signal, 2, 2) of the group delays, for I/NAV and for F/NAV clocks
    ahead_m: Float64  # added to the clock: the inter-signal correction of CNAV


def signal_facts(gnss: GnssTable, nav: BroadcastMessages) -> _SignalFacts:
    """Return the facts of each signal of each satellite in the log."""
    shape = (len(gnss.sv_names), len(gnss.signal_names))
    facts = _SignalFacts(np.full(shape, UNKNOWN_SIGNAL, np.uint8), np.zeros((*shape, 2, 2)), np.zeros(shape))
    channels = glonass_channels(gnss, nav)
    for i, name in enumerate(gnss.sv_names):
        corrections = nav.inter_signal_s.get(name)
        for j, code in enumerate(gnss.signal_names):
            signal = signal_of(name[0], code)
            if signal is None:
                continue
            no_carrier = math.isnan(wavelength_m(name[0], code, channels.get(name)))
            facts.status[i, j] = NO_CHANNEL if no_carrier else USED
            facts.factors[i, j, 0] = signal.group_delay
            facts.factors[i, j, 1] = signal.group_delay_fnav or signal.group_delay
            place = inter_signal_index(name[0], code)
            if corrections is not None and place >= 0 and is_inter_signal(float(corrections[place])):
                # dt - TGD + ISC, on every frequency    [IS-GPS-200N, 30.3.3.3.1.1; IS-GPS-705J, 20.3.3.3.1.2]
                facts.factors[i, j] = (1.0, 0.0)
                facts.ahead_m[i, j] = C_MPS * corrections[place]
    return facts


@kernel
def flight_times(t_ns: Int64, pseudorange: Float64, tau: Float64) -> None:
    """Write pseudorange / c [s] of each row, its epoch's median where the row's own is missing or absurd.

    Parameters
    ----------
    t_ns : (n,) receiver time tags, equal within an epoch
    pseudorange : (n,) [m]
    tau : (n,) output
    """
    sorted_values = np.empty(len(t_ns))
    start = 0
    while start < len(t_ns):
        stop, n_times = start, 0
        while stop < len(t_ns) and t_ns[stop] == t_ns[start]:
            if abs(pseudorange[stop]) < C_MPS * _LONGEST_FLIGHT_S:
                sorted_values[n_times] = pseudorange[stop] / C_MPS
                n_times += 1
            stop += 1
        median = median_of(sorted_values, n_times) if n_times > 0 else USUAL_FLIGHT_S
        for i in range(start, stop):
            own = pseudorange[i] / C_MPS
            near = abs(own - median) <= WIDEST_SPREAD_S  # false for NaN
            tau[i] = own if near else median
        start = stop


@kernel
def _broadcast_state(
    rows: Float64, k: int, t_tag: float, tau: float, out: Float64, i: int
) -> tuple[float, float, float]:
    """Write the state at transmission into ``out[i]``; return t - toe [s], clock [m] and drift [m/s].

    ``t_tag`` is the receiver's tag since toe. The satellite's clock (up to 1 ms, 4 m of orbit) is found at the time
    without it, then the state at the time with it; the clock changes by 1e-14 s between the two.
    """
    e, n = rows[k, E], rows[k, N]
    t = t_tag - tau
    mean = rows[k, M0] + n * t
    anomaly, sin_E, cos_E = eccentric_anomaly(mean, e, mean)
    clock, _ = satellite_clock(rows, k, t, sin_E, cos_E)
    shift = clock / C_MPS
    t -= shift
    _, sin_E, cos_E = eccentric_anomaly(mean - n * shift, e, anomaly - n * shift / (1.0 - e * cos_E))
    orbit_state(rows, k, t, sin_E, cos_E, out, i)
    clock, drift = satellite_clock(rows, k, t, sin_E, cos_E)
    return t, clock, drift


@kernel(inline=True)
def _integrated_state(
    arcs: StateVectorArcs, m: int, t_tag: float, tau: float, out: Float64, i: int
) -> tuple[float, float, float]:
    """Write the state at transmission into ``out[i]``; return time since the message's, clock [m] and drift [m/s].

    Equation: dt = -tau_n + gamma_n (t - t_b)    [GLONASS ICD 5.1, 3.3.3], relativity of the orbit included in both.
    """
    t = t_tag - tau
    t -= arcs.clock[m, 0] + arcs.clock[m, 1] * t
    arc_state(arcs, m, t, out, i)
    return t, C_MPS * (arcs.clock[m, 0] + arcs.clock[m, 1] * t), C_MPS * arcs.clock[m, 1]


@kernel
def broadcast_states(
    t_ns: Int64,
    sv: Int16,
    signal: Int16,
    tau: Float64,
    of_sv: Int64,
    signals: _SignalFacts,
    index: MessageIndex,
    states: SatelliteStates,
) -> None:
    """Fill the states of all rows; ``of_sv`` is each satellite's number in the index, -1 for none."""
    place = index.first.copy()
    for i in range(len(t_ns)):
        s, code = sv[i], signal[i]
        t_transmit_ns = t_ns[i] - np.int64(tau[i] * NS_PER_S)
        k, reason = choose_message(t_transmit_ns, of_sv[s], index, place)
        of_signal = signals.status[s, code]
        # a missing channel is reported only if nothing else is missing
        states.status[i] = of_signal if of_signal == UNKNOWN_SIGNAL or reason == USED else reason
        if k < 0:
            continue
        t_tag = (t_ns[i] - index.toe_ns[k]) / NS_PER_S
        factor = signals.factors[s, code, index.is_fnav[k]]
        if k < len(index.rows):
            t, clock, drift = _broadcast_state(index.rows, k, t_tag, tau[i], states.sat, i)
            delay = group_delay(index.rows, k, factor[0], factor[1])
        else:
            m = k - len(index.rows)
            t, clock, drift = _integrated_state(index.arcs, m, t_tag, tau[i], states.sat, i)
            delay = C_MPS * factor[0] * index.arcs.clock[m, 2]
        states.clock_m[i] = clock - delay + signals.ahead_m[s, code]
        states.drift_mps[i] = drift
        states.age_s[i] = t
        states.message[i] = k
