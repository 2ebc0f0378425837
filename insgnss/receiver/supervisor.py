"""The search supervisor: what a receiver should do for every satellite, based on attitude and filter.

``supervise`` takes whole histories, ``Supervisor`` epoch after epoch; both run the same compiled rules
(``tracking_rules.advance``) on the same vectorised windows, so both give the same bits.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.antenna.visibility import UNCERTAIN_VISIBLE, UNDECIDED
from insgnss.config.search import Search
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError, InputError, TimeError
from insgnss.receiver.detection import Detector, detector
from insgnss.receiver.search_window import (
    SearchWindow,
    SignalScale,
    search_window,
    signal_scale,
    unsupervised_sweep_s,
)
from insgnss.receiver.tracking_rules import advance
from insgnss.receiver.tracking_state import (
    MISSING,
    NONE,
    NOT_KNOWN,
    PRESENT,
    SPENT,
    Records,
    Rules,
    View,
    new_memory,
    new_spent,
)
from insgnss.tables import Bool, Float64, Int8, Int16, Int64

_LONGEST_NS: Final = 2**60  # 36 years: what takes longer never ends


class Predictions(NamedTuple):
    """The filter's and visibility stage's output for each satellite at each epoch: n epochs, m satellites.

    A satellite without a prediction at an epoch has UNDECIDED, or NaN in C/N0 or in either variance.
    """

    t_ns: Int64  # (n,) GPS time, strictly increasing
    decision: Int8  # (n, m) of ``insgnss.antenna.visibility``; what a mask of elevation hides is HIDDEN
    cn0_dbhz: Float64  # (n, m) predicted: link budget and gain; -inf where nothing is received
    d_range_m2: Float64  # (n, m) h P^- h^T of the pseudorange
    d_rate_m2ps2: Float64  # (n, m) of the range rate
    delay_m: Float64  # (n, m) predicted pseudorange
    range_rate_mps: Float64  # (n, m) predicted, positive when the distance grows


class Transitions(NamedTuple):
    """One entry for each change of state, by time, then satellite; ``_asdict()`` makes the columns of a table."""

    t_ns: Int64
    sv: Int16  # index of the satellite
    before: Int8  # states
    after: Int8
    reason: Int8
    delay_m: Float64  # NaN without a prediction, as are the following fields
    doppler_hz: Float64  # RINEX sign
    sigma_delay_m: Float64
    sigma_doppler_hz: Float64
    accumulation_s: Float64
    delay_cells: Float64
    doppler_bins: Float64
    search_s: Float64


class Totals(NamedTuple):
    """Seconds of each satellite, (m,)."""

    hold_s: Float64  # extrapolated
    control_s: Float64  # in control detections
    search_s: Float64  # in searches
    in_vain_s: Float64  # of both: failed or broken off
    unsupervised_s: Float64  # what a receiver without a supervisor would have searched
    unsupervised_in_vain_s: Float64  # of it: while there was nothing to be found


class Supervision(NamedTuple):
    """The supervisor's decisions on a whole history."""

    state: Int8  # (n, m)
    transitions: Transitions
    totals: Totals
    window: SearchWindow  # arrays (n, m)


class Supervisor:
    """The supervisor for live use: one epoch at a time.

    Parameters
    ----------
    satellites : how many; their places in the arrays stay the same
    scale : of each satellite's signal; that of the settings' grid if None

    Raises
    ------
    ConfigError : a signal at the threshold, or the unsupervised receiver's, needs more looks than ``max_looks``
    """

    def __init__(
        self, satellites: int, settings: Search | None = None, scale: SignalScale | None = None
    ) -> None:
        self.settings = Search() if settings is None else settings
        self._need = detector(self.settings.detection)
        self._rules = rules_of(self.settings, self._need)
        self._scale = signal_scale(self.settings.grid) if scale is None else scale
        self._memory: Records = new_memory(satellites)
        self._spent: Records = new_spent(satellites)
        self._last_ns: int | None = None

    def epoch(self, predicted: Predictions, present: npt.ArrayLike | None = None) -> Supervision:
        """Advance by one or more epochs (n, m), later than those before; ``totals`` count from the beginning.

        Parameters
        ----------
        predicted : as for ``supervise``
        present : (n, m) 1 where the receiver sees the signal at the predicted place, 0 where not, -1 where nothing is
            known; None: nothing is

        Raises
        ------
        InputError : shapes that do not fit, a negative variance, a decision that is none
        TimeError : time does not increase
        """
        seen = _checked_presence(present, predicted.decision.shape)
        _check(predicted, len(self._memory), self._last_ns)
        window = search_window(
            predicted.cn0_dbhz,
            predicted.d_range_m2,
            predicted.d_rate_m2ps2,
            self.settings,
            self._need,
            self._scale,
        )
        before = self._memory["state"].copy()
        state = np.empty(predicted.decision.shape, np.int8)
        reason = np.empty_like(state)
        view = _view(predicted, window, seen)
        advance(predicted.t_ns, view, self._rules, self._memory, self._spent, state, reason)
        if len(predicted.t_ns):
            self._last_ns = int(predicted.t_ns[-1])
        transitions = _transitions(predicted, window, self._scale, before, state, reason)
        return Supervision(state, transitions, self.totals, window)

    @property
    def state(self) -> Int8:
        """The state of each satellite now, (m,)."""
        return self._memory["state"].copy()

    @property
    def totals(self) -> Totals:
        """The seconds so far."""
        return Totals(*(np.asarray(self._spent[name] / NS_PER_S) for name in SPENT.names or ()))


def supervise(
    predicted: Predictions,
    present: npt.ArrayLike | None = None,
    settings: Search | None = None,
    scale: SignalScale | None = None,
) -> Supervision:
    """Return a supervised receiver's actions over a whole history, and the search of an unsupervised one.

    Where ``present`` is not given, a visible signal is there and a detection succeeds; otherwise it decides.

    Raises
    ------
    ConfigError, InputError, TimeError : as ``Supervisor``
    """
    satellites = predicted.decision.shape[1] if predicted.decision.ndim == 2 else 0
    return Supervisor(satellites, settings, scale).epoch(predicted, present)


def rules_of(settings: Search, need: Detector) -> Rules:
    """Return the settings as the compiled rules need them.

    Raises
    ------
    ConfigError : a signal at the threshold, or the unsupervised receiver's, needs more looks than ``max_looks``
    """
    guards = settings.guards
    sweep_s = unsupervised_sweep_s(settings, need)
    scale_free = search_window(guards.threshold_cn0_dbhz, 0.0, 0.0, settings, need)
    for key, time_s in (
        ("guards.threshold_cn0_dbhz", float(scale_free.accumulation_s)),
        ("unsupervised.cn0_dbhz", sweep_s),
    ):
        if not np.isfinite(time_s):
            looks = settings.detection.max_looks
            advice = "raise it, or detection.max_looks, or detection.coherent_limit_s"
            raise ConfigError(f"a signal that weak is not detected in {looks} looks", key=key, advice=advice)
    return Rules(
        guards.threshold_cn0_dbhz,
        guards.hysteresis_db,
        _ns(guards.fall_s),
        _ns(guards.rise_s),
        _ns(guards.loss_s),
        _ns(guards.pull_in_s),
        _ns(guards.retry_s),
        _ns(guards.max_hold_s),
        guards.control_attempts,
        guards.max_sweeps,
        # a signal returns at a random moment of the sweep, which is half a sweep from finding it on average
        _ns(0.5 * sweep_s),
    )


def _ns(seconds: float) -> int:
    return min(round(seconds * NS_PER_S), _LONGEST_NS)


def _view(predicted: Predictions, window: SearchWindow, present: Int8) -> View:
    """Return the inputs of the compiled rules; an entry without a complete prediction is UNDECIDED."""
    known = ~(
        np.isnan(predicted.cn0_dbhz) | np.isnan(window.sigma_delay_m) | np.isnan(window.sigma_doppler_hz)
    )
    search_s = np.where(np.isfinite(window.search_s), window.search_s, np.inf)
    return View(
        np.where(known, predicted.decision, UNDECIDED).astype(np.int8),
        np.ascontiguousarray(predicted.cn0_dbhz, np.float64),
        window.within_aperture,
        np.minimum(np.ceil(search_s * NS_PER_S), float(_LONGEST_NS)).astype(np.int64),
        present,
    )


def _transitions(
    predicted: Predictions,
    window: SearchWindow,
    scale: SignalScale,
    before: Int8,
    state: Int8,
    reason: Int8,
) -> Transitions:
    k, s = np.nonzero(reason != NONE)
    previous = np.vstack([before[None, :], state])[:-1]
    wavelength_m = np.broadcast_to(np.asarray(scale.wavelength_m, float), before.shape)
    return Transitions(
        predicted.t_ns[k],
        s.astype(np.int16),
        previous[k, s],
        state[k, s],
        reason[k, s],
        predicted.delay_m[k, s],
        -predicted.range_rate_mps[k, s] / wavelength_m[s],
        *(values[k, s] for name, values in window._asdict().items() if name != "within_aperture"),
    )


def _check(predicted: Predictions, satellites: int, last_ns: int | None) -> None:
    shape = (len(predicted.t_ns), satellites)
    for name, values in predicted._asdict().items():
        expected = shape[:1] if name == "t_ns" else shape
        if values.shape != expected:
            raise InputError(
                f"'{name}' has shape {values.shape}, expected {expected}",
                column=name,
                advice="give arrays of one row an epoch and one column a satellite",
            )
    before = predicted.t_ns[:1] - 1 if last_ns is None else np.array([last_ns])
    falls = np.flatnonzero(np.diff(np.concatenate([before, predicted.t_ns])) <= 0)
    if len(falls):
        raise TimeError(
            f"the time of epoch {falls[0] + 1} is not later than that before it",
            column="t_ns",
            advice="give each epoch once, in the order of time",
        )
    for name in ("d_range_m2", "d_rate_m2ps2"):
        _refuse(
            getattr(predicted, name) < 0.0, name, "a variance is negative", "D = h P h^T is never negative"
        )
    known = (predicted.decision >= UNDECIDED) & (predicted.decision <= UNCERTAIN_VISIBLE)
    _refuse(~known, "decision", "unknown decision", "take those of insgnss.antenna.visibility")


def _checked_presence(present: npt.ArrayLike | None, shape: tuple[int, ...]) -> Int8:
    if present is None:
        return np.full(shape, NOT_KNOWN, np.int8)
    given = np.asarray(present)
    if given.shape != shape:
        raise InputError(
            f"'present' has shape {given.shape}, expected {shape}",
            column="present",
            advice="give one row an epoch and one column a satellite",
        )
    unknown = ~np.isin(given, (NOT_KNOWN, MISSING, PRESENT))
    _refuse(unknown, "present", "unknown value of presence", "give 1 (seen), 0 (not seen) or -1 (not known)")
    return np.ascontiguousarray(given, np.int8)


def _refuse(wrong: Bool, column: str, message: str, advice: str) -> None:
    if np.any(wrong):
        epoch, satellite = np.argwhere(wrong)[0]
        place = f"epoch {epoch + 1}, satellite column {satellite + 1}"
        raise InputError(f"{message} ({place})", column=column, advice=advice)
