"""The effect of slowly varying range errors on a position, which averaging over epochs does not reduce.

A filter's covariance is about what varies from epoch to epoch. Orbits and clocks of the messages, and what the models
of ionosphere and troposphere leave, do not: they pass into the position as into that of a least-squares solution with
the epoch's own weights,

    G = (H^T W H)^-1 H^T W,    P_slow = sum_s sigma_s^2 g_s g_s^T + sum_j (G a_j) (G a_j)^T

with H = (-u, clock of each group) by row, W = diag(1 / r), g_s the sum of the columns of satellite s, and a_j a pattern
that the whole sky shares: ionosphere at the zenith, its gradients to the north and to the east, troposphere at the
zenith. The clock absorbs most of the rows' common part. [Misra & Enge 2006, 6.1; mapping of a thin shell as in
RTCA DO-229, A.4.4.10]
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import WGS84_A_M
from insgnss.gnss.least_squares import CLOCKS, Ties
from insgnss.tables import Float64, Int64

WORST_PDOP: Final = 6.0  # an epoch of a worse one says nothing: the filter carries earlier ones through it
_SHELL_M: Final = 350_000.0
_AT_SHELL: Final = WGS84_A_M / (WGS84_A_M + _SHELL_M)
_GRADIENT_PER_M: Final = 1.0 / 1_000_000.0  # gradients are per 1000 km
_LEAST_SINE: Final = 0.05  # of the troposphere's mapping, below 3 deg


class SlowSigmas(NamedTuple):
    """Sizes of the slow errors, one sigma."""

    satellite_m: Float64  # (s,) orbit and clock, by the log's number of the satellite
    ionosphere_m: float  # at the zenith, on L1
    gradient_m: float  # of that, over 1000 km
    troposphere_m: float  # at the zenith


class SlowRows(NamedTuple):
    """The pseudoranges that corrected the state, epoch after epoch."""

    epoch: Int64  # (n,) ascending
    u_n: Float64  # (n, 3) line of sight, north-east-down
    r: Float64  # (n,) variance of the noise [m^2]
    sv: npt.NDArray[np.integer]  # (n,)
    group: npt.NDArray[np.integer]  # (n,) clock
    ionosphere_factor: Float64  # (n,) delay against that on L1


def slow_position_variances(rows: SlowRows, sigmas: SlowSigmas, ties: Ties) -> tuple[Int64, Float64]:
    """Return epochs (m,) and the diagonal of P_slow (m, 3) there, north-east-down [m^2].

    Epochs whose geometry is worse than ``WORST_PDOP`` are left out.
    """
    if not len(rows.epoch):
        return np.zeros(0, np.int64), np.zeros((0, 3))
    starts = np.flatnonzero(np.diff(rows.epoch, prepend=rows.epoch[0] - 1))
    at = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(rows.epoch)))
    gain, pdop = _position_gains(rows, starts, at, ties)
    variance = np.zeros((len(starts), 3))
    for pattern in _patterns(rows, sigmas):
        variance += np.add.reduceat(gain * pattern[:, None], starts) ** 2
    # rows of one satellite share its orbit and clock
    order = np.lexsort((rows.sv, at))
    at, sv = at[order], rows.sv[order]
    first = np.flatnonzero((np.diff(at, prepend=-1) != 0) | (np.diff(sv, prepend=-1) != 0))
    of_satellite = np.add.reduceat(gain[order], first)
    np.add.at(variance, at[first], (of_satellite * sigmas.satellite_m[sv[first], None]) ** 2)
    good = pdop < WORST_PDOP
    return rows.epoch[starts][good].astype(np.int64), variance[good]


def _position_gains(
    rows: SlowRows, starts: Int64, at: Int64, ties: Ties
) -> tuple[Float64, npt.NDArray[np.float64]]:
    """Return the first three rows of G, a column for each row (n, 3), and the epochs' PDOP at equal weights."""
    k = 3 + len(ties.home)
    H = np.zeros((len(at), k))
    H[:, :3] = -rows.u_n
    H[np.arange(len(at)), CLOCKS + rows.group] = 1.0
    weighted = H / rows.r[:, None]
    normal = np.empty((len(starts), k, k))
    for i in range(k):
        normal[:, i] = np.add.reduceat(weighted[:, i, None] * H, starts)
    for group in np.flatnonzero(ties.home >= 0):
        i, j = CLOCKS + ties.home[group], CLOCKS + group
        weight = np.where(normal[:, i, i] * normal[:, j, j] > 0.0, ties.weight, 0.0)
        normal[:, [i, j], [i, j]] += weight[:, None]
        normal[:, [i, j], [j, i]] -= weight[:, None]
    # the clock of a group without a row in the epoch is undetermined; what cannot be solved gets a huge PDOP
    normal[:, range(k), range(k)] += np.where(np.einsum("mii->mi", normal) == 0.0, 1.0, 1e-12)
    inverse = np.linalg.inv(normal)[:, :3]
    mean_weight = np.add.reduceat(1.0 / rows.r, starts) / np.diff(starts, append=len(at))
    pdop = np.sqrt(np.abs(np.einsum("mii->m", inverse[:, :, :3])) * mean_weight)
    return np.einsum("nij,nj->ni", inverse[at], weighted), pdop


def _patterns(rows: SlowRows, sigmas: SlowSigmas) -> list[Float64]:
    """Return one sigma of each error that the whole sky shares, as every row has it [m]."""
    north, east, down = rows.u_n.T
    cosine = np.hypot(north, east)
    at_shell = _AT_SHELL * np.minimum(cosine, 1.0)
    ionosphere = rows.ionosphere_factor / np.sqrt(1.0 - at_shell**2)
    # from the receiver to where the line pierces the shell, along the ground
    away_m = WGS84_A_M * (0.5 * np.pi - np.arctan2(-down, cosine) - np.arcsin(at_shell))
    gradient = sigmas.gradient_m * ionosphere * away_m * _GRADIENT_PER_M / np.maximum(cosine, 1e-9)
    troposphere = sigmas.troposphere_m / np.maximum(-down, _LEAST_SINE)
    return [sigmas.ionosphere_m * ionosphere, gradient * north, gradient * east, troposphere]
