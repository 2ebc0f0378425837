"""Which rows of a long series are drawn: the smallest and the largest of each piece, so that no peak is lost."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from insgnss.tables import Float64, Int64

LINE_BREAK_INTERVALS: Final = 5.0  # usual intervals without a row, after which a line is broken


def envelope(values: npt.ArrayLike, at_most: int) -> Int64:
    """Return the indices, in order, of at most ``at_most`` rows that keep the envelope of every column.

    The rows are cut into equal pieces; of each piece the rows with the smallest and the largest value of each column
    stay, and the first and the last row of all. Values that are not numbers are never chosen for their size.

    Parameters
    ----------
    values : (n,) or (n, k)
    at_most : not below 2 k + 2
    """
    table = np.asarray(values, np.float64)
    table = table.reshape(len(table), -1)
    n, k = table.shape
    if n <= at_most:
        return np.arange(n)
    pieces = max((at_most - 2) // (2 * k), 1)
    first = (np.arange(pieces) * n) // pieces
    size = int(np.diff(np.append(first, n)).max())
    rows = np.minimum(first[:, None] + np.arange(size), np.append(first[1:], n)[:, None] - 1)
    chosen = [np.array([0, n - 1])]
    for column in table.T:
        cells = column[rows]
        for extreme, filler in ((np.argmin, np.inf), (np.argmax, -np.inf)):
            at = extreme(np.where(np.isfinite(cells), cells, filler), axis=1)
            chosen.append(rows[np.arange(pieces), at])
    return np.unique(np.concatenate(chosen))


def breaks(time_s: Float64, values: Float64, period: float | None = None) -> Int64:
    """Return the rows before which a line must be broken: after a gap in time, or where an angle jumps by its period.

    Parameters
    ----------
    time_s : (n,)
    values : (n,)
    period : of an angle, in the unit of ``values``; None for other quantities
    """
    step = np.diff(time_s)
    if len(step) == 0:
        return np.empty(0, np.int64)
    broken = step > LINE_BREAK_INTERVALS * float(np.median(step))
    if period is not None:
        broken |= np.abs(np.diff(values)) > period / 2.0
    return np.flatnonzero(broken) + 1


def line(
    time_s: Float64, values: Float64, at_most: int, period: float | None = None
) -> tuple[Float64, Float64]:
    """Return times and values of a line to draw: its envelope, with a NaN wherever it is broken."""
    before = breaks(time_s, values, period)
    points = envelope(values, at_most)
    if len(before) == 0:
        return time_s[points], values[points]
    # both shores of a break stay, the longest breaks first if there are too many of them
    if len(before) > at_most // 4:
        longest = np.argsort(time_s[before] - time_s[before - 1], kind="stable")[-(at_most // 4) :]
        before = np.sort(before[longest])
    points = np.union1d(points, np.concatenate([before, before - 1]))
    at = np.searchsorted(points, before)
    middle = 0.5 * (time_s[before] + time_s[before - 1])
    return np.insert(time_s[points], at, middle), np.insert(values[points], at, np.nan)


def columns_of_time(time_s: Float64, at_most: int) -> tuple[Int64, float, float]:
    """Return the column of a picture each time falls in, the first column's left edge and a column's width [s].

    A column is as wide as the usual interval of the times, or wider, so that there are at most ``at_most``.
    """
    if len(time_s) == 0:
        return np.empty(0, np.int64), 0.0, 1.0
    first, last = float(time_s.min()), float(time_s.max())
    step = np.diff(np.unique(time_s))
    usual = float(np.median(step)) if len(step) else 1.0
    width = max(usual, (last - first) / at_most)
    column = np.floor((time_s - first) / width + 1e-6).astype(np.int64)
    return column, first, width
