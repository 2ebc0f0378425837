"""The error of the GNSS tags, from 0.05 s to some ten seconds, estimated from the pseudoranges alone.

Tags that are late by t put each satellite where it is t later: its range is off by its range rate times t, of which
position and clock take up only what looks like them. The rest makes chi-square of an epoch a parabola of the shift s,

    c(s) = c_min + (s - t)^2 / sd^2,    sd^2 = 2 h^2 / (c(h) - 2 c(0) + c(-h)),

since range rates change by less than 0.2 m/s in a second.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S, SIGMA_PER_MEDIAN
from insgnss.errors import InsGnssError
from insgnss.log.checks.time_offset import SIGNIFICANT_SIGMAS, SMALLEST_S
from insgnss.log.checks.track import Solve, solved_share
from insgnss.tables import Float64, GnssTable, Int64

PROBE_S: Final = 1.0  # on both sides of a shift
SHIFT_PASSES: Final = 3  # of the search, each from the shift that the one before found
LEAST_FREEDOM: Final = 2  # redundant ranges: with one alone, any error of a range is explained by some shift
_LEAST_TRIED: Final = 3  # epochs, for their median


class TagShift(NamedTuple):
    """Something to be added to the GNSS tags."""

    shift_s: float
    sd_s: float  # of one epoch: errors of the ranges persist from epoch to epoch


def shift_by_ranges(
    solve: Solve, sample: GnssTable, agreeing: float, begin_s: float = 0.0
) -> TagShift | None:
    """Return the shift of the tags that makes the pseudoranges agree; None if they agree as logged, or never agree.

    Parameters
    ----------
    solve : gives the track of a log
    sample : some epochs of the log
    agreeing : least share of the epochs whose ranges must agree with the shift, up to reflections
    begin_s : shift that the search begins at, within some ten seconds of what it finds
    """
    found = TagShift(begin_s, np.inf)
    for _ in range(SHIFT_PASSES):
        parabola = _parabola(solve, sample, found.shift_s)
        if parabola is None or (found.shift_s == 0.0 and not _is_significant(parabola)):
            return None
        found = TagShift(found.shift_s + parabola.shift_s, parabola.sd_s)
    if not _is_significant(found):
        return None
    tagged = sample.later(round(found.shift_s * NS_PER_S))
    return found if solved_share(solve, tagged, tested=False) >= agreeing else None


def is_refuted(solve: Solve, sample: GnssTable, shift_s: float) -> bool:
    """Return whether the pseudoranges agree better with tags a little off a shift than with it."""
    parabola = _parabola(solve, sample, shift_s)
    return parabola is not None and _is_significant(parabola)


def _parabola(solve: Solve, sample: GnssTable, shift_s: float) -> TagShift | None:
    """Return how far from a shift chi-square is lowest, None where it has no minimum or too few ranges."""
    at, late, early = (_chi_square(solve, sample, shift_s + h) for h in (0.0, PROBE_S, -PROBE_S))
    return None if at is None or late is None or early is None else _lowest(at, late, early)


def _is_significant(shift: TagShift) -> bool:
    return abs(shift.shift_s) > max(SIGNIFICANT_SIGMAS * shift.sd_s, SMALLEST_S)


def _chi_square(solve: Solve, sample: GnssTable, seconds: float) -> tuple[Float64, Int64] | None:
    """Return each epoch's chi-square of all its ranges and their redundancy, with so much added to the tags."""
    try:
        track = solve(sample.later(round(seconds * NS_PER_S)))
    except InsGnssError:
        return None
    return None if track is None else (track.range_chi2, track.range_freedom)


def _lowest(
    at: tuple[Float64, Int64], late: tuple[Float64, Int64], early: tuple[Float64, Int64]
) -> TagShift | None:
    """Return where chi-square is lowest, by the median epoch, and the sigma of one epoch.

    The sigma is that of the ranges, enlarged where they disagree at the lowest point too, or the scatter of the epochs.
    """
    if not len(at[0]) == len(late[0]) == len(early[0]):
        return None
    chi2 = np.stack([early[0], at[0], late[0]])
    freedom = at[1]
    used = np.isfinite(chi2).all(axis=0) & (freedom >= LEAST_FREEDOM)
    used &= (freedom == late[1]) & (freedom == early[1])  # the same satellites
    before, middle, after = chi2[:, used]
    curvature = (before - 2.0 * middle + after) / (2.0 * PROBE_S**2)
    if len(middle) < _LEAST_TRIED or not (curvature > 0.0).all():
        return None
    each_s = (before - after) / (4.0 * PROBE_S * curvature)
    left = np.maximum(middle - curvature * each_s**2, 0.0)
    disagree = float(left.sum() / (freedom[used] - 1).sum())
    shift_s = float(np.median(each_s))
    of_ranges = float(np.median(curvature**-0.5)) * max(1.0, disagree**0.5)
    scatter_s = SIGMA_PER_MEDIAN * float(np.median(np.abs(each_s - shift_s)))
    return TagShift(shift_s, max(of_ranges, scatter_s))
