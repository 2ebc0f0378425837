"""Position, clock and velocity from one epoch alone, with the filter's own corrections: for start and recovery."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from insgnss.filter.parameters import KindNumbers, Parameters
from insgnss.filter.start.rest import MeasuredVelocity
from insgnss.filter.start.start_noise import AS_DECLARED, Misfit
from insgnss.gnss.least_squares import CLOCKS, Ties
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.gnss.point.integrity import EXCLUDED, OK, UNTESTED
from insgnss.gnss.point.log import solve_epochs
from insgnss.gnss.point.rows import PointLog, PointRows, PointSettings, at_time_tags, new_point_log
from insgnss.gnss.troposphere import Weather
from insgnss.status import USED
from insgnss.tables import Bool, Float64, Int64

_FALSE_ALARM_Z: Final = 3.719  # normal quantile of 1 - 1e-4: a false alarm costs one epoch
# what atmosphere and multipath leave in a fix beyond its own covariance; larger where the filter has states for that,
# because the epochs after the fix show the same errors
_BEYOND_M, _BEYOND_WITH_STATES_M = 2.0, 30.0
_TRUSTED: Final = (OK, EXCLUDED, UNTESTED)


def sigma_beyond_m(range_biases: bool) -> float:
    """Return the sigma of a fix's position and clock beyond its own covariance; with range biases as states or not."""
    return _BEYOND_WITH_STATES_M if range_biases else _BEYOND_M


@dataclass(frozen=True)
class Fix:
    """The solution of one epoch: the antenna's state at the receiver's time tag."""

    t_ns: int
    r_a: Float64  # (3,) antenna, ECEF [m]
    clocks: Float64  # (g,) clock of each group [m], NaN without satellites
    P: Float64  # (3 + g, 3 + g) covariance of both
    v_a: Float64 | None  # (3,) [m/s], None without range rates
    drift: float  # [m/s], NaN without range rates
    P_v: Float64  # (4, 4)
    rows: Int64  # rows of the log that went in, or might have
    used: Bool  # (2, k) which of them the solution used, per kind
    tried: Bool  # (2, k) which of them were offered to it
    checked: bool  # there was redundancy and it agreed
    left_out: tuple[frozenset[int], ...] = (frozenset(), frozenset())  # numbers of satellites, per kind

    @property
    def n_used(self) -> int:
        """Number of pseudoranges in the solution."""
        return int(self.used[PSEUDORANGE].sum())

    @property
    def velocity(self) -> MeasuredVelocity | None:
        """The antenna's velocity, ECEF; None without range rates."""
        return None if self.v_a is None else MeasuredVelocity(self.t_ns, self.v_a, self.P_v[:3, :3])

    def clock_variance(self, group: int) -> float:
        """Return the variance of a group's clock [m^2]."""
        return float(self.P[CLOCKS + group, CLOCKS + group])

    def without_velocity(self) -> Fix:
        """Return the position alone."""
        used = self.used.copy()
        used[RANGE_RATE] = False
        return replace(self, v_a=None, drift=math.nan, used=used)

    @property
    def drift_variance(self) -> float:
        """Variance of the clock's drift [m^2/s^2]."""
        return float(self.P_v[CLOCKS, CLOCKS])


def fix_epoch(rows: GnssRows, epoch: int, par: Parameters, ties: Ties, max_gdop: float) -> Fix | None:
    """Return the point solution of an epoch, or None when it has none that can be trusted."""
    return try_fix(rows, epoch, par, ties, max_gdop, AS_DECLARED)[0]


def try_fix(
    rows: GnssRows, epoch: int, par: Parameters, ties: Ties, max_gdop: float, noise: Float64
) -> tuple[Fix | None, Misfit]:
    """Return the point solution of an epoch with the variances times ``noise`` (2,), None when it cannot be trusted.

    And how far its rows disagree.
    """
    first, last = int(rows.first[epoch]), int(rows.first[epoch + 1])
    one = point_rows(rows, par, epoch, epoch + 1)
    one = one._replace(sigma=one.sigma * np.sqrt(noise))
    out = new_point_log(one, len(ties.home))
    solve_epochs(one, _noisier(point_settings(par, ties, max_gdop), noise), _limits(last - first), out)
    out = at_time_tags(out)
    verdict, rate_verdict = int(out.verdict[0, PSEUDORANGE]), int(out.verdict[0, RANGE_RATE])
    agrees = np.isin(out.verdict[0], _TRUSTED) & (noise == 1.0)
    square = np.where(agrees, math.nan, noise * out.statistic[0] / np.maximum(out.freedom[0], 1))
    whole = verdict in (OK, UNTESTED) and noise[PSEUDORANGE] == 1.0
    misfit = Misfit(square, None if whole else _for_the_tag(one, out))
    if verdict not in _TRUSTED:
        return None, misfit
    with_rates = rate_verdict in _TRUSTED
    tried = one.status.T == USED
    used = tried & (out.status.T == USED)
    used[RANGE_RATE] &= with_rates
    sv = rows.observation["sv"][first:last]
    fix = Fix(
        t_ns=int(rows.epoch_ns[epoch]),
        r_a=out.r_e[0],
        clocks=out.clock_m[0],
        P=out.P[0],
        v_a=out.v_e[0] if with_rates else None,
        drift=float(out.drift_mps[0]) if with_rates else math.nan,
        P_v=out.P_v[0],
        rows=np.arange(first, last),
        used=used,
        tried=tried,
        checked=verdict != UNTESTED,
        left_out=tuple(frozenset(sv[row].tolist()) for row in tried & ~used),
    )
    return fix, misfit


def _for_the_tag(rows: PointRows, out: PointLog) -> Float64:
    """Return the pseudoranges of an epoch as ``late_apart`` takes them (n, 6)."""
    there = (rows.status[:, PSEUDORANGE] == USED) & np.isfinite(rows.value[:, RANGE_RATE])
    there &= np.isfinite(out.residual[:, PSEUDORANGE])
    clock = np.ones(int(there.sum()))
    growth, residual = -rows.value[there, RANGE_RATE], out.residual[there, PSEUDORANGE]
    return np.column_stack([out.u_n[there], clock, growth, residual]) / out.sigma[there, PSEUDORANGE, None]


def _noisier(settings: PointSettings, noise: Float64) -> PointSettings:
    """Return the settings with the model's variances times ``noise`` (2,)."""
    floor2, elevation2, cn02, thermal = settings.range_noise
    ranges = (floor2 * noise[0], elevation2 * noise[0], cn02 * noise[0], thermal)
    floor2, elevation2, cn02, thermal = settings.rate_noise
    rates = (floor2 * noise[1], elevation2 * noise[1], cn02 * noise[1], thermal)
    return settings._replace(range_noise=ranges, rate_noise=rates)


def _limits(most: int) -> Float64:
    """Return the value that chi-square exceeds once in 10 000, by its degrees of freedom 0..most.

    Equation: f (1 - s + z sqrt(s))^3, s = 2 / (9 f)                                        [Wilson and Hilferty 1931]
    An approximation in place of ``point_solutions.chi_square_limits``: every replay would pay for the import of
    ``scipy.special`` there.
    """
    freedom = np.arange(1.0, most + 1.0)
    s = 2.0 / (9.0 * freedom)
    return np.append(0.0, freedom * (1.0 - s + _FALSE_ALARM_Z * np.sqrt(s)) ** 3)


def point_rows(rows: GnssRows, par: Parameters, first: int, last: int) -> PointRows:
    """Return the filter's rows of the epochs ``first`` .. ``last`` - 1 as the point solution takes them."""
    begin, end = rows.first[first], rows.first[last]
    row = rows.observation[begin:end]
    return PointRows(
        epoch_ns=rows.epoch_ns[first:last],
        first=rows.first[first : last + 1] - begin,
        sat=rows.sat[begin:end],
        value=np.ascontiguousarray(row["value"][:, :2]),
        sigma=np.ascontiguousarray(row["sigma"][:, :2]),
        status=np.ascontiguousarray(row["status"][:, :2]),
        group=row["group"].astype(np.int64),
        cn0=np.ascontiguousarray(row["cn0"]),
        thermal=np.ascontiguousarray(row["thermal"]),
        weakness=np.ascontiguousarray(row["weakness"]),
        variance_scale=np.ascontiguousarray(row["variance_scale"]),
        ionosphere_factor=row["ionosphere_factor"] * par["use_ionosphere"],
        ionosphere_m=np.ascontiguousarray(row["ionosphere_m"]),
        klobuchar=rows.klobuchar,
    )


def point_settings(
    par: Parameters,
    ties: Ties,
    max_gdop: float,
    missed_sigmas: float = math.nan,
    unmodelled_zenith_m: float = 0.0,
) -> PointSettings:
    """Return masks, air and noise of the filter's parameters for the point solution.

    ``missed_sigmas`` is the normal quantile of a missed detection; without it there are no protection levels.
    ``unmodelled_zenith_m`` is the sigma of an ionosphere that no model removes.
    """

    def noise(kind: int) -> tuple[float, float, float, float]:
        of: KindNumbers = par.kind[kind]
        return float(of.floor2), float(of.elevation2), float(of.cn02), float(of.missing_thermal)

    return PointSettings(
        sine_mask=float(par["sine_mask"]),
        cn0_mask=float(par["cn0_mask"]),
        troposphere_factor=float(par["use_troposphere"]),
        weather=Weather(float(par["pressure_0"]), float(par["temperature_0"]), float(par["humidity"])),
        range_noise=noise(PSEUDORANGE),
        rate_noise=noise(RANGE_RATE),
        weak_signal2=(float(par["weak_signal2"]), float(par["weak_rate2"])),
        max_gdop=max_gdop,
        missed_sigmas=missed_sigmas,
        ties=ties,
        unmodelled_zenith_m=unmodelled_zenith_m,
    )
