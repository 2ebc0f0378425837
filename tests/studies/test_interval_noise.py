"""Noise within an interval: a filter that takes its messages knows what the joint distribution says, and no more."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import pytest
from scipy import linalg

from insgnss.filter.state import BA, CLOCK, DR, DRIFT, DV, OFFSETS
from insgnss.studies.receiver.imu import UnknownMotion
from insgnss.studies.receiver.interval_message import add_observation, carry_message
from insgnss.studies.receiver.interval_noise import disturbed_states, lead_noise
from insgnss.studies.receiver.own_channels import take_channels
from insgnss.studies.receiver.runs import channel_room
from insgnss.studies.receiver.variants import (
    STARTS,
    VARIANTS,
    TrueStart,
    filter_room,
    oscillator_of,
    receiver_of,
    without_ins,
)
from insgnss.tables import Float64

T, COUNT, CHANNELS = 0.01, 10, 6
DENSITY: Final = 0.3  # of the clock's drift [m^2/s^3]
MOTION: Final = UnknownMotion(20.0, 2.0)
VARIANCES: Final = (0.04, 0.01)
CARRIER_HZ: Final = 1.6e9


class Interval(NamedTuple):
    """A linear interval: its last state and all messages as products with the same independent normal numbers."""

    state: Float64  # (17, k)
    messages: Float64  # (m, p, k)
    observed: Float64  # (COUNT, m, 2, k)


def dynamics(with_ins: bool) -> tuple[Float64, Float64]:
    """Return the step of all states, and a root of the noise that it adds."""
    F, Q = np.eye(OFFSETS), np.zeros((OFFSETS, OFFSETS))
    of_clock = DENSITY * np.array([[T**3 / 3.0, T**2 / 2.0], [T**2 / 2.0, T]])
    F[CLOCK, DRIFT] = T
    Q[np.ix_([CLOCK, DRIFT], [CLOCK, DRIFT])] = of_clock
    for i in range(3):
        F[DR + i, DV + i] = T
        if not with_ins:
            own = [DR + i, DV + i, BA + i]
            A, noise = fading()
            flip = np.diag([1.0, 1.0, -1.0])  # the bias is minus the acceleration
            F[np.ix_(own, own)], Q[np.ix_(own, own)] = flip @ A @ flip, flip @ noise @ flip
    values, vectors = np.linalg.eigh(Q)
    return F, vectors * np.sqrt(np.maximum(values, 0.0))


def fading() -> tuple[Float64, Float64]:
    """Return step and noise of range, rate and a Gauss-Markov acceleration.

    Equation: exp([-A, Q; 0, A^T] T) = [., F^-1 W; 0, F^T]                    [Van Loan 1978, IEEE Trans. AC-23]
    """
    both = np.zeros((6, 6))
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / MOTION.time_s]])
    both[:3, :3], both[3:, 3:], both[2, 5] = -A, A.T, 2.0 * MOTION.sigma**2 / MOTION.time_s
    exponential = linalg.expm(both * T)
    F = exponential[3:, 3:].T
    return F, F @ exponential[:3, 3:]


def flown(with_ins: bool, rng: np.random.Generator, sight: Float64) -> tuple[Interval, Float64]:
    """Return an interval, and a draw of its numbers."""
    F, root = dynamics(with_ins)
    p = 2 if with_ins else 3
    begin = 0.1 * rng.standard_normal((OFFSETS, OFFSETS)) + np.eye(OFFSETS)
    size = OFFSETS * COUNT + 2 * CHANNELS * COUNT
    x, at = np.zeros((OFFSETS, size)), OFFSETS
    x[:, :OFFSETS] = begin
    rows = np.zeros((CHANNELS, 2, OFFSETS))
    rows[:, 0, DR : DR + 3], rows[:, 0, CLOCK] = -sight, 1.0
    rows[:, 1, DV : DV + 3], rows[:, 1, DRIFT] = -sight, 1.0
    observed = np.zeros((COUNT, CHANNELS, 2, size))
    for k in range(COUNT):
        if k:
            x = F @ x
            x[:, at : at + OFFSETS] += root
            at += OFFSETS
        observed[k] = rows @ x
        for c in range(CHANNELS):
            for i in range(2):
                observed[k, c, i, at] = math.sqrt(VARIANCES[i])
                at += 1
    A = np.array([[1.0, T], [0.0, 1.0]]) if with_ins else fading()[0]
    H, W = np.eye(2, p), np.diag(1.0 / np.array(VARIANCES))
    led = [np.linalg.matrix_power(np.linalg.inv(A), COUNT - 1 - k).T @ H.T @ W for k in range(COUNT)]
    information = sum(
        L @ H @ np.linalg.matrix_power(np.linalg.inv(A), COUNT - 1 - k) for k, L in enumerate(led)
    )
    total = sum(np.einsum("pi,cis->cps", L, observed[k]) for k, L in enumerate(led))
    messages = np.einsum("pq,cqs->cps", np.linalg.inv(information), total)
    return Interval(x, messages, observed), rng.standard_normal(size)


@pytest.mark.parametrize("with_ins", [True, False])
def test_filter_knows_of_disturbed_messages_what_their_joint_distribution_says(with_ins: bool) -> None:
    rng = np.random.default_rng(61)
    sight = rng.standard_normal((CHANNELS, 3))
    sight /= np.linalg.norm(sight, axis=1)[:, None]
    interval, numbers = flown(with_ins, rng, sight)
    at = TrueStart(np.array([6.4e6, 0.0, 0.0]), np.zeros(3), np.eye(3), 0.0, 0.0, np.zeros(3))
    start, unknown = STARTS["noncoherent"], None if with_ins else MOTION
    f = filter_room(
        without_ins(MOTION), oscillator_of(1.0, CARRIER_HZ), start, at, rng, False,
        disturbed=disturbed_states(with_ins),
    )  # fmt: skip
    receiver = receiver_of(VARIANTS["optimal"], T, COUNT, DENSITY, unknown, (1e9, 1e9, 0), 1, 0)
    room = channel_room(receiver, np.zeros(CHANNELS), np.zeros((2, CHANNELS)), start, rng, T)
    room.u[:], room.x[:], room.predicted[:] = sight, 0.0, 0.0
    f.P[:], f.v[:] = 0.0, 0.0
    f.P[:OFFSETS, :OFFSETS] = interval.state @ interval.state.T
    for k in range(COUNT):
        for c in range(CHANNELS):
            carry_message(room.message[c], receiver.back)
        lead_noise(receiver, room)
        for c in range(CHANNELS):
            seen = np.array([*(interval.observed[k, c] @ numbers), 0.0, 0.0])
            add_observation(room.message[c], room.x[c], room.predicted[c], seen, VARIANCES)
    take_channels(receiver, np.zeros(CHANNELS, np.int64), f, room)

    y = interval.messages.reshape(-1, interval.messages.shape[-1])
    K = np.linalg.solve(y @ y.T, y @ interval.state.T).T
    left = interval.state - K @ y
    scale = np.sqrt(np.diag(left @ left.T))
    assert f.P[:OFFSETS, :OFFSETS] / np.outer(scale, scale) == pytest.approx(
        left @ left.T / np.outer(scale, scale), abs=1e-8
    )
    assert f.v[0, :OFFSETS] / scale == pytest.approx(K @ y @ numbers / scale, abs=1e-8)
    assert not f.P[OFFSETS:].any() and not f.v[0, OFFSETS:].any() and not room.noise_sums.any()
