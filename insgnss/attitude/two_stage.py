"""The two-stage way, for comparison: whole cycles first, by an integer search for each baseline, then the attitude.

Stage one takes the nearest integer vectors of each baseline (``integer_search``), keeps those whose baseline has its
known length, joins those at their known angles to each other, and ranks the rest by the joint fit of all
phases. Nothing is used unless the best one fits, and fits better than the second by a ratio.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincinv

from insgnss.attitude.array_observability import require_attitude
from insgnss.attitude.attitude_fit import CoarseBaselines, PhaseRows, fit_attitude, wahba
from insgnss.attitude.baselines import (
    AntennaArray,
    Sky,
    difference_covariance,
)
from insgnss.attitude.cycle_search import SHARE_REFUSED
from insgnss.attitude.integer_search import nearest_integers
from insgnss.errors import ConfigError
from insgnss.tables import Float64, Int64

Clocks = Literal["common", "separate"]
CANDIDATES: Final = 2000  # searched for each baseline: ranges to 1 m and 5 satellites leave some hundreds
# of the second loss to the first; a loss has tens of degrees of freedom and varies by a third
RATIO: Final = 2.0
_SIGMAS: Final = 4.5  # of a length or a product of two baselines
_MOST_COMBINATIONS: Final = 2000  # of baselines, each a fit of a fifth of a millisecond
_MOST_ANTENNAS_PERMUTED: Final = 5
_SAME_CARRIER: Final = 1e-9


@dataclass(frozen=True)
class Solution:
    """The attitude of one epoch, and whether it may be used."""

    is_valid: bool
    reason: str  # why not, or ""
    # (3, 3) of the best whole cycles; None where nothing fits: not to be used if not valid
    C_nb: Float64 | None
    covariance_n: Float64 | None  # (3, 3) of its error as a rotation vector in n [rad^2]
    cycles: Int64 | None  # (M - 1, R)
    loss: float  # of the best
    ratio: float  # second loss over the best
    swapped: tuple[int, ...] = ()  # an order of the antennas that fits where the given one does not


@dataclass(frozen=True)
class Epoch:
    """The measurements of all antennas' receivers at one moment.

    ``clocks``: "common" where one oscillator drives all receivers and the delays of the cables are taken off;
    "separate" where each has its own: then satellites are differenced too, and all need one carrier.
    """

    array: AntennaArray
    sky: Sky
    phase: Float64  # (M - 1, N) differences against the first antenna, any whole cycles [rad]
    phase_variance: Float64  # (M, N) of each antenna's phase [rad^2]
    range_m: Float64 | None = None  # (M - 1, N) differences of pseudoranges against the first antenna
    range_variance: Float64 | None = None  # (M, N) [m^2]
    clocks: Clocks = "common"

    def __post_init__(self) -> None:
        require_attitude(self.array, self.sky)
        wave = self.sky.wavelength_m
        if self.clocks == "separate" and np.ptp(wave) > _SAME_CARRIER:
            raise ConfigError(
                "the clocks of separate receivers do not cancel in whole cycles of different carriers",
                key="clocks",
                advice="solve each carrier (each GLONASS channel) alone, or drive the receivers by one oscillator",
            )
        if (self.range_m is None) != (self.range_variance is None):
            raise ConfigError("ranges need variances", key="range_variance", advice="give both or neither")

    def differences(self) -> Float64:
        """Return how rows are made from satellites, (R, N): the unit matrix, or each against the first."""
        n = len(self.sky.los_n)
        if self.clocks == "common":
            return np.eye(n)
        return np.hstack([-np.ones((n - 1, 1)), np.eye(n - 1)])

    def rows(self, array: AntennaArray) -> PhaseRows:
        """Return the phases as rows, for the antennas in an order that may not be the given one."""
        D = self.differences()
        R = np.einsum("rn,nmk,sn->mrks", D, difference_covariance(self.phase_variance), D)
        size = R.shape[0] * R.shape[1]
        return PhaseRows(array, self.sky, self.phase @ D.T, R.reshape(size, size), D)

    def rough(self, guess_C_nb: npt.ArrayLike | None, guess_sd_rad: float) -> CoarseBaselines:
        """Return rough baselines from the ranges, and from a guess of the attitude where there is one.

        Raises
        ------
        ConfigError : neither ranges nor a guess: phases alone leave every baseline open
        """
        count = len(self.array.baselines_b)
        known, slope = np.zeros((count, 3, 3)), np.zeros((count, 3))
        if self.range_m is not None and self.range_variance is not None:
            D, H = self.differences(), -self.differences() @ self.sky.los_n
            for m in range(count):
                R = D @ np.diag(self.range_variance[0] + self.range_variance[m + 1]) @ D.T
                known[m] += H.T @ np.linalg.solve(R, H)
                slope[m] += H.T @ np.linalg.solve(R, D @ self.range_m[m])
        if guess_C_nb is not None:
            for m, l_n in enumerate(self.array.baselines_b @ np.asarray(guess_C_nb, np.float64).T):
                along = np.outer(l_n, l_n) / (l_n @ l_n)
                # the length is known to a millimetre, the direction to the guess
                P = guess_sd_rad**2 * (l_n @ l_n) * (np.eye(3) - along) + 1e-6 * along
                known[m] += np.linalg.inv(P)
                slope[m] += np.linalg.solve(P, l_n)
        if np.linalg.cond(known).max() > 1e12:
            raise ConfigError(
                "phases alone leave every baseline open",
                key="range_m",
                advice="give pseudoranges of four satellites or more, or a guess of the attitude",
            )
        P = np.asarray(np.linalg.inv(known))
        return CoarseBaselines(np.einsum("mij,mj->mi", P, slope), P)


@dataclass(frozen=True)
class _Choice:
    """Whole cycles of one baseline and the baseline they make."""

    cycles: Int64  # (R,)
    vector_n: Float64  # (3,) [m]


def solve(
    epoch: Epoch, guess_C_nb: npt.ArrayLike | None = None, guess_sd_rad: float = 0.1, ratio: float = RATIO
) -> Solution:
    """Return the attitude of one epoch from its phases, whole cycles resolved, and whether it passed the checks.

    Parameters
    ----------
    guess_C_nb, guess_sd_rad : an attitude known beforehand, as from gyros, and its standard deviation on each axis
    ratio : of the second best loss to the best that is asked for

    Raises
    ------
    GeometryError : antennas on one line, or fewer than two satellites
    ConfigError : nothing to start from
    """
    rough = epoch.rough(guess_C_nb, guess_sd_rad)
    solution = _resolved(epoch, epoch.array, rough, ratio)
    if solution.is_valid or not solution.loss > _largest_loss(epoch):
        return solution
    swapped = _fitting_order(epoch, rough, ratio) if guess_C_nb is None else ()
    if not swapped:
        return solution
    names = ", ".join(epoch.array.names[i] for i in swapped)
    return Solution(
        False,
        f"the antennas do not fit in the given order, and fit in the order {names}: their cables are swapped",
        *(None, None, None),
        solution.loss,
        solution.ratio,
        swapped,
    )


def _resolved(epoch: Epoch, array: AntennaArray, rough: CoarseBaselines, ratio: float) -> Solution:
    rows = epoch.rows(array)
    own = [_choices(rows, rough, m) for m in range(len(array.baselines_b))]
    fits = []
    choices = list(itertools.islice(_joined(array, own, _vector_sd(rows)), _MOST_COMBINATIONS + 1))
    if any(one is None for one in own) or len(choices) > _MOST_COMBINATIONS:
        reason = "too many whole cycles are possible: ranges or guess are too coarse for these satellites"
        return Solution(False, reason, None, None, None, math.nan, math.nan)
    for choice in choices:
        cycles = np.stack([one.cycles for one in choice])
        start = wahba([one.vector_n for one in choice], array.baselines_b, 1.0)
        fits.append((fit_attitude(start.C_nb, rows, cycles, rough), cycles))
    if not fits:
        reason = "no whole cycles give the baselines their known lengths and angles"
        return Solution(False, reason, None, None, None, math.inf, math.nan)
    fits.sort(key=lambda fit: fit[0].loss)
    best, cycles = fits[0]
    second = fits[1][0].loss if len(fits) > 1 else math.inf
    reason = ""
    if best.loss > _largest_loss(epoch):
        reason = f"the best whole cycles do not fit: loss {best.loss:.3g} above {_largest_loss(epoch):.3g}"
    elif second < ratio * best.loss:
        reason = f"two sets of whole cycles fit almost equally well: ratio {second / best.loss:.2f} below {ratio:g}"
    return Solution(not reason, reason, best.C_nb, best.covariance_n, cycles, best.loss, second / best.loss)


def _largest_loss(epoch: Epoch) -> float:
    """Return the loss that one right solution in 10 000 exceeds."""
    count = len(epoch.array.baselines_b)
    return _quantile(count * (len(epoch.differences()) + 3) - 3)


def _quantile(freedom: int) -> float:
    """Return the chi-square that one right solution in 10 000 exceeds."""
    return 2.0 * float(gammaincinv(0.5 * freedom, 1.0 - SHARE_REFUSED))


def _choices(rows: PhaseRows, rough: CoarseBaselines, m: int) -> list[_Choice] | None:
    """Return all likely whole cycles of one baseline that give it its known length; None where they are too many."""
    cycles = _likely_cycles(rows, rough, m)
    if cycles is None:
        return None
    H, own = rows.wave_rows(), _own_covariance(rows, m)
    known = np.linalg.inv(rough.covariance[m])
    P = np.linalg.inv(H.T @ np.linalg.solve(own, H) + known)
    gain = P @ H.T @ np.linalg.inv(own)
    vectors = (rows.phase[m] + 2.0 * math.pi * cycles) @ gain.T + P @ known @ rough.vectors_n[m]
    size = np.linalg.norm(vectors, axis=1)
    sd = np.sqrt(np.einsum("ki,ij,kj->k", vectors, P, vectors)) / np.maximum(size, 1e-9)
    fits = np.abs(size - rows.array.lengths_m[m]) < _SIGMAS * sd
    return [_Choice(c, v) for c, v in zip(cycles[fits], vectors[fits], strict=True)]


def _likely_cycles(rows: PhaseRows, rough: CoarseBaselines, m: int) -> Int64 | None:
    """Return the whole cycles of one baseline within the chi-square limit, the likeliest first; None for too many.

    A list cut off before the limit may lack the right ones, and a wrong remaining set could pass every later check by
    chance. The length enters as a direction drawn from all, l^2 / 3 on each axis, which costs the right ones exactly
    3.
    """
    R, length = rows.phase.shape[1], float(rows.array.lengths_m[m])
    P = np.linalg.inv(np.linalg.inv(rough.covariance[m]) + 3.0 / length**2 * np.eye(3))
    centre = P @ np.linalg.solve(rough.covariance[m], rough.vectors_n[m])
    H, turn = rows.wave_rows(), 2.0 * math.pi
    real = (H @ centre - rows.phase[m]) / turn
    Q = (H @ P @ H.T + _own_covariance(rows, m)) / turn**2
    limit = 3.0 + _quantile(R)
    cycles = nearest_integers(real, Q, CANDIDATES, limit).integers
    return None if len(cycles) == CANDIDATES else cycles


def _own_covariance(rows: PhaseRows, m: int) -> Float64:
    R = rows.phase.shape[1]
    return rows.covariance[m * R : (m + 1) * R, m * R : (m + 1) * R]


def _vector_sd(rows: PhaseRows) -> Float64:
    """Return the largest standard deviation of a component of each baseline with its cycles resolved, (M - 1,) [m]."""
    H, sds = rows.wave_rows(), []
    for m in range(len(rows.phase)):
        known = H.T @ np.linalg.solve(_own_covariance(rows, m), H)
        sds.append(1.0 / math.sqrt(max(float(np.linalg.eigvalsh(known)[0]), 1e-6)))
    return np.array(sds)


def _joined(
    array: AntennaArray, own: list[list[_Choice] | None], sd: Float64, chosen: tuple[_Choice, ...] = ()
) -> Iterator[tuple[_Choice, ...]]:
    """Yield one choice for each baseline, of those at their known angles to each other."""
    m = len(chosen)
    if m == len(own):
        yield chosen
        return
    l_b, lengths = array.baselines_b, array.lengths_m
    for one in own[m] or ():
        if all(
            abs(one.vector_n @ other.vector_n - l_b[m] @ l_b[k])
            < _SIGMAS * math.hypot(lengths[k] * sd[m], lengths[m] * sd[k])
            for k, other in enumerate(chosen)
        ):
            yield from _joined(array, own, sd, (*chosen, one))


def _fitting_order(epoch: Epoch, rough: CoarseBaselines, ratio: float) -> tuple[int, ...]:
    """Return the first other order of the antennas in which the epoch is resolved; empty where there is none."""
    count = len(epoch.array.positions_b)
    if count > _MOST_ANTENNAS_PERMUTED:
        return ()
    for order in itertools.permutations(range(count)):
        if (
            order != tuple(range(count))
            and _resolved(epoch, epoch.array.reordered(order), rough, ratio).is_valid
        ):
            return order
    return ()


def equivalent_orders(array: AntennaArray) -> list[tuple[int, ...]]:
    """Return the orders of the antennas indistinguishable from the given one: all distances are equal.

    Antennas in one plane have mirror images that are rotations: two of an equilateral triangle may be swapped, and the
    attitude comes out turned over. Unequal distances between all antennas exclude it.
    """
    distance = np.linalg.norm(array.positions_b[:, None] - array.positions_b[None], axis=-1)
    count = len(distance)
    same = []
    for order in itertools.permutations(range(count)):
        other = distance[np.ix_(order, order)]
        if order != tuple(range(count)) and np.allclose(other, distance, rtol=0.0, atol=0.02):
            same.append(order)
    return same


def is_turned_over(C_nb: npt.ArrayLike, sky: Sky) -> bool:
    """Return whether most satellites would be below the antennas (which look along minus z of the body).

    That is what two swapped antennas of a symmetric array look like where lengths and angles cannot decide.
    """
    up_n = -np.asarray(C_nb, np.float64)[:, 2]
    return bool(np.mean(sky.los_n @ up_n) < 0.0)
