"""Epochs of ranges with known truth for the tests of the point solution: a sky, an antenna, noise, faults."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pymap3d

from insgnss.gnss.least_squares import RANGE, FitRows, Ties, free_clocks, workspace
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.gnss.point.integrity import Fits, agree, redundancy_room
from insgnss.runs.point import chi_square_limits
from insgnss.tables import Float64

PLACE = (48.78, 9.17, 320.0)  # [deg, deg, m]
R_E = np.array(pymap3d.geodetic2ecef(*PLACE))
CLOCK_M = 83_211.7
# azimuth and elevation [deg]; any first n of at least four are a fair geometry
SKY = (
    *((20, 30), (140, 45), (250, 20), (300, 75), (90, 15), (200, 60)),
    *((340, 12), (60, 50), (170, 25), (280, 35), (110, 65), (230, 10)),
)


class Sky:
    """Satellites seen from ``PLACE``, their true ranges, and the test's room."""

    def __init__(
        self,
        n: int = 10,
        groups: Sequence[int] | None = None,
        sigma_m: float = 1.0,
        false_alarm: float = 1e-3,
        ties: Ties | None = None,
    ) -> None:
        places = [pymap3d.aer2ecef(az, el, 2.2e7, *PLACE) for az, el in SKY[:n]]
        self.sat = np.hstack([np.array(places), np.zeros((n, 5))])
        self.group = np.array(groups if groups is not None else [0] * n, np.int64)
        self.sigma = np.full(n, sigma_m)
        u = np.zeros(3)
        distances = [line_of_sight_range(self.sat, k, R_E, u) for k in range(n)]
        self.ranges = np.array(distances) + CLOCK_M + 25.0 * self.group
        p = 3 + int(self.group.max()) + 1
        self.fits = Fits(chi_square_limits(n, false_alarm), workspace(p), redundancy_room(n))
        self.ties = free_clocks(p - 3) if ties is None else ties
        self.x, self.P, self.use = np.zeros(p), np.zeros((p, p)), np.ones(n, np.bool_)
        self.statistic, self.freedom = np.nan, 0

    def rows(self, ranges: Float64) -> FitRows:
        """Return the rows as the solution takes them."""
        return FitRows(RANGE, self.sat, ranges, self.sigma, self.group, self.ties, np.zeros(len(self.x)))

    def solve(self, ranges: Float64) -> int:
        """Return the verdict on an epoch's ranges; the solution stays in ``x``, ``P`` and ``use``."""
        self.use[:] = True
        start = np.zeros(len(self.x))
        found = agree(self.rows(ranges), self.use, start, self.x, self.P, self.fits)
        verdict, self.statistic, self.freedom = found
        return verdict

    def excluded(self) -> list[int]:
        """Return the rows the solution left out."""
        return [int(k) for k in np.flatnonzero(~self.use)]

    def error_m(self) -> float:
        """Return the distance of the solution from the truth."""
        return float(np.linalg.norm(self.x[:3] - R_E))

    def noisy(
        self, rng: np.random.Generator, faults: dict[int, float] | None = None
    ) -> npt.NDArray[np.float64]:
        """Return ranges with noise of the stated sigma and the given faults [m] added."""
        ranges = self.ranges + self.sigma * rng.normal(size=len(self.sigma))
        for k, size in (faults or {}).items():
            ranges[k] += size
        return ranges
