"""Whether a reading of the columns lets the vehicle move along one direction of the sensor, over the whole log.

Each stretch has its own attitude Q, found from the velocities that it gains. Where it only turns, or only speeds up,
mirrored readings explain it as well, each with another Q. A car or an aircraft moves nose first: with one direction a
in sensor axes for the whole log, and C(t) the attitude of ``motion_fit``,

    v_e / |v_e| = Q C(t) a

must hold in every stretch together with ds_e = c Q dU. A reading for which the two want different Q pays for it.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.log.checks.motion_fit import (
    CORRELATED,
    MODEL_SIGMA_MPS,
    PathReading,
    best_rotation,
    nearest_rotation,
    rotate,
)
from insgnss.log.checks.stretches import GnssStretch, lag_of
from insgnss.tables import Bool, Float64

# Slower motion has no direction: a car may creep backwards. For a slow vehicle, half of its usual speed
SLOW_MPS: Final = 1.0
USUAL: Final = 0.9  # share of the epochs below a vehicle's usual speed
CLEAR: Final = 5.0  # nor has motion that is not so many sigmas of the velocity
# The nose points along the motion to so much: angle of attack, wind, a car's tail in a turn, the walker's step [rad]
DIRECTION_SD: Final = 0.2
CORRELATION_S: Final = 10.0  # and so long it stays off on one side
STEADY: Final = 0.8  # mean length of the direction: less wanders by more than 40 deg
APART: Final = 0.7  # cosine: directions farther apart are two readings
LEVEL: Final = 0.8  # cosine with gravity, of a direction that is begun from
ITERATIONS: Final = 3
AXES: Final = np.concatenate((np.eye(3), -np.eye(3)))


class Nose(NamedTuple):
    """A direction in which the vehicle moves, and the cost of assuming it throughout the log."""

    along_s: Float64  # (3,) mean direction in sensor axes; short where it wanders, or is seen for a few seconds alone
    cost: float  # -2 log likelihood above that of the velocities alone with a direction that holds exactly

    @property
    def steady(self) -> bool:
        """Whether the vehicle keeps to this direction."""
        return float(np.linalg.norm(self.along_s)) > STEADY


class _Moments(NamedTuple):
    """The evidence of one stretch under one reading: sums over its epochs."""

    ds: Float64  # (k, 3)
    du: Float64
    turned: Float64  # (3, 3, 3) sum of v_i C_jl / |v| over epochs that move
    fast: float  # their number
    floor: float  # of the variance of a velocity difference
    each: float  # weight of one difference, and
    once: float  # of one direction: correlated ones count once
    handed: int

    def velocity_squares(self, Q: Float64) -> float:
        trace = max(float(np.sum(self.ds * (self.du @ Q.T))), 0.0)
        return max(float(np.sum(self.ds**2) - trace**2 / max(float(np.sum(self.du**2)), 1e-12)), 0.0)

    def direction_squares(self, Q: Float64, a: Float64) -> float:
        return max(2.0 * self.fast - 2.0 * float(np.einsum("ijl,ij,l", self.turned, Q, a)), 0.0)

    def cost(self, Q: Float64, a: Float64) -> float:
        """Return -2 log likelihood of both, the scatter of each its own."""
        rows, off = self.ds.size, self.direction_squares(Q, a) / max(2.0 * self.fast, 1.0)
        velocity = self.each * rows * np.log(self.velocity_squares(Q) / rows + self.floor)
        return float(velocity + self.once * 2.0 * self.fast * np.log(off / DIRECTION_SD**2 + 1.0))

    def attitude(self, a: Float64) -> tuple[Float64, float]:
        """Return the Q that serves both best, begun from either, and its cost."""
        rows = self.ds.size
        free = best_rotation(self.ds, self.du, self.handed)
        candidates = [(self.cost(free, a), free)]
        off = 0.0
        squares = self.velocity_squares(free)
        M_v, M_a = self.ds.T @ self.du, self.turned @ a
        for _ in range(2):
            w_v = self.each / (squares / rows + self.floor)
            w_a = self.once / (off / max(2.0 * self.fast, 1.0) + DIRECTION_SD**2)
            Q = nearest_rotation(w_v * M_v + w_a * M_a, self.handed)
            squares, off = self.velocity_squares(Q), self.direction_squares(Q, a)
            candidates.append((self.cost(Q, a), Q))
        cost, Q = min(candidates, key=lambda one: one[0])
        return Q, cost


def noses(chosen: list[GnssStretch], reading: PathReading, down_s: Float64) -> list[Nose]:
    """Return the directions of motion that stretches allow under one reading, the cheapest first.

    Parameters
    ----------
    chosen : stretches in motion
    reading : of their grid
    down_s : mean direction of gravity in sensor axes: no vehicle moves along it for long
    """
    least = least_speed(chosen)
    parts = [_moments(one, reading, i, least) for i, one in enumerate(chosen)]
    free = [part.velocity_squares(best_rotation(part.ds, part.du, part.handed)) for part in parts]
    base = sum(
        part.each * part.ds.size * np.log(squares / part.ds.size + part.floor)
        for part, squares in zip(parts, free, strict=True)
    )
    level = AXES[np.abs(AXES @ down_s) < LEVEL]
    distinct: list[Nose] = []
    for nose in sorted((_settled(parts, a, base) for a in level), key=lambda one: one.cost):
        a = nose.along_s / max(float(np.linalg.norm(nose.along_s)), 1e-9)
        others = [other.along_s / max(float(np.linalg.norm(other.along_s)), 1e-9) for other in distinct]
        if all(float(a @ other) < APART for other in others):
            distinct.append(nose)
    return distinct


def least_speed(chosen: list[GnssStretch]) -> float:
    """Return the speed from which on motion has a direction [m/s]."""
    speeds = np.concatenate([np.linalg.norm(stretch.v_e, axis=1) for stretch in chosen])
    return min(SLOW_MPS, 0.5 * float(np.quantile(speeds, USUAL)))


def directions_of(stretch: GnssStretch, least_mps: float) -> tuple[Float64, Bool]:
    """Return the unit vectors (k, 3) of a stretch's velocities, and a mask of their epochs (n,)."""
    speed = np.linalg.norm(stretch.v_e, axis=1)
    fast = speed > max(least_mps, CLEAR * stretch.sd_mps)
    return stretch.v_e[fast] / speed[fast, None], fast


def epoch_weight(stretch: GnssStretch) -> float:
    """Return as how much of an independent direction one epoch counts."""
    return min(1.0, float(np.median(np.diff(stretch.t_s))) / CORRELATION_S)


def mean_direction(total: Float64, epochs: float, weight: float) -> Float64:
    """Return the mean of ``epochs`` unit vectors from their sum, shorter where they count as less than one direction.

    A slow rover was faster than 1 m/s for 0.4 s at the start of its log: this decided which axis is forward, wrongly.
    """
    return np.asarray(total * weight / max(epochs * weight, 1.0))


def _settled(parts: list[_Moments], a: Float64, base: float) -> Nose:
    """Return the direction that attitudes and direction agree on, begun from ``a``."""
    mean, cost = a, np.inf
    for _ in range(ITERATIONS):
        fits = [part.attitude(a) for part in parts]
        cost = sum(one for _, one in fits)
        total = sum(
            (np.einsum("ijl,ij", p.turned, Q) for p, (Q, _) in zip(parts, fits, strict=True)), np.zeros(3)
        )
        mean = mean_direction(total, sum(part.fast for part in parts), parts[0].once)
        length = float(np.linalg.norm(mean))
        if length < 1e-6:
            break
        a = mean / length
    return Nose(mean, float(cost - base))


def _moments(stretch: GnssStretch, reading: PathReading, i: int, least_mps: float) -> _Moments:
    lag = lag_of(stretch.t_s)
    gained, q = reading.at(i, stretch.t_s)
    along_e, fast = directions_of(stretch, least_mps)
    C = np.stack(
        [rotate(q[fast], np.broadcast_to(unit, (int(fast.sum()), 3))) for unit in np.eye(3)], axis=-1
    )
    turned = np.einsum("ki,kjl->ijl", along_e, C)
    return _Moments(
        stretch.s_e[lag:] - stretch.s_e[:-lag],
        gained[lag:] - gained[:-lag],
        turned,
        float(fast.sum()),
        2.0 * stretch.sd_mps**2 + MODEL_SIGMA_MPS**2,
        1.0 / (CORRELATED * lag),
        epoch_weight(stretch),
        reading.handed,
    )
