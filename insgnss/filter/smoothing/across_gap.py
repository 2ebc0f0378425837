"""Over a gap in the inertial samples: from the filter that began after it to the one that ended before it.

After a gap the filter starts again from a fix. The samples between the first one after the gap and that fix lead back,
without any filter: steps of Rauch, Tung and Striebel, each to a time at which nothing was known before (``way_back``).
The filter's transition depends on its own covariance, so that it learns no heading from noise: a filter that knows
nothing would count no motion. On the way back no heading is learnt, so all motion counts.

Over the gap the motion counts as a random walk of rate and specific force, as over a short gap that the filter bridges.
So the place after the gap shows where the vehicle was before it (``last_sample``). With x the state before, y^- the
state after as predicted from x with covariance P^-, and y the later filter's estimate of it with covariance P_y,

    P_s = (P^-^-1 + P_y^-1 - B^-1)^-1,  y_s - y^- = P_s P_y^-1 (y - y^-)
    x^s = x + A (y_s - y^-),  P^s = P + A (P_s - P^-) A^T,  A = P_x,y^- (P^-)^-1

B is the covariance of the sensors' errors that the later filter took over from the earlier one: what both know counts
once. Of the attitude the tilt counts, for the heading may have been taken over too. After a long gap only the sensors'
errors count, for the vehicle may be anywhere: then P^- = B and P_s = P_y. Of the clocks nothing is carried back: a
receiver may have set them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.filter.imu.inertial_stream import Cut
from insgnss.filter.layout import Layout
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.smoothing.between import one_hypothesis, regression
from insgnss.filter.smoothing.smoother_step import (
    FilteredEpoch,
    SmoothedEpoch,
    attitude_before,
    kept_as_opened,
    one_back,
    predicted,
    step_of_state,
)
from insgnss.filter.start.carried_start import errors_in_a_gap
from insgnss.filter.state import BA, BG, CLOCK, DR, DRIFT, DV, OFFSETS, PSI, Bank, StateRecord
from insgnss.filter.update.closed_loop import close_loop
from insgnss.geodesy.local_level import level_axes
from insgnss.tables import Float64

_UNKNOWN: Final = 1e4  # times the variance that later data leave: what was known before adds a ten-thousandth
_PIECE_NS: Final = 5 * NS_PER_S  # of the way back, over which a state is a good guess of the one before it
_MOST_STEPS: Final = 10  # to the state about which a piece is linear; three are enough
_NOTHING: Final = 1e-300  # the variance of a state that has none
_CLOSE: Final = 1e-3  # sigmas by which the last of them moves it
_LONGEST_WAY_S: Final = 60.0  # over which a random walk of 1 m/s^2 per root second leaves 4 km


def without_shown_motion(parameters: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the filter's numbers with which all motion counts, shown or not."""
    all_of_it = parameters.copy()
    all_of_it["motion_gate2"] = 0.0
    return all_of_it


def way_back(
    epoch: SmoothedEpoch, imu: ImuSamples, parameters: npt.NDArray[Any], layout: Layout
) -> Iterator[SmoothedEpoch]:
    """Yield samples before the ``epoch`` at which a filter began anew, the last first, smoothed by that epoch.

    The last of them is the first of the samples ``imu``; in between they are some seconds apart.
    """
    while epoch.kept.t_ns > imu.t_ns[0]:
        k = int(np.searchsorted(imu.t_ns, epoch.kept.t_ns - _PIECE_NS))
        k = min(k, int(np.searchsorted(imu.t_ns, epoch.kept.t_ns)) - 1)
        epoch = _one_before(epoch, k, imu, parameters, layout)
        yield epoch


def _one_before(
    epoch: SmoothedEpoch, k: int, imu: ImuSamples, parameters: npt.NDArray[Any], layout: Layout
) -> SmoothedEpoch:
    """Return sample ``k`` smoothed by a later state alone."""
    bank = _about(epoch, k, imu, parameters)
    for _ in range(_MOST_STEPS):
        before = one_back(kept_as_opened(bank)._replace(anew=True), epoch, imu, parameters, layout)
        if float((before.e**2 / np.diagonal(before.P).clip(min=_NOTHING)).max()) < _CLOSE**2:
            break
        bank = one_hypothesis(bank.state, bank.P, bank.head)
        close_loop(bank.state[0], before.e, len(before.e))
    return before


def _about(epoch: SmoothedEpoch, k: int, imu: ImuSamples, parameters: npt.NDArray[Any]) -> Bank:
    """Return a filter at sample ``k`` that knows nothing, about where the later state has come from.

    It knows a hundred times less than the later state leaves, carried back: of velocity P_v + T^2 (g^2 P_psi + P_ba),
    of position T^2 times that more.
    """
    filtered, n, t_ns = epoch.kept.bank, len(epoch.P), int(imu.t_ns[k])
    bank = one_hypothesis(filtered.state, np.zeros_like(filtered.P), filtered.head)
    m: StateRecord = bank.state[0]
    bank.state[0] = epoch.state()
    bank.head["now_ns"], bank.head["next"] = t_ns, k + 1
    m.C_eb[:] = attitude_before(bank, epoch.kept.t_ns, epoch.state(), imu, parameters)
    seconds = (epoch.kept.t_ns - t_ns) / NS_PER_S
    m.r_e[:] -= seconds * m.v_e
    m.clock[0] -= seconds * m.clock[1]
    left = np.diagonal(epoch.P).copy()
    for block, by, factor in (
        (PSI, BG, 1.0),
        (DV, BA, 1.0),
        (DV, PSI, STANDARD_GRAVITY_MPS2**2),
        (DR, DV, 1.0),
    ):
        left[block : block + 3] += seconds**2 * factor * left[by : by + 3].sum()
    left[CLOCK] += seconds**2 * left[DRIFT]
    bank.P[0, range(n), range(n)] = _UNKNOWN * left
    return bank


def last_sample(
    filtered: FilteredEpoch,
    after: SmoothedEpoch,
    cut: Cut,
    imu: ImuSamples,
    parameters: npt.NDArray[Any],
    layout: Layout,
) -> SmoothedEpoch:
    """Return the last sample before a gap, of ``filtered``, smoothed by the first one ``after`` it."""
    bank, seconds = filtered.bank, (cut.next_ns - cut.last_ns) / NS_PER_S
    errors, left, grown = errors_in_a_gap(bank.state[0], parameters[0], seconds, layout)
    if cut.bridge is not None and seconds < _LONGEST_WAY_S:
        way = one_hypothesis(bank.state, bank.P, bank.head)
        way.head["next"] = 1
        across = _across(cut, imu)
        P, crosses = predicted(way, after.kept, across, parameters[0], len(bank.P[0]))
        n = len(after.e)
        shown = _shown(bank.state[0].r_e, errors, n)
        cross, prior = crosses[:, :n] @ shown.T, shown @ P[:n, :n] @ shown.T
        d = shown @ step_of_state(way, after, across, parameters, layout)
        step, change = _fused(prior, shown @ after.P @ shown.T, d, len(errors))
    else:
        cross = bank.P[0][:, errors] * left
        prior = left[:, None] * cross[errors] + np.diag(grown)
        step = _errors(after.state(), layout) - left * _errors(bank.state[0], layout)
        change = after.P[np.ix_(errors, errors)] - prior
    gain = regression(cross, prior)
    smoothed = bank.P[0] + gain @ change @ gain.T
    return SmoothedEpoch(filtered, gain @ step, 0.5 * (smoothed + smoothed.T), None)


def _shown(r_e: Float64, errors: list[int], n: int) -> Float64:
    """Return what counts across a gap of ``n`` error states (m, n): place, velocity, tilt, and the sensors' errors."""
    north_east = level_axes(r_e)[:2]
    rows = np.zeros((8 + len(errors), n))
    rows[:6, DR : DV + 3] = np.eye(6)
    rows[6:8, PSI : PSI + 3] = north_east
    rows[range(8, len(rows)), errors] = 1.0
    return rows


def _fused(prior: Float64, P_y: Float64, d: Float64, n_errors: int) -> tuple[Float64, Float64]:
    """Return y_s - y^- (m,) and P_s - P^- (m, m); the last ``n_errors`` states are the sensors' errors."""
    sigma = np.sqrt(np.diagonal(prior))
    size = np.outer(sigma, sigma)
    taken_over = np.zeros(prior.shape)
    taken_over[-n_errors:, -n_errors:] = np.linalg.inv((prior / size)[-n_errors:, -n_errors:])
    values, axes = np.linalg.eigh(np.linalg.inv(P_y / size) - taken_over)
    learnt = (
        axes * values.clip(min=0.0)
    ) @ axes.T  # the errors' noise since then leaves a little less than nothing
    P_s = np.linalg.inv(np.linalg.inv(prior / size) + learnt)
    return sigma * (P_s @ (learnt + taken_over) @ (d / sigma)), P_s * size - prior


def _across(cut: Cut, imu: ImuSamples) -> ImuSamples:
    """Return the last sample before a gap, the one that bridges it, and one like it at the first time after it."""
    assert cut.bridge is not None
    bridge, unknown = cut.bridge, np.zeros((3, 2))
    unknown[1] = bridge.unknown
    return ImuSamples(
        np.array([cut.last_ns, bridge.t_ns, cut.next_ns]),
        np.array([imu.w_ib_b[-1], bridge.w_ib_b, bridge.w_ib_b]),
        np.array([imu.f_b[-1], bridge.f_b, bridge.f_b]),
        unknown,
    )


def _errors(m: StateRecord, layout: Layout) -> Float64:
    """Return the sensors' errors of a state, as ``errors_in_a_gap`` orders them."""
    further = [m.optional[at - OFFSETS] for at in layout.sensor_states]
    return np.concatenate([m.b_a, m.b_g, further])
