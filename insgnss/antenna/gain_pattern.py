"""Gain patterns: the gain of an antenna towards each direction of its own frame, and its slope, compiled.

The antenna frame a is laid like the body's: x forward, y right, z down; an antenna that looks at the zenith of a level
vehicle has the mounting rotation of identity. Elevation counts towards the boresight, -z_a; azimuth from x_a towards
y_a. Gains are in dBic, against an isotropic antenna of the signal's circular polarisation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from insgnss.kernels.jit import kernel
from insgnss.tables import Float64, Int64

_LEAST_LEVEL: Final = 1e-9  # sine of the angle to a pole below which azimuth says nothing [rad]
_HALF_PI: Final = 0.5 * math.pi
_TWO_PI: Final = 2.0 * math.pi


@dataclass(frozen=True)
class GainTable:
    """A pattern as its file holds it: both poles among the elevations, no azimuth twice."""

    name: str
    frequency_hz: float
    polarisation: str
    source: str
    elevation_deg: Float64  # (n,) from -90 to 90, strictly increasing
    # (m,) from 0, strictly increasing, below 360; one alone where the gain does not depend on it
    azimuth_deg: Float64
    gain_dbic: Float64  # (n, m), one value in each pole's row


class Pattern(NamedTuple):
    """The patterns of one or more antennas on even grids, one after another, as the kernels read them."""

    # (sum,) of each antenna n_rows x (n_columns + 1) values, the first column again as the last
    gain_dbic: Float64
    shape: Int64  # (k, 3) where the antenna's values begin, n_rows, n_columns
    per_rad: Float64  # (k, 2) rows and columns per radian


def pattern_of(tables: Sequence[GainTable]) -> Pattern:
    """Return the patterns of one or more antennas on even grids, which hold the nodes of the tables' grids.

    An uneven grid is refined to the largest step that divides all of its own (in thousandths of a degree); between the
    nodes the refined values are those of the same bilinear interpolation, so nothing changes.
    """
    values, shape, per_rad, first = [], [], [], 0
    for table in tables:
        rows = _even(table.elevation_deg, 180.0)
        columns = _even(np.append(table.azimuth_deg, 360.0), 360.0)
        around = np.column_stack([table.gain_dbic, table.gain_dbic[:, 0]])
        along = np.array([np.interp(rows, table.elevation_deg, column) for column in around.T]).T
        azimuth = np.append(table.azimuth_deg, 360.0)
        even = np.array([np.interp(columns, azimuth, row) for row in along])
        values.append(even.ravel())
        shape.append((first, len(rows), len(columns) - 1))
        per_rad.append(((len(rows) - 1) / math.pi, (len(columns) - 1) / _TWO_PI))
        first += even.size
    return Pattern(
        np.concatenate(values),
        np.array(shape, np.int64).reshape(-1, 3),
        np.array(per_rad, np.float64).reshape(-1, 2),
    )


def even_step_deg(nodes_deg: Float64) -> float:
    """Return the largest step that divides all steps of a grid, in whole thousandths of a degree."""
    steps = np.rint(np.diff(nodes_deg) * 1000.0).astype(np.int64)
    return float(np.gcd.reduce(steps)) / 1000.0


def _even(nodes_deg: Float64, span_deg: float) -> Float64:
    count = round(span_deg / even_step_deg(nodes_deg))
    return np.asarray(nodes_deg[0] + span_deg * np.arange(count + 1) / count)


@kernel(inline=True)
def gain_at(pattern: Pattern, k: int, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return gain [dBic] and its gradient on the unit sphere [dB/rad] of antenna ``k`` towards (x, y, z) in a.

    Equation: bilinear in elevation and azimuth; the last column is the first again, so there is no seam, and the row
    of a pole has one value, so there is no jump. grad = dg/d_el e_el + dg/d_az e_az / cos el.
    At a node the slope is that of one of the neighbouring cells; at a pole itself the one along azimuth zero.
    A direction that is not a number has no gain: NaN, which no comparison passes, and no slope.

    Parameters
    ----------
    pattern : of all antennas
    k : which of them
    x, y, z : unit direction from the antenna to the satellite, antenna frame
    """
    level = math.sqrt(x * x + y * y)
    azimuth = math.atan2(y, x)
    if azimuth < 0.0:
        azimuth += _TWO_PI
    first, n_rows, n_columns = pattern.shape[k, 0], pattern.shape[k, 1], pattern.shape[k, 2]
    per_row, per_column = pattern.per_rad[k, 0], pattern.per_rad[k, 1]
    row = (math.atan2(-z, level) + _HALF_PI) * per_row
    column = azimuth * per_column
    if not (row >= 0.0 and column >= 0.0):
        return math.nan, 0.0, 0.0, 0.0
    i, j = min(int(row), n_rows - 2), min(int(column), n_columns - 1)
    t, s = row - i, column - j
    at = first + i * (n_columns + 1) + j
    below, above = pattern.gain_dbic[at], pattern.gain_dbic[at + n_columns + 1]
    across_below = pattern.gain_dbic[at + 1] - below
    across_above = pattern.gain_dbic[at + n_columns + 2] - above
    below += s * across_below
    above += s * across_above
    up = (above - below) * per_row
    cosine, sine = 1.0, 0.0
    if level > _LEAST_LEVEL:
        cosine, sine = x / level, y / level
    around = (across_below + t * (across_above - across_below)) * per_column / max(level, _LEAST_LEVEL)
    # e_el = (-sin el cos az, -sin el sin az, -cos el), e_az = (-sin az, cos az, 0), sin el = -z
    return (
        below + t * (above - below),
        up * z * cosine - around * sine,
        up * z * sine + around * cosine,
        -up * level,
    )
