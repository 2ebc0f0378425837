"""A receiver's report at each row of a run: date, satellites, quality, dilution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.geodesy.directions import directions
from insgnss.report.epochs import satellites_used
from insgnss.report.run_time import gps_week, utc_dates
from insgnss.runs.result import Run
from insgnss.tables import Bool, Float64, Int64

_LATE_EPOCHS: Final = 2.5  # usual intervals since the latest epoch, after which a row is dead reckoning
_HEADING_SIGMA_DEG: Final = 30.0  # a heading of a larger sigma is not reported: 104 is that of any direction


@dataclass(frozen=True)
class NavSolution:
    """One entry for each row of the navigation table (n,)."""

    nav: pd.DataFrame  # with height above mean sea level and heading
    week: int  # GPS week of nav's time_s
    utc: npt.NDArray[np.datetime64]
    satellites: Int64  # used in the latest epoch, 0 in dead reckoning
    hdop: Float64  # of these satellites, NaN where they leave it open
    dead_reckoning: Bool  # no satellite was used in the latest epoch, or that is long ago
    heading_known: Bool
    differential: bool  # a base station corrected the ranges

    def columns(self, *names: str) -> list[list[float]]:
        """Return columns of the navigation table as lists."""
        return [self.nav[name].tolist() for name in names]


def solution(run: Run) -> NavSolution:
    """Return the report of a receiver.

    Raises
    ------
    ResultError : the run does not say its GPS week
    """
    nav, week = run.nav_with(sea_level=True, heading=True), gps_week(run)
    time_s = nav["time_s"].to_numpy()
    epochs, count = satellites_used(run)
    if len(epochs) == 0:
        epochs, count = np.array([-np.inf]), np.array([0])
    # a row is at its epoch to the nanosecond, but seconds of the week round
    latest = np.maximum(np.searchsorted(epochs, time_s + 1e-6, side="right") - 1, 0)
    usual_s = float(np.median(np.diff(epochs))) if len(epochs) > 1 else np.inf
    age_s = time_s - epochs[latest]
    dead = (count[latest] == 0) | (age_s > _LATE_EPOCHS * usual_s) | (age_s < -1e-6)
    one = nav["n_hypotheses"].to_numpy() <= 1
    return NavSolution(
        nav=nav,
        week=week,
        utc=utc_dates(time_s, week),
        satellites=np.where(dead, 0, count[latest]),
        hdop=np.where(dead, np.nan, _hdop(run.satellites, epochs)[latest]),
        dead_reckoning=dead,
        heading_known=one & (nav["sd_yaw_deg"].to_numpy() < _HEADING_SIGMA_DEG),
        differential=_has_base(run),
    )


def _has_base(run: Run) -> bool:
    flight = run.settings.get("flight")
    gnss = flight.get("gnss") if isinstance(flight, Mapping) else None
    return isinstance(gnss, Mapping) and gnss.get("base") is not None


def _hdop(satellites: pd.DataFrame, epochs: Float64) -> Float64:
    """Return the horizontal dilution of precision at each epoch (n,), NaN where the tracked satellites leave it open.

    Equation: N = sum over systems of (sum u u^T - s s^T / m), s = sum u of its m satellites, which leaves a clock to
    each system; HDOP^2 = (N^-1)_nn + (N^-1)_ee
    """
    tracked = satellites[satellites["state"].isin(("tracked", "used_for_start"))]
    u = directions(tracked["az_deg"], tracked["el_deg"])
    epoch = np.searchsorted(epochs, tracked["time_s"].to_numpy() - 1e-6)
    letters, system = np.unique(tracked["sv"].astype("str").str[:1], return_inverse=True)
    N = np.zeros((len(epochs) + 1, 3, 3))
    np.add.at(N, epoch, u[:, :, None] * u[:, None, :])
    for number in range(len(letters)):
        s, m = np.zeros((len(epochs) + 1, 3)), np.zeros(len(epochs) + 1)
        np.add.at(s, epoch[system == number], u[system == number])
        np.add.at(m, epoch[system == number], 1.0)
        N -= s[:, :, None] * s[:, None, :] / np.maximum(m, 1.0)[:, None, None]
    hdop = np.full(len(epochs), np.nan)
    solvable = np.linalg.det(N[:-1]) > 1e-9
    Q = np.linalg.inv(N[:-1][solvable])
    hdop[solvable] = np.sqrt(Q[:, 0, 0] + Q[:, 1, 1])
    return hdop
