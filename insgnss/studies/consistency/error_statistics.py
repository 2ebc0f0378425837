"""Errors against a reference beside their sigmas, and how the sigmas of heading and biases came down.

A run holds sigmas, not covariances: the squared error over sigma is summed over the axes of a block without their
correlations. Its mean is the number of axes all the same, whatever the correlations; only its spread grows, and the
bounds take the largest it can be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from insgnss.results.nav_columns import ATTITUDE, POSITION, VELOCITY
from insgnss.runs.agreement import HeadingAgreement
from insgnss.studies.outage.drift import stays_from
from insgnss.tables import Float64

BLOCKS: Final = {"position": POSITION, "velocity": VELOCITY, "attitude": ATTITUDE}
SIGMAS: Final = (
    "sd_yaw_deg",
    "sd_roll_deg",
    "sd_pitch_deg",
    *(f"sd_accel_bias_{axis}_mps2" for axis in "xyz"),
    *(f"sd_gyro_bias_{axis}_radps" for axis in "xyz"),
)
# of its first sigma: below, what is known of a bias comes from the flight, not its grade
BIAS_KNOWN_AT: Final = 0.5
LEAST_ROWS: Final = 10


class ErrorComponent(NamedTuple):
    """One component or block of components against its sigma."""

    component: str
    axes: int
    rows: int
    dof: float  # independent values in time, per axis
    mean: float  # error, in its unit; NaN of a block
    rms: float
    mean_sigma: float
    nees: float  # mean of the squared error over sigma, per axis: 1 is right
    low: float
    high: float
    share_1_sigma: float  # 0.683 is right; NaN of a block
    share_3_sigma: float  # 0.997


def error_rows(errors: pd.DataFrame, from_s: float, confidence: float) -> list[ErrorComponent]:
    """Return the statistics of each component with a reference, then of each whole block, from a time on."""
    table = errors[errors["time_s"] >= from_s]
    components: list[ErrorComponent] = []
    for block, names in BLOCKS.items():
        scaled = [_scaled(table, name) for name in names]
        parts = [_component(table, name, z, confidence) for name, z in zip(names, scaled, strict=True)]
        components += [part for part in parts if part is not None]
        if all(part is not None for part in parts):
            components.append(_block(block, scaled, confidence))
    return components


def _scaled(table: pd.DataFrame, name: str) -> Float64:
    return np.asarray((table[f"d_{name}"] / table[f"sd_{name}"]).to_numpy(np.float64))


def _component(table: pd.DataFrame, name: str, z: Float64, confidence: float) -> ErrorComponent | None:
    known = np.isfinite(z)
    if np.count_nonzero(known) < LEAST_ROWS:
        return None
    z, error = z[known], table[f"d_{name}"].to_numpy()[known]
    count = independent_in_time(z)
    low, high = bounds_of_mean(count, confidence)
    return ErrorComponent(
        name,
        1,
        len(z),
        count,
        float(error.mean()),
        float(np.sqrt(np.mean(error**2))),
        float(table[f"sd_{name}"].to_numpy()[known].mean()),
        float(np.mean(z**2)),
        low,
        high,
        float(np.mean(np.abs(z) <= 1.0)),
        float(np.mean(np.abs(z) <= 3.0)),
    )


def _block(name: str, scaled: Sequence[Float64], confidence: float) -> ErrorComponent:
    z = np.array(scaled)
    z = z[:, np.isfinite(z).all(axis=0)]
    count = min(independent_in_time(row) for row in z)
    # axes that are wholly correlated: the sum of their squares spreads as one axis' square does, times their number
    low, high = bounds_of_mean(count, confidence)
    none = float("nan")
    nees = float(np.mean(z**2))
    return ErrorComponent(name, len(z), z.shape[1], count, none, none, none, nees, low, high, none, none)


def bounds_of_mean(count: float, confidence: float) -> tuple[float, float]:
    """Return the bounds of the mean of ``count`` independent chi-square values of one degree of freedom each.

    Equation: count * mean ~ chi2(count)                                                [Bar-Shalom 2001, 5.4.2]
    """
    tail = 0.5 * (1.0 - confidence)
    dof = max(count, 1.0)
    return float(stats.chi2.ppf(tail, dof) / dof), float(stats.chi2.isf(tail, dof) / dof)


def independent_in_time(z: Float64) -> float:
    """Return how many independent values a series of scaled errors is worth, for the mean of its squares.

    Equation: n / (1 + 2 sum_k rho_k^2), summed up to the first lag with rho_k <= 0: Gaussian squares correlate by rho^2
    Neglects: the effect of the autocorrelation's own uncertainty on it; fewer than some ten correlation times make the
    result little more than an order of magnitude.
    """
    n = len(z)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(z, size)) ** 2
    rho = np.fft.irfft(spectrum, size)[:n]
    if not rho[0] > 0.0:
        return float(n)
    rho = rho / rho[0]
    falls = np.flatnonzero(rho <= 0.0)
    last = int(falls[0]) if len(falls) else n
    return float(n / (1.0 + 2.0 * np.sum(rho[1:last] ** 2)))


def observability_table(nav: pd.DataFrame, heading: HeadingAgreement) -> pd.DataFrame:
    """Return, per state, its sigma at first and last, by what it came down, and from when on it counts as known.

    When the heading became known is what ``heading`` says. A bias is known below half its first sigma: ``known_s`` is
    the first time from which that held to the end, NaN where it does not hold at the end.
    """
    rows = []
    time_s = nav["time_s"].to_numpy()
    for column in SIGMAS:
        if column not in nav or nav[column].empty:
            continue
        sigma = nav[column].to_numpy()
        first = float(sigma[0])
        limit = BIAS_KNOWN_AT * first
        known_s = stays_from(time_s, sigma < limit)
        if column == "sd_yaw_deg":
            limit, known_s = heading.limit_deg, np.nan if heading.known_s is None else heading.known_s
        rows.append(
            {
                "state": column.removeprefix("sd_"),
                "first": first,
                "last": float(sigma[-1]),
                "smallest": float(sigma.min()),
                "reduction": first / float(sigma[-1]) if sigma[-1] > 0.0 else np.inf,
                "limit": limit,
                "known_s": known_s,
            }
        )
    return pd.DataFrame(rows)
