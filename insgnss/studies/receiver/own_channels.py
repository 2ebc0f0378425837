"""A receiver's channels with filters of their own: how they move on, what they give to the filter, and their restart.

Compiled; the loop of all channels is ``receiver.loop``.
"""

from __future__ import annotations

import math

from insgnss.filter.update.replica_offsets import (
    acceleration_covariance,
    begin_phase,
    offset_covariance,
    use_acceleration_beside,
    use_offsets,
    use_rate_beside,
)
from insgnss.filter.update.scalar_update import scalar_update
from insgnss.kernels.jit import kernel
from insgnss.studies.receiver.interval_message import carry_message, solve_message, widen_message
from insgnss.studies.receiver.interval_noise import disturb, lead_noise, undisturb
from insgnss.studies.receiver.phase_return import clear_message, has_phase_states, own_column
from insgnss.studies.receiver.workspace import (
    INTERVAL_MESSAGE,
    NO_SIGNAL,
    ChannelRoom,
    FilterRoom,
    ReceiverDesign,
)
from insgnss.tables import Int64
from insgnss.tracking.vector_loop import SEEN_RANGE, SEEN_RATE


@kernel(inline=True)
def lead_channels(
    receiver: ReceiverDesign, dt: float, with_filter: bool, unknown: float, room: ChannelRoom
) -> None:
    """Propagate the channels by their own rates and by the change of the filter's predictions.

    Equation: x <- F x + [r_k - r_(k-1) - T r'_(k-1), r'_k - r'_(k-1)], r the filter's prediction; P <- F P F^T + W + U,
              U = q [T^3/3, T^2/2; T^2/2, T], q = ``unknown`` the density of an acceleration that no sample shows
    """
    n = receiver.F.shape[0]
    u = (unknown * dt**3 / 3.0, unknown * dt**2 / 2.0, unknown * dt) if with_filter else (0.0, 0.0, 0.0)
    for c in range(room.x.shape[0]):
        x, P, F_P = room.x[c], room.P[c], room.F_P
        for i in range(n):
            moved = 0.0
            for j in range(i, n):
                moved += receiver.F[i, j] * x[j]
            x[i] = moved
        if with_filter:
            x[0] += room.predicted[c, 0] - room.base[c, 0] - dt * room.base[c, 1]
            x[1] += room.predicted[c, 1] - room.base[c, 1]
            if receiver.kind == INTERVAL_MESSAGE:
                carry_message(room.message[c], receiver.back)
                if unknown > 0.0:
                    widen_message(room.message[c], u)
        for i in range(n):
            for j in range(n):
                total = 0.0
                for b in range(i, n):
                    total += receiver.F[i, b] * P[b, j]
                F_P[i, j] = total
        for i in range(n):
            for j in range(i + 1):
                total = receiver.walk[i, j]
                for b in range(j, n):
                    total += F_P[i, b] * receiver.F[j, b]
                P[i, j] = total
                P[j, i] = total
        P[0, 0] += u[0]
        P[0, 1] += u[1]
        P[1, 0] += u[1]
        P[1, 1] += u[2]
    if with_filter and receiver.kind == INTERVAL_MESSAGE:
        lead_noise(receiver, room)


@kernel(inline=True)
def correct_channel(room: ChannelRoom, c: int, variances: tuple[float, float]) -> None:
    """Correct a channel by its own observations."""
    n = room.x.shape[1]
    for i in range(n):
        room.v[0, i] = 0.0
    room.h[0] = 1.0
    scalar_update(room.P[c], room.h, room.columns[:1], room.seen[SEEN_RANGE], variances[0], room.v)
    if variances[1] > 0.0:
        scalar_update(room.P[c], room.h, room.columns[1:2], room.seen[SEEN_RATE], variances[1], room.v)
    for i in range(n):
        room.x[c, i] += room.v[0, i]


@kernel(apart=True)
def take_channels(receiver: ReceiverDesign, level: Int64, f: FilterRoom, room: ChannelRoom) -> None:
    """Update the filter with its channels' measurements; the intervals' sums restart."""
    own, own_covariance, known = room.z, room.C, True
    if receiver.kind == INTERVAL_MESSAGE:
        disturb(f, room)
    for c in range(room.x.shape[0]):
        if receiver.kind == INTERVAL_MESSAGE:
            known = solve_message(room.message[c], own, own_covariance)
            clear_message(room, c)
        else:
            expected = room.predicted[c, 0] + (f.state[0].optional[c] if has_phase_states(f) else 0.0)
            own[0], own[1] = room.x[c, 0] - expected, room.x[c, 1] - room.predicted[c, 1]
            for i in range(2):
                for j in range(2):
                    own_covariance[i, j] = receiver.inflation * room.P[c, i, j]
        if level[c] != NO_SIGNAL and known:
            own_column(f, c)
            z = (own[0], own[1])
            C = (own_covariance[0, 0], own_covariance[0, 1], own_covariance[1, 1])
            room.innovation[c] = math.nan if room.fresh[c] == 1 else z[0]
            if room.fresh[c] == 1:
                begin_phase(f.P, f.columns, room.u[c], z[0], C[0], f.h[0], f.v)
                use_rate_beside(f.P, f.columns, room.u[c], room.g[c], z, C, f.h[0], f.v)
                room.fresh[c] = 0
            else:
                use_offsets(f.P, f.columns, room.u[c], room.g[c], z, C, f.h[0], f.v)
            if own.shape[0] > 2:
                columns = f.acceleration_columns
                use_acceleration_beside(f.P, columns, room.u[c], room.g[c], own, own_covariance, f.h[0], f.v)
        else:
            room.innovation[c] = math.nan
    if receiver.kind == INTERVAL_MESSAGE:
        undisturb(f, room)


@kernel(apart=True)
def restart_channel(f: FilterRoom, room: ChannelRoom, c: int) -> None:
    """Set a channel to the filter's prediction, with its covariance h P h^T.

    The acceleration of a receiver without INS is that of the channel less the filter's: zero.
    """
    x, P = room.x[c], room.P[c]
    x[0], x[1] = room.predicted[c, 0], room.predicted[c, 1]
    if has_phase_states(f):
        x[0] += f.state[0].optional[c]
    room.fresh[c] = 0
    own_column(f, c)
    D = offset_covariance(f.P, f.columns, room.u[c], room.g[c], f.h, f.v)
    P[0, 0], P[0, 1], P[1, 0], P[1, 1] = D[0], D[1], D[1], D[2]
    if len(x) > 2:
        x[2] = 0.0
        D = acceleration_covariance(f.P, f.acceleration_columns, room.u[c], room.g[c], f.h, f.v)
        P[0, 2], P[2, 0], P[1, 2], P[2, 1], P[2, 2] = D[0], D[0], D[1], D[1], D[2]
