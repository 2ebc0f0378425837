"""Solution separation: a sub-filter for each fault runs over the log without its satellites, from the start on.

The fault does not affect its solution x_k, of sigma s_k. The full solution x_0 differs from it by d_k = x_k - x_0, so
the error of x_0 is at most |d_k| larger than that of x_k, whatever the fault has done to x_0. With the fault's
probability p_k and the same part r of the risk for each of the faults and for their absence,

    L = max(K(r) s_0, max_k(|d_k| + K(r / p_k) s_k)),  K(r) the normal quantile: |x| > K with probability r

The risk of a row is that of the settings less the probability of the faults that no sub-filter covers (``faults``).
Where nothing is left of it the level is infinite.

Both sigmas include the range errors that last, each filter's own: as its states, or else by its gains
(``update.slow_errors``).

[Brenner 1996, Integrated GPS/inertial fault detection availability, Navigation 43(2); Blanch et al. 2015, Baseline
advanced RAIM user algorithm, IEEE Trans. Aerosp. Electron. Syst. 51(1)]. An alert is |d_k| beyond K s_k. The difference
of both variances would be too small a measure of d_k: the adaptive noise levels of the sub-filters are their own.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
import pymap3d

from insgnss.config.integrity import Integrity
from insgnss.errors import StartError
from insgnss.filter.output.total_sigmas import total_values
from insgnss.filter.output.writing import NAV_COLUMNS, Table
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import LedgerPart, OutputRate, run_blocks
from insgnss.gnss.observation_rows import GnssRows
from insgnss.runs.integrity.alerts import AXES, Separations, alert_events, epoch_misfit, fault_table
from insgnss.runs.integrity.faults import Fault, fault_model, without
from insgnss.tables import Event, Float64, ImuTable, Int64

_SHARES: Final = (0.25, 0.25, 0.5)  # of the risk: north, east, down
_PLACE = slice(0, 3)  # latitude, longitude, height in a navigation row
_SIGMA = slice(NAV_COLUMNS.index("sd_n_m"), NAV_COLUMNS.index("sd_d_m") + 1)


class Job(NamedTuple):
    """The inputs of the full filter, which its sub-filters have too."""

    setup: FilterSetup
    imu: ImuTable
    blocks: list[GnssRows]
    output: OutputRate
    smooth: bool


class Separation(NamedTuple):
    """The solutions of k sub-filters relative to the full one at n rows; NaN where a sub-filter has none."""

    faults: list[Fault]
    unmonitored: Float64  # (n,) probability of the faults that no sub-filter covers
    d: Float64  # (k, 3, n) north, east, down [m]
    sigma: Float64  # (k, 3, n)
    misfit: Float64  # (k, m) of the measurements at each epoch (``alerts.epoch_misfit``)
    epoch_ns: Int64  # (m,)


class Protection(NamedTuple):
    """Protection levels of a solution, and how far each fault moves it."""

    hpl_m: Float64  # (n,) of the solution's rows
    vpl_m: Float64
    faults: pd.DataFrame  # a row for each fault
    events: list[Event]


def separation_of(job: Job, nav: Table, ledger: list[LedgerPart], tell: Callable[[str], None]) -> Separation:
    """Return the separation of the solution without each fault's satellites from a solution's navigation rows.

    ``ledger`` is that of the solution. The sub-filters share the processor's cores, unless the rows include a
    measurement of the user's own.
    """
    model = fault_model(job.blocks, job.setup.config.integrity)
    tell(f"running {len(model.faults)} sub-filters")
    with ThreadPoolExecutor(job.setup.threads) as pool:
        solutions = list(pool.map(lambda fault: _sub_filter(job, fault, nav, ledger), model.faults))
    d, sigma = (
        np.array([one[i] for one in solutions]).reshape(len(solutions), len(AXES), len(nav)) for i in (0, 1)
    )
    misfit = np.array([one[2] for one in solutions]).reshape(len(solutions), len(model.epoch_ns))
    unmonitored = model.unmonitored_at(np.asarray(nav["t_ns"]))
    return Separation(model.faults, unmonitored, d, sigma, misfit, model.epoch_ns)


def protection_of(separation: Separation, nav: pd.DataFrame, t_ns: Int64, config: Integrity) -> Protection:
    """Return protection levels for navigation rows at ``t_ns``, and how far each fault moves the solution."""
    sigma = nav[[f"sd_{axis}_m" for axis in AXES]].to_numpy().T
    p = np.array([fault.probability for fault in separation.faults])
    risk = np.maximum(config.risk - separation.unmonitored, 0.0)
    hpl_m, vpl_m = protection_levels(sigma, separation.d, separation.sigma, p, risk)
    separations = Separations(
        *(separation.faults, separation.d, alert_limits(separation.sigma, config), t_ns),
        *(nav["time_s"].to_numpy(), separation.misfit, separation.epoch_ns),
    )
    events = alert_events(separations) + _spent_risk(separation.unmonitored, t_ns, config)
    return Protection(hpl_m, vpl_m, fault_table(separations), events)


def protection_levels(
    sigma: Float64, d: Float64, of_faults: Float64, p: Float64, risk: Float64
) -> tuple[Float64, Float64]:
    """Return the horizontal and the vertical level of n rows, (n,) each.

    Parameters
    ----------
    sigma : (3, n) of the full solution, north, east, down
    d, of_faults : (k, 3, n) separation and sigma of the sub-filters
    p : (k,) probability of each fault
    risk : (n,) that is left for what the levels bound
    """
    levels = [
        protection_level(sigma[i], d[:, i], of_faults[:, i], p, share * risk)
        for i, share in enumerate(_SHARES)
    ]
    return np.hypot(levels[0], levels[1]), levels[2]


def alert_limits(of_faults: Float64, config: Integrity) -> Float64:
    """Return the separation that each sub-filter, of a sigma (k, 3, n), may have without an alert."""
    return np.asarray(_quantile(config.false_alert / (len(AXES) * max(len(of_faults), 1))) * of_faults)


def protection_level(
    sigma: Float64, d: Float64, of_faults: Float64, p: Float64, risk: Float64 | float
) -> Float64:
    """Return the level that one axis' error exceeds with at most the risk (n,); infinite without a sub-filter's row.

    Parameters
    ----------
    sigma : (n,) of the full solution
    d, of_faults : (k, n) separation and sigma of the sub-filters
    p : (k,) probability of each fault; one that is rarer than its part of the risk is left out
    risk : (n,) or for all rows; the level is infinite where it is zero
    """
    part = np.broadcast_to(np.asarray(risk) / (len(p) + 1), sigma.shape)
    level = _finite_or_infinite(_quantile(part) * sigma)
    for k in np.flatnonzero(p > part.min(initial=1.0)):
        bound = np.abs(d[k]) + _quantile(np.minimum(part / p[k], 1.0)) * of_faults[k]
        level = np.where(p[k] > part, np.maximum(level, _finite_or_infinite(bound)), level)
    return level


def _finite_or_infinite(level: Float64) -> Float64:
    return np.where(np.isnan(level), np.inf, level)


def _quantile(risk: Float64 | float) -> Float64:
    """Return K with P(|x| > K) = risk of a standard normal x."""
    from scipy.special import ndtri  # here: every replay would pay for it

    return np.asarray(-ndtri(0.5 * np.asarray(risk)))


def _spent_risk(unmonitored: Float64, t_ns: Int64, config: Integrity) -> list[Event]:
    """Return the event of rows whose level is infinite because nothing is left of the risk."""
    rows = np.flatnonzero(unmonitored >= config.risk)
    if not len(rows):
        return []
    where = f"in {len(rows)} of {len(unmonitored)} rows"
    detail = spent_risk(where, float(unmonitored.max()), config)
    return [Event(int(t_ns[rows[0]]), "integrity_risk_spent", detail)]


def spent_risk(where: str, unmonitored: float, config: Integrity) -> str:
    """Return why the protection levels are infinite, in words."""
    return (
        f"no protection level {where}: two faults at once, which no sub-filter covers, have a probability of up to"
        f" {unmonitored:.1e}, integrity.risk is {config.risk:.1e}; raise it, or lower integrity.satellite_fault and"
        " integrity.constellation_fault"
    )


def _sub_filter(
    job: Job, fault: Fault, nav: Table, ledger: list[LedgerPart]
) -> tuple[Float64, Float64, Float64]:
    """Return a sub-filter's solution less the full one and its sigma, (3, n), NaN where it has none, and its misfit."""
    d, sigma = np.full((3, len(nav)), np.nan), np.full((3, len(nav)), np.nan)
    blocks = [without(rows, fault.satellites) for rows in job.blocks]
    try:
        out, own_ledger, _ = run_blocks(job.setup, job.imu, blocks, job.output, smooth=job.smooth)
    except StartError:
        return d, sigma, np.zeros(sum(len(rows.epoch_ns) for rows in job.blocks))
    rows = out.nav[: out.counts[0].nav]
    _, here, there = np.intersect1d(nav["t_ns"], rows["t_ns"], return_indices=True)
    d[:, here], sigma[:, here] = from_full(nav[here], rows[there])
    return d, sigma, epoch_misfit(job.blocks, own_ledger, ledger)


def from_full(nav: Table, rows: Table) -> tuple[Float64, Float64]:
    """Return the separation of a sub-filter's navigation rows from the full filter's at equal times, and their sigma.

    Both north, east, down [m] (3, n).
    """
    full, sub = nav["value"], rows["value"]
    difference = [
        b - a
        for a, b in zip(
            pymap3d.geodetic2ecef(*full[:, _PLACE].T), pymap3d.geodetic2ecef(*sub[:, _PLACE].T), strict=True
        )
    ]
    return np.array(pymap3d.ecef2nedv(*difference, full[:, 0], full[:, 1])), place_sigma(rows)


def place_sigma(rows: Table) -> Float64:
    """Return the sigmas of the position, the errors that last included: north, east, down [m] (3, n)."""
    return total_values(rows)[:, _SIGMA].T
