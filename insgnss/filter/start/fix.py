"""Position, clock and velocity from one epoch alone, with the filter's own corrections: for start and recovery."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from insgnss.constants import C_MPS, NS_PER_S, NS_PER_WEEK
from insgnss.filter.parameters import Parameters
from insgnss.filter.rows.row_noise import model_variance, row_variance
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.least_squares import Ties
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, Rows
from insgnss.gnss.point_solution import INCONSISTENT, SOLVED, UNCHECKED, point_position, point_velocity
from insgnss.gnss.range_model import AIR_DTYPE, place_air, slant_delay
from insgnss.status import USED
from insgnss.tables import Float64, Int64

Bool = npt.NDArray[np.bool_]

_UNCORRECTED_SIGMA_M = 15.0  # of the first pass, which knows no elevation and no atmosphere
_CLOSEST_RADIUS_M, _FARTHEST_RADIUS_M = (
    6.3e6,
    1.0e8,
)  # a fix inside the Earth or far beyond the satellites is none


@dataclass(frozen=True)
class Fix:
    """What one epoch says: the antenna's state at the receiver's time tag."""

    t_ns: int
    r_a: Float64  # (3,) antenna, ECEF [m]
    clocks: Float64  # (g,) clock of each group [m], NaN without satellites
    P: Float64  # (3 + g, 3 + g) covariance of both
    v_a: Float64 | None  # (3,) [m/s], None without range rates
    drift: float  # [m/s], NaN without range rates
    P_v: Float64  # (4, 4)
    rows: Int64  # rows of the log that went in, or might have
    used: npt.NDArray[np.bool_]  # (2, k) which of them the solution used, per kind
    tried: npt.NDArray[np.bool_]  # (2, k) which of them were offered to it
    checked: bool  # there was redundancy and it agreed

    @property
    def n_used(self) -> int:
        """Number of pseudoranges in the solution."""
        return int(self.used[PSEUDORANGE].sum())


def fix_epoch(rows: Rows, epoch: int, par: Parameters, ties: Ties, max_gdop: float) -> Fix | None:
    """Return the point solution of an epoch, or None when it has none that can be trusted."""
    index = np.arange(rows.first[epoch], rows.first[epoch + 1])
    row = rows.observation[index]
    tried = row["status"].T == USED
    sat = rows.sat[index]
    n = 3 + len(ties.home)
    x, P = np.full(n, math.nan), np.zeros((n, n))
    corrected = row["value"][:, PSEUDORANGE] + sat[:, 6]
    use = tried[PSEUDORANGE].copy()
    sigma = np.full(len(index), _UNCORRECTED_SIGMA_M)
    group = row["group"].astype(np.int64)
    status = point_position(sat, corrected, sigma, group, use, np.zeros(3), 2.0 * max_gdop, x, P, ties)
    radius = float(np.linalg.norm(x[:3]))
    if status not in (SOLVED, UNCHECKED, INCONSISTENT) or not _CLOSEST_RADIUS_M < radius < _FARTHEST_RADIUS_M:
        return None
    delay, variance, visible = _corrections(rows, index, x[:3].copy(), int(rows.epoch_ns[epoch]), par)
    use = tried[PSEUDORANGE] & visible
    start = x[:3].copy()
    corrected -= delay
    status = point_position(sat, corrected, np.sqrt(variance[0]), group, use, start, max_gdop, x, P, ties)
    if status not in (SOLVED, UNCHECKED):
        return None
    used = np.zeros_like(tried)
    used[PSEUDORANGE] = use
    xv, P_v = np.full(4, math.nan), np.zeros((4, 4))
    use_rate = tried[RANGE_RATE] & visible
    rates = row["value"][:, RANGE_RATE] + sat[:, 7]
    v_status = point_velocity(sat, rates, np.sqrt(variance[1]), use_rate, x[:3].copy(), max_gdop, xv, P_v)
    with_rates = v_status in (SOLVED, UNCHECKED)
    used[RANGE_RATE] = use_rate & with_rates
    clock = x[3:][np.isfinite(x[3:])][0]
    r_a = x[:3] + (xv[:3] * clock / C_MPS if with_rates else 0.0)
    return Fix(
        t_ns=int(rows.epoch_ns[epoch]),
        r_a=r_a,
        clocks=x[3:].copy(),
        P=P,
        v_a=xv[:3].copy() if with_rates else None,
        drift=float(xv[3]) if with_rates else math.nan,
        P_v=P_v,
        rows=index,
        used=used,
        tried=tried,
        checked=status == SOLVED,
    )


def _corrections(
    rows: Rows, index: Int64, r_a: Float64, t_ns: int, par: Parameters
) -> tuple[Float64, Float64, Bool]:
    """Return delay (k,) [m], variances (2, k) and whether each row is above the masks, seen from ``r_a``."""
    lat, lon, h = ecef_to_geodetic(r_a)
    C_ne = np.zeros((3, 3))
    ecef_to_ned_matrix(lat, lon, C_ne)
    week_s = (t_ns % NS_PER_WEEK) / NS_PER_S
    air = np.zeros(1, AIR_DTYPE)
    place_air(
        air[0], lat, lon, h, week_s, par.use_troposphere, par.pressure_0, par.temperature_0, par.humidity
    )
    k = len(index)
    delay, variance, visible = np.zeros(k), np.ones((2, k)), np.zeros(k, np.bool_)
    u = np.zeros(3)
    for j, i in enumerate(index):
        row = rows.observation[i]
        if row.no_satellite:
            continue
        line_of_sight_range(rows.sat, i, r_a, u)
        u_n = C_ne @ u
        sine = float(-u_n[2])
        visible[j] = sine >= par.sine_mask and not row.cn0 < par.cn0_mask
        delay[j] = slant_delay(
            air[0], rows.klobuchar, u_n, row.ionosphere_factor * par.use_ionosphere, row.ionosphere_m
        )
        variance[:, j] = _variances(row, sine, par)
    return delay, variance, visible


def _variances(row: np.record, sine: float, par: Parameters) -> tuple[float, float]:
    """Return the variances of a row's pseudorange and range rate."""
    # a fix has no history to correct a sigma that the log states too small: the model's is the least
    of_range, of_rate = (
        max(row_variance(row.sigma[kind], sine, row.thermal, of), model_variance(sine, row.thermal, of))
        for kind, of in ((PSEUDORANGE, par.kind[PSEUDORANGE]), (RANGE_RATE, par.kind[RANGE_RATE]))
    )
    return float(row.variance_scale) * of_range, of_rate
