"""The point solution of a whole log, epoch by epoch and each for itself: position, clocks, velocity, integrity.

A first fit without atmosphere says where the antenna is to some tens of metres; seen from there the rows get their
masks, delays and sigmas, until the position stands still. Velocity and common clock drift follow from the range rates.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.dilution import dilution
from insgnss.gnss.ionosphere import shell_mapping
from insgnss.gnss.least_squares import (
    CLOCKS,
    RANGE,
    RANGE_RATE,
    FitRows,
    copy_into,
    count,
    fill,
    free_clocks,
    n_unknowns,
    normal_matrix,
    residual,
    rows_per_clock,
    workspace,
)
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.gnss.noise_model import measurement_variance
from insgnss.gnss.point.integrity import (
    BAD_GEOMETRY,
    EXCLUDED,
    NOT_IDENTIFIED,
    OK,
    TOO_FEW,
    UNTESTED,
    Fits,
    agree,
    protection_levels,
    redundancy,
    redundancy_room,
)
from insgnss.gnss.point.robust_fit import HIGHEST_M, LOWEST_M, spread
from insgnss.gnss.point.rows import PointLog, PointRows, PointSettings
from insgnss.gnss.range_model import AIR_DTYPE, EpochAtmosphere, evaluate_atmosphere, slant_delay
from insgnss.kernels.jit import kernel
from insgnss.status import INCONSISTENT, MASKED_CN0, MASKED_ELEVATION, NO_SOLUTION, USED
from insgnss.tables import Bool, Float64, Int64

_UNCORRECTED_SIGMA_M: Final = 15.0  # of the first fit, which knows no elevation and no atmosphere
_STILL_M: Final = 1.0  # the corrections of a place a metre away differ by less than 2 mm
_MOST_PASSES: Final = 5  # two or three do; more only where a satellite is at the mask


class PointFit(NamedTuple):
    """The solution from the rows of one kind of an epoch: position and clocks, or velocity and drift."""

    use: Bool  # (k,) rows in the solution
    x: Float64  # (3 + groups,) NaN where there is nothing
    P: Float64  # (3 + groups, 3 + groups) as the sigmas say


class _EpochRows(NamedTuple):
    """One epoch's rows that may be used, side by side; k at most."""

    at: Int64  # (k,) row of the log
    sat: Float64  # (k, 8)
    raw: Float64  # (2, k) values corrected for the satellite's clock
    fitted: Float64  # (2, k) corrected for the air as well
    sigma: Float64  # (2, k)
    group: Int64  # (2, k) clock of the pseudorange; the drift is common
    visible: Bool  # (k,)
    offered: Bool  # (2, k)
    C_ne: Float64  # (3, 3)
    air: npt.NDArray[Any]  # (1,) of AIR_DTYPE


@kernel
def new_room(k: int) -> _EpochRows:
    """Return room for an epoch of at most ``k`` rows."""
    return _EpochRows(
        np.zeros(k, np.int64),
        np.zeros((k, 8)),
        np.zeros((2, k)),
        np.zeros((2, k)),
        np.zeros((2, k)),
        np.zeros((2, k), np.int64),
        np.zeros(k, np.bool_),
        np.zeros((2, k), np.bool_),
        np.zeros((3, 3)),
        np.zeros(1, AIR_DTYPE),
    )


@kernel
def _gather(rows: PointRows, epoch: int, room: _EpochRows) -> int:
    """Copy the epoch's rows of which a kind may be used; return how many."""
    k = 0
    for i in range(rows.first[epoch], rows.first[epoch + 1]):
        if rows.status[i, 0] != USED and rows.status[i, 1] != USED:
            continue
        room.at[k] = i
        room.group[0, k] = rows.group[i]
        for j in range(8):
            room.sat[k, j] = rows.sat[i, j]
        for kind in range(2):
            room.offered[kind, k] = rows.status[i, kind] == USED
            room.raw[kind, k] = rows.value[i, kind] + rows.sat[i, 6 + kind]
            room.fitted[kind, k] = room.raw[kind, k]
        k += 1
    return k


@kernel
def _variance(stated: float, sine: float, thermal: float, noise: tuple[float, float, float, float]) -> float:
    """Return a row's variance: the model's is the least, for one epoch cannot correct a sigma stated too small."""
    modelled = measurement_variance(sine, thermal, noise[0], noise[1], noise[2], noise[3])
    return max(stated * stated, modelled) if stated > 0.0 else modelled


@kernel
def _weak_variance(rows: PointRows, settings: PointSettings, i: int, kind: int) -> float:
    """Return what a weak signal adds to a row's variance; a sigma that the log states has it already."""
    stated = rows.sigma[i, kind] > 0.0
    return 0.0 if stated else settings.weak_signal2[kind] * float(rows.weakness[i]) ** 2


@kernel(apart=True)
def see_rows(
    rows: PointRows, settings: PointSettings, t_ns: int, x: Float64, k: int, room: _EpochRows, u_n: Float64
) -> None:
    """Write masks, delays and sigmas of the rows as seen from ``x``."""
    lat, lon, h = ecef_to_geodetic(x)
    ecef_to_ned_matrix(lat, lon, room.C_ne)
    air: EpochAtmosphere = room.air[0]
    week_s = (t_ns % NS_PER_WEEK) / NS_PER_S
    evaluate_atmosphere(air, lat, lon, h, week_s, settings.troposphere_factor, settings.weather)
    u, seen = np.zeros(3), np.zeros(3)
    for j in range(k):
        i = room.at[j]
        line_of_sight_range(room.sat, j, x, u)
        for a in range(3):
            seen[a] = room.C_ne[a, 0] * u[0] + room.C_ne[a, 1] * u[1] + room.C_ne[a, 2] * u[2]
            u_n[i, a] = seen[a]
        sine = -seen[2]
        room.visible[j] = sine >= settings.sine_mask and not rows.cn0[i] < settings.cn0_mask
        delay = slant_delay(air, rows.klobuchar, seen, rows.ionosphere_factor[i], rows.ionosphere_m[i])
        room.fitted[0, j] = room.raw[0, j] - delay
        thermal = float(rows.thermal[i])  # of single precision: plain Python would compute in it
        modelled = _variance(rows.sigma[i, 0], sine, thermal, settings.range_noise)
        left = settings.unmodelled_zenith_m * shell_mapping(sine)
        range_variance = modelled * float(rows.variance_scale[i]) + left * left
        rate_variance = _variance(rows.sigma[i, 1], sine, thermal, settings.rate_noise)
        room.sigma[0, j] = math.sqrt(range_variance + _weak_variance(rows, settings, i, 0))
        room.sigma[1, j] = math.sqrt(rate_variance + _weak_variance(rows, settings, i, 1))


@kernel(apart=True)
def fit_position(
    rows: PointRows,
    settings: PointSettings,
    epoch: int,
    k: int,
    room: _EpochRows,
    fits: Fits,
    solution: PointFit,
    u_n: Float64,
) -> tuple[int, float, int]:
    """Return verdict, statistic and redundant rows of an epoch's position; ``solution`` is the output."""
    use, x = solution.use, solution.x
    start = np.zeros(len(x))
    fit_rows = FitRows(RANGE, room.sat, room.fitted[0], room.sigma[0], room.group[0], settings.ties, start)
    verdict, total, freedom = TOO_FEW, math.nan, 0
    for step in range(_MOST_PASSES + 1):
        if step > 0:
            see_rows(rows, settings, rows.epoch_ns[epoch], x, k, room, u_n)
        for j in range(k):
            use[j] = room.offered[0, j] and (step == 0 or room.visible[j])
            if step == 0:
                room.sigma[0, j] = _UNCORRECTED_SIGMA_M
        verdict, total, freedom = agree(fit_rows, use, start, x, solution.P, fits)
        if verdict == TOO_FEW or verdict == BAD_GEOMETRY:
            break
        radius = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        if not LOWEST_M < radius < HIGHEST_M:
            return (BAD_GEOMETRY if verdict == UNTESTED else NOT_IDENTIFIED), math.nan, -1
        moved = (x[0] - start[0]) ** 2 + (x[1] - start[1]) ** 2 + (x[2] - start[2]) ** 2
        copy_into(x, start)
        if step > 0 and moved < _STILL_M * _STILL_M:
            break
    return verdict, total, freedom


@kernel(apart=True)
def write_rows(
    rows: PointRows,
    settings: PointSettings,
    e: int,
    kind: int,
    solution: PointFit,
    room: _EpochRows,
    fits: Fits,
    out: PointLog,
) -> None:
    """Write status, residual and sigma of one kind of the epoch's rows, which may have no solution."""
    use, x = solution.use, solution.x
    solved, free = not math.isnan(x[0]), free_clocks(len(x) - CLOCKS)
    one = FitRows(kind, room.sat, room.fitted[kind], room.sigma[kind], room.group[kind], free, out.r_e[e])
    for j in range(len(use)):
        if not room.offered[kind, j]:
            continue
        i = room.at[j]
        if not solved:
            out.status[i, kind] = NO_SOLUTION
            continue
        if use[j]:
            out.n_used[e, kind] += 1
        elif room.visible[j]:
            out.status[i, kind] = INCONSISTENT
        else:
            weak = rows.cn0[i] < settings.cn0_mask
            out.status[i, kind] = MASKED_CN0 if weak else MASKED_ELEVATION
        sigma = one.sigma[j]
        out.sigma[i, kind] = sigma
        out.residual[i, kind] = residual(one, j, x, fits.work)
        own = spread(solution.P, fits.work.u, CLOCKS + one.group[j])
        variance = sigma * sigma + (-own if use[j] else own)
        if variance > 1e-6 * sigma * sigma:
            out.normalised[i, kind] = out.residual[i, kind] / math.sqrt(variance)


@kernel
def _forget(use: Bool, group: Int64, x: Float64, P: Float64) -> None:
    """Make the clocks without a row, and their covariances, NaN."""
    for g in range(CLOCKS, len(x)):
        present = False
        for j in range(len(use)):
            present = present or (use[j] and group[j] == g - CLOCKS)
        if not present:
            x[g] = math.nan
            for i in range(len(x)):
                P[i, g] = math.nan
                P[g, i] = math.nan


@kernel
def _misfit(rows: FitRows, solution: PointFit, fits: Fits) -> float:
    """Return chi-square of the rows in the solution by their redundancy, NaN without any."""
    freedom = count(solution.use) - n_unknowns(rows_per_clock(rows, solution.use, len(solution.x) - CLOCKS))
    return normal_matrix(rows, solution.use, solution.x, fits.work) / freedom if freedom > 0 else math.nan


@kernel
def _stretch(misfit: float) -> float:
    """Return the factor on a covariance whose rows scatter more than their sigmas say."""
    return misfit if misfit > 1.0 else 1.0


@kernel
def _write(e: int, position: PointFit, velocity: PointFit, out: PointLog) -> None:
    """Write position and velocity at reception, clocks and covariances of an epoch."""
    p = len(position.x)
    stretch, rate_stretch = _stretch(out.misfit[e, 0]), _stretch(out.misfit[e, 1])
    for a in range(3):
        out.r_e[e, a] = position.x[a]
        out.v_e[e, a] = velocity.x[a]
    for g in range(CLOCKS, p):
        out.clock_m[e, g - CLOCKS] = position.x[g]
    out.drift_mps[e] = velocity.x[3]
    for a in range(p):
        for c in range(p):
            out.P[e, a, c] = position.P[a, c] * stretch
    for a in range(4):
        for c in range(4):
            out.P_v[e, a, c] = velocity.P[a, c] * rate_stretch + 0.0 * velocity.x[0]


@kernel(apart=True)
def solve_position(
    rows: PointRows,
    settings: PointSettings,
    e: int,
    k: int,
    room: _EpochRows,
    fits: Fits,
    solution: PointFit,
    out: PointLog,
) -> int:
    """Solve an epoch for position and clocks; write test, dilution and protection levels, and return the verdict."""
    use, x, P = solution.use, solution.x, solution.P
    verdict, out.statistic[e, 0], freedom = fit_position(rows, settings, e, k, room, fits, solution, out.u_n)
    out.freedom[e, 0] = max(freedom, 0)
    one = FitRows(RANGE, room.sat, room.fitted[0], room.sigma[0], room.group[0], settings.ties, x)
    if verdict != TOO_FEW and verdict != BAD_GEOMETRY and freedom >= 0:
        known = dilution(one, use, x, room.C_ne, fits.work, np.zeros(P.shape), out.dop[e])
        if not (known and out.dop[e, 0] <= settings.max_gdop):
            verdict = BAD_GEOMETRY
    if verdict == TOO_FEW or verdict == BAD_GEOMETRY or freedom < 0:
        fill(x, math.nan)
        return verdict
    out.misfit[e, 0] = _misfit(one, solution, fits)
    if verdict == OK or verdict == EXCLUDED:
        redundancy(one, use, x, P, fits.work, fits.room)
        left = count(use) - n_unknowns(rows_per_clock(one, use, len(x) - CLOCKS))
        sigmas = settings.missed_sigmas * math.sqrt(_stretch(out.misfit[e, 0]))
        out.level_m[e, 0], out.level_m[e, 1] = protection_levels(
            use, fits.room, P, room.C_ne, fits.limits[left], sigmas
        )
    _forget(use, room.group[0], x, P)
    return verdict


@kernel(apart=True)
def solve_velocity(
    settings: PointSettings,
    e: int,
    r_e: Float64,
    room: _EpochRows,
    fits: Fits,
    solution: PointFit,
    out: PointLog,
) -> int:
    """Solve an epoch for velocity and drift at a position, write the test, and return the verdict."""
    use, x = solution.use, solution.x
    for j in range(len(use)):
        use[j] = room.offered[1, j] and room.visible[j]
    one = FitRows(RANGE_RATE, room.sat, room.raw[1], room.sigma[1], room.group[1], free_clocks(1), r_e)
    verdict, out.statistic[e, 1], out.freedom[e, 1] = agree(one, use, np.zeros(4), x, solution.P, fits)
    if verdict != TOO_FEW and verdict != BAD_GEOMETRY:
        dop = np.zeros(5)
        known = dilution(one, use, r_e, room.C_ne, fits.work, np.zeros((4, 4)), dop)
        if not (known and dop[0] <= settings.max_gdop):
            verdict = BAD_GEOMETRY
        out.misfit[e, 1] = _misfit(one, solution, fits)
    if verdict == TOO_FEW or verdict == BAD_GEOMETRY:
        fill(x, math.nan)
    return verdict


@kernel
def solve_epochs(rows: PointRows, settings: PointSettings, limits: Float64, out: PointLog) -> None:
    """Solve every epoch of a log; positions are at the time of reception, clock / c before the tags.

    Parameters
    ----------
    rows, settings : the log and how it is used
    limits : (k + 1,) limit of chi-square by its degrees of freedom; k at least the rows of the largest epoch
    out : ``new_point_log``
    """
    p, most = out.P.shape[1], len(limits)
    room, fits = new_room(most), Fits(limits, workspace(p), redundancy_room(most))
    rate_fits = Fits(limits, workspace(4), fits.room)
    for e in range(len(rows.epoch_ns)):
        k = _gather(rows, e, room)
        position = PointFit(np.zeros(k, np.bool_), np.full(p, math.nan), np.zeros((p, p)))
        velocity = PointFit(np.zeros(k, np.bool_), np.full(4, math.nan), np.full((4, 4), math.nan))
        out.verdict[e, 0] = solve_position(rows, settings, e, k, room, fits, position, out)
        if not math.isnan(position.x[0]):
            out.verdict[e, 1] = solve_velocity(settings, e, position.x, room, rate_fits, velocity, out)
            _write(e, position, velocity, out)
        write_rows(rows, settings, e, 0, position, room, fits, out)
        write_rows(rows, settings, e, 1, velocity, room, rate_fits, out)
