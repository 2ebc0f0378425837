"""One step of the smoother: from what the whole log tells of an epoch to what it tells of the epoch before.

The equations are those of ``smoother``; how an epoch is kept for the way back stands here.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.fusion.between import Costate, one_hypothesis
from insgnss.fusion.closed_loop import close_loop
from insgnss.fusion.heading_bank import difference
from insgnss.fusion.lines import CLONE_ROWS, Epoch
from insgnss.fusion.prediction import Imu, carry_bank, new_scratch, predict_covariance
from insgnss.fusion.state import (
    BA,
    BG,
    CLOCK,
    DR,
    DRIFT,
    DV,
    N_CLONE,
    OFFSETS,
    PSI,
    Bank,
    Layout,
    StateRecord,
)
from insgnss.tables import Float64

_STEP_VARIANCE: Final = 1e14  # (10 000 km)^2, of a clock that may have stepped anywhere


class Kept(NamedTuple):
    """One epoch as the filter left it."""

    bank: Bank  # of one hypothesis
    correction: Float64  # (q,) what its update added to the prediction
    clone: Float64  # (N_CLONE, q) rows of the covariance that the epoch before had after the update
    linked: bool = False  # whether it follows from the epoch kept before it
    stepped: tuple[int, ...] = ()  # states of the clock that stepped in between
    reset: bool = False  # whether the filter was set right at it
    fits: bool = True  # whether the filter agreed with it

    @property
    def t_ns(self) -> int:
        """Time of the epoch."""
        return int(self.bank.head[0].now_ns)


class Smoothed(NamedTuple):
    """What the whole log tells of an epoch."""

    kept: Kept
    e: Float64  # (n,) to be added to the filter's state
    P: Float64  # (n, n)
    onward: Costate | None  # at the epoch after it; None where nothing comes after

    def state(self) -> StateRecord:
        """Return the smoothed state."""
        state = self.kept.bank.state[:1].copy()
        close_loop(state[0], self.e, len(self.e))
        return state[0]


def keep(bank: Bank, work: Epoch, layout: Layout, **told: Any) -> Kept:
    """Return an epoch as the filter has left it; ``work`` still holds its correction and the clone's rows."""
    vectors, q = work.vectors, bank.P.shape[1]
    clone = vectors[CLONE_ROWS : CLONE_ROWS + N_CLONE * layout.clone, :q].copy()
    return Kept(one_hypothesis(bank.state, bank.P, bank.head), vectors[0, :q].copy(), clone, **told)


def kept_as_opened(bank: Bank) -> Kept:
    """Return a filter as it was opened, before its first epoch."""
    return Kept(one_hypothesis(bank.state, bank.P, bank.head), np.zeros(0), np.zeros((0, 0)))


def last_of_all(kept: Kept, layout: Layout) -> Smoothed:
    """Return an epoch of which nothing later tells: as the filter has it."""
    n = OFFSETS + layout.n_values
    return Smoothed(kept, np.zeros(n), kept.bank.P[0, :n, :n].copy(), None)


def same_time(kept: Kept, found: Smoothed, layout: Layout) -> Smoothed:
    """Return what ``found``, of another filter at the same time, tells of this one."""
    return Smoothed(kept, apart(found.state(), kept.bank.state[0], layout), found.P, None)


def apart(m: StateRecord, of: StateRecord, layout: Layout) -> Float64:
    """Return the state ``m`` minus the state ``of`` as an error state (n,), without the clone."""
    n = OFFSETS + layout.n_values
    return difference(m, of, OFFSETS + layout.n_optional, layout)[:n]


def one_back(kept: Kept, later: Smoothed, imu: Imu, parameters: npt.NDArray[Any], layout: Layout) -> Smoothed:
    """Return an epoch as the ``later`` one tells of it."""
    n = len(later.e)
    if later.kept.reset:
        imu, total, P_y = across_reset(kept, later, imu, parameters, layout)
        prior, cross = predicted(kept.bank, later.kept, imu, parameters[0], layout)
        d = total**2
        for block in (BA, BG):
            prior[range(block, block + 3), range(block, block + 3)] += d[block : block + 3].sum()
        stepped = [CLOCK, DRIFT, *range(OFFSETS, n)]
        prior[stepped, stepped] += _STEP_VARIANCE
        prior, cross = prior[:n, :n], cross[:, :n]
    else:
        e_y, P_y = with_clone(later.kept, later.e, later.P)
        prior, cross = predicted(kept.bank, later.kept, imu, parameters[0], layout)
        total = later.kept.correction + e_y
    known = np.flatnonzero(np.diagonal(prior) > 0.0)  # an epoch of a start has left no clone yet
    P_known = prior[np.ix_(known, known)]
    gain = regression(cross[:, known], P_known)
    change = (P_y - prior)[np.ix_(known, known)]
    smoothed = kept.bank.P[0, :n, :n] + gain @ change @ gain.T
    q = kept.bank.P.shape[1]
    inverse = regression(np.eye(len(known)), P_known)
    value, information = np.zeros(q), np.zeros((q, q))
    value[known] = inverse @ total[known]
    information[np.ix_(known, known)] = -inverse @ change @ inverse.T
    onward = Costate(later.kept.t_ns, value, 0.5 * (information + information.T), imu)
    return Smoothed(kept, gain @ total[known], 0.5 * (smoothed + smoothed.T), onward)


def across_reset(
    kept: Kept, later: Smoothed, imu: Imu, parameters: npt.NDArray[Any], layout: Layout
) -> tuple[Imu, Float64, Float64]:
    """Return the samples on the way to a reset, the step from the filter's prediction (n,), and what is known there.

    What the filter was off by at the reset had grown since the epoch that last fitted it. By what the samples are off
    is not known, so what they do not show counts as a motion that makes just such a step of one sigma.

    Equation: S_w = |d psi|^2 / T, S_f = max(|d v|^2 / T, 3 |d r|^2 / T^3), T the time since, for every axis
    """
    carried = one_hypothesis(kept.bank.state, kept.bank.P, kept.bank.head)
    carry_bank(carried, later.kept.t_ns, imu, parameters[0], new_scratch(carried.P.shape[1]))
    d = apart(later.state(), carried.state[0], layout)
    seconds = (later.kept.t_ns - kept.t_ns) / NS_PER_S
    r2, v2, psi2 = (float(d[at : at + 3] @ d[at : at + 3]) for at in (DR, DV, PSI))
    unknown = np.zeros((len(imu.t_ns), 2))
    unknown[: len(imu.unknown)] = imu.unknown
    unknown += [psi2 / seconds, max(v2 / seconds, 3.0 * r2 / seconds**3)]
    return imu._replace(unknown=unknown), d, later.P


def with_clone(later: Kept, e: Float64, P: Float64) -> tuple[Float64, Float64]:
    """Return smoothed correction (q,) and covariance (q, q) of an epoch together with the clone it was updated with.

    Equation: G = P_cx P_xx^-1 of the filter after the update; e_c = G e_x, P^s_cx = G P^s_xx, P^s_cc = P_cc + G
              (P^s_xx - P_xx) G^T
    """
    n, q = len(e), later.bank.P.shape[1]
    if q == n:
        return e, P
    filtered = later.bank.P[0, :n, :n]
    G = regression(later.clone[:, :n], filtered)
    P_y = np.empty((q, q))
    P_y[:n, :n] = P
    P_y[n:, :n] = G @ P
    P_y[:n, n:] = P_y[n:, :n].T
    P_y[n:, n:] = later.clone[:, n:] + G @ (P - filtered) @ G.T
    return np.concatenate([e, G @ e]), P_y


def predicted(
    bank: Bank, later: Kept, imu: Imu, parameters: np.record, layout: Layout
) -> tuple[Float64, Float64]:
    """Return the covariance (q, q) predicted for the ``later`` epoch, and that of the state now with it (n, q)."""
    q, n = bank.P.shape[1], OFFSETS + layout.n_values
    carried = one_hypothesis(bank.state, np.empty((1, q + n, q + n)), bank.head)
    P = carried.P[0]
    P[:q, :q] = bank.P[0]
    P[:q, q:] = bank.P[0][:, :n]
    P[q:, :q] = P[:q, q:].T
    P[q:, q:] = bank.P[0][:n, :n]
    scratch = new_scratch(q + n)
    carry_bank(carried, later.t_ns, imu, parameters, scratch)
    predict_covariance(carried.state[0], P, parameters, scratch)
    for state in later.stepped:
        P[state, state] += _STEP_VARIANCE
    return P[:q, :q].copy(), P[q:, :q].copy()


def regression(cross: Float64, P: Float64) -> Float64:
    """Return ``cross @ P^-1`` of a covariance whose states differ in size by ten powers of ten."""
    scale = 1.0 / np.sqrt(np.diagonal(P))
    unit = P * np.outer(scale, scale)
    try:
        solved = np.linalg.solve(unit, (cross * scale).T)
    except np.linalg.LinAlgError:
        solved = np.linalg.lstsq(unit, (cross * scale).T, rcond=None)[0]
    return np.asarray(solved.T * scale)
