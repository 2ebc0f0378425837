"""The likelihood of the rows of a satellite that is left out, as measurements that drift away at one rate.

The filter that runs without a satellite predicts that satellite's rows. If it runs away from t1 on at a rate b,

    range rate y = b + e,   pseudorange y = b (t - t1) + e,   carrier difference y = b dt + e, or e if it stays behind

Integrated over b ~ N(0, s^2) and t1, that is a likelihood like that of the rows which the filter uses: it pays for its
unknowns; noise does not look like a ramp.                                              [MacKay 2003, 28: Occam factor]
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.witnesses import EpochLog, KindColumns, used_and_refused
from insgnss.filter.parameters import Parameters
from insgnss.filter.update.epoch_update import charge, charge_of_refused
from insgnss.gnss.observation_rows import CARRIER, N_BANDS, N_KINDS, PSEUDORANGE, RANGE_RATE
from insgnss.status import DRIFTING
from insgnss.tables import Float64, Int64

_RATE_MPS: Final = 2.0  # sigma of the rates at which satellites run away
_WRONG_MPS: Final = 10.0 ** np.arange(-1.0, 3.0, 0.5)  # by so much wrong range rates wander in a second
_ONSETS: Final = 12
# of normal equations of unit vectors: fewer than four rows leave unobserved unknowns at zero
_RIDGE: Final = 1e-6
_PRECISION: Final = float(np.finfo(np.float32).eps)


class _SatelliteInnovations(NamedTuple):
    """The rows of one kind of a satellite: their innovations, and when."""

    kind: int
    t_s: Float64
    since_s: Float64  # the epoch before
    innovation: Float64
    variance: Float64
    noise: Float64  # of it, the measurement's own
    spread: Float64  # by how much the filter widens that, as epochs share their errors

    @property
    def widened(self) -> Float64:
        return self.variance + (self.spread - 1.0) * self.noise


class Ramp(NamedTuple):
    """How well a satellite's rows fit a ramp, and which."""

    log_likelihood: float
    rate_mps: float


@dataclass(frozen=True)
class WrittenRows:
    """The filter's output of some epochs, the rows of all of them in one: many satellites are looked for in them."""

    written: list[EpochLog]

    @cached_property
    def epochs(self) -> list[int]:
        """Return the places of the epochs that have rows."""
        return [k for k, epoch in enumerate(self.written) if len(epoch.slot)]

    @cached_property
    def sizes(self) -> list[int]:
        """Return the number of each of their rows."""
        return [len(self.written[k].slot) for k in self.epochs]

    @cached_property
    def satellite(self) -> Int64:
        """Return the number of each row's satellite."""
        return np.asarray(np.concatenate([self.written[k].slot for k in self.epochs]) // N_BANDS)

    @cached_property
    def G(self) -> Float64:
        """Return the partials by antenna and clock, (n, 4)."""
        u_n = np.concatenate([self.written[k].ledger["u_n"] for k in self.epochs])
        return np.column_stack((-u_n, np.ones(len(u_n))))

    @cached_property
    def times_s(self) -> tuple[Float64, Float64, Float64]:
        """Return each row's time, that of the epoch with rows before, and the time from the epoch before."""
        t_s, since_s = (
            np.repeat([self.written[k].t_ns / NS_PER_S for k in at], self.sizes)
            for at in (self.epochs, _before(self.epochs))
        )
        return t_s, since_s, np.repeat(_steps_s(self.written)[self.epochs], self.sizes)

    @cached_property
    def kinds(self) -> list[KindColumns]:
        """Return the output of the rows of each kind."""
        n_kinds = N_KINDS if len(self.written[-1].carrier) else CARRIER
        rows = ([self.written[k].of_kind(kind) for k in self.epochs] for kind in range(n_kinds))
        return [KindColumns(*map(np.concatenate, zip(*each, strict=True))) for each in rows]


def ramps(
    base: WrittenRows, without: WrittenRows, satellites: tuple[int, ...], par: Parameters
) -> tuple[Ramp, ...]:
    """Return the ramp of each of ``satellites``.

    Parameters
    ----------
    base, without : what the filter wrote of the same epochs with them and without them
    """
    return tuple(
        _ramp(_shown(base, without, satellites, each, par), base.written, par) for each in satellites
    )


def ramp_evidence(written: WrittenRows, satellite: int, par: Parameters) -> float:
    """Return how much better a satellite's rows fit a ramp than none, from the filter's output."""
    shown = _shown(written, written, (), satellite, par)
    if not shown:
        return -math.inf
    none = -0.5 * sum(float(np.sum(_cost(each, each.innovation, par))) for each in shown)
    return max(_of_one(shown, carrier_too, par).log_likelihood for carrier_too in (True, False)) - none


def of_wrong_rates(written: list[EpochLog], par: Parameters) -> float:
    """Return the log-likelihood of range rates that are all wrong, in a filter that leaves them out.

    Their errors e begin at once and wander on, as those of a Doppler that is held or of another motion do. Equation:
    y = e + n, e <- e + w, var w = s^2 a second, for each satellite; the mean of exp(-sum c / 2) over s, with c what the
    filter charges for a row (``charge``)
    """
    if not written:
        return 0.0
    step_s = _steps_s(written)
    spreads = _spreads(par, RANGE_RATE, step_s)
    slots = np.unique(np.concatenate([epoch.slot for epoch in written]))
    e, P = np.zeros((len(_WRONG_MPS), len(slots))), np.zeros((len(_WRONG_MPS), len(slots)))
    log_likelihood = np.zeros(len(_WRONG_MPS))
    for epoch, dt_s, spread in zip(written, step_s, spreads, strict=True):
        rates = epoch.of_kind(RANGE_RATE)
        own = rates.status == DRIFTING
        at = np.searchsorted(slots, epoch.slot[own])
        P += _WRONG_MPS[:, None] ** 2 * dt_s
        D, y = rates.predicted[own].astype(float), rates.innovation[own].astype(float)
        noise = _own_noise(rates)[own]
        S = P[:, at] + D + spread * noise
        gain = P[:, at] / S
        rest = y - e[:, at]
        log_likelihood -= 0.5 * np.sum(charge(rest**2 / S, S, noise, spread), axis=1)
        e[:, at] += gain * rest
        P[:, at] *= 1.0 - gain
    return float(np.logaddexp.reduce(log_likelihood)) - math.log(len(_WRONG_MPS))


def _cost(shown: _SatelliteInnovations, rest: Float64, par: Parameters) -> Float64:
    """Return the filter's charge for rows with such residuals (``use_rows``)."""
    gate2 = par.kind[shown.kind].gate2
    cost = charge(rest**2 / shown.widened, shown.widened, shown.noise, shown.spread)
    refused = charge_of_refused(shown.kind, gate2, shown.variance, shown.spread)
    return np.where(rest**2 > gate2 * shown.variance, refused, cost)


def _steps_s(epochs: list[EpochLog]) -> Float64:
    """Return the time from each epoch's predecessor; the first has the median's."""
    steps_s = np.diff([epoch.t_ns for epoch in epochs]) / NS_PER_S
    return np.append(np.median(steps_s) if len(steps_s) else 1.0, steps_s)


def _spreads(par: Parameters, kind: int, since_s: Float64) -> Float64:
    """Return ``epoch_update.spread_of`` of epochs so long after their predecessors."""
    return np.asarray(np.maximum(1.0, float(par.kind[kind].correlation) / since_s))


def _own_noise(rows: KindColumns) -> Float64:
    """Return the variance of rows without the state's share; the ledger's single precision may leave nothing of it."""
    S = rows.variance.astype(float)
    return np.asarray(np.maximum(S - rows.predicted, _PRECISION * S))


def _ramp(shown: list[_SatelliteInnovations], base: list[EpochLog], par: Parameters) -> Ramp:
    """Return the ramp of a satellite; the carrier runs away, too, or it does not."""
    in_view = len({int(k) for k in base[-1].slot // N_BANDS})
    alternatives = (
        [_of_one(shown, carrier_too, par) for carrier_too in (True, False)] if shown else [Ramp(0.0, 0.0)]
    )
    every = float(np.logaddexp.reduce([each.log_likelihood for each in alternatives])) - math.log(
        len(alternatives)
    )
    rate = max(alternatives, key=lambda each: each.log_likelihood).rate_mps
    return Ramp(every - math.log(max(in_view, 1)), rate)  # it could have been any of them


def _of_one(shown: list[_SatelliteInnovations], carrier_too: bool, par: Parameters) -> Ramp:
    """Return the ramp that a satellite's rows show.

    Equation: L = sum_j L_j / n over the onsets, L_j = exp(-sum c / 2 - b^2 / (2 s^2)) / sqrt(1 + a s^2) with
              a = sum h^2 / S, b = sum h y / S / (a + 1 / s^2), c what the filter charges for y - h b (``charge``)
    """
    first, last = min(each.t_s[0] for each in shown), max(each.t_s[-1] for each in shown)
    onset = first + (last - first) * np.arange(_ONSETS) / _ONSETS
    h = [_response(each, onset[:, None], carrier_too) for each in shown]
    a = sum(np.sum(k**2 / each.widened, axis=1) for k, each in zip(h, shown, strict=True))
    y = sum(k @ (each.innovation / each.widened) for k, each in zip(h, shown, strict=True))
    rate = y / (a + _RATE_MPS**-2)
    log_likelihood = -0.5 * (rate**2 / _RATE_MPS**2 + np.log(1.0 + a * _RATE_MPS**2))
    for k, each in zip(h, shown, strict=True):
        log_likelihood -= 0.5 * np.sum(_cost(each, each.innovation - k * rate[:, None], par), axis=1)
    every = float(np.logaddexp.reduce(log_likelihood)) - math.log(_ONSETS)
    return Ramp(every, float(rate[np.argmax(log_likelihood)]))


def _response(shown: _SatelliteInnovations, onset_s: Float64, carrier_too: bool) -> Float64:
    """Return by how much a ramp of 1 m/s moves each row (onsets, rows)."""
    if shown.kind == RANGE_RATE:
        return np.asarray(shown.t_s > onset_s, np.float64)
    if shown.kind == PSEUDORANGE:
        return np.maximum(shown.t_s - onset_s, 0.0)
    moved = np.maximum(shown.t_s - np.maximum(shown.since_s, onset_s), 0.0)
    return moved if carrier_too else np.zeros_like(moved)


def _shown(
    base: WrittenRows,
    without: WrittenRows,
    satellites: tuple[int, ...],
    satellite: int,
    par: Parameters,
) -> list[_SatelliteInnovations]:
    """Return a satellite's innovations of each kind against the filter that runs without it.

    Equation: y' = y + g dx, dx the least-squares change of antenna and clock that the other rows' innovations show
    Neglects: that a constellation's own clock offset may have changed, too.
    """
    t_s, since_s, step_s = base.times_s
    shown = []
    for kind, before in enumerate(base.kinds):
        own = (base.satellite == satellite) & np.any(used_and_refused(before.status), axis=0)
        if not own.any():
            continue
        moved = without.kinds[kind].innovation - before.innovation
        others = np.where(np.isin(base.satellite, satellites), np.nan, moved)
        dx = _common_change(base.G, others, base.sizes)
        y = before.innovation + np.sum(base.G * np.repeat(dx, base.sizes, axis=0), axis=1)
        S, spread = before.variance.astype(float), _spreads(par, kind, step_s)
        columns = (t_s, since_s, y, S, _own_noise(before), spread)
        shown.append(_SatelliteInnovations(kind, *(column[own] for column in columns)))
    return shown


def _before(epochs: list[int]) -> list[int]:
    return [epochs[0], *epochs[:-1]]


def _common_change(G: Float64, moved: Float64, sizes: list[int]) -> Float64:
    """Return the least-squares dx (epochs, 4) of each epoch's rows: moved = G dx, rows without a number left out."""
    is_known = np.isfinite(moved)
    G, moved = np.where(is_known[:, None], G, 0.0), np.where(is_known, moved, 0.0)
    first = np.cumsum([0, *sizes[:-1]])
    N = np.add.reduceat(G[:, :, None] * G[:, None, :], first) + _RIDGE * np.eye(4)
    return np.asarray(np.linalg.solve(N, np.add.reduceat(G * moved[:, None], first)[..., None])[..., 0])
