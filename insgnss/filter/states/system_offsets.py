"""Clock offsets of further constellations, and of further bands of one, against the receiver clock [m]."""

from __future__ import annotations

from insgnss.filter.layout import SYSTEM_OFFSETS, RandomWalk, StateBlock
from insgnss.filter.states.wanted import StateInputs


def system_offsets(wanted: StateInputs) -> StateBlock | None:
    """Return the block; None where one clock serves all. A start knows some of them better than ``sigma``."""
    process = wanted.config.process
    names = tuple(f"offset_{group.replace(':', '_')}_m" for group in wanted.clock_groups[1:])
    walk = RandomWalk(process.inter_system_walk_m_per_sqrt_s)
    return StateBlock(SYSTEM_OFFSETS, names, "m", process.inter_system_sigma_m, walk) if names else None
