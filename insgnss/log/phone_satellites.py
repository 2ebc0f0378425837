"""Rows of a phone's log completed by messages: GLONASS satellites known by their channel, and satellite states.

Two GLONASS satellites share a channel, on opposite sides of the Earth: at most one of them is in view. The
receiver lies in the mean direction of the satellites that its log names, within some 30 deg; a satellite in view is
less than 76 deg from the receiver's zenith as seen from the Earth's centre, its antipode more than 104 deg.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.gnss.orbits.ephemeris_choice import broadcast_messages
from insgnss.gnss.orbits.satellite_state import satellite_states, status_of_given
from insgnss.log.events import counted, listed
from insgnss.log.satellites import channel_of_name
from insgnss.status import USED
from insgnss.tables import Bool, Event, Float64, GnssTable, NavigationData, StateVectorTable

_PIECE_NS: Final = 300 * NS_PER_S  # in which a satellite moves 3 deg
_OLDEST_NS: Final = 1800 * NS_PER_S  # of a message: the satellite has moved 16 deg
# between the cosines of the candidate and the next one; antipodes differ by 0.5 at the horizon
_CLEAR: Final = 0.5


def with_slots(gnss: GnssTable, navigation: NavigationData | None) -> tuple[GnssTable, list[Event]]:
    """Return the log with satellites known by channel alone renamed, if messages identify them."""
    unknown = {
        k: channel for k, name in enumerate(gnss.sv_names) if (channel := channel_of_name(name)) is not None
    }
    of_unknown = np.isin(gnss.sv, list(unknown))
    if not of_unknown.any():
        return gnss, []
    states = None if navigation is None else navigation.state_vectors
    names = np.array(gnss.sv_names, dtype=object)[gnss.sv]
    by_name = {gnss.sv_names[k]: channel for k, channel in unknown.items()}
    slots: dict[str, int] = {}
    if navigation is not None and states is not None:
        piece = (gnss.t_ns - gnss.t_ns[0]) // _PIECE_NS
        for begin, end in pairwise([0, *(np.flatnonzero(np.diff(piece)) + 1).tolist(), len(piece)]):
            part = gnss.take(slice(begin, end))
            zenith = _zenith(part, of_unknown[begin:end], navigation)
            if zenith is None:
                continue
            for k in np.unique(part.sv[of_unknown[begin:end]]).tolist():
                slot = _in_view(states, unknown[k], int(part.t_ns[0]), zenith)
                if slot is not None:
                    names[begin:end][part.sv == k] = slot
                    slots[slot] = unknown[k]
    left = sum(channel_of_name(name) is not None for name in names.tolist())
    found = ", ".join(f"{slot} on {channel:+d}" for slot, channel in sorted(slots.items()))
    what = f"rows of GLONASS satellites known by their channel alone: {found}"
    ambiguous = (
        "rows of GLONASS satellites known by their channel alone (R43 to R56) are ambiguous:"
        " log messages of GLONASS and of other satellites to identify them"
    )
    events = counted("glonass_slot_found", int(of_unknown.sum()) - left, what)
    events += counted("glonass_slot_unknown", left, ambiguous)
    sv_names, sv = np.unique(names.astype(str), return_inverse=True)
    return replace(
        gnss,
        sv=sv.astype(np.int16),
        sv_names=tuple(sv_names.tolist()),
        glonass_channels=gnss.glonass_channels | by_name | slots,
    ), events


def _zenith(part: GnssTable, unknown: Bool, navigation: NavigationData) -> Float64 | None:
    """Return the mean direction (3,) of the satellites that a stretch names, one row of each, None without any."""
    rows = np.flatnonzero(~unknown & np.isfinite(part.pseudorange_m))
    if not len(rows):
        return None
    _, first = np.unique(part.sv[rows], return_index=True)
    chosen = part.take(np.sort(rows[first]))
    states = satellite_states(chosen, broadcast_messages(navigation))
    r_e = states.position[states.status == USED]
    if not len(r_e):
        return None
    mean: Float64 = (r_e / np.linalg.norm(r_e, axis=1)[:, None]).sum(axis=0)
    return mean / np.linalg.norm(mean)


def _in_view(states: StateVectorTable, channel: int, t_ns: int, zenith: Float64) -> str | None:
    """Return the satellite of a channel that is in view, None when that is not clear."""
    cosines: dict[str, float] = {}
    near = np.flatnonzero((states.channel == channel) & (np.abs(states.t_ns - t_ns) <= _OLDEST_NS))
    for k in near[np.argsort(-np.abs(states.t_ns[near] - t_ns), kind="stable")].tolist():
        cosines[states.sv_names[k]] = float(states.r_e[k] @ zenith / np.linalg.norm(states.r_e[k]))
    ranked = sorted(cosines.items(), key=lambda item: -item[1])
    if not ranked or ranked[0][1] <= 0.0 or (len(ranked) > 1 and ranked[0][1] - ranked[1][1] < _CLEAR):
        return None
    return ranked[0][0]


def states_beside(
    gnss: GnssTable, navigation: NavigationData | None, products: bool = False
) -> tuple[GnssTable, list[Event]]:
    """Return a phone's log with its own satellite states where no message serves the row; an event tells how many.

    Orbits of messages are better known than those that a phone computed, and have a group delay for each signal.
    Products replace all of them.
    """
    if gnss.sat is None or not (products or (navigation is not None and navigation.has_messages)):
        return gnss, []
    served = np.ones(len(gnss.t_ns), np.bool_)
    if not products:
        served = satellite_states(replace(gnss, sat=None), navigation).message >= 0
    kept = ~served & (status_of_given(gnss.sat) == USED)
    if not kept.any():
        detail = f"the phone's satellite states are not used: {'products' if products else 'messages'} replace them"
        return replace(gnss, sat=None), [Event(None, "satellite_states_not_used", detail)]
    systems = np.array([name[0] for name in gnss.sv_names], "U1")[gnss.sv]
    letters, counts = np.unique(systems[kept], return_counts=True)
    by_system = {f"rows of {letter}": n for letter, n in zip(letters, counts.tolist(), strict=True)}
    what = "the phone's satellite states are used in rows without a message"
    sat = np.where(kept[:, None], gnss.sat, np.nan)
    return replace(gnss, sat=sat), listed("satellite_states_beside", what, by_system)
