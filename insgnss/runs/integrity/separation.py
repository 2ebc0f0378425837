"""Solution separation: a sub-filter for each fault runs over the log without its satellites, from the start on.

Its solution x_k, of sigma s_k, has no part in the fault. The full solution x_0 is d_k = x_k - x_0 away from it, so its
error is at most |d_k| more than that of x_k, whatever the fault has done to x_0. With the fault's probability p_k and
the same part r of the risk for each of the faults and for none of them,

    L = max(K(r) s_0, max_k(|d_k| + K(r / p_k) s_k)),  K(r) the normal quantile: |x| > K with probability r

Both sigmas hold the errors that last: by states of the filter, or else by ``sd_slow_*`` of the solution, of which the
solution without the satellites is taken to have more as it has more of all others.

[Brenner 1996, Integrated GPS/inertial fault detection availability, Navigation 43(2); Blanch et al. 2015, Baseline
advanced RAIM user algorithm, IEEE Trans. Aerosp. Electron. Syst. 51(1)]. An event reports |d_k| beyond K s_k; that the
sub-filters have a noise level of their own makes the difference of both variances too small a measure of d_k.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
import pymap3d
from scipy.special import ndtri

from insgnss.errors import StartError
from insgnss.filter.output.writing import NAV_COLUMNS, Table
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import OutputRate, run_blocks
from insgnss.gnss.observation_rows import GnssRows
from insgnss.runs.integrity.faults import Fault, faults_of, risk_left, without
from insgnss.tables import Event, Float64, ImuTable, Int64

AXES: Final = ("n", "e", "d")
_SHARES: Final = (0.25, 0.25, 0.5)  # of the risk
_PLACE = slice(0, 3)  # latitude, longitude, height in a navigation row
_SIGMA = slice(NAV_COLUMNS.index("sd_n_m"), NAV_COLUMNS.index("sd_d_m") + 1)


class Job(NamedTuple):
    """The inputs of a sub-filter: everything the full filter used."""

    setup: FilterSetup
    imu: ImuTable
    blocks: list[GnssRows]
    output: OutputRate
    smooth: bool


class Separation(NamedTuple):
    """The solutions of all sub-filters and of the full one, k faults at n rows; NaN where a sub-filter has none."""

    faults: list[Fault]
    risk: float  # what two faults at once leave of it
    d: Float64  # (k, 3, n) north, east, down [m]
    sigma: Float64  # (k, 3, n)


class Protection(NamedTuple):
    """The sub-filters' result for a solution."""

    hpl_m: Float64  # (n,) of the solution's rows
    vpl_m: Float64
    faults: pd.DataFrame  # a row for each fault
    events: list[Event]


def separation_of(job: Job, nav: Table, tell: Callable[[str], None]) -> Separation:
    """Return how far the solution without each fault's satellites is from a solution's navigation rows.

    The sub-filters share the processor's cores, unless a measurement of the user's own is among the rows.

    Raises
    ------
    ConfigError : the risk is less than that of two faults at once
    """
    config = job.setup.config.integrity
    risk, faults = risk_left(job.blocks, config), faults_of(job.blocks, config)
    tell(f"running {len(faults)} sub-filters")
    threads = (os.cpu_count() or 1) if job.setup.own is None else 1
    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(lambda fault: _beside(job, fault, nav), faults))
    d, sigma = (np.array(part) for part in zip(*found, strict=True))
    return Separation(faults, risk, d, sigma)


def protection_of(apart: Separation, nav: pd.DataFrame, t_ns: Int64, false_alert: float) -> Protection:
    """Return protection levels for navigation rows at ``t_ns``, and which fault moves the solution how far."""
    sigma = nav[[f"sd_{axis}_m" for axis in AXES]].to_numpy().T
    slow = [f"sd_slow_{axis}_m" for axis in AXES]
    lasting = nav[slow].to_numpy().T / sigma if slow[0] in nav else np.zeros(sigma.shape)
    more = np.sqrt(1.0 + lasting**2)
    of_faults = apart.sigma * more
    p = np.array([fault.probability for fault in apart.faults])
    levels = [
        protection_level((sigma * more)[i], apart.d[:, i], of_faults[:, i], p, share * apart.risk)
        for i, share in enumerate(_SHARES)
    ]
    limit = _quantile(false_alert / (len(AXES) * len(p))) * of_faults
    alert = np.abs(apart.d) > limit
    table = _table(apart, limit, alert, nav["time_s"].to_numpy())
    return Protection(np.hypot(levels[0], levels[1]), levels[2], table, _alerts(table, alert, t_ns))


def protection_level(sigma: Float64, d: Float64, of_faults: Float64, p: Float64, risk: float) -> Float64:
    """Return the bound on one axis' error at a risk (n,), infinite where a sub-filter has no row.

    Parameters
    ----------
    sigma : (n,) of the full solution
    d, of_faults : (k, n) separation and sigma of the sub-filters
    p : (k,) probability of each fault; one that is rarer than its part of the risk is left out
    """
    each = risk / (len(p) + 1)
    level = np.where(np.isnan(sigma), np.inf, _quantile(each) * sigma)
    for k in np.flatnonzero(p > each):
        beside = np.abs(d[k]) + _quantile(each / p[k]) * of_faults[k]
        level = np.fmax(level, np.where(np.isnan(beside), np.inf, beside))
    return level


def _quantile(risk: float) -> float:
    """Return K with P(|x| > K) = risk of a standard normal x."""
    return float(-ndtri(0.5 * risk))


def _beside(job: Job, fault: Fault, nav: Table) -> tuple[Float64, Float64]:
    """Return a sub-filter's solution less the full one and its sigma, (3, n) each, NaN where it has no row."""
    d, sigma = np.full((3, len(nav)), np.nan), np.full((3, len(nav)), np.nan)
    blocks = [without(rows, fault.satellites) for rows in job.blocks]
    try:
        out, *_ = run_blocks(job.setup, job.imu, blocks, job.output, smooth=job.smooth)
    except StartError:
        return d, sigma
    rows = out.nav[: out.counts[0].nav]
    _, here, there = np.intersect1d(nav["t_ns"], rows["t_ns"], return_indices=True)
    full, sub = nav["value"][here], rows["value"][there]
    apart = [
        b - a
        for a, b in zip(
            pymap3d.geodetic2ecef(*full[:, _PLACE].T), pymap3d.geodetic2ecef(*sub[:, _PLACE].T), strict=True
        )
    ]
    d[:, here] = pymap3d.ecef2nedv(*apart, full[:, 0], full[:, 1])
    sigma[:, here] = sub[:, _SIGMA].T
    return d, sigma


def _table(apart: Separation, limit: Float64, alert: npt.NDArray[np.bool_], time_s: Float64) -> pd.DataFrame:
    """Return for each fault its largest separation over the limit, where and when, and its rows with an alert."""
    ratio = np.nan_to_num(np.abs(apart.d) / limit, nan=0.0)
    rows = []
    for k, fault in enumerate(apart.faults):
        axis, row = np.unravel_index(int(np.argmax(ratio[k])), ratio[k].shape)
        rows.append(
            {
                "fault": fault.name,
                "probability": fault.probability,
                "time_s": time_s[row],
                "axis": AXES[axis],
                "separation_m": apart.d[k, axis, row],
                "limit_m": limit[k, axis, row],
                "alert_rows": int(alert[k].any(axis=0).sum()),
                "rows_without": int(np.isnan(apart.sigma[k, 0]).sum()),
            }
        )
    return pd.DataFrame(rows)


def _alerts(table: pd.DataFrame, alert: npt.NDArray[np.bool_], t_ns: Int64) -> list[Event]:
    """Return an event for each fault that raises an alert, at its first."""
    events = []
    for k in np.flatnonzero(alert.any(axis=(1, 2))):
        first, row = int(np.argmax(alert[k].any(axis=0))), table.iloc[k]
        most = f"{row['separation_m']:+.2f} m {row['axis']} at {row['time_s']:.1f} s"
        detail = (
            f"without {row['fault']} the solution differs in {row['alert_rows']} rows, most by {most},"
            f" limit {row['limit_m']:.2f} m"
        )
        events.append(Event(int(t_ns[first]), "integrity_alert", detail))
    return events
