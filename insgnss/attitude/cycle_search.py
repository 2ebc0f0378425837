"""Whole cycles of phase differences from an attitude that is partly known: level, but perhaps no heading.

Every attitude that the prior leaves is visited on a grid so fine that rounding from its nearest node gives the whole
cycles; each distinct set of them is fitted, all differences at once, with the lengths and angles of the antennas held
and the prior's level as two more measurements. One set alone must fit. It serves one baseline as well as many, where
``two_stage`` needs antennas off one line and ranges.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.special import gammaincinv

from insgnss.attitude.array_observability import SAME_DIRECTION
from insgnss.geodesy.rotations import rotation_matrices
from insgnss.tables import Float64, Int64

_STEP_CYCLES: Final = 0.2  # by which no difference changes more from node to node, about each axis
_LEVEL_SIGMAS: Final = 3.0  # of the level that the grid covers; the fit goes beyond it where it must
_MOST_NODES: Final = 150_000  # a fifth of a second
_MOST_FITTED: Final = 3_000  # nearest nodes, before duplicate sets are removed
_NEWTON_STEPS: Final = 3  # Newton's, from a degree away
SHARE_REFUSED: Final = 1e-4  # of right sets and solutions, by the test of their fit


@dataclass(frozen=True)
class DifferenceRows:
    """Phase differences of one epoch between pairs of antennas, whole cycles left open."""

    l_b: Float64  # (R, 3) from the first antenna of each pair to its second, body axes [m]
    u_n: Float64  # (R, 3) unit vectors, receiver to satellite, north-east-down
    value_m: Float64  # (R,) as ranges: grows as the second antenna goes away from the satellite
    wavelength_m: Float64  # (R,)
    covariance: Float64  # (R, R) [m^2]
    clock: Int64  # (R,) number of the unknown clock difference in each; -1 where the clock is common


def clock_columns(clock: Int64) -> Float64:
    """Return which clock difference is in which row, (R, clocks), of each row's number; -1: none."""
    numbers = np.unique(clock[clock >= 0])
    return np.asarray(clock[:, None] == numbers, np.float64)


class Prior(NamedTuple):
    """An attitude known beforehand, and the headings around it to search."""

    C_nb: Float64  # (3, 3)
    sd_level: float  # [rad] about each level axis
    reach: float  # [rad] to both sides of its heading, at most pi
    wound_m: Float64 | None = None  # (R,) wind-up in the differences at this attitude; None: none


@dataclass(frozen=True)
class CycleFix:
    """The whole cycles that fit best, and whether they may be used."""

    is_valid: bool
    reason: str  # why not, or ""
    fits: bool  # whether the best set passes its own test
    C_nb: Float64  # (3, 3) of the fit
    cycles: Int64  # (R,) to be taken off: value - wavelength cycles is the difference of ranges
    loss: float  # chi-square with ``freedom`` degrees where the cycles are right
    ratio: float  # loss of the second best set over it


def find_cycles(rows: DifferenceRows, priors: Sequence[Prior], ratio: float = 2.0) -> CycleFix:
    """Return the whole cycles of an epoch, valid where one set alone fits.

    A set is believed where its loss is below the bound that one right set in 10 000 exceeds, the second best set's is
    above it, and above ``ratio`` times the best one's.

    Equation: loss = min over C of r^T W r + |tilt|^2 / sd_level^2, r = value - wavelength cycles + u^T C l; W is the
    inverse covariance with the clock differences eliminated.
    """
    count = len(rows.value_m)
    if count < 2 or np.linalg.matrix_rank(rows.u_n, tol=SAME_DIRECTION * math.sqrt(count)) < 2:
        return _nothing("fewer than two satellites in different directions")
    rows = _less_clocks(rows)
    W, freedom = _weights(rows)
    if freedom < 1:
        return _nothing("too few differences to test a set of whole cycles")
    step = _step(rows)
    if sum(_node_count(prior, step) for prior in priors) > _MOST_NODES:
        return _nothing("the attitude is too uncertain for baselines of this length")
    fits: dict[tuple[int, ...], tuple[float, Float64]] = {}
    for prior in priors:
        for cycles, loss, C in zip(*_fitted(rows, prior, step, W), strict=True):
            key = tuple(cycles.tolist())
            if key not in fits or loss < fits[key][0]:
                fits[key] = (float(loss), C)
    order = sorted(fits, key=lambda key: fits[key][0])
    loss, C = fits[order[0]]
    second = fits[order[1]][0] if len(order) > 1 else math.inf
    largest = 2.0 * float(gammaincinv(0.5 * freedom, 1.0 - SHARE_REFUSED))  # chi-square's quantile
    reason = ""
    if loss > largest:
        reason = f"no whole cycles fit: the best loss is {loss:.3g}, above {largest:.3g}"
    elif second < max(largest, ratio * loss):
        reason = f"several sets of whole cycles fit: losses {loss:.3g} and {second:.3g}, bound {largest:.3g}"
    cycles = np.array(order[0], np.int64)
    return CycleFix(not reason, reason, loss <= largest, C, cycles, loss, second / max(loss, 1e-12))


def _nothing(reason: str) -> CycleFix:
    return CycleFix(False, reason, False, np.eye(3), np.zeros(0, np.int64), math.inf, math.nan)


def _less_clocks(rows: DifferenceRows) -> DifferenceRows:
    """Return the rows with the first of each clock taken off: the remaining clock is small, and costs no digits."""
    value = rows.value_m.copy()
    for clock in np.unique(rows.clock[rows.clock >= 0]):
        own = np.flatnonzero(rows.clock == clock)
        value[own] -= value[own[0]]
    return replace(rows, value_m=value)


def _weights(rows: DifferenceRows) -> tuple[Float64, int]:
    """Return W with the clocks eliminated, (R, R), and the degrees of freedom: rows - clocks + 2 levels - 3 angles."""
    W, B = np.linalg.inv(rows.covariance), clock_columns(rows.clock)
    if B.shape[1]:
        W = W - W @ B @ np.linalg.solve(B.T @ W @ B, B.T @ W)
    return np.asarray(W), len(W) - B.shape[1] - 1


def _step(rows: DifferenceRows) -> float:
    lengths = np.linalg.norm(rows.l_b, axis=1)
    # with clocks of their own it is differences of two satellites that are rounded: they change twice as fast
    twice = np.where(rows.clock >= 0, 2.0, 1.0)
    return float(np.min(_STEP_CYCLES * rows.wavelength_m / (twice * lengths)))


def _axes(prior: Prior, step: float) -> tuple[Float64, Float64]:
    """Return tilts about each level axis and turns of the heading that the grid has."""
    tilts = math.ceil(max(_LEVEL_SIGMAS * prior.sd_level - 0.5 * step, 0.0) / step)
    turns = math.ceil(min(prior.reach, math.pi) / step)
    even = min(prior.reach, math.pi) / turns
    return np.asarray(np.arange(-tilts, tilts + 1) * step), np.asarray(np.arange(-turns, turns + 1) * even)


def _node_count(prior: Prior, step: float) -> int:
    tilts, turns = _axes(prior, step)
    return len(tilts) ** 2 * len(turns)


def _fitted(rows: DifferenceRows, prior: Prior, step: float, W: Float64) -> tuple[Int64, Float64, Float64]:
    """Return the distinct sets of whole cycles near a prior (k, R), their losses (k,) and attitudes (k, 3, 3)."""
    if prior.wound_m is not None:
        rows = replace(rows, value_m=rows.value_m - prior.wound_m)
    tilts, turns = _axes(prior, step)
    pairs = np.array(list(itertools.product(tilts, tilts)))
    level = rotation_matrices(np.pad(pairs, ((0, 0), (0, 1))))
    heading = rotation_matrices(np.pad(turns[:, None], ((0, 0), (2, 0)))) @ prior.C_nb
    C = (level[:, None] @ heading[None]).reshape(-1, 3, 3)
    tilt = np.repeat(pairs, len(turns), axis=0)
    cycles, rest = _rounded(rows, C)
    away = np.sum(rest**2, axis=1)
    near = np.argsort(away, kind="stable")[:_MOST_FITTED]
    cycles, first = np.unique(cycles[near], axis=0, return_index=True)
    C, tilt = C[near][first], tilt[near][first]
    for _ in range(_NEWTON_STEPS):
        C, tilt = _improved(rows, C, tilt, cycles, W, prior.sd_level)
    r = _residuals(rows, C, cycles)
    return cycles, np.einsum("kr,rs,ks->k", r, W, r) + np.sum(tilt**2, axis=1) / prior.sd_level**2, C


def _rounded(rows: DifferenceRows, C: Float64) -> tuple[Int64, Float64]:
    """Return the whole cycles nearest at each attitude and what is left, both (k, R).

    With clocks of their own the first row of each clock has no whole cycle: it is part of the clock.
    """
    r = rows.value_m + _along(rows, C)
    for clock in np.unique(rows.clock[rows.clock >= 0]):
        own = np.flatnonzero(rows.clock == clock)
        r[:, own] -= r[:, own[:1]]
    cycles = np.rint(r / rows.wavelength_m)
    rest = r - rows.wavelength_m * cycles
    for clock in np.unique(rows.clock[rows.clock >= 0]):
        own = rows.clock == clock
        rest[:, own] -= rest[:, own].mean(axis=1, keepdims=True)
    return cycles.astype(np.int64), rest


def _along(rows: DifferenceRows, C: Float64) -> Float64:
    """Return u^T C l, (k, R) [m]."""
    return np.asarray(np.sum((C[:, None] @ rows.l_b[None, :, :, None])[..., 0] * rows.u_n, axis=-1))


def _residuals(rows: DifferenceRows, C: Float64, cycles: Int64) -> Float64:
    return np.asarray(rows.value_m - rows.wavelength_m * cycles + _along(rows, C))


def _improved(
    rows: DifferenceRows, C: Float64, tilt: Float64, cycles: Int64, W: Float64, sd_level: float
) -> tuple[Float64, Float64]:
    """Return attitudes and tilts after one step of Newton: d(-u^T C l) / d phi = u x C l."""
    l_n = (C[:, None] @ rows.l_b[None, :, :, None])[..., 0]
    J = np.cross(rows.u_n[None], l_n)  # (k, R, 3)
    r = _residuals(rows, C, cycles)
    JW = np.swapaxes(J, 1, 2) @ W
    known, slope = JW @ J, (JW @ r[..., None])[..., 0]
    known[:, [0, 1], [0, 1]] += 1.0 / sd_level**2
    known[:, 2, 2] += 1e-6  # a vertical baseline gives no heading
    slope[:, :2] -= tilt / sd_level**2
    phi = np.linalg.solve(known, slope[..., None])[..., 0]
    return rotation_matrices(phi) @ C, tilt + phi[:, :2]
