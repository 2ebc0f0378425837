"""A run as a solution file of RTKLIB (.pos): position, quality, satellites, sigmas and velocity."""

from __future__ import annotations

from typing import Final

import numpy as np
import pandas as pd

from insgnss.gpstime import GPS_EPOCH, week_seconds_to_ns
from insgnss.report.sentences import name_of
from insgnss.report.solution import NavSolution, solution
from insgnss.runs.result import Run
from insgnss.version import __version__

# RTKLIB manual 2.4.2, appendix B.1: Q
_DIFFERENTIAL: Final = 4
_SINGLE: Final = 5
_DEAD_RECKONING: Final = 7  # of rtklib.h; the manual's list ends at 6
_COLUMNS: Final = (
    "latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)"
    "  ratio    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu    sdvne    sdveu    sdvun"
)
_ROW: Final = (
    "%s %14.9f %14.9f %10.4f %3d %3d %8.4f %8.4f %8.4f %8.4f %8.4f %8.4f %6.2f %6.1f"
    " %10.5f %10.5f %10.5f %9.5f %8.5f %8.5f %8.5f %8.5f %8.5f\n"
)
# covariances between axes, which RTKLIB writes as signed roots: north-east, east-up, up-north
_POSITION: Final = (("cov_n_e_m2", 1.0), ("cov_e_d_m2", -1.0), ("cov_n_d_m2", -1.0))
_VELOCITY: Final = (("cov_vn_ve_m2ps2", 1.0), ("cov_ve_vd_m2ps2", -1.0), ("cov_vn_vd_m2ps2", -1.0))


def as_pos(run: Run) -> bytes:
    """Return the run as RTKLIB writes solutions: GPS time, latitude, longitude, height above the ellipsoid.

    Q is 5 (single), 4 (corrected by a base station) or 7 (no satellite used: inertial alone). Covariances between axes
    are 0 where the navigation table has none, as are age and ratio.
    """
    s = solution(run)
    dates = _gps_dates(s)
    head = (
        f"% program   : insgnss {__version__}\n"
        f"% inp file  : {name_of(run)}\n"
        f"% obs start : {dates[0]} GPST (week{s.week:04d} {s.nav['time_s'].iloc[0]:8.1f}s)\n"
        f"% obs end   : {dates[-1]} GPST (week{s.week:04d} {s.nav['time_s'].iloc[-1]:8.1f}s)\n"
        "%\n"
        "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,7:dr,ns=# of satellites)\n"
        f"%  {'GPST':<{len(dates[0]) - 3}} {_COLUMNS}\n"
    )
    return (head + "".join(_ROW % row for row in _rows(s, dates))).encode()


def _gps_dates(s: NavSolution) -> list[str]:
    """Return the rows' GPS dates, to the microsecond where the log's times need it, else to the millisecond."""
    us = np.rint(week_seconds_to_ns(s.week, s.nav["time_s"].to_numpy()) / 1e3).astype(np.int64)
    dates = np.datetime64(GPS_EPOCH, "us") + us.astype("timedelta64[us]")
    texts = np.datetime_as_string(dates, unit="us" if (us % 1000).any() else "ms").tolist()
    return [text.replace("-", "/").replace("T", " ") for text in texts]


def _roots(nav: pd.DataFrame, covariances: tuple[tuple[str, float], ...]) -> list[list[float]]:
    """Return sign(c) sqrt(abs(c)) of covariances, 0 where the table has none."""
    absent = np.zeros(len(nav))
    values = [sign * np.asarray(nav.get(name, absent), np.float64) for name, sign in covariances]
    return [(np.sign(value) * np.sqrt(np.abs(value))).tolist() for value in values]


def _rows(s: NavSolution, dates: list[str]) -> list[tuple[object, ...]]:
    quality = np.where(s.dead_reckoning, _DEAD_RECKONING, _DIFFERENTIAL if s.differential else _SINGLE)
    place = s.columns("lat_deg", "lon_deg", "h_m")
    sd_place = [*s.columns("sd_n_m", "sd_e_m", "sd_d_m"), *_roots(s.nav, _POSITION)]
    velocity = [*s.columns("vn_mps", "ve_mps"), (-s.nav["vd_mps"]).tolist()]
    sd_velocity = [*s.columns("sd_vn_mps", "sd_ve_mps", "sd_vd_mps"), *_roots(s.nav, _VELOCITY)]
    return [
        (date, *at, q, ns, *sd_at, 0.0, 0.0, *v, *sd_v)
        for date, at, q, ns, sd_at, v, sd_v in zip(
            dates,
            zip(*place, strict=True),
            quality.tolist(),
            s.satellites.tolist(),
            zip(*sd_place, strict=True),
            zip(*velocity, strict=True),
            zip(*sd_velocity, strict=True),
            strict=True,
        )
    ]
