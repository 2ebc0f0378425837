"""Which broadcast messages hold the numbers of a satellite: values outside their own format are damage.

The limits are those of the fields that carry the numbers, bits and scale, of each constellation's document; twice of
each is allowed, so that no rounding on the way through a file refuses a message. Besides that the ellipse must lie
where navigation satellites fly. What a damaged message would make of a satellite is then never computed.

| constellation | document |
|---------------|----------|
| GPS, QZSS | IS-GPS-200N, tables 20-I, 20-III, 20-X; IS-QZSS-PNT-005, 4.3.2 |
| Galileo | OS SIS ICD 2.1, tables 67, 68, 70, 78 |
| BeiDou | BDS-SIS-ICD B1I 3.0, tables 5-6, 5-8, 5-10, 5-11 |
| NavIC | IRNSS SIS ICD for SPS 1.1, tables 11, 12 |
| GLONASS | GLONASS ICD 5.1, table 4.5 |
| SBAS | RTCA DO-229, A.4.4.11 |
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from insgnss.constants import S_PER_WEEK
from insgnss.tables import Bool, EphemerisTable, Event, Float64, NavigationData, StateVectorTable

# From medium to geostationary orbit the distance from the Earth's centre is 2.3e7 (Galileo's two eccentric satellites,
# at perigee) to 4.6e7 m (QZSS, at apogee), and no satellite there is faster than the escape velocity at 1e7 m
NEAREST_M, FARTHEST_M, FASTEST_MPS = 1.0e7, 1.0e8, 9.0e3
# Of what is added to a range: the widest clock, Galileo's 62.5 ms; with a drift far above what any format holds
MOST_CLOCK_M, MOST_DRIFT_MPS = 4.0e7, 100.0
_MARGIN: Final = 2.0
_LONGEST_FIT_S: Final = 146 * 3600.0  # IS-GPS-200N, table 20-XII: the longest interval of an IODC

# Fields of two's complement: bits, and the power of two of the last one; those of angles count semicircles
_GPS: Final = {
    **dict.fromkeys(("delta_n",), (16, -43)),
    **dict.fromkeys(("cuc", "cus", "cic", "cis"), (16, -29)),
    **dict.fromkeys(("crc", "crs"), (16, -5)),
    **{"idot": (14, -43), "omega_dot": (24, -43), "af0": (22, -31), "af1": (16, -43), "af2": (8, -55)},
    "group_delay_s": (8, -31),
}
_GALILEO: Final = {
    **_GPS,
    **{"af0": (31, -34), "af1": (21, -46), "af2": (6, -59), "group_delay_s": (10, -32)},
}
_BEIDOU: Final = {
    **_GPS,
    **dict.fromkeys(("cuc", "cus", "cic", "cis"), (18, -31)),
    **dict.fromkeys(("crc", "crs"), (18, -6)),
    **{"af0": (24, -33), "af1": (22, -50), "af2": (11, -66), "group_delay_s": (10, -33)},  # 0.1 ns: 2^-33.2 s
}
_NAVIC: Final = {
    **_GPS,
    **{"delta_n": (22, -41), "omega_dot": (22, -41)},
    **dict.fromkeys(("cuc", "cus", "cic", "cis"), (15, -28)),
    **dict.fromkeys(("crc", "crs"), (15, -4)),
}
_FIELDS: Final = {"G": _GPS, "J": _GPS, "E": _GALILEO, "C": _BEIDOU, "I": _NAVIC}
_SEMICIRCLES: Final = frozenset({"delta_n", "idot", "omega_dot"})
_ANGLES: Final = ("i0", "omega0", "omega", "m0")  # +-1 semicircle; some files write them from zero on
_MOST_E: Final = 0.5  # 32 bits of 2^-33 in all formats
# GLONASS: x'' in 5 bits of 2^-30 km/s^2, tau in 22 bits of 2^-30 s, gamma in 11 bits of 2^-40, delta tau in 5 bits of
# 2^-30 s; SBAS: accelerations in 10 bits of 62.5 um/s^2 at most, clocks within GLONASS's
_MOST_ACCELERATION_MPS2: Final = {"R": 15 * 2.0**-30 * 1e3, "S": 512 * 62.5e-6}
_MOST_STATE_CLOCK_S, _MOST_STATE_RATE, _MOST_STATE_DELAY_S = 2.0**-9, 2.0**-30, 2.0**-26
# Klobuchar's eight, 8 bits each; BeiDou, QZSS and NavIC send the same form [IS-GPS-200N, table 20-X]
_KLOBUCHAR: Final = np.array([2.0**-23, 2.0**-20, 2.0**-17, 2.0**-17, 2.0**18, 2.0**21, 2.0**23, 2.0**23])
_NEQUICK: Final = np.array([512.0, 4.0, 0.25])  # Galileo OS SIS ICD 2.1, table 71
_MOST_INTER_SIGNAL_S: Final = 2.0**-22  # 13 bits of 2^-35 s; IS-GPS-200N, table 30-IV


def limit_of(system: str, name: str) -> float:
    """Return the largest size [SI units, radians] that a field of a constellation's message is believed with."""
    bits, power = _FIELDS.get(system, _GPS)[name]
    return _MARGIN * 2.0 ** (bits - 1 + power) * (math.pi if name in _SEMICIRCLES else 1.0)


def faults_of_ephemerides(table: EphemerisTable) -> dict[str, Bool]:
    """Return which messages (n,) are impossible, by the field that shows it."""
    system = np.array([name[0] for name in table.sv_names], dtype="U1")
    faults: dict[str, Bool] = {}
    with np.errstate(invalid="ignore", over="ignore"):
        nearest, farthest = table.sqrt_a**2 * (1.0 - table.e), table.sqrt_a**2 * (1.0 + table.e)
        faults["e"] = ~((table.e >= 0.0) & (table.e <= _MOST_E))
        faults["sqrt_a"] = ~((table.sqrt_a > 0.0) & (nearest > NEAREST_M) & (farthest < FARTHEST_M))
        for name in _ANGLES:
            faults[name] = ~(np.abs(getattr(table, name)) <= _MARGIN * math.pi)
        faults["toe_sow_s"] = ~(np.abs(table.toe_sow_s) <= _MARGIN * S_PER_WEEK)
        apart_s = np.abs(table.toc_ns.astype(np.float64) - table.toe_ns.astype(np.float64)) * 1e-9
        faults["toc_ns"] = ~(apart_s <= S_PER_WEEK)
        for name in _GPS:
            most = np.array([limit_of(letter, name) for letter in system.tolist()], np.float64)
            size: Float64 = np.abs(getattr(table, name))
            if name == "group_delay_s":  # none is given where it is NaN
                size, most = np.nan_to_num(size, nan=0.0, posinf=math.inf), most[:, None]
            faults[name] = np.asarray(~np.atleast_2d((size <= most).T).all(axis=0))
    return faults


def faults_of_states(table: StateVectorTable) -> dict[str, Bool]:
    """Return which states (n,) of GLONASS and SBAS are impossible, by the field that shows it."""
    most = np.array([_MOST_ACCELERATION_MPS2.get(name[0], 0.0) for name in table.sv_names], np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        distance, speed = np.sqrt((table.r_e**2).sum(axis=1)), np.sqrt((table.v_e**2).sum(axis=1))
        return {
            "position": ~((distance > NEAREST_M) & (distance < FARTHEST_M)),
            "velocity": ~(speed < FASTEST_MPS),
            "acceleration": ~(np.abs(table.a_e) <= _MARGIN * most[:, None]).all(axis=1),
            "clock": ~(np.abs(table.clock_s) <= _MARGIN * _MOST_STATE_CLOCK_S),
            "clock rate": ~(np.abs(table.clock_rate) <= _MARGIN * _MOST_STATE_RATE),
            "group delay": np.abs(table.group_delay_s) > _MARGIN * _MOST_STATE_DELAY_S,
        }


def is_satellite(sat: Float64, clock_m: Float64, drift_mps: Float64, nearest_m: float = NEAREST_M) -> Bool:
    """Return which states (n, >= 6) stand and move as a satellite does, with a clock that one can have; NaN does not.

    Parameters
    ----------
    sat : position [m] and velocity [m/s], ECEF
    clock_m, drift_mps : (n,) of the satellite
    nearest_m : least distance from the Earth's centre
    """
    with np.errstate(over="ignore", invalid="ignore"):
        square = sat[:, 0] ** 2 + sat[:, 1] ** 2 + sat[:, 2] ** 2
        speed2 = sat[:, 3] ** 2 + sat[:, 4] ** 2 + sat[:, 5] ** 2
        placed = (square > nearest_m**2) & (square < FARTHEST_M**2) & (speed2 < FASTEST_MPS**2)
    return np.asarray(placed & (np.abs(clock_m) < MOST_CLOCK_M) & (np.abs(drift_mps) < MOST_DRIFT_MPS))


def is_plausible(faults: dict[str, Bool], n: int) -> Bool:
    """Return which of ``n`` messages have no fault."""
    refused = np.zeros(n, np.bool_)
    for where in faults.values():
        refused |= where
    return ~refused


def stated_fit_s(table: EphemerisTable) -> Float64:
    """Return the fit interval [s] that each message states, NaN where it states none that there can be."""
    fit = table.fit_interval_s
    return np.where((fit > 0.0) & (fit <= _LONGEST_FIT_S), fit, np.nan)


def plausible_klobuchar(coefficients: Float64 | None) -> Float64 | None:
    """Return the eight coefficients of an ionosphere, None where they are none that a message can hold."""
    if coefficients is None or not bool((np.abs(coefficients) <= _MARGIN * _KLOBUCHAR).all()):
        return None
    return coefficients


def is_ionosphere(coefficients: Float64) -> bool:
    """Return whether coefficients are within a message's format: eight as GPS's, three as Galileo's."""
    most = _NEQUICK if len(coefficients) == len(_NEQUICK) else _KLOBUCHAR
    return len(coefficients) == len(most) and bool((np.abs(coefficients) <= _MARGIN * most).all())


def is_inter_signal(seconds: float) -> bool:
    """Return whether an inter-signal correction [s] is one that a message can hold."""
    return abs(seconds) <= _MARGIN * _MOST_INTER_SIGNAL_S


def refused_messages(navigation: NavigationData | None) -> list[Event]:
    """Return an event for each satellite with messages that are not used because their numbers are impossible."""
    if navigation is None:
        return []
    table, states = navigation.ephemerides, navigation.state_vectors
    events = _told(table.sv_names, faults_of_ephemerides(table))
    if states is not None:
        events += _told(states.sv_names, faults_of_states(states))
    if navigation.klobuchar is not None and plausible_klobuchar(navigation.klobuchar) is None:
        events.append(_not_used("the ionosphere's coefficients of GPS"))
    for name, coefficients in navigation.ionosphere.items():
        if not is_ionosphere(coefficients):
            events.append(_not_used(f"the ionosphere's coefficients of {name}"))
    return events


def _not_used(what: str) -> Event:
    return Event(None, "ephemeris_refused", f"{what} are beyond what a message can hold: not used")


def _told(sv_names: tuple[str, ...], faults: dict[str, Bool]) -> list[Event]:
    """Return an event for each satellite, with the fields at fault."""
    refused = ~is_plausible(faults, len(sv_names))
    events = []
    for name in sorted({sv_names[k] for k in np.flatnonzero(refused)}):
        own = np.array([other == name for other in sv_names], np.bool_) & refused
        fields = ", ".join(field for field, where in faults.items() if (where & own).any())
        detail = f"{name}: {int(own.sum())} message(s) not used, beyond what a message can hold: {fields}"
        events.append(Event(None, "ephemeris_refused", detail))
    return events
