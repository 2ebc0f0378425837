"""The fixed-interval smoother: every epoch with what the whole log tells of it, not only what came before.

Rauch, Tung and Striebel's backward pass over the filter's own epochs. With e the smoothed state minus the filter's, and
kappa what the update of the next epoch added to its prediction,

    e_k   = A_k (kappa_k+1 + e_k+1)
    P^s_k = P_k + A_k (P^s_k+1 - P^-_k+1) A_k^T,     A_k = P_k Phi^T (P^-_k+1)^-1

where P_k Phi^T is read off a prediction that carries a copy of the state at k along (the copy's error is constant),
with the filter's own mechanization and covariance. A carrier difference at k+1 is about the clone of k as well, so the
next epoch is taken together with that clone; the clone follows from the smoothed state of k+1 by regression, for all
later measurements know it only by way of that state. [Rauch, Tung & Striebel 1965; Roumeliotis & Burdick 2002]

Smoothing stops where the filter was set anew (reset, restart, long gap) and where more than one heading was possible:
what comes before a reset is smoothed by itself, what comes before the one heading stays as the filter had it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from insgnss.fusion.closed_loop import close_loop
from insgnss.fusion.lines import CLONE_ROWS
from insgnss.fusion.navigator import Navigator
from insgnss.fusion.output import Output, write_nav
from insgnss.fusion.prediction import Imu, carry_bank, new_scratch, predict_covariance
from insgnss.fusion.state import CLOCK, DRIFT, N_CLONE, OFFSETS, Bank, Layout, StateArray
from insgnss.gnss.observation_rows import Rows
from insgnss.tables import Float64

_STEPPED_CLOCK: Final = {"clock_jump": CLOCK, "clock_drift_jump": DRIFT}
_SET_ANEW: Final = frozenset({"reset", "restart", "start"})
_STEP_VARIANCE: Final = 1e14  # (10 000 km)^2, of a clock that may have stepped anywhere


class Kept(NamedTuple):
    """One epoch as the filter left it."""

    bank: Bank  # of one hypothesis
    correction: Float64  # (q,) what its update added to the prediction
    clone: Float64  # (N_CLONE, q) rows of the covariance that the epoch before had after the update
    nav: int  # its navigation row
    linked: bool  # whether it follows from the epoch kept before it
    stepped: tuple[int, ...]  # states of the clock that stepped in between


@dataclass
class Smoother:
    """Keeps the filter at every epoch of a stretch, then runs back over them."""

    navigator: Navigator
    imu: Imu
    kept: list[Kept] = field(default_factory=list)
    _linked: bool = False  # whether the next epoch follows from the one kept last

    def finish(self, out: Output) -> None:
        """Write the navigation rows of all that ``forward`` has kept, as ``backward`` makes them."""
        for kept, e, P in self.backward():
            if e.any():  # the last epoch of a part stays as the filter wrote it, to the bit
                _write(out, kept, e, P)

    def forward(self, rows: Rows, first: int, last: int, out: Output) -> None:
        """Process the epochs ``first`` to ``last - 1`` as ``Navigator.run`` does, one at a time, and keep each."""
        navigator = self.navigator
        for epoch in range(first, last):
            told, written = len(navigator.events), int(out.counts[0].nav)
            navigator.run(self.imu, rows, epoch, epoch + 1, out)
            kinds = {event.kind for event in navigator.events[told:]}
            bank = navigator.bank
            linked = self._linked and not kinds & _SET_ANEW
            if bank is None or len(bank.state) > 1 or out.counts[0].nav == written:
                self._linked = False
                continue
            vectors, q = navigator.workspace(rows).epoch.vectors, bank.P.shape[1]
            n_clone = N_CLONE * navigator.setup.layout.clone
            self.kept.append(
                Kept(
                    _alone(bank.state, bank.P, bank.head),
                    vectors[0, :q].copy(),
                    vectors[CLONE_ROWS : CLONE_ROWS + n_clone, :q].copy(),
                    written,
                    linked,
                    tuple(_STEPPED_CLOCK[kind] for kind in kinds & _STEPPED_CLOCK.keys()),
                )
            )
            self._linked = True

    def backward(self) -> Iterator[tuple[Kept, Float64, Float64]]:
        """Yield the epochs kept from the last to the first: what to add to the filter's state, and its covariance."""
        layout = self.navigator.setup.layout
        n = OFFSETS + layout.n_values
        later: Kept | None = None
        e, P = np.zeros(n), np.zeros((n, n))
        for kept in reversed(self.kept):
            if later is None or not later.linked:
                e, P = np.zeros(n), kept.bank.P[0, :n, :n].copy()
            else:
                e, P = self._one_back(kept, later, layout, e, P)
            yield kept, e, P
            later = kept

    def _one_back(
        self, kept: Kept, later: Kept, layout: Layout, e: Float64, P: Float64
    ) -> tuple[Float64, Float64]:
        """Return correction and covariance of an epoch from those of the ``later`` one."""
        e_y, P_y = with_clone(later, e, P)
        prior, cross = predicted(kept.bank, later, self.imu, self.navigator.parameters[0], layout)
        known = np.flatnonzero(np.diagonal(prior) > 0.0)  # an epoch of a start has left no clone yet
        gain = regression(cross[:, known], prior[np.ix_(known, known)])
        filtered = kept.bank.P[0, : len(e), : len(e)]
        total = (later.correction + e_y)[known]
        change = (P_y - prior)[np.ix_(known, known)]
        smoothed = filtered + gain @ change @ gain.T
        return gain @ total, 0.5 * (smoothed + smoothed.T)


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
    carried = _alone(bank.state, np.empty((1, q + n, q + n)), bank.head)
    P = carried.P[0]
    P[:q, :q] = bank.P[0]
    P[:q, q:] = bank.P[0][:, :n]
    P[q:, :q] = P[:q, q:].T
    P[q:, q:] = bank.P[0][:n, :n]
    scratch = new_scratch(q + n)
    carry_bank(carried, int(later.bank.head[0].epoch_ns), imu, parameters, scratch)
    predict_covariance(carried.state[0], P, parameters, scratch)
    for state in later.stepped:
        P[state, state] += _STEP_VARIANCE
    return P[:q, :q].copy(), P[q:, :q].copy()


def _alone(state: StateArray, P: Float64, head: StateArray) -> Bank:
    """Return a copy of a bank without what only updates need."""
    return Bank(state.copy(), P.copy(), head.copy(), np.zeros((1, 0), np.int8), np.zeros((1, 0, 3)))


def regression(cross: Float64, P: Float64) -> Float64:
    """Return ``cross @ P^-1`` of a covariance whose states differ in size by ten powers of ten."""
    scale = 1.0 / np.sqrt(np.diagonal(P))
    unit = P * np.outer(scale, scale)
    try:
        solved = np.linalg.solve(unit, (cross * scale).T)
    except np.linalg.LinAlgError:
        solved = np.linalg.lstsq(unit, (cross * scale).T, rcond=None)[0]
    return np.asarray(solved.T * scale)


def _write(out: Output, kept: Kept, e: Float64, P: Float64) -> None:
    """Write the navigation row of an epoch anew."""
    state: StateArray = kept.bank.state[:1].copy()
    close_loop(state[0], e, len(e))
    old = out.nav[kept.nav].copy()
    count = np.zeros(1, out.counts.dtype)
    count["nav"] = kept.nav
    used = int(old["value"][34])
    write_nav(out.nav, out.optional, count[0], int(old["t_ns"]), state[0], P, used, 1)
