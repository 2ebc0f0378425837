"""The loop that joins a receiver's channels and the navigation filter, one integration after the other, compiled.

All states are at the middles of the integrations. From one to the next:

1. the filter is propagated by the inertial system (``prediction``), and predicts every range and range rate;
2. a replica is set: by that prediction (one stage), or by the channel's own filter (two stages), which follows the
   predicted change of range and rate, the radial acceleration that the inertial system knows. Its integration begins
   before the samples of its middle have come: the newest one is led on, and the error that this has made is taken off
   the observation once it is known;
3. correlators and discriminators see how far the replica is off (``vector_loop``);
4. the filter takes these observations as rows (one stage), or the channels take them, and every ``interval``
   integrations the filter takes the channels' results (two stages): their running estimates with the covariance of
   their own filters, or what the observations of the interval alone say (``interval_message``).

A channel whose signal was gone begins again at the filter's prediction; a phase whose cycle is then open has a state of
its own from there on (``phase_return``).

The filter is the package's own: state, prediction, scalar update and closed loop are those of a replay.
"""

from __future__ import annotations

import math

from insgnss.filter.prediction import predict_covariance, step_state
from insgnss.filter.rows.replica_offset import RANGE_COLUMNS, offset_range_row
from insgnss.filter.state import OFFSETS, StateRecord
from insgnss.filter.update.closed_loop import close_loop
from insgnss.filter.update.replica_offsets import (
    offset_covariance,
    use_offsets,
    use_phase_and_code,
)
from insgnss.filter.update.scalar_update import scalar_update
from insgnss.geodesy.vectors import rotate_back
from insgnss.gnss.line_of_sight import line_of_sight
from insgnss.kernels.jit import kernel
from insgnss.studies.receiver.own_channels import (
    correct_channel,
    lead_channels,
    restart_channel,
    take_channels,
)
from insgnss.studies.receiver.phase_return import (
    PULL_IN,
    add_to_message,
    count_from_nearest,
    has_phase_states,
    own_column,
    phase_apart,
    pull_in,
)
from insgnss.studies.receiver.workspace import (
    HELD,
    INTERVAL_MESSAGE,
    NO_SIGNAL,
    ONE_STAGE,
    RECORDED,
    SCALAR,
    AidingInputs,
    ChannelRoom,
    FilterRoom,
    ReceiverDesign,
    ReceiverHistory,
    SignalArrivals,
)
from insgnss.tables import Float64, Int64
from insgnss.tracking.vector_loop import (
    CODE_VARIANCE,
    OFFSET_CODE,
    OFFSET_RANGE,
    OFFSET_RATE,
    RANGE_VARIANCE,
    RATE_VARIANCE,
    SEEN_ANGLE,
    SEEN_CODE,
    SEEN_POWER,
    SEEN_RANGE,
    SEEN_RATE,
    ChannelConstants,
    observe_channel,
)


@kernel
def run_receiver(
    receiver: ReceiverDesign,
    channels: ChannelConstants,
    arriving: SignalArrivals,
    inputs: AidingInputs,
    f: FilterRoom,
    room: ChannelRoom,
    noise: Float64,
    history: ReceiverHistory,
) -> None:
    """Run a receiver over a block of integrations.

    Parameters
    ----------
    arriving, inputs : of the n integrations of the block
    noise : (n, m, 2, 6 or 12) independent normal numbers
    """
    m, with_filter = f.state[0], receiver.kind != SCALAR
    for k in range(noise.shape[0]):
        step = room.done[0]
        if with_filter:
            if step > 0:
                lead_filter(f, inputs.rate_b[k], inputs.force_b[k], channels.step_s, inputs.unknown[k])
            predict_offsets(m, inputs.satellites[k], room)
        if step > 0 and receiver.kind != ONE_STAGE:
            lead_channels(receiver, channels.step_s, with_filter, inputs.unknown[k, 1], room)
        if step >= receiver.settle:
            count_predicted(receiver, arriving.level[k], inputs.level[k], f, room, history)
        for i in range(f.v.shape[1]):
            f.v[0, i] = 0.0
        for c in range(noise.shape[1]):
            silent = inputs.level[k, c] == NO_SIGNAL
            if room.silent[c] == 1 and not silent and with_filter:
                # the signal is back: search has its centre where the filter expects it
                restart_channel(f, room, c)
                room.pulling[c] = PULL_IN if has_phase_states(f) else 0
            room.silent[c] = 1 if silent else 0
            estimate = room.predicted[c] if receiver.kind == ONE_STAGE else room.x[c]
            led_m, led_mps = led_wrongly(m.C_eb, inputs.ahead_b[k], room.u[c])
            apart = phase_apart(receiver, f, c)
            led_m = in_steps(estimate[0] + apart, led_m, receiver.steps[0])
            led_mps = in_steps(estimate[1], led_mps, receiver.steps[1])
            set_offsets(arriving, k, c, estimate, (led_m, led_mps), apart, room)
            if room.pulling[c] > 0:
                count_from_nearest(channels, room, c)
            elif arriving.level[k, c] != NO_SIGNAL and not silent:
                count_offset(receiver, room.offset, c, step, (led_m, led_mps), history)
            observe_channel(
                channels, arriving.level[k, c], inputs.level[k, c], room.offset, noise[k, c], room.seen
            )
            history.power[k, c] = room.seen[SEEN_POWER]
            room.seen[SEEN_RANGE] += led_m
            room.seen[SEEN_RATE] += led_mps
            room.seen[SEEN_CODE] += led_m
            room.seen[SEEN_ANGLE] += led_m
            if not silent:
                take_observation(receiver, channels, channels.table[inputs.level[k, c]], f, room, c)
        if receiver.kind == ONE_STAGE:
            close_loop(m, f.v[0], f.P.shape[0])
        elif with_filter and (step + 1) % receiver.interval == 0:
            take_channels(receiver, inputs.level[k], f, room)
            close_loop(m, f.v[0], f.P.shape[0])
            predict_offsets(m, inputs.satellites[k], room)
            if receiver.kind == INTERVAL_MESSAGE:
                for c in range(noise.shape[1]):
                    restart_channel(f, room, c)
        if with_filter:
            for c in range(noise.shape[1]):
                room.base[c, 0], room.base[c, 1] = room.predicted[c, 0], room.predicted[c, 1]
        if step % receiver.record_every == 0:
            record(receiver, arriving, k, f, room, step // receiver.record_every, history)
        room.done[0] = step + 1


@kernel(apart=True)
def lead_filter(f: FilterRoom, rate_b: Float64, force_b: Float64, dt: float, unknown: Float64) -> None:
    """Propagate the filter by one integration."""
    m, rates = f.state[0], f.scratch.rates[0]
    for i in range(3):
        rates.w[i] = rate_b[i] - m.b_g[i]
        rates.f[i] = force_b[i] - m.b_a[i]
    step_state(m, f.par[0], dt, unknown[0], unknown[1], rates)
    predict_covariance(m, f.P, f.par[0], f.scratch)


@kernel(inline=True)
def predict_offsets(m: StateRecord, satellites: Float64, room: ChannelRoom) -> None:
    """Write the filter's prediction for every channel."""
    for c in range(satellites.shape[0]):
        distance, rate = line_of_sight(satellites, c, m.r_e, m.v_e, room.u[c], room.g[c])
        room.predicted[c, 0] = distance + m.clock[0]
        room.predicted[c, 1] = rate + m.clock[1]


@kernel(inline=True)
def led_wrongly(C: Float64, ahead_b: Float64, u: Float64) -> tuple[float, float]:
    """Return a replica's error in range and range rate from extrapolating the newest inertial sample."""
    back = rotate_back(C, u)
    range_m = back[0] * ahead_b[0] + back[1] * ahead_b[1] + back[2] * ahead_b[2]
    rate_mps = back[0] * ahead_b[3] + back[1] * ahead_b[4] + back[2] * ahead_b[5]
    return -range_m, -rate_mps


@kernel(inline=True)
def set_offsets(
    arriving: SignalArrivals,
    k: int,
    c: int,
    estimate: Float64,
    led: tuple[float, float],
    apart: float,
    room: ChannelRoom,
) -> None:
    """Write truth less replica; ``led`` [m, m/s] the replica's own offset, ``apart`` [m] that of phase from code."""
    room.offset[OFFSET_CODE] = arriving.ranges[k, c] - estimate[0] - led[0]
    room.offset[OFFSET_RANGE] = room.offset[OFFSET_CODE] + (arriving.apart[k, c] + room.cycles[c] - apart)
    room.offset[OFFSET_RATE] = arriving.rates[k, c] - estimate[1] - led[1]


@kernel(apart=True)
def take_observation(
    receiver: ReceiverDesign,
    channels: ChannelConstants,
    row: Float64,
    f: FilterRoom,
    room: ChannelRoom,
    c: int,
) -> None:
    """Pass a channel's observations to the filter or to the channel's own; ``row`` (7,) is the table's."""
    seen, variances = room.seen, (row[RANGE_VARIANCE], row[RATE_VARIANCE])
    begun = room.pulling[c] > 0 and pull_in(receiver, channels, variances[0], f, room, c)
    room.met[c] = 1
    if receiver.kind == ONE_STAGE:
        room.innovation[c] = math.nan if begun else seen[SEEN_RANGE]
    if channels.with_code:
        if begun:
            offset_range_row(room.u[c], f.h[0])
            columns = f.columns[:RANGE_COLUMNS]
            scalar_update(f.P, f.h[0], columns, seen[SEEN_CODE], row[CODE_VARIANCE], f.v)
            return
        z, of_both = (seen[SEEN_RANGE], seen[SEEN_CODE]), (variances[0], row[CODE_VARIANCE])
        use_phase_and_code(f.P, f.phase_columns, OFFSETS + c, room.u[c], z, of_both, f.h[0], f.v)
    elif begun:
        return
    elif receiver.kind == ONE_STAGE:
        C = (variances[0], 0.0, variances[1])
        own_column(f, c)
        use_offsets(f.P, f.columns, room.u[c], room.g[c], (seen[SEEN_RANGE], seen[SEEN_RATE]), C, f.h[0], f.v)
    else:
        if receiver.kind == INTERVAL_MESSAGE:
            add_to_message(f, room, c, variances)
        correct_channel(room, c, variances)


@kernel(inline=True)
def in_steps(estimate: float, led: float, step: float) -> float:
    """Return the offset of a replica from the estimate when it is set in steps."""
    if step <= 0.0:
        return led
    return step * math.floor((estimate + led) / step + 0.5) - estimate


@kernel(inline=True)
def count_offset(
    receiver: ReceiverDesign,
    offset: Float64,
    c: int,
    step: int,
    led: tuple[float, float],
    history: ReceiverHistory,
) -> None:
    """Count a channel's offset, and find out whether it is lost; ``led`` as in ``set_offsets``."""
    if history.lost_at[c] != HELD:
        return
    limits = receiver.limits
    if abs(offset[0]) > limits[0] or abs(offset[1]) > limits[1]:
        history.losing[c] += 1
        if history.losing[c] > limits[2]:
            history.lost_at[c] = step
            return
    else:
        history.losing[c] = 0
    if step >= receiver.settle:
        history.counted[c] += 1
        history.squares[c, 0] += offset[0] * offset[0]
        history.squares[c, 1] += offset[1] * offset[1]
        history.led[c, 0] += led[0] * led[0]
        history.led[c, 1] += led[1] * led[1]


@kernel(apart=True)
def count_predicted(
    receiver: ReceiverDesign,
    arriving: Int64,
    levels: Int64,
    f: FilterRoom,
    room: ChannelRoom,
    history: ReceiverHistory,
) -> None:
    """Count the variances predicted for the replicas' offsets; ``arriving`` and assumed ``levels`` are (m,)."""
    if receiver.kind == ONE_STAGE and room.done[0] % receiver.record_every != 0:
        return  # the filter's covariance is that of any other integration
    for c in range(room.x.shape[0]):
        if arriving[c] == NO_SIGNAL or levels[c] == NO_SIGNAL or history.lost_at[c] != HELD:
            continue
        own_column(f, c)
        D = (room.P[c, 0, 0], 0.0, room.P[c, 1, 1])
        if receiver.kind == ONE_STAGE:
            D = offset_covariance(f.P, f.columns, room.u[c], room.g[c], f.h, f.v)
        history.predicted[c, 0] += D[0]
        history.predicted[c, 1] += D[2]
        history.predicted[c, 2] += 1.0


@kernel(apart=True)
def record(
    receiver: ReceiverDesign,
    arriving: SignalArrivals,
    k: int,
    f: FilterRoom,
    room: ChannelRoom,
    at: int,
    history: ReceiverHistory,
) -> None:
    """Write filter and channels, after their updates, into row ``at``."""
    m, state = f.state[0], history.state[at]
    for i in range(3):
        state[i], state[3 + i] = m.r_e[i], m.v_e[i]
    for i in range(4):
        state[6 + i] = m.q_eb[i]
    state[10], state[11] = m.clock[0], m.clock[1]
    for i in range(history.covariance.shape[1]):
        for j in range(history.covariance.shape[2]):
            history.covariance[at, i, j] = f.P[RECORDED[i], RECORDED[j]]
    for c in range(room.x.shape[0]):
        estimate = room.predicted[c] if receiver.kind == ONE_STAGE else room.x[c]
        apart = phase_apart(receiver, f, c)
        history.innovation[at, c] = math.nan if room.silent[c] == 1 else room.innovation[c]
        history.offsets[at, c, 0] = arriving.ranges[k, c] - estimate[0] + (room.cycles[c] - apart)
        history.offsets[at, c, 0] += arriving.apart[k, c]
        history.offsets[at, c, 1] = arriving.rates[k, c] - estimate[1]
        if has_phase_states(f):
            history.apart[at, c, 0] = m.optional[c] - room.cycles[c]
            history.apart[at, c, 1] = f.P[OFFSETS + c, OFFSETS + c]
