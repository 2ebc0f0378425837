"""The antenna's track from the GNSS log alone: velocities and clocks of single-epoch solutions, with their tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from insgnss.constants import C_MPS, NS_PER_S
from insgnss.errors import InsGnssError
from insgnss.gnss.point.integrity import EXCLUDED, NOT_IDENTIFIED, OK, UNTESTED
from insgnss.gnss.point.rows import PointLog
from insgnss.tables import Bool, Float64, GnssTable, Int64

# on and above the Earth, where logs come from; a solution elsewhere has wrong satellites
NEAREST_M: Final = 6.33e6
FARTHEST_M: Final = 4.0e7
VELOCITY_FLOOR_MPS: Final = 0.02  # no single epoch of range rates is better
# Of all ranges together, in their sigmas: reflections make it 4, leap seconds 600 at least
REFLECTED_SIGMAS: Final = 30.0
# A longer step between epochs, in their median step and in seconds, is a gap
GNSS_GAP_STEPS: Final = 2.5
_GAP_MIN_S: Final = 1.2
POSITION_SIGMA_MPS: Final = 1.0  # of a velocity out of two positions a second apart


@dataclass(frozen=True)
class GnssTrack:
    """Epochs with a solution; times are GPS time, the receiver's clock taken out."""

    t_s: Float64  # (m,) seconds after ``origin_ns``
    r_e: Float64  # (m, 3) [m]
    v_e: Float64  # (m, 3) [m/s]
    sd_v_mps: Float64  # (m,) of one component
    clock_m: Float64  # (m,)
    drift_mps: Float64  # (m,) NaN without range rates
    origin_ns: int
    n_epochs: int  # of the log
    n_good: int  # epochs whose position passed all tests, or whose ranges contradict it as reflections do
    n_tested: int  # those of them that were tested: there was a redundant row
    sd_time_s: float = 0.0  # how well the times of the velocities are known
    late_s: float = 0.0  # lag of the range rates, taken out of the times
    # of every epoch of the log: chi-square of all its ranges, not finite without a common fit, and their redundancy
    range_chi2: Float64 = field(default_factory=lambda: np.zeros(0))
    range_freedom: Int64 = field(default_factory=lambda: np.zeros(0, np.int64))


def longest_step_s(epoch_s: Float64) -> float:
    """Return the step between epochs beyond which there is a gap, zero for a single epoch [s]."""
    steps = np.diff(epoch_s)
    return max(GNSS_GAP_STEPS * float(np.median(steps)), _GAP_MIN_S) if len(steps) else 0.0


def between_epochs(epoch_s: Float64, t_s: Float64) -> Bool:
    """Return whether times lie between two epochs without a gap between them: values may be interpolated."""
    steps = np.diff(epoch_s)
    after = np.searchsorted(epoch_s, t_s, side="left")
    inside = (after > 0) & (after < len(epoch_s))
    whole = np.zeros(len(t_s), bool)
    whole[inside] = steps[after[inside] - 1] <= longest_step_s(epoch_s)
    return whole | np.isin(t_s, epoch_s)


Solve = Callable[[GnssTable], GnssTrack | None]  # the track of a GNSS log, None where nothing can be solved


def solved_share(solve: Solve, gnss: GnssTable, *, tested: bool) -> float:
    """Return the share of a log's epochs whose pseudoranges agree on a place, zero where nothing can be solved.

    ``tested``: only epochs with more rows than unknowns count.
    """
    try:
        track = solve(gnss)
    except InsGnssError:
        return 0.0
    if track is None or not track.n_epochs:
        return 0.0
    return (track.n_tested if tested else track.n_good) / track.n_epochs


def track_of(epoch_ns: Int64, out: PointLog) -> GnssTrack:
    """Return the track of single-epoch solutions, without those that failed a test."""
    distance = np.linalg.norm(out.r_e, axis=1)
    near = (distance > NEAREST_M) & (distance < FARTHEST_M)
    good = near & np.isin(out.verdict[:, 0], (OK, EXCLUDED, UNTESTED))
    faulty = near & (out.verdict[:, 0] == NOT_IDENTIFIED)
    used = good | faulty
    reflected = faulty & (out.statistic[:, 0] < REFLECTED_SIGMAS**2 * out.freedom[:, 0])
    v_e = out.v_e
    sd = np.sqrt(np.einsum("mii->m", out.P_v[:, :3, :3]) / 3.0)
    t_s = (epoch_ns - epoch_ns[0]) / NS_PER_S
    if not np.isfinite(v_e[used, 0]).any():
        v_e, sd = velocities_by_positions(t_s, out.r_e, used)
    used &= np.isfinite(v_e[:, 0]) & np.isfinite(out.clock_m[:, 0])
    clock_m = out.clock_m[used, 0]
    return GnssTrack(
        t_s[used] - clock_m / C_MPS,
        out.r_e[used],
        v_e[used],
        np.maximum(sd[used], VELOCITY_FLOOR_MPS),
        clock_m,
        out.drift_mps[used],
        int(epoch_ns[0]),
        len(epoch_ns),
        int((good | reflected).sum()),
        int((good & (out.verdict[:, 0] != UNTESTED)).sum()),
        range_chi2=out.statistic[:, 0],
        range_freedom=out.freedom[:, 0],
    )


def velocities_by_positions(t_s: Float64, r_e: Float64, used: Bool) -> tuple[Float64, Float64]:
    """Return velocities between the neighbours of each epoch and their sigma, where the log has no range rates."""
    v_e = np.full_like(r_e, np.nan)
    sd = np.full(len(t_s), np.nan)
    at = np.flatnonzero(used)
    if len(at) > 2:
        span = t_s[at[2:]] - t_s[at[:-2]]
        v_e[at[1:-1]] = (r_e[at[2:]] - r_e[at[:-2]]) / span[:, None]
        sd[at[1:-1]] = POSITION_SIGMA_MPS / span
    return v_e, sd
