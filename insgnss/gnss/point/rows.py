"""The rows a point solution takes and the arrays it gives, for a whole log at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from insgnss.constants import C_MPS
from insgnss.gnss.least_squares import Ties
from insgnss.gnss.point.integrity import NOT_IDENTIFIED, TOO_FEW
from insgnss.gnss.troposphere import Weather
from insgnss.tables import Float64, Int8, Int64


class PointRows(NamedTuple):
    """The log's rows, epochs one after the other; column 0 pseudoranges, 1 range rates."""

    epoch_ns: Int64  # (m,)
    first: Int64  # (m + 1,) first row of each epoch
    sat: Float64  # (n, 8) position, velocity ECEF, clock [m], clock drift [m/s]
    value: Float64  # (n, 2) [m, m/s]
    sigma: Float64  # (n, 2) as stated by the log, else NaN
    status: Int8  # (n, 2) USED where the row may be used
    group: Int64  # (n,) clock
    cn0: Float64  # (n,) [dBHz], NaN where not known
    thermal: Float64  # (n,) ``noise_model.thermal_factor``
    weakness: Float64  # (n,) of the signal [dB], see ``signal_weakness``
    variance_scale: Float64  # (n,) on the modelled variance of the pseudorange
    ionosphere_factor: Float64  # (n,) (f_L1 / f)^2, 0 for no correction
    ionosphere_m: Float64  # (n,) delay on L1 where it is known already, NaN for Klobuchar's model
    klobuchar: Float64  # (8,)


class PointSettings(NamedTuple):
    """Masks, noise and limits; the squares are those of ``noise_model.measurement_variance``."""

    sine_mask: float
    cn0_mask: float  # [dBHz]
    troposphere_factor: float  # 1 or 0
    weather: Weather
    # floor2, elevation2, cn02 [m^2], thermal factor where missing
    range_noise: tuple[float, float, float, float]
    rate_noise: tuple[float, float, float, float]  # [m^2/s^2]
    # variance that a weak signal adds to its pseudorange and its range rate [m^2/dB^2, m^2/s^2/dB^2]
    weak_signal2: tuple[float, float]
    max_gdop: float
    missed_sigmas: float  # normal quantile of a missed detection, for the protection levels
    ties: Ties  # of the clocks
    unmodelled_zenith_m: float  # sigma of an ionosphere that no model removes, at the zenith on L1


class PointLog(NamedTuple):
    """The output of ``solve_epochs``: m epochs, n rows, g clocks; NaN where there is nothing."""

    r_e: Float64  # (m, 3) antenna, ECEF [m]; ``solve_epochs``: at reception, ``at_time_tags``: at the tags
    v_e: Float64  # (m, 3) [m/s]
    clock_m: Float64  # (m, g)
    drift_mps: Float64  # (m,)
    # covariance as the sigmas say, or as the rows in the solution scatter where that is more (``misfit``)
    P: Float64  # (m, 3 + g, 3 + g) of position and clocks
    P_v: Float64  # (m, 4, 4) of velocity and drift
    dop: Float64  # (m, 5) G, P, H, V, T
    level_m: Float64  # (m, 2) horizontal, vertical protection level
    verdict: Int8  # (m, 2) of ``integrity``
    statistic: Float64  # (m, 2) chi-square of all rows offered
    freedom: Int64  # (m, 2) redundant rows among them
    misfit: Float64  # (m, 2) chi-square of the rows in the solution by their redundancy, NaN without any
    n_used: Int64  # (m, 2)
    status: Int8  # (n, 2)
    residual: Float64  # (n, 2) measured minus predicted by the solution
    sigma: Float64  # (n, 2) of the measurement
    normalised: Float64  # (n, 2) residual by its own deviation
    u_n: Float64  # (n, 3) line of sight, north-east-down


def new_point_log(rows: PointRows, n_groups: int) -> PointLog:
    """Return the output of a log, empty."""
    m, n, p = len(rows.epoch_ns), len(rows.group), 3 + n_groups

    def empty(*shape: int) -> Float64:
        return np.full(shape, math.nan)

    return PointLog(
        r_e=empty(m, 3),
        v_e=empty(m, 3),
        clock_m=empty(m, n_groups),
        drift_mps=empty(m),
        P=empty(m, p, p),
        P_v=empty(m, 4, 4),
        dop=empty(m, 5),
        level_m=empty(m, 2),
        verdict=np.full((m, 2), TOO_FEW, np.int8),
        statistic=empty(m, 2),
        freedom=np.zeros((m, 2), np.int64),
        misfit=empty(m, 2),
        n_used=np.zeros((m, 2), np.int64),
        status=rows.status.copy(),
        residual=empty(n, 2),
        sigma=empty(n, 2),
        normalised=empty(n, 2),
        u_n=empty(n, 3),
    )


def at_time_tags(out: PointLog) -> PointLog:
    """Return the solution with positions carried from reception to the receiver's time tags, clock / c later.

    An epoch whose velocity is missing or not to be trusted stays as it is.
    """
    clock_m = np.full(len(out.r_e), math.nan)
    for column in out.clock_m.T[::-1]:
        clock_m = np.where(np.isnan(column), clock_m, column)
    carried = np.isfinite(out.v_e[:, 0]) & np.isfinite(clock_m) & (out.verdict[:, 1] != NOT_IDENTIFIED)
    r_e = out.r_e.copy()
    r_e[carried] += out.v_e[carried] * (clock_m[carried, None] / C_MPS)
    return out._replace(r_e=r_e)
