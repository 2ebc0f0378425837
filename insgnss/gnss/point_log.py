"""The point solution of a whole log, epoch by epoch and each for itself: position, clocks, velocity, integrity.

A first fit without atmosphere says where the antenna is to some tens of metres; seen from there the rows get their
masks, delays and sigmas, until the position stands still. Velocity and common clock drift follow from the range rates.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.apart import apart
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.geodesy.ellipsoid import ecef_to_geodetic
from insgnss.geodesy.local_level import ecef_to_ned_matrix
from insgnss.gnss.dilution import dilution
from insgnss.gnss.integrity import (
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
from insgnss.gnss.least_squares import (
    RANGE,
    RANGE_RATE,
    Bool,
    FitRows,
    Ties,
    copy,
    count,
    fill,
    free_clocks,
    n_unknowns,
    residual,
    rows_per_clock,
    workspace,
)
from insgnss.gnss.line_of_sight import line_of_sight_range
from insgnss.gnss.noise_model import measurement_variance
from insgnss.gnss.point_rows import PointLog, PointRows, PointSettings
from insgnss.gnss.range_model import AIR_DTYPE, Air, place_air, slant_delay
from insgnss.gnss.robust_fit import spread
from insgnss.jit import kernel
from insgnss.status import INCONSISTENT, MASKED_CN0, MASKED_ELEVATION, NO_SOLUTION, USED
from insgnss.tables import Float64, Int64

_UNCORRECTED_SIGMA_M: Final = 15.0  # of the first fit, which knows no elevation and no atmosphere
# a first fit inside the Earth or far beyond the satellites is none
_CLOSEST_RADIUS_M, _FARTHEST_RADIUS_M = 6.3e6, 1.0e8
_STILL_M: Final = 1.0  # the corrections of a place a metre away differ by less than 2 mm
_MOST_PASSES: Final = 5  # two or three do; more only where a satellite stands on the mask


class _Room(NamedTuple):
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
def new_room(k: int) -> _Room:
    """Return room for an epoch of at most ``k`` rows."""
    return _Room(
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
def _gather(rows: PointRows, epoch: int, room: _Room) -> int:
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


@apart
@kernel
def see_rows(
    rows: PointRows, settings: PointSettings, t_ns: int, x: Float64, k: int, room: _Room, u_n: Float64
) -> None:
    """Write masks, delays and sigmas of the rows as seen from ``x``."""
    lat, lon, h = ecef_to_geodetic(x)
    ecef_to_ned_matrix(lat, lon, room.C_ne)
    air: Air = room.air[0]
    place_air(air, lat, lon, h, (t_ns % NS_PER_WEEK) / NS_PER_S, settings.troposphere_factor)
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
        modelled = _variance(rows.sigma[i, 0], sine, rows.thermal[i], settings.range_noise)
        room.sigma[0, j] = math.sqrt(modelled * rows.variance_scale[i])
        room.sigma[1, j] = math.sqrt(_variance(rows.sigma[i, 1], sine, rows.thermal[i], settings.rate_noise))


@apart
@kernel
def fit_position(
    rows: PointRows,
    settings: PointSettings,
    epoch: int,
    k: int,
    room: _Room,
    fits: Fits,
    use: Bool,
    x: Float64,
    P: Float64,
    u_n: Float64,
) -> tuple[int, float, int]:
    """Return verdict, statistic and redundant rows of an epoch's position; ``x``, ``P`` and ``use`` are the output."""
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
        verdict, total, freedom = agree(fit_rows, use, start, x, P, fits)
        if verdict == TOO_FEW or verdict == BAD_GEOMETRY:
            break
        radius = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        if not _CLOSEST_RADIUS_M < radius < _FARTHEST_RADIUS_M:
            return (BAD_GEOMETRY if verdict == UNTESTED else NOT_IDENTIFIED), math.nan, -1
        moved = (x[0] - start[0]) ** 2 + (x[1] - start[1]) ** 2 + (x[2] - start[2]) ** 2
        copy(x, start)
        if step > 0 and moved < _STILL_M * _STILL_M:
            break
    return verdict, total, freedom


@apart
@kernel
def write_rows(
    rows: PointRows,
    settings: PointSettings,
    e: int,
    kind: int,
    use: Bool,
    x: Float64,
    P: Float64,
    room: _Room,
    fits: Fits,
    ties: Ties,
    out: PointLog,
) -> None:
    """Write status, residual and sigma of one kind of the epoch's rows; ``x`` is NaN where there is no solution."""
    solved = not math.isnan(x[0])
    one = FitRows(kind, room.sat, room.fitted[kind], room.sigma[kind], room.group[kind], ties, out.r_e[e])
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
        own = spread(P, fits.work.u, 3 + one.group[j])
        variance = sigma * sigma + (-own if use[j] else own)
        if variance > 1e-6 * sigma * sigma:
            out.normalised[i, kind] = out.residual[i, kind] / math.sqrt(variance)


@kernel
def _forget(use: Bool, group: Int64, x: Float64, P: Float64) -> None:
    """Make the clocks without a row, and their covariances, NaN."""
    for g in range(3, len(x)):
        present = False
        for j in range(len(use)):
            present = present or (use[j] and group[j] == g - 3)
        if not present:
            x[g] = math.nan
            for i in range(len(x)):
                P[i, g] = math.nan
                P[g, i] = math.nan


@kernel
def _write(e: int, x: Float64, P: Float64, v: Float64, P_v: Float64, out: PointLog) -> None:
    """Write position and velocity at reception, clocks and covariances of an epoch."""
    p = len(x)
    for a in range(3):
        out.r_e[e, a] = x[a]
        out.v_e[e, a] = v[a]
    for g in range(3, p):
        out.clock_m[e, g - 3] = x[g]
    out.drift_mps[e] = v[3]
    for a in range(p):
        for c in range(p):
            out.P[e, a, c] = P[a, c]
    for a in range(4):
        for c in range(4):
            out.P_v[e, a, c] = P_v[a, c] + 0.0 * v[0]


@kernel
def solve_epochs(rows: PointRows, settings: PointSettings, limits: Float64, out: PointLog) -> None:
    """Solve every epoch of a log; positions stand at the time of reception, clock / c before the tags.

    Parameters
    ----------
    rows, settings : the log and how it is used
    limits : (k + 1,) limit of chi-square by its degrees of freedom; k at least the rows of the largest epoch
    out : ``new_point_log``
    """
    p, most = out.P.shape[1], len(limits)
    room, fits = new_room(most), Fits(limits, workspace(p), redundancy_room(most))
    rate_fits = Fits(limits, workspace(4), fits.room)
    Q, one_drift = np.zeros((p, p)), free_clocks(1)
    for e in range(len(rows.epoch_ns)):
        k = _gather(rows, e, room)
        x, P = np.full(p, math.nan), np.zeros((p, p))
        v, P_v = np.full(4, math.nan), np.full((4, 4), math.nan)
        use, use_rate = np.zeros(k, np.bool_), np.zeros(k, np.bool_)
        verdict, total, freedom = fit_position(rows, settings, e, k, room, fits, use, x, P, out.u_n)
        range_rows = FitRows(RANGE, room.sat, room.fitted[0], room.sigma[0], room.group[0], settings.ties, x)
        if verdict != TOO_FEW and verdict != BAD_GEOMETRY and freedom >= 0:
            if not dilution(range_rows, use, x, room.C_ne, fits.work, Q, out.dop[e]):
                verdict = BAD_GEOMETRY
            elif not out.dop[e, 0] <= settings.max_gdop:
                verdict = BAD_GEOMETRY
        rate_verdict = TOO_FEW
        if verdict == TOO_FEW or verdict == BAD_GEOMETRY or freedom < 0:
            fill(x, math.nan)
        else:
            if verdict == OK or verdict == EXCLUDED:
                redundancy(range_rows, use, x, P, fits.work, fits.room)
                left = count(use) - n_unknowns(rows_per_clock(range_rows, use, p - 3))
                out.level_m[e, 0], out.level_m[e, 1] = protection_levels(
                    use, fits.room, P, room.C_ne, limits[left], settings.missed_sigmas
                )
            _forget(use, room.group[0], x, P)
            for j in range(k):
                use_rate[j] = room.offered[1, j] and room.visible[j]
            rate_rows = FitRows(RANGE_RATE, room.sat, room.raw[1], room.sigma[1], room.group[1], one_drift, x)
            rate_verdict, out.statistic[e, 1], out.freedom[e, 1] = agree(
                rate_rows, use_rate, np.zeros(4), v, P_v, rate_fits
            )
            if rate_verdict == TOO_FEW or rate_verdict == BAD_GEOMETRY:
                fill(v, math.nan)
            _write(e, x, P, v, P_v, out)
        out.verdict[e, 0], out.verdict[e, 1] = verdict, rate_verdict
        out.statistic[e, 0], out.freedom[e, 0] = total, max(freedom, 0)
        for kind in range(2):
            if kind == 0:
                write_rows(rows, settings, e, kind, use, x, P, room, fits, settings.ties, out)
            else:
                write_rows(rows, settings, e, kind, use_rate, v, P_v, room, rate_fits, one_drift, out)
