"""Time of reception from pseudoranges alone: position, clocks and the shift of the tags in one fit.

A shift of the tags moves each satellite along its orbit, so each range changes by its range rate times the shift:
beside place and clock it is one more unknown of a fix, with six satellites a tested one (coarse-time navigation
[van Diggelen 2009, 4.1]). Range rates change by less than 0.2 m/s in a second, so the fit converges from minutes away.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import C_MPS, NS_PER_S, S_PER_WEEK, WGS84_OMEGA_RADPS
from insgnss.gnss.orbits.ephemeris_choice import BroadcastMessages, broadcast_messages
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.log.checks.track import NEAREST_M
from insgnss.log.gnss_rows import epochs
from insgnss.log.overlap import MOST_HOURS
from insgnss.tables import Bool, Float64, GnssTable, Int64, NavigationData
from insgnss.units import S_PER_H

_START_STEP_S: Final = 600.0
_FITTED_EPOCHS: Final = 3
_PLACE_PASSES: Final = 5  # of a fit, before the shift is free: from the Earth's centre no shift shows
_ALL_PASSES: Final = 16
_LONGEST_STEP_S: Final = 900.0  # of the shift in one pass
_HIGHEST_M: Final = 7.5e6  # from the Earth's centre: receivers in low orbits too
# Orbits that are hours old are kilometres off, the air and reflections make some ten metres
_FITTING_M: Final = 300.0
_AGREEING_S: Final = 1.0  # shifts of the epochs
_SMALL: Final = 1e-9  # of a normal matrix, relative: what no row shows stays as it is


class _Problems(NamedTuple):
    """Fits side by side: one for each epoch and start, rows padded to the epoch with the most."""

    row: Int64  # (m, n) of the log
    used: Bool  # (m, n)
    system: Int64  # (m, n)
    n_systems: int


class _State(NamedTuple):
    r_e: Float64  # (m, 3) [m]
    clock_m: Float64  # (m, systems)
    shift_s: Float64  # (m,)


def coarse_shift(sample: GnssTable, navigation: NavigationData, weeks: int) -> float | None:
    """Return the seconds to be added to the tags by a fit of place, clocks and shift; None if none fits well.

    Parameters
    ----------
    sample : some epochs of the log
    weeks : added to the tags beforehand; the fit begins at all times up to 14 hours from there
    """
    messages = broadcast_messages(navigation, max_age_s=(MOST_HOURS + 2) * S_PER_H)
    blocks = _blocks(sample, messages)
    reach_s = MOST_HOURS * S_PER_H
    starts_s = weeks * float(S_PER_WEEK) + np.arange(-reach_s, reach_s + 1.0, _START_STEP_S)
    if len(blocks.row) == 0:
        return None
    n = len(starts_s)
    row, used, system = (np.repeat(a, n, axis=0) for a in (blocks.row, blocks.used, blocks.system))
    problems = _Problems(
        row.astype(np.int64), used.astype(np.bool_), system.astype(np.int64), blocks.n_systems
    )
    state, rms_m = _fitted(sample, messages, problems, np.tile(starts_s, len(blocks.row)))
    distance = np.linalg.norm(state.r_e, axis=1)
    fits = (rms_m < _FITTING_M) & (distance > NEAREST_M) & (distance < _HIGHEST_M)
    rms_m = np.where(fits, rms_m, np.inf).reshape(len(blocks.row), -1)
    best = np.argmin(rms_m, axis=1)
    if not np.isfinite(rms_m[np.arange(len(best)), best]).all():
        return None
    shifts_s = state.shift_s.reshape(rms_m.shape)[np.arange(len(best)), best]
    return float(np.median(shifts_s)) if np.ptp(shifts_s) < _AGREEING_S else None


def _blocks(sample: GnssTable, messages: BroadcastMessages) -> _Problems:
    """Return the rows of some epochs, one for each satellite with a message, where they leave a redundant one."""
    known = np.array([name in messages.satellites for name in sample.sv_names], np.bool_)
    names = sorted({name[0] for name in sample.sv_names})
    system = np.array([names.index(name[0]) for name in sample.sv_names], np.int64)
    _, bounds = epochs(sample)
    kept = []
    for k in np.unique(np.linspace(0, len(bounds) - 2, _FITTED_EPOCHS).astype(int)):
        rows = np.arange(bounds[k], bounds[k + 1])
        rows = rows[np.isfinite(sample.pseudorange_m[rows]) & known[sample.sv[rows]]]
        rows = rows[np.unique(sample.sv[rows], return_index=True)[1]]
        if len(rows) > 4 + len(np.unique(system[sample.sv[rows]])):
            kept.append(rows)
    most = max((len(rows) for rows in kept), default=0)
    row, used = np.zeros((len(kept), most), np.int64), np.zeros((len(kept), most), np.bool_)
    for k, rows in enumerate(kept):
        row[k, : len(rows)], used[k, : len(rows)] = rows, True
    return _Problems(row, used, system[sample.sv[row]], len(names))


def _fitted(
    sample: GnssTable, messages: BroadcastMessages, problems: _Problems, starts_s: Float64
) -> tuple[_State, Float64]:
    """Return places, clocks and shifts from the Earth's centre and the given shifts on, and the rms of what is left."""
    m, p = len(starts_s), 4 + problems.n_systems
    state = _State(np.zeros((m, 3)), np.zeros((m, problems.n_systems)), starts_s.copy())
    for k in range(_ALL_PASSES):
        H, left_m = _rows(sample, messages, problems, state)
        if k < _PLACE_PASSES:
            H[:, :, 3] = 0.0
        N = np.einsum("mki,mkj->mij", H, H)
        N += _SMALL * np.eye(p) * np.maximum(np.trace(N, axis1=1, axis2=2), 1.0)[:, None, None]
        step = np.linalg.solve(N, np.einsum("mki,mk->mi", H, left_m)[:, :, None])[:, :, 0]
        along_s = np.clip(step[:, 3], -_LONGEST_STEP_S, _LONGEST_STEP_S)
        state = _State(state.r_e + step[:, :3], state.clock_m + step[:, 4:], state.shift_s + along_s)
    H, left_m = _rows(sample, messages, problems, state)
    freedom = (H != 0.0).any(axis=2).sum(axis=1) - (H != 0.0).any(axis=1).sum(axis=1)
    squares = np.sum(left_m**2, axis=1)
    rms_m = np.full(m, np.inf)
    np.sqrt(squares / np.maximum(freedom, 1), out=rms_m, where=freedom > 0)
    return state, rms_m


def _rows(
    sample: GnssTable, messages: BroadcastMessages, problems: _Problems, state: _State
) -> tuple[Float64, Float64]:
    """Return (m, n, 4 + systems) derivatives and (m, n) residuals; zero where a satellite has no message."""
    row = problems.row
    added_ns = np.rint(state.shift_s * NS_PER_S).astype(np.int64)
    table = sample.take(row.ravel()).later(np.repeat(added_ns, row.shape[1]))
    states = satellite_states(table, messages)
    sat, v_e = (a.reshape(*row.shape, 3) for a in (states.position, states.velocity))
    clock_m = states.clock_m.reshape(row.shape)
    turn = WGS84_OMEGA_RADPS * np.linalg.norm(sat - state.r_e[:, None], axis=2) / C_MPS
    sat = sat + turn[:, :, None] * np.stack([sat[:, :, 1], -sat[:, :, 0], np.zeros(row.shape)], axis=2)
    away = sat - state.r_e[:, None]
    distance = np.linalg.norm(away, axis=2)
    u = away / distance[:, :, None]
    own_clock = np.take_along_axis(state.clock_m, problems.system, axis=1)
    left_m = sample.pseudorange_m[row] + clock_m - distance - own_clock
    used = problems.used & np.isfinite(left_m)
    H = np.zeros((*row.shape, 4 + state.clock_m.shape[1]))
    H[:, :, :3], H[:, :, 3] = -u, np.sum(u * v_e, axis=2)
    np.put_along_axis(H, 4 + problems.system[:, :, None], 1.0, axis=2)
    H[~used] = 0.0
    return H, np.where(used, left_m, 0.0)
