"""Which broadcast message serves a satellite at an instant.

Among the satellite's healthy messages of the preferred kind the one whose toe is nearest to the time of
transmission is taken, if it lies within the message's validity: half its fit interval where the message states one,
else the constellation's own limit, or ``max_age_s`` in place of both. toe may lie ahead: a log is replayed with all
its messages at hand (the age has a sign, so a user sees it). Of two messages with the same toe the later one in the
table counts. When no preferred message is valid the next kind is tried (Galileo: I/NAV, then F/NAV, or the
reverse); when none is valid at all the reason is UNHEALTHY if a message marked so is, STALE_EPHEMERIS if the
satellite has any message, else NO_EPHEMERIS. Messages with a rate of the semi-major axis (CNAV, CNV1, CNV2) are not
used: the table has no place for it. A message with impossible numbers (``plausible_messages``) counts as
absent. States to be integrated (GLONASS, SBAS) are chosen by the same rule; their rows count on after the ephemerides'.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.gnss.orbits.ephemeris_rows import ephemeris_rows
from insgnss.gnss.orbits.glonass import StateVectorArcs, state_vector_arcs
from insgnss.gnss.orbits.plausible_messages import (
    faults_of_ephemerides,
    faults_of_states,
    is_plausible,
    stated_fit_s,
)
from insgnss.gnss.signals import CHANNELS
from insgnss.kernels.jit import kernel
from insgnss.status import NO_EPHEMERIS, STALE_EPHEMERIS, UNHEALTHY, USED
from insgnss.tables import EphemerisTable, Float64, Int16, Int64, NavigationData, StateVectorTable

# How far from toe a message without a fit interval may be used [s]: GPS half of 4 h (IS-GPS-200N, 20.3.3.4.3.1),
# Galileo 4 h (OS SDD, validity of the navigation message), BeiDou 1 h (toe is renewed every hour), QZSS half of 2 h
# (IS-QZSS-PNT-005, 4.1.2), NavIC half of 4 h (toe is renewed every 2 h), GLONASS 15 min (GLONASS ICD 5.1, 4.4: t_b is
# the middle of its interval) and half a minute for the next message to be decoded (a frame), SBAS 6 min (RTCA DO-229,
# table A-25: message 9 outside of precision approaches)
VALIDITY_S: Final[dict[str, float]] = {
    **{"G": 7200.0, "E": 14400.0, "C": 3600.0, "J": 3600.0, "I": 7200.0},
    **{"R": 930.0, "S": 360.0},
}
# A state may be used this far from its time if ``max_age_s`` allows: the acceleration of Moon and Sun is then no longer
# the constant of the message, the orbit 5 m off
LONGEST_STATE_VECTOR_S: Final = 1800.0

_KINDS: Final[dict[str, tuple[str, ...]]] = {
    "G": ("LNAV", ""),
    "J": ("LNAV", ""),
    "I": ("LNAV", ""),
    "C": ("D1", "D2", ""),
    "E": ("INAV", "FNAV", ""),
}

_PREFERRED, _OTHER, _UNHEALTHY, _N_CLASSES = 0, 1, 2, 3
_UNUSABLE: Final = -1


class MessageIndex(NamedTuple):
    """All messages, sorted for the search, as the compiled code takes them."""

    rows: Float64  # (k, N_COLUMNS) the ephemerides, in the order of the table
    arcs: StateVectorArcs  # of the m - k states, in the order of their table
    toe_ns: Int64  # (m,) of the ephemerides, then of the states
    validity_ns: Int64  # (m,) largest distance from toe
    is_fnav: Int64  # (m,) 1 where the clock is Galileo's F/NAV
    order: Int64  # rows sorted by satellite, class, toe
    first: Int64  # (satellites * classes + 1,) where each satellite's class begins in ``order``


@dataclass(frozen=True)
class BroadcastMessages:
    """The messages of all satellites, and the number each satellite has in the index."""

    satellites: tuple[str, ...]
    index: MessageIndex
    channels: dict[str, int] = field(default_factory=dict)  # GLONASS, if the messages state them
    inter_signal_s: dict[str, Float64] = field(default_factory=dict)  # see ``NavigationData``


def _class_of(system: str, message: str, health: float, galileo_message: str) -> int:
    """Return the class of one message, _UNUSABLE for a kind that the orbit model does not serve."""
    if message not in _KINDS.get(system, ()):
        return _UNUSABLE
    if health != 0.0:
        return _UNHEALTHY
    return _OTHER if system == "E" and message not in (galileo_message, "") else _PREFERRED


def _validity_ns(table: EphemerisTable, max_age_s: float | None) -> Int64:
    """Return how far from toe each ephemeris may be used [ns]."""
    if max_age_s is not None:
        return np.full(len(table.sv_names), round(max_age_s * NS_PER_S), np.int64)
    limit = np.array([VALIDITY_S.get(name[0], 0.0) for name in table.sv_names], dtype=np.float64)
    stated = stated_fit_s(table)
    half_s: Float64 = np.where(np.isnan(stated), limit, stated / 2.0)
    return np.asarray(np.rint(half_s * NS_PER_S), dtype=np.int64)


def _state_validity_ns(table: StateVectorTable, max_age_s: float | None) -> Int64:
    """Return how far from its time each state may be used [ns]."""
    limit = np.array([VALIDITY_S.get(name[0], 0.0) for name in table.sv_names], dtype=np.float64)
    if max_age_s is not None:
        limit[:] = min(max_age_s, LONGEST_STATE_VECTOR_S)
    return np.asarray(np.rint(limit * NS_PER_S), dtype=np.int64)


def _no_state_vectors() -> StateVectorTable:
    """Return the table of no states."""
    none, nowhere = np.zeros(0), np.zeros((0, 3))
    return StateVectorTable(
        sv_names=(),
        t_ns=np.zeros(0, np.int64),
        r_e=nowhere,
        v_e=nowhere,
        a_e=nowhere,
        clock_s=none,
        clock_rate=none,
        group_delay_s=none,
        health=none,
        channel=np.zeros(0, np.int16),
    )


def _channels(sv_names: tuple[str, ...], channel: Int16) -> dict[str, int]:
    """Return the channel of each GLONASS satellite; its last message counts."""
    return {
        name: int(k) for name, k in zip(sv_names, channel, strict=True) if name[0] == "R" and k in CHANNELS
    }


def _classified(
    table: EphemerisTable, rows: Float64, states: StateVectorTable, galileo_message: str
) -> list[tuple[str, int, int]]:
    """Return satellite, class and toe of every message, ephemerides first; _UNUSABLE also where its numbers are."""
    sane = is_plausible(faults_of_ephemerides(table), len(rows)) & np.isfinite(rows).all(axis=1)
    classes = [
        _class_of(name[0], message, float(health), galileo_message) if of_satellite else _UNUSABLE
        for name, message, health, of_satellite in zip(
            table.sv_names, table.message, table.health, sane.tolist(), strict=True
        )
    ]
    sane = is_plausible(faults_of_states(states), len(states.sv_names))
    classes += [
        (_PREFERRED if health == 0.0 else _UNHEALTHY) if of_satellite else _UNUSABLE
        for health, of_satellite in zip(states.health, sane.tolist(), strict=True)
    ]
    toe = [*table.toe_ns.tolist(), *states.t_ns.tolist()]
    return list(zip((*table.sv_names, *states.sv_names), classes, toe, strict=True))


def broadcast_messages(
    navigation: EphemerisTable | NavigationData,
    *,
    max_age_s: float | None = None,
    galileo_message: str = "INAV",
) -> BroadcastMessages:
    """Return the messages sorted for ``choose_message``; the rule is the module's.

    Parameters
    ----------
    navigation : the messages as read; GLONASS and SBAS are in ``NavigationData`` alone
    max_age_s : largest distance from toe [s] for every message (states to be integrated: 30 min at most); each
        message's own validity when None
    galileo_message : "INAV" (clock for E1/E5b) or "FNAV" (clock for E1/E5a), the preferred one
    """
    whole = navigation if isinstance(navigation, NavigationData) else NavigationData(navigation, None, None)
    table, states = whole.ephemerides, whole.state_vectors or _no_state_vectors()
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        rows = ephemeris_rows(table)
        state_validity_ns = _state_validity_ns(states, max_age_s)
        arcs = state_vector_arcs(states, state_validity_ns)
    satellites = tuple(sorted({*table.sv_names, *states.sv_names}))
    number = {name: i for i, name in enumerate(satellites)}
    row_of: dict[tuple[int, int, int], int] = {}  # (satellite, class, toe) -> row, the last one of its kind
    for k, (name, kind, toe_ns) in enumerate(_classified(table, rows, states, galileo_message)):
        if kind != _UNUSABLE:
            row_of[number[name], kind, toe_ns] = k
    keys = sorted(row_of)
    count = np.zeros(len(satellites) * _N_CLASSES + 1, np.int64)
    for satellite, kind, _ in keys:
        count[satellite * _N_CLASSES + kind + 1] += 1
    is_fnav = [message == "FNAV" for message in table.message] + [False] * len(states.sv_names)
    index = MessageIndex(
        rows=rows,
        arcs=arcs,
        toe_ns=np.concatenate([table.toe_ns, states.t_ns]).astype(np.int64),
        validity_ns=np.concatenate([_validity_ns(table, max_age_s), state_validity_ns]),
        is_fnav=np.array(is_fnav, dtype=np.int64),
        order=np.array([row_of[key] for key in keys], dtype=np.int64),
        first=np.cumsum(count),
    )
    channels = _channels(states.sv_names, states.channel)
    return BroadcastMessages(satellites, index, channels, whole.inter_signal_s)


@kernel
def _nearest(t_ns: int, index: MessageIndex, first: int, last: int, start: int) -> int:
    """Return the place in ``index.order[first:last]`` whose toe is nearest to ``t_ns`` (the earlier one of two).

    The walk from ``start`` ends at the same place from anywhere; from the last epoch's place it takes no step.
    """
    toe_ns, order = index.toe_ns, index.order
    place = start
    while place + 1 < last and abs(toe_ns[order[place + 1]] - t_ns) < abs(toe_ns[order[place]] - t_ns):
        place += 1
    while place > first and abs(toe_ns[order[place - 1]] - t_ns) <= abs(toe_ns[order[place]] - t_ns):
        place -= 1
    return place


@kernel
def choose_message(t_ns: int, satellite: int, index: MessageIndex, place: Int64) -> tuple[int, int]:
    """Return the message's row and USED, or -1 and the reason for no message; the module states the rule.

    Parameters
    ----------
    t_ns : time of transmission
    satellite : index into ``BroadcastMessages.satellites``, -1 for one that has no message
    index : the messages
    place : in and out, where each satellite's class was found last, initially ``index.first`` itself
    """
    if satellite < 0:
        return -1, NO_EPHEMERIS
    reason = NO_EPHEMERIS
    for kind in range(_N_CLASSES):
        slot = satellite * _N_CLASSES + kind
        first, last = index.first[slot], index.first[slot + 1]
        if first == last:
            continue
        place[slot] = _nearest(t_ns, index, first, last, place[slot])
        k = index.order[place[slot]]
        if abs(index.toe_ns[k] - t_ns) <= index.validity_ns[k]:
            return (-1, UNHEALTHY) if kind == _UNHEALTHY else (k, USED)
        reason = STALE_EPHEMERIS
    return -1, reason
