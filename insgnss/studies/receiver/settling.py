"""When a receiver's errors have settled after C/N0 has fallen: by the covariance that its filter predicts.

A covariance forgets its initial value. So the filter runs twice without errors, which leaves its covariance as in any
run: once from below, with a hundredth of the initial sigmas and the C/N0 before the fall; and once from above, with ten
times the initial sigmas and the C/N0 after the fall throughout. Both enclose the covariance of a run and the steady
one, also along a manoeuvre, in which it is not constant. Where they differ by less than 5 % the run has settled.
The covariance of channels with loops of their own is carried on from the fall until it is within 5 % of the steady one.

At 28 dBHz without phase tracking (integrations of 10 ms, "industrial", "tcxo") the position settles in 28 s, with an
IMU of 80 deg/h in 38 s and at 20 dBHz in 61 s; receivers that track the phase settle within some seconds.
Neglects: that a filter which counts the same information twice has larger errors than it predicts. They settle with the
same modes of filter and channels, as long as these do not drive each other.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any, Final, NamedTuple

import numpy as np

from insgnss.errors import ConfigError
from insgnss.interference.riccati import DiscreteModel, predicted_covariance
from insgnss.simulation.oscillator import clock_densities
from insgnss.studies.receiver.runs import Setting, run_once
from insgnss.studies.receiver.variants import InitialSigmas, Variant, oscillator_of, receiver_of
from insgnss.studies.receiver.workspace import SCALAR, TWO_STAGE
from insgnss.tables import Float64
from insgnss.tracking.vector_loop import RANGE_VARIANCE, RATE_VARIANCE, levels_of

SETTLED_DBHZ: Final = 45.0  # before the fall, or more if the C/N0 after it is higher
SETTLED: Final = 0.05  # of one sigma
# factors of the initial sigmas for covariances that come from below and from above
_NARROWER: Final = 0.01
_WIDER: Final = 10.0
# of a run's sigmas (k, 11)
_ERRORS: Final = {
    "position": slice(0, 3),
    "velocity": slice(3, 6),
    "attitude": slice(6, 9),
    "clock": slice(9, 10),
    "clock drift": slice(10, 11),
}
_OF_CHANNELS: Final = ("position", "velocity")


class NoErrors(np.random.Generator):
    """A generator whose normal numbers are all zero: a run without errors, with the covariance of any run."""

    def __init__(self) -> None:
        super().__init__(np.random.PCG64(0))

    def standard_normal(self, size: Any = None, *_: Any, **__: Any) -> Any:
        """Return zeros."""
        return np.zeros(() if size is None else size)


class Fall(NamedTuple):
    """C/N0 of the channels over time, as ``run_once`` takes them: with its fall, and without."""

    at: int  # integration
    fallen: Float64
    steady: Float64  # that after the fall, throughout
    cn0_dbhz: float  # after the fall, at 0 dBic


def settling_s(setting: Setting, variant: Variant, fall: Fall) -> dict[str, float]:
    """Return how many seconds after the fall of C/N0 each error of a receiver has settled; inf: not within the run."""
    channels = dict(zip(_OF_CHANNELS, _channels_settle_s(setting, variant, fall), strict=True))
    if not variant.has_filter:
        return channels
    quiet = replace(setting, options=replace(setting.options, estimates_cn0=False))
    narrow, wide = (replace(quiet, start=_scaled(setting.start, factor)) for factor in (_NARROWER, _WIDER))
    below = run_once(narrow, variant, fall.fallen, NoErrors()).sd
    above = run_once(wide, variant, fall.steady, NoErrors()).sd
    # a filter that takes a C/N0 for true whatever arrives has no fall of its own; its initial value fades as fast
    first = 0 if setting.options.told_cn0_dbhz is not None else math.ceil(fall.at / setting.record_every)
    step_s = setting.record_every * setting.truth.step_s
    waits_s = {name: step_s * _agreed(below[first:, at], above[first:, at]) for name, at in _ERRORS.items()}
    return {name: max(wait, channels.get(name, 0.0)) for name, wait in waits_s.items()}


def _scaled(start: InitialSigmas, factor: float) -> InitialSigmas:
    return InitialSigmas(*(factor * getattr(start, field.name) for field in fields(start)))


def _agreed(below: Float64, above: Float64) -> float:
    """Return the record from which two histories of sigmas (k, n) agree; inf: they do not."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.sqrt((below**2).sum(axis=1) / (above**2).sum(axis=1)) - 1.0) > SETTLED
    apart = np.flatnonzero(off)
    if not len(apart):
        return 0.0
    return float(apart[-1] + 1) if apart[-1] + 1 < len(off) else math.inf


def _channels_settle_s(setting: Setting, variant: Variant, fall: Fall) -> tuple[float, float]:
    """Return how long after the fall range and rate of a channel with a loop of its own take [s]; 0 of others.

    Equation: P <- F (I - K H) P F^T + W, K = P H^T (H P H^T + R)^-1, from the steady P before the fall
    """
    if variant.kind not in (SCALAR, TWO_STAGE):
        return 0.0, 0.0
    drift = clock_densities(oscillator_of(setting.drift_density, setting.options.carrier_hz))[1]
    unknown = setting.unknown if variant.kind == SCALAR or setting.inertial is None else None
    T, count = setting.truth.step_s, len(setting.truth.t_s) - fall.at
    design = receiver_of(variant, T, setting.interval, drift, unknown, setting.limits, 1, 0)
    model, assumed_dbhz = DiscreteModel(design.F, design.walk), setting.options.told_cn0_dbhz
    try:
        H = _rows(setting, len(design.F), fall.cn0_dbhz if assumed_dbhz is None else assumed_dbhz)
        steady = predicted_covariance(model, H, 1.0)
        # a channel that takes a C/N0 for true whatever arrives starts with next to no errors
        before = _rows(setting, len(design.F), max(SETTLED_DBHZ, fall.cn0_dbhz))
        P = predicted_covariance(model, before, 1.0) if assumed_dbhz is None else 1e-2 * steady
    except ConfigError:
        return math.inf, math.inf
    waits = [0.0, 0.0]
    for k in range(count):
        off = np.abs(np.sqrt(np.diag(P / steady))[:2] - 1.0) > SETTLED
        if not off.any():
            return waits[0], waits[1]
        waits = [T * (k + 1) if late else wait for late, wait in zip(off, waits, strict=True)]
        K = np.linalg.solve(H @ P @ H.T + np.eye(len(H)), H @ P).T
        P = model.F @ (P - K @ H @ P) @ model.F.T + model.Q
    return math.inf if off[0] else waits[0], math.inf if off[1] else waits[1]


def _rows(setting: Setting, states: int, cn0_dbhz: float) -> Float64:
    """Return the rows of a channel's observations over their sigmas: range, and rate without phase tracking."""
    rows = 1 if setting.channels.coherent else 2
    noise = setting.channels.table[levels_of(cn0_dbhz), [RANGE_VARIANCE, RATE_VARIANCE][:rows]]
    return np.asarray(np.eye(rows, states) / np.sqrt(noise)[:, None])
