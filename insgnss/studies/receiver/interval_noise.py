"""The noise that oscillator and motion within an interval add to the messages of its channels; compiled.

A message (``interval_message``) assumes that nothing disturbs its path. But the noise w_j that enters between the
observations j - 1 and j is not in the earlier ones, which the message carries to the end without it. So it is off by

    d = -C sum L_(j-1) A^(n-j) w_j,        L_j the information of the first j observations, as of the end

All channels share the noise of the clock, and by their lines of sight that of the motion along each axis. The filter's
own prediction contains the same noise. With the noise as of the end, Q_j = A^(n-j) Q A^(n-j)^T, and the sums
G = sum L_(j-1) Q_j L_(j-1), Y = sum Q_j L_(j-1),

    cov(d) = C G C,        cov(x, d) = -Y C

During an update the filter has such a state d for each state x that the noise drives. The messages measure x + d: d is
added to x before the rows, which are those of any offset, and subtracted after them. From one observation to the next

    L <- B^T L B,   G <- B^T G B + L Q L,   Y <- A Y B + Q L,        B = A^-1

Neglects: that a channel weighs the observations of an interval otherwise than the sum of all channels does, if its C/N0
differs or its signal came within the interval.
"""

from __future__ import annotations

from typing import Final

from insgnss.filter.state import BA, CLOCK, DR, DRIFT, DV
from insgnss.kernels.jit import kernel
from insgnss.studies.receiver.interval_message import carry_message, solve_message
from insgnss.studies.receiver.workspace import NO_STATE, ChannelRoom, FilterRoom, ReceiverDesign
from insgnss.tables import Float64

_ACCELERATION: Final = 2  # of a message's offsets


def disturbed_states(with_ins: bool) -> tuple[int, ...]:
    """Return the states that noise within an interval drives, one for each offset of a message: clock, motion by axis.

    With INS the motion is known. The clock has no state that a message's acceleration would see: ``NO_STATE``.
    """
    if with_ins:
        return CLOCK, DRIFT
    return (CLOCK, DRIFT, NO_STATE, *(state + i for i in range(3) for state in (DR, DV, BA)))


@kernel(apart=True)
def lead_noise(receiver: ReceiverDesign, room: ChannelRoom) -> None:
    """Lead the sums G and Y of clock and motion on by an integration; L is that of the messages, led on already."""
    p, half = receiver.F.shape[0], room.F_P
    sum_messages(room)
    for k in range(receiver.noise.shape[0]):
        G, Y = room.noise_sums[k, 0], room.noise_sums[k, 1]
        carry_message(G, receiver.back)
        multiply(receiver.F, Y, half)
        multiply(half, receiver.back, Y)
        multiply(receiver.noise[k], room.all_messages, half)
        for i in range(p):
            for j in range(p):
                total = 0.0
                for b in range(p):
                    total += room.all_messages[i, b] * half[b, j]
                G[i, j] += total
                Y[i, j] += half[i, j]


@kernel(inline=True)
def sum_messages(room: ChannelRoom) -> None:
    """Write the sum of the channels' messages."""
    for i in range(room.all_messages.shape[0]):
        for j in range(room.all_messages.shape[1]):
            total = 0.0
            for c in range(room.message.shape[0]):
                total += room.message[c, i, j]
            room.all_messages[i, j] = total


@kernel(inline=True)
def multiply(A: Float64, X: Float64, to: Float64) -> None:
    """Write the product A X of the first p columns, ``A`` (p, p)."""
    p = A.shape[0]
    for i in range(p):
        for j in range(p):
            total = 0.0
            for b in range(p):
                total += A[i, b] * X[b, j]
            to[i, j] = total


@kernel(apart=True)
def disturb(f: FilterRoom, room: ChannelRoom) -> None:
    """Add to the filter's states what the messages contain beside them: x <- x + d, d the last states of ``P``.

    Nothing is done where the channels together do not observe all offsets.
    """
    P, states = f.P, f.disturbed
    at, p = P.shape[0] - states.shape[0], room.C.shape[0]
    sum_messages(room)
    if not solve_message(room.all_messages, room.z, room.C):
        return
    half = room.F_P
    for k in range(room.noise_sums.shape[0]):  # Y <- Y C, G <- C G C
        G, Y = room.noise_sums[k, 0], room.noise_sums[k, 1]
        multiply(Y, room.C, half)
        for i in range(p):
            for j in range(p):
                Y[i, j] = half[i, j]
        multiply(room.C, G, half)
        multiply(half, room.C, G)
    for i in range(states.shape[0]):
        first, own, source = i // p * p, i % p, min(i // p, 1)
        G, Y = room.noise_sums[source, 0], room.noise_sums[source, 1]
        for j in range(p):
            sign = sign_of(source, own) * sign_of(source, j)
            P[at + i, at + first + j] = sign * G[own, j]
            if states[first + j] != NO_STATE:
                crossed = -sign * Y[j, own]
                P[at + i, states[first + j]], P[states[first + j], at + i] = crossed, crossed
    for i in range(states.shape[0]):
        if states[i] != NO_STATE:
            add_state(P, states[i], at + i, 1.0)


@kernel(inline=True)
def sign_of(source: int, offset: int) -> float:
    """Return the sign of a state as part of an offset: without INS a bias is minus the vehicle's acceleration."""
    return -1.0 if source == 1 and offset == _ACCELERATION else 1.0


@kernel(apart=True)
def undisturb(f: FilterRoom, room: ChannelRoom) -> None:
    """Subtract the noise of the interval from the filter's states again, and clear it and its sums."""
    P, states = f.P, f.disturbed
    at = P.shape[0] - states.shape[0]
    for i in range(states.shape[0]):
        if states[i] != NO_STATE:
            add_state(P, states[i], at + i, -1.0)
            f.v[0, states[i]] -= f.v[0, at + i]
    for i in range(at, P.shape[0]):
        f.v[0, i] = 0.0
        for c in range(P.shape[0]):
            P[i, c], P[c, i] = 0.0, 0.0
    for k in range(room.noise_sums.shape[0]):
        for i in range(room.noise_sums.shape[2]):
            for j in range(room.noise_sums.shape[3]):
                room.noise_sums[k, 0, i, j], room.noise_sums[k, 1, i, j] = 0.0, 0.0


@kernel(inline=True)
def add_state(P: Float64, to: int, other: int, sign: float) -> None:
    """Add a state to another in a covariance, or subtract it (``sign`` -1); P stays symmetric bit for bit."""
    own = P[to, to] + 2.0 * sign * P[to, other] + P[other, other]
    for c in range(P.shape[0]):
        P[to, c] += sign * P[other, c]
        P[c, to] = P[to, c]
    P[to, to] = own
