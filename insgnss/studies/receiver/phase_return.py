"""A phase that comes back after its signal was gone: does the receiver still know its cycle?, compiled.

A phase discriminator sees an offset up to whole distances between its stable points, half a cycle with data, a cycle of
a pilot. Where the sigma of the predicted phase is a small part of that distance, the phase goes on as it was. Else its
cycle is unknown: what it measures first says nothing of position or velocity. It begins a state of its own, by how much
the phase's range is off from the predicted one, with the covariance that this makes with all other states
(``begin_phase``). From then on only its changes count. The phase of a satellite that rises, which was not seen before,
begins in this way however well it is predicted: its fraction of a cycle was not known either.

For ``PULL_IN`` integrations the observation is the angle of the prompt correlator, which is linear as far as the
neighbouring points; other discriminators are so close to zero only. Where the range rate is so uncertain that the next
integration's cycle is open again, the phase begins again: integrations that are long against the wavelength over the
sigma of the rate do not catch a phase.
Neglects: a wrong cycle of a noisy phase while it is pulled in. Fixing the cycle by all phases together is not tried.
"""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.rows.replica_offset import COLUMNS, OWN_COLUMN
from insgnss.filter.state import OFFSETS
from insgnss.filter.update.replica_offsets import begin_phase, phase_variance
from insgnss.kernels.jit import kernel
from insgnss.studies.receiver.interval_message import add_observation
from insgnss.studies.receiver.workspace import (
    INTERVAL_MESSAGE,
    ONE_STAGE,
    ChannelRoom,
    FilterRoom,
    ReceiverDesign,
)
from insgnss.tracking.vector_loop import OFFSET_RANGE, SEEN_ANGLE, SEEN_RANGE, ChannelConstants, is_of_pilot

PULL_IN: Final = 20  # integrations: the sigma of one observation has fallen to less than a quarter
# sigmas of the predicted phase between its stable point and the middle to the next one: beyond them 6e-5 are left
SURE_SIGMAS: Final = 4.0


@kernel(inline=True)
def has_phase_states(f: FilterRoom) -> bool:
    """Return whether each phase has a state of its own."""
    return bool(f.columns.shape[0] > len(COLUMNS))


@kernel(inline=True)
def own_column(f: FilterRoom, c: int) -> None:
    """Let the last column of a channel's rows be the state of its own phase."""
    if has_phase_states(f):
        f.columns[len(COLUMNS)] = OFFSETS + c
        f.acceleration_columns[OWN_COLUMN] = OFFSETS + c


@kernel(inline=True)
def phase_apart(receiver: ReceiverDesign, f: FilterRoom, c: int) -> float:
    """Return the offset of the filter's phase replica from the predicted range [m]."""
    if receiver.kind == ONE_STAGE and has_phase_states(f):
        return float(f.state[0].optional[c])
    return 0.0


@kernel(inline=True)
def cycle_m(channels: ChannelConstants) -> float:
    """Return the distance between two stable points of the phase discriminator [m]."""
    return (2.0 if is_of_pilot(channels) else 1.0) * math.pi / channels.radians_per_m


@kernel(inline=True)
def count_from_nearest(channels: ChannelConstants, room: ChannelRoom, c: int) -> None:
    """Let the truth of a phase that is pulled in count from the stable point next to its replica."""
    step = cycle_m(channels)
    turns = math.floor(room.offset[OFFSET_RANGE] / step + 0.5)
    room.cycles[c] -= turns * step
    room.offset[OFFSET_RANGE] -= turns * step


@kernel(apart=True)
def pull_in(
    receiver: ReceiverDesign,
    channels: ChannelConstants,
    variance: float,
    f: FilterRoom,
    room: ChannelRoom,
    c: int,
) -> bool:
    """Take the prompt's angle for the phase; return whether it has begun anew, and nothing else is to be learnt of it.

    Parameters
    ----------
    variance : of the phase's range
    """
    room.seen[SEEN_RANGE] = room.seen[SEEN_ANGLE]
    room.pulling[c] -= 1
    one_stage = receiver.kind == ONE_STAGE
    own_column(f, c)
    D = phase_variance(f.P, f.columns, room.u[c], f.h[0]) if one_stage else room.P[c, 0, 0]
    if room.met[c] == 1 and not SURE_SIGMAS * math.sqrt(D) > 0.5 * cycle_m(channels):
        return False
    room.pulling[c] = PULL_IN
    if one_stage:
        begin_phase(f.P, f.columns, room.u[c], room.seen[SEEN_RANGE], variance, f.h[0], f.v)
        return True
    x, P = room.x[c], room.P[c]
    x[0] += room.seen[SEEN_RANGE]
    for i in range(P.shape[0]):
        P[0, i], P[i, 0] = 0.0, 0.0
    P[0, 0] = variance
    room.fresh[c] = 1
    if receiver.kind == INTERVAL_MESSAGE:
        clear_message(room, c)
        room.seen[SEEN_RANGE] = 0.0
        add_to_message(f, room, c, (variance, 0.0))
    return True


@kernel(inline=True)
def clear_message(room: ChannelRoom, c: int) -> None:
    """Let the sums of a channel's interval begin again."""
    for i in range(room.message.shape[1]):
        for j in range(room.message.shape[2]):
            room.message[c, i, j] = 0.0


@kernel(inline=True)
def add_to_message(f: FilterRoom, room: ChannelRoom, c: int, variances: tuple[float, float]) -> None:
    """Add an observation of a phase or a code to its interval's message, counted from where the filter expects it."""
    apart = f.state[0].optional[c] if has_phase_states(f) else 0.0
    room.seen[SEEN_RANGE] -= apart
    add_observation(room.message[c], room.x[c], room.predicted[c], room.seen, variances)
    room.seen[SEEN_RANGE] += apart
