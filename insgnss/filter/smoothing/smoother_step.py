"""One step of the smoother: from the smoothed estimate of an epoch to that of the epoch before.

The equations are those of ``smoother``; the storage of an epoch for the backward pass is here.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, WGS84_OMEGA_RADPS
from insgnss.filter.headings.heading_bank import difference
from insgnss.filter.layout import Layout
from insgnss.filter.own_update import OwnUpdate
from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples, carry_bank, new_scratch, predict_covariance
from insgnss.filter.rows.lines import CLONE_ROWS, EpochWorkspace
from insgnss.filter.smoothing.between import NextEpoch, one_hypothesis, regression
from insgnss.filter.state import (
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
    StateRecord,
)
from insgnss.filter.states.gnss_time import GNSS_TIME
from insgnss.filter.update.closed_loop import close_loop
from insgnss.geodesy.local_level import up_direction
from insgnss.geodesy.rotations import rotation_matrix, rotation_vector
from insgnss.tables import Float64, Int64

_STEP_VARIANCE: Final = 1e14  # (10 000 km)^2, of a clock that may have stepped anywhere


class FilteredEpoch(NamedTuple):
    """One epoch as the filter left it."""

    bank: Bank  # of one hypothesis
    correction: Float64  # (q,) what its update added to the prediction
    clone: Float64  # (N_CLONE, q) rows of the covariance that the epoch before had after the update
    linked: bool = False  # whether it follows from the epoch kept before it
    stepped: tuple[int, ...] = ()  # states that stepped in between: the clock's, a sensor's own error
    reset: bool = False  # whether the filter was set right at it
    anew: bool = False  # whether it began at it, and what comes before is another filter's
    fits: bool = True  # whether the filter agreed with it
    is_own: bool = False  # no epoch, but a user's own rows: the clone stays that of the epoch before

    @property
    def t_ns(self) -> int:
        """Time of the epoch."""
        return int(self.bank.head[0].now_ns)


class SmoothedEpoch(NamedTuple):
    """The smoothed estimate of an epoch, or of a time at which the filter used a user's own rows."""

    kept: FilteredEpoch
    e: Float64  # (n,) to be added to the filter's state; with the clone behind it where own rows were used
    P: Float64  # (n, n)
    onward: NextEpoch | None  # at the epoch after it; None where nothing comes after

    def state(self) -> StateRecord:
        """Return the smoothed state of an epoch."""
        state: StateRecord = self.kept.bank.state[:1].copy()[0]
        close_loop(state, self.e, len(self.e))
        return state


def keep(bank: Bank, work: EpochWorkspace, layout: Layout, **told: Any) -> FilteredEpoch:
    """Return an epoch as the filter has left it; ``work`` still holds its correction and the clone's rows."""
    vectors, q = work.vectors, bank.P.shape[1]
    clone = vectors[CLONE_ROWS : CLONE_ROWS + N_CLONE * layout.clone, :q].copy()
    return FilteredEpoch(one_hypothesis(bank.state, bank.P, bank.head), vectors[0, :q].copy(), clone, **told)


def keep_own(bank: Bank, update: OwnUpdate, *, linked: bool, fits: bool) -> FilteredEpoch:
    """Return the filter as a user's own rows have left it."""
    alone, clone = one_hypothesis(bank.state, bank.P, bank.head), np.zeros((0, 0))
    correction = update.correction.copy()
    return FilteredEpoch(alone, correction, clone, linked, update.stepped, fits=fits, is_own=True)


def kept_as_opened(bank: Bank) -> FilteredEpoch:
    """Return a filter as it was opened, before its first epoch."""
    return FilteredEpoch(one_hypothesis(bank.state, bank.P, bank.head), np.zeros(0), np.zeros((0, 0)))


def stepped_tags(bank: Bank, layout: Layout, t_ns: int) -> tuple[int, ...]:
    """Return the state of the GNSS tags' offset if the epoch's tag has jumped."""
    at = layout.at(GNSS_TIME)
    return (at,) if at >= 0 and int(bank.head[0].tag_jump_ns) == t_ns else ()


def last_of_all(filtered: FilteredEpoch, layout: Layout) -> SmoothedEpoch:
    """Return an epoch without later information: as the filter has it."""
    n = _told(filtered, layout)
    return SmoothedEpoch(filtered, np.zeros(n), filtered.bank.P[0, :n, :n].copy(), None)


def _told(filtered: FilteredEpoch, layout: Layout) -> int:
    """Return the number of error states with smoothed information."""
    return int(filtered.bank.P.shape[1]) if filtered.is_own else OFFSETS + layout.n_values


def same_time(filtered: FilteredEpoch, epoch: SmoothedEpoch, layout: Layout) -> SmoothedEpoch:
    """Return the smoothed estimate of this filter from ``epoch``, of another filter at the same time."""
    e = apart(epoch.state(), filtered.bank.state[0], layout)
    return SmoothedEpoch(filtered, e, epoch.P[: len(e), : len(e)], None)


def apart(m: StateRecord, of: StateRecord, layout: Layout) -> Float64:
    """Return the correction (n,) that makes the state ``m`` out of the state ``of``, without the clone."""
    n = OFFSETS + layout.n_values
    d = difference(m, of, OFFSETS + layout.n_optional, layout)[:n]
    d[PSI : PSI + 3] = _as_correction(m.C_eb @ of.C_eb.T, np.array(up_direction(of.r_e)))
    return d


def one_back(
    filtered: FilteredEpoch,
    later: SmoothedEpoch,
    imu: ImuSamples,
    parameters: npt.NDArray[Any],
    layout: Layout,
) -> SmoothedEpoch:
    """Return an epoch smoothed from the ``later`` one."""
    n, q = _told(filtered, layout), filtered.bank.P.shape[1]
    if later.kept.reset or later.kept.anew:
        d = step_of_state(filtered.bank, later, imu, parameters, layout)
        if later.kept.reset:
            imu = doubted(imu, d, (later.kept.t_ns - filtered.t_ns) / NS_PER_S)
        prior, cross = predicted(filtered.bank, later.kept, imu, parameters[0], n)
        if later.kept.reset:
            doubt_what_jumped(prior, d)
        known = len(d)
        step, P_y = np.zeros(q), prior.copy()  # of a clone from before nothing is known
        step[:known], P_y[:known, :known] = d, later.P[:known, :known]
        cross[:, known:] = prior[known:] = prior[:, known:] = P_y[known:] = P_y[:, known:] = 0.0
    else:
        e_y, P_y = with_clone(later.kept, later.e, later.P)
        prior, cross = predicted(filtered.bank, later.kept, imu, parameters[0], n)
        step = later.kept.correction + e_y
        up = np.array(up_direction(later.kept.bank.state[0].r_e))
        step[PSI : PSI + 3] = one_after_another(later.kept.correction[PSI : PSI + 3], e_y[PSI : PSI + 3], up)
    gain, change = regression(cross, prior), P_y - prior
    smoothed = filtered.bank.P[0, :n, :n] + gain @ change @ gain.T
    onward = NextEpoch(later.kept.t_ns, prior, step, change, imu)
    return SmoothedEpoch(filtered, gain @ step, 0.5 * (smoothed + smoothed.T), onward)


def doubt_what_jumped(prior: Float64, d: Float64) -> None:
    """Drop the information of a reset's step on the clocks before it, and keep for the biases only what remains."""
    for block in (BA, BG):
        jump = d[block : block + 3]
        prior[range(block, block + 3), range(block, block + 3)] += float(jump @ jump)
    clocks = [CLOCK, DRIFT, *range(OFFSETS, len(d))]
    prior[clocks, clocks] += _STEP_VARIANCE


def step_of_state(
    bank: Bank, later: SmoothedEpoch, imu: ImuSamples, parameters: npt.NDArray[Any], layout: Layout
) -> Float64:
    """Return a smoothed state minus that to which the samples carry a bank of one hypothesis (n,)."""
    carried = one_hypothesis(bank.state, bank.P, bank.head)
    carry_bank(carried, later.kept.t_ns, imu, parameters[0], new_scratch(carried.P.shape[1]))
    return apart(later.state(), carried.state[0], layout)


def doubted(imu: ImuSamples, d: Float64, seconds: float) -> ImuSamples:
    """Return the samples of the ``seconds`` before a reset that has made a step ``d`` of the state (n,).

    What the filter was off by at the reset had grown since the epoch that last fitted it. By what the samples are off
    is not known, so what they do not show counts as a motion that makes just such a step of one sigma.

    Equation: S_w = |d psi|^2 / T, S_f = max(|d v|^2 / T, 3 |d r|^2 / T^3), T the time since, for every axis
    """
    r2, v2, psi2 = (float(d[at : at + 3] @ d[at : at + 3]) for at in (DR, DV, PSI))
    unknown = np.zeros((len(imu.t_ns), 2))
    unknown[: len(imu.unknown)] = imu.unknown
    unknown += [psi2 / seconds, max(v2 / seconds, 3.0 * r2 / seconds**3)]
    return imu._replace(unknown=unknown)


def attitude_before(
    bank: Bank, end_ns: int, smoothed: StateRecord, imu: ImuSamples, parameters: npt.NDArray[Any]
) -> Float64:
    """Return C_eb (3, 3) at a bank's time by the smoothed one at ``end_ns`` and the gyros.

    Equation: C(t_0) = R^T C(t_1) C_a(t_1)^T R C_a(t_0), C_a any attitude that the gyros have carried from t_0 to t_1,
              with the smoothed bias; R what the Earth has turned
    """
    first: Int64 = np.zeros(1, np.int64)
    carried = one_hypothesis(bank.state[first], bank.P[first], bank.head)
    carried.state[0].b_g[:] = smoothed.b_g
    before = carried.state[0].C_eb.copy()
    seconds = (end_ns - int(bank.head[0].now_ns)) / NS_PER_S
    carry_bank(carried, end_ns, imu, parameters[0], new_scratch(carried.P.shape[1]))
    R = rotation_matrix(np.array([0.0, 0.0, -WGS84_OMEGA_RADPS * seconds]))
    return np.asarray(R.T @ smoothed.C_eb @ carried.state[0].C_eb.T @ R @ before)


def one_after_another(first: Float64, then: Float64, up: Float64) -> Float64:
    """Return the one correction of an attitude (3,) [rad] that does what two do, as ``close_loop`` takes each.

    A correction is a tilt and then a turn about the vertical ``up``. Their sum would lay the second tilt into the axes
    before the first turn: after a turn by 16 deg it would be off by 0.28 of its size.

    Equation: exp([y u x]) exp([t x]) = R(then) R(first), R(c) = exp([(u . c) u x]) exp([(c - (u . c) u) x])
    """
    return _as_correction(_as_rotation(then, up) @ _as_rotation(first, up), up)


def _as_correction(R: Float64, up: Float64) -> Float64:
    """Return the correction of an attitude (3,) [rad] that is the rotation ``R`` (3, 3): a tilt, then a turn."""
    whole = rotation_vector(R)
    half = 0.5 * float(np.linalg.norm(whole))
    if half == 0.0:
        return np.asarray(whole)
    turn = 2.0 * math.atan2(math.sin(half) * float(whole @ up), 2.0 * half * math.cos(half)) * up
    return np.asarray(turn + rotation_vector(rotation_matrix(-turn) @ R))


def _as_rotation(correction: Float64, up: Float64) -> Float64:
    """Return the rotation matrix (3, 3) of a correction: the tilt before the turn."""
    turn = float(correction @ up) * up
    return np.asarray(rotation_matrix(turn) @ rotation_matrix(correction - turn))


def with_clone(later: FilteredEpoch, e: Float64, P: Float64) -> tuple[Float64, Float64]:
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
    bank: Bank, later: FilteredEpoch, imu: ImuSamples, parameters: Parameters, n: int
) -> tuple[Float64, Float64]:
    """Return the covariance (q, q) predicted for the ``later`` epoch, and that of ``n`` states now with it (n, q)."""
    q = bank.P.shape[1]
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
