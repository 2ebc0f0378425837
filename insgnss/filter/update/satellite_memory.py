"""What is remembered of each band of a satellite from epoch to epoch, compiled."""

from __future__ import annotations

import math
from typing import Final

from insgnss.filter.rows.lines import Line
from insgnss.filter.rows.usual_variance import usual_variance
from insgnss.filter.update.consistency import residual_variance
from insgnss.filter.update.integrity import OUTLIER2, explained_by, explained_variance
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE
from insgnss.kernels.jit import kernel
from insgnss.status import DRIFTING, GATED, USED
from insgnss.tables import Float64

# columns of ``memory``: of the ranges the fast and the slow mean [m] and when [s]; of the rates the mean [m/s], when
# and since when [s]; until when the satellite's band is left out [s];
# the range rate that may repeat, and the satellite's own and the row's variance when it began [m/s], [m^2/s^2]
FAST, SLOW, RANGE_S, RATE, RATE_S, RATE_SINCE_S, LEFT_OUT_S = range(7)
REPEATED, REPEATED_MOTION, REPEATED_VARIANCE = 7, 8, 9
# since when the others have contradicted its range rate, and when they did so last [s]
CONTRADICTED_SINCE_S, CONTRADICTED_S = 10, 11
# mean square of its range rate's residual over the variance, and when [s] (``satellite_noise``)
SQUARE, SQUARE_S = 12, 13
# mean over five seconds of its pseudorange's residual, scaled to the variance r of a single row [m], and the variance
# of that mean over r (``reflections``)
REFLECTION, REFLECTION_VARIANCE = 14, 15
# of range rates, then of carrier differences, from ``LASTING`` on: when [s], means over five seconds of the residual in
# sigmas and of its square, variance of the first over that of one residual (``lasting_errors``)
LASTING, N_LASTING = 16, 4
# probability that its carrier phase is not locked, and when [s] (``phase_locks``)
UNLOCKED, UNLOCKED_S = 24, 25
# mean square of its range rate about ``RATE`` [m^2/s^2]
SCATTER = 26

RATE_MEAN_S: Final = 10.0
FORGOTTEN_S: Final = 5.0  # a satellite unseen for longer starts again
_FAST_MEAN_S: Final = 5.0
_SLOW_MEAN_S: Final = 30.0
_MOST_SIGMAS: Final = 10.0  # that one rate counts
_TOO_WIDE: Final = 9.0  # predicted over the row's own variance: a clock that is not known yet


@kernel(inline=True)
def takes_part(line: Line, kind: int) -> bool:
    """Return whether a row can show its satellite's error: its clock is known, and a range is inside its gate.

    A range rate may be out of its gate, or left out: a permanent one is the fault searched for.
    """
    if kind == RANGE_RATE:
        return bool(line.status[kind] == USED or line.status[kind] == GATED or line.status[kind] == DRIFTING)
    return bool(line.status[kind] == USED and line.predicted[kind] <= _TOO_WIDE * line.variance[kind])


@kernel(inline=True)
def carry_means(mean: Float64, line: Line, kind: int, now: float, fit: Float64) -> None:
    """Update one row's means by its residual after ``fit``."""
    value = line.innovation[kind] - explained_by(line, kind, fit)
    if kind == PSEUDORANGE:
        carry_range_means(mean, value, value / math.sqrt(shown_share(line, value, fit)), now)
        return
    limit = _MOST_SIGMAS * math.sqrt(usual_variance(line, kind))
    value = min(max(value, -limit), limit)
    since = now - mean[RATE_S]
    mean[RATE_S] = now
    if not 0.0 <= since <= FORGOTTEN_S:
        mean[RATE], mean[RATE_SINCE_S], mean[SCATTER] = value, now, -math.inf
        return
    new = 1.0 - math.exp(-since / RATE_MEAN_S)
    square = (value - mean[RATE]) ** 2
    mean[RATE] += new * (value - mean[RATE])
    if not mean[SCATTER] >= 0.0:
        mean[SCATTER] = square
    else:
        mean[SCATTER] += max(new, since / (now - mean[RATE_SINCE_S])) * (square - mean[SCATTER])


@kernel(inline=True)
def shown_share(line: Line, residual: float, fit: Float64) -> float:
    """Return the variance of a pseudorange's residual after ``fit`` over that of the row, 1 -+ g D g^T / r.

    A row that stands out is not in the fit (``fit_freely``).
    """
    r = line.variance[PSEUDORANGE]
    explained = explained_variance(line, PSEUDORANGE, fit) / r
    if residual * residual > OUTLIER2 * r:
        return float(1.0 + explained)
    return residual_variance(1.0, explained)


@kernel(inline=True)
def carry_range_means(mean: Float64, value: float, scaled: float, now: float) -> None:
    """Update the means of a pseudorange's residual; ``scaled`` has the variance r of a single row."""
    since = now - mean[RANGE_S]
    mean[RANGE_S] = now
    if not 0.0 <= since <= FORGOTTEN_S:
        mean[FAST], mean[SLOW] = value, value
        mean[REFLECTION], mean[REFLECTION_VARIANCE] = scaled, 1.0
        return
    fast = 1.0 - math.exp(-since / _FAST_MEAN_S)
    mean[FAST] += fast * (value - mean[FAST])
    mean[REFLECTION] += fast * (scaled - mean[REFLECTION])
    mean[REFLECTION_VARIANCE] = variance_of_mean(mean[REFLECTION_VARIANCE], fast)
    mean[SLOW] += (1.0 - math.exp(-since / _SLOW_MEAN_S)) * (value - mean[SLOW])


@kernel(inline=True)
def variance_of_mean(before: float, new: float) -> float:
    """Return the variance of a fading mean over that of one value, once a value has entered with the share ``new``."""
    return (1.0 - new) ** 2 * before + new * new
