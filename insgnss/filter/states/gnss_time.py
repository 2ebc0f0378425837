"""The error of the GNSS time tags after a jump: s seconds to be added to them, constant until the next jump.

An epoch with the tag t was measured at t + s. By then the antenna is at r_a + v s with the velocity v_a + a s
(``update.prior_rows``), and the satellites have moved on: a pseudorange is larger by s times its own rate, up to 800 m
for a second and different for each satellite, so one epoch of six satellites shows s to milliseconds. No setting asks
for the state: a filter whose epoch shows a jump (``update.tag_jumps``) goes on with it.
Neglects: the drift of the satellites' clocks, 1e-4 m in a second; s^2 / 2 times the ranges' acceleration, 0.1 m in one.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.layout import Layout, StateBlock
from insgnss.filter.state import CLOCK, DR, OFFSETS, StateRecord
from insgnss.tables import Float64

GNSS_TIME: Final = "gnss_time"
JUMP_SIGMA_S: Final = 1.0  # of a jump whose size only its rows show
# of an offset beyond which the acceleration of a moment says too little of a velocity that much earlier or later
LONGEST_FOR_RATES_S: Final = 0.2
SPOILT_MPS: Final = (
    1500.0  # by which wrong tags spoil a place and a clock that are found with them: twice a rate
)
UNKNOWN_GNSS_TIME: Final = StateBlock(GNSS_TIME, ("gnss_time_offset_s",), "s", JUMP_SIGMA_S, shown=False)


def gnss_time_of(m: StateRecord, layout: Layout) -> float:
    """Return the offset of a hypothesis [s]; zero where it is not a state."""
    at = layout.at(GNSS_TIME)
    return float(m.optional[at - OFFSETS]) if at >= 0 else 0.0


def forget_gnss_time(m: StateRecord, P: Float64, layout: Layout, before_s: float) -> None:
    """Let the offset, where it is a state, be unknown beside the place and clock of a fix, which does not know it.

    Fix and filter may both be right: the tags may have jumped again, or the fix may be off by what the offset
    ``before_s`` does to it.
    """
    at = layout.at(GNSS_TIME)
    if at < 0:
        return
    m.optional[at - OFFSETS] = 0.0
    P[at, :] = P[:, at] = 0.0
    P[at, at] = JUMP_SIGMA_S**2
    for state in (DR, DR + 1, DR + 2, CLOCK):
        P[state, state] += (SPOILT_MPS * before_s) ** 2
