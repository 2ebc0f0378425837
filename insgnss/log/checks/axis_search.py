"""The hypothesis of axes, gyro unit and time that fits the logs, and the vehicle's axes that follow from it.

Every exchange and sign of the gyros' axes against the accelerometers' is tried, right- and left-handed, with both
units, over a range of time shifts. The attitude that comes with each shows along which sensor axes the vehicle moves
and is pulled down; it must move along one direction all through the log (``nose_first``).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.log.checks.longitudinal_axis import (
    Nose,
    directions_of,
    epoch_weight,
    least_speed,
    mean_direction,
    noses,
)
from insgnss.log.checks.motion_fit import (
    PathReading,
    best_rotation,
    fit_costs,
    integrate,
    rotate,
    signed_permutations,
)
from insgnss.log.checks.stretches import GnssStretch, inertial_grid, lag_of
from insgnss.tables import Float64, ImuTable

SCAN_S: Final = 22.0  # holds the leap seconds
QUICK_STEP_S: Final = 0.25
FULL_STEP_S: Final = 0.5
MIN_MOTION: Final = 1.5  # rms change of velocity over noise, for a stretch to say anything
SCAN_STRETCHES: Final = 6
AXIS_STRETCHES: Final = 12
# Differences of -2 log likelihood: below EQUAL two hypotheses are indistinguishable, above SURE one is ruled out
EQUAL: Final = 8.0
SURE: Final = 20.0
RANKED: Final = 8
LOOKED_AT: Final = 40.0  # so far above the best, biases or the direction of motion may bring one back


class Hypothesis(NamedTuple):
    """One reading of the columns, with the vehicle's motion that follows from it."""

    gyro_map: Float64  # (3, 3) H of the accelerometers' axes, a signed permutation
    factor: float  # on the gyros' declared unit
    handed: int
    cost: float  # above the best [-]
    along_s: Float64  # (3,) mean direction of motion in sensor axes; short where it wanders
    down_s: Float64  # (3,) mean direction of gravity
    noses: tuple[Nose, ...] = ()  # directions of motion that it allows
    fit: float = 0.0  # the part of the cost that the velocities alone make, above the best


class Match(NamedTuple):
    """The result of the search."""

    shift_s: float  # to be added to the inertial tags, to a quarter of a second
    contrast: float  # how much the likelihood peaks at the shift
    ranked: list[Hypothesis]  # by the velocities, the best first; the declared one with each unit among them
    gap: float  # to the best of those that are not ranked
    unit_gap: float  # to the best one with another unit of the gyros
    rms_mps: float
    stretches: list[GnssStretch]

    @property
    def readings(self) -> list[Hypothesis]:
        """The hypotheses with each direction of motion they allow, the best first."""
        return with_noses(self.ranked)

    @property
    def tied(self) -> list[Hypothesis]:
        """The hypotheses indistinguishable from the best."""
        return [one for one in self.readings if one.cost < EQUAL]


def in_motion(stretches: list[GnssStretch]) -> list[GnssStretch]:
    """Return the stretches whose motion exceeds the noise."""
    return [stretch for stretch in stretches if stretch.motion > MIN_MOTION]


def search(
    imu: ImuTable,
    origin_ns: int,
    stretches: list[GnssStretch],
    declared: Float64,
    factors: tuple[float, ...],
    base_s: float = 0.0,
) -> Match | None:
    """Return the hypotheses that explain the stretches best, None without motion.

    Parameters
    ----------
    imu : in sensor axes by the declared units
    stretches : of the track
    declared : (3, 3) the declared map of the gyros against the accelerometers
    factors : on the gyros' unit, 1 first
    base_s : added to the inertial tags beforehand
    """
    moving = in_motion(stretches)
    if not moving:
        return None
    maps = np.concatenate([factor * signed_permutations() for factor in factors])
    shift, contrast = scan(imu, origin_ns, moving, declared[None] * factors[0], base_s, QUICK_STEP_S)
    match = _ranked(imu, origin_ns, moving, maps, shift, contrast, base_s, factors, declared)
    right = any(is_map(h, declared, factors[0]) for h in match.tied)
    if contrast < SURE or not right:
        shift, contrast = scan(imu, origin_ns, moving, maps, base_s, FULL_STEP_S)
        match = _ranked(imu, origin_ns, moving, maps, shift, contrast, base_s, factors, declared)
    return match


def with_noses(ranked: list[Hypothesis]) -> list[Hypothesis]:
    """Return each hypothesis with each direction that it lets the vehicle move in, the cost of holding it added.

    Where the vehicle moves in no steady direction under any hypothesis that the velocities leave, as a helicopter may,
    its direction says nothing: then they come back as they are.
    """
    least = min((one.cost for one in ranked), default=0.0)
    pairs = [(one, nose) for one in ranked for nose in one.noses]
    left = [(one.cost + nose.cost, nose) for one, nose in pairs if one.cost - least < SURE]
    if not left or not min(left, key=lambda pair: pair[0])[1].steady:
        hypotheses = [one._replace(fit=one.cost - least) for one in ranked]
    else:
        hypotheses = [
            one._replace(cost=one.cost + nose.cost, along_s=nose.along_s, fit=one.cost - least)
            for one, nose in pairs
        ]
    best = min((one.cost for one in hypotheses), default=0.0)
    return sorted((one._replace(cost=one.cost - best) for one in hypotheses), key=lambda one: one.cost)


def is_map(hypothesis: Hypothesis, gyro_map: Float64, factor: float) -> bool:
    """Return whether a hypothesis has this map and this unit of the gyros."""
    return hypothesis.factor == factor and bool(np.array_equal(hypothesis.gyro_map, gyro_map))


def scan(
    imu: ImuTable, origin_ns: int, moving: list[GnssStretch], maps: Float64, base_s: float, step_s: float
) -> tuple[float, float]:
    """Return the shift with the least cost over all maps, zero where that is as good, and the fall below the median."""
    chosen = moving[:SCAN_STRETCHES]
    shifts = np.arange(-SCAN_S, SCAN_S + 0.5 * step_s, step_s)
    grid = inertial_grid(imu, origin_ns, chosen, SCAN_S + 1.0, base_s)
    cost = fit_costs(chosen, grid, integrate(grid, maps), shifts).cost.reshape(-1, len(shifts))
    best = int(np.argmin(cost.min(axis=1)))
    at = int(np.argmin(cost[best]))
    finite = cost[best][np.isfinite(cost[best])]
    middle = int(np.argmin(np.abs(shifts)))
    if cost[best, middle] - cost[best, at] < EQUAL:
        return 0.0, float(np.median(finite) - cost[best, middle])
    return float(shifts[at]), float(np.median(finite) - cost[best, at])


def _ranked(
    imu: ImuTable,
    origin_ns: int,
    moving: list[GnssStretch],
    maps: Float64,
    shift_s: float,
    contrast: float,
    base_s: float,
    factors: tuple[float, ...],
    declared: Float64,
) -> Match:
    """Return all hypotheses at a shift, those indistinguishable from the best with the vehicle's motion."""
    chosen = _mixed(moving)
    grid = inertial_grid(imu, origin_ns, chosen, 1.5, base_s + shift_s)
    path = integrate(grid, maps)
    shifts = np.array([-0.25, -0.125, 0.0, 0.125, 0.25])
    fit = fit_costs(chosen, grid, path, shifts)
    cost = fit.cost.min(axis=2)
    best = np.unravel_index(np.argmin(cost), cost.shape)
    above = cost - cost[best]
    fine = float(shifts[np.argmin(fit.cost[best])])
    near = max(int(np.count_nonzero(above < LOOKED_AT)), RANKED)
    order = [int(k) for k in np.argsort(above.ravel())[:near]]
    not_ranked = np.sort(above.ravel())[near:]
    as_declared = np.flatnonzero((np.sign(maps) == declared).all(axis=(1, 2)))
    order += [int(2 * h + side) for h in as_declared for side in (0, 1)]
    ranked = []
    for h, side in (divmod(k, 2) for k in dict.fromkeys(order)):
        reading = PathReading(path, grid.start_s, h, 1 - 2 * side, fine)
        along, down = _directions(chosen, reading)
        factor, noses_of = factors[h // 48], tuple(noses(chosen, reading, down))
        gyro_map, cost = maps[h] / factor, float(above[h, side])
        ranked.append(Hypothesis(gyro_map, factor, reading.handed, cost, along, down, noses_of))
    unit = np.arange(len(maps)) // 48
    others = above[unit != unit[best[0]]]
    total = shift_s + (0.0 if shift_s == 0.0 else fine)
    return Match(
        total,
        contrast,
        ranked,
        float(not_ranked.min(initial=np.inf)),
        float(others.min(initial=np.inf)),
        float(fit.rms[best].min()),
        moving,
    )


def _mixed(moving: list[GnssStretch]) -> list[GnssStretch]:
    """Return those with most motion and, of a long log, others spread over the rest: runs as well as turns."""
    if len(moving) <= AXIS_STRETCHES:
        return moving
    first = AXIS_STRETCHES // 2
    spread = np.linspace(first, len(moving) - 1, AXIS_STRETCHES - first).astype(int)
    return moving[:first] + [moving[k] for k in spread]


def _directions(chosen: list[GnssStretch], reading: PathReading) -> tuple[Float64, Float64]:
    """Return the mean directions of motion and of gravity in sensor axes under one hypothesis."""
    along, down, epochs, least = np.zeros(3), np.zeros(3), 0.0, least_speed(chosen)
    for i, stretch in enumerate(chosen):
        lag = lag_of(stretch.t_s)
        gained, q = reading.at(i, stretch.t_s)
        Q = best_rotation(
            stretch.s_e[lag:] - stretch.s_e[:-lag], gained[lag:] - gained[:-lag], reading.handed
        )
        back = q * np.array([1.0, -1.0, -1.0, -1.0])
        along_e, fast = directions_of(stretch, least)
        along += rotate(back[fast], along_e @ Q).sum(axis=0)
        epochs += float(fast.sum())
        down += rotate(back, np.broadcast_to(-stretch.up_e @ Q, (len(q), 3))).mean(axis=0)
    return mean_direction(along, epochs, epoch_weight(chosen[0])), down / len(chosen)
