"""Validation of a given start: automatically started filters run in parallel until the likelihood decides.

A heading that is wrong by far more than its sigma can be absorbed: biases of consumer-grade sensors explain the first
turn, and the sigma shrinks as if they were right. No innovation is then large enough for a gate, but the likelihood of
all of them shows it. So a copy of the filter runs in a bank with alternatives that were started automatically, of the
same heading and of headings all around, each of a low prior weight. When the measurements rule out the given attitude,
the alternatives replace it. When they rule out the alternatives, or these reach the same attitude, the validation ends.
It does not change the filter itself by a bit.

A heading that a sensor has given or decided is validated in the same way: a compass beside steel, two antennas that are
exchanged, degrees for radians, a wheel speed that is late. There the alternatives do not use the sensor. If they take
the filter's place, it is left out until it agrees with them. The validation begins when the heading is known, also with
several hypotheses of it left: the alternatives must be there before the first motion, which refutes a wrong heading in
seconds, and which the filter would otherwise explain by biases and hard iron.

A start may also be wrong in its position or velocity alone. The alternative of the same heading shows that: it gains as
all others do, but it has the given attitude, and the filter corrects its position by itself.

It takes one epoch a second, whatever the receiver's rate. Nothing decides while the velocity stays as it is, at rest or
on a straight: after a minute of that it takes one in ten seconds, until the velocity changes.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.headings.heading_bank import attitude
from insgnss.filter.headings.headings import SMALLEST_DIFFERENCE_RAD, yaw_variance
from insgnss.filter.own_rows.contradiction import refute
from insgnss.filter.own_rows.rows import Kind
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.beside import clear_failures, copy_filter, roomy, update_beside
from insgnss.filter.start.start import StartHeading, headings_around
from insgnss.filter.start.starter import Starter
from insgnss.filter.state import BG, DV, PSI, Bank, copy_bank, joined_banks, select_members
from insgnss.filter.update.epoch_space import FilterWorkspace
from insgnss.filter.update.masking import OFF
from insgnss.gnss.observation_rows import GnssRows, one_epoch
from insgnss.tables import Bool, Event, Float64

_SAME_HEADING_WEIGHT: Final = 1e-3  # prior of a start wrong in roll, pitch or position, its heading right
_OTHER_HEADING_WEIGHT: Final = 1e-6  # of each heading around the circle: a sign or an axis mistaken
_HOPELESS: Final = (
    -30.0
)  # logarithm of the share of its prior at which a alternative goes: at first it knows less
_HALF: Final = math.log(0.5)
_SETTLING_NS: Final = NS_PER_S  # while the alternatives settle, no likelihood counts
_PERIOD_NS: Final = 900_000_000  # less than a second: time tags may be a little early
_CALM_PERIOD_NS: Final = 10 * NS_PER_S
_PATIENCE_NS: Final = (
    60 * NS_PER_S
)  # without a fix to start the alternatives from, or without a change of velocity
_CHANGE: Final = 0.02  # of the speed: a smaller change of the velocity is none
_SAME_ATTITUDE: Final = 6.0  # squared sigmas of three angles and three rates within which two are one
_TURNING: Final = [*range(PSI, PSI + 3), *range(BG, BG + 3)]
_SMALLEST_BIAS_RADPS: Final = 1e-6  # 0.2 deg/h
_KNOWS_AS_WELL: Final = 2.0  # sigmas of the other: who knows less than that has not come to anything yet


@dataclass
class StartValidation:
    """The alternatives to a given start, or to a sensor's heading, and their likelihoods."""

    setup: FilterSetup  # of the alternatives
    headings: tuple[Kind, ...] = ()  # the sensors that they do not use
    is_given: bool = True  # rather than started automatically, with the heading of a sensor
    starter: Starter = field(init=False)
    bank: Bank | None = (
        None  # copies of the filter's hypotheses first, then the alternatives; None: not opened yet
    )
    n_given: int = 0  # of its hypotheses are the filter's
    over: bool = False
    since_ns: int = 0  # when the wait began, then when the alternatives were started
    settling: bool = False
    look_ns: int = 0  # the first epoch from then on is taken
    taken_ns: int = 0  # the epoch taken last
    v_e: Float64 | None = None  # the velocity that has not changed
    calm_ns: int = 0  # since when
    _work: FilterWorkspace | None = None

    def __post_init__(self) -> None:
        """Get ready to start alternatives."""
        self.starter = Starter(self.setup, given=False)

    def copied(self) -> StartValidation:
        """Return a copy that shares nothing that changes."""
        twin = copy.copy(self)
        twin.starter = self.starter.snapshot()
        twin.bank = None if self.bank is None else copy_bank(self.bank)
        return twin

    @property
    def waits(self) -> bool:
        """Whether no sensor has given a heading yet."""
        return not self.is_given and self.bank is None

    def log_probability(self) -> float:
        """Return the logarithm of the given attitude's probability, all who have come to it; 0 before the trial."""
        if self.bank is None or self.settling:
            return 0.0
        weight = self.bank.state["log_weight"]
        alone = _log_sum(weight[: self.n_given])
        return alone if alone > _HALF else _log_sum(weight[self._agreeing(_agreement(self.bank))])

    def _agreeing(self, agreement: Bool) -> Bool:
        """Return which hypotheses have the attitude of the given start, its own of course."""
        given = np.arange(len(agreement)) < self.n_given
        return np.asarray(given | agreement[:, : self.n_given].any(axis=1))

    def update(
        self, bank: Bank, imu: ImuSamples, rows: GnssRows, epoch: int, parameters: npt.NDArray[Any]
    ) -> Bank | None:
        """Update with an epoch after the filter's ``bank`` did; return the bank that is to take its place, if any."""
        t_ns = int(rows.epoch_ns[epoch])
        if t_ns < self.look_ns:
            return None
        self.look_ns = t_ns + _PERIOD_NS
        if not self.is_given and self._is_undecided(bank):
            self.over = self.bank is not None
            return None
        self.since_ns = self.since_ns or t_ns
        if self.bank is None:
            self._open(bank, imu, rows, epoch, parameters)
            return None
        if self._calm(bank, t_ns) and t_ns - self.taken_ns < _CALM_PERIOD_NS:
            return None
        self.taken_ns = t_ns
        # likelihoods compare only where errors are taken to last as long for all ...
        self.bank.state["lasting"] = bank.state["lasting"][bank.head[0].leader]
        # ... and all use the same satellites: none is masked by an attitude that is in question
        every = parameters.copy()
        every["visibility"] = OFF
        self._update_bank(imu, rows, epoch, every)
        if self.over:
            return None
        if len(bank.state) == self.n_given:
            copy_filter(bank, self.bank)
        if self.log_probability() < self.setup.log_drop:
            return self.end_with_alternatives()
        self._thin_out()
        return None

    def _is_undecided(self, bank: Bank) -> bool:
        """Return whether the sensor has not decided on a heading yet, or the filter has opened others since."""
        if self.bank is None:
            return len(bank.state) > 1 and bool(bank.head[0].heading_open)
        return len(bank.state) > self.n_given

    def epoch_after_look(self, rows: GnssRows, epoch: int, last: int) -> int:
        """Return up to which epoch the filter may run before it is to be asked again."""
        return min(max(int(np.searchsorted(rows.epoch_ns, self.look_ns)), epoch) + 1, last)

    def _calm(self, bank: Bank, t_ns: int) -> bool:
        """Return whether the velocity has stayed as it is for long."""
        lead = int(bank.head[0].leader)
        v_e = bank.state[lead].v_e
        if self.v_e is None or np.linalg.norm(v_e - self.v_e) > self._least_change(bank, lead):
            self.v_e, self.calm_ns = v_e.copy(), t_ns
        return t_ns - self.calm_ns > _PATIENCE_NS

    def _least_change(self, bank: Bank, lead: int) -> float:
        """Return how much of a change of velocity is one [m/s]."""
        variance = np.trace(bank.P[lead, DV : DV + 3, DV : DV + 3])
        speed = float(np.linalg.norm(bank.state[lead].v_e))
        return self.setup.config.start.rest_speed_mps + 3.0 * math.sqrt(float(variance)) + _CHANGE * speed

    def end_with_alternatives(self) -> Bank:
        """End the validation; return the alternatives without the given start, those of negligible weight left out."""
        assert self.bank is not None
        self.over = True
        weight = self.bank.state["log_weight"].copy()
        weight[: self.n_given] = -math.inf
        keep = np.flatnonzero(weight > weight.max() + self.setup.log_drop)
        bank = select_members(self.bank, keep.astype(np.int64))
        bank.head["heading_open"] = 1
        bank.head["more_than_headings"] = 0
        return bank

    def _open(
        self, bank: Bank, imu: ImuSamples, rows: GnssRows, epoch: int, parameters: npt.NDArray[Any]
    ) -> None:
        """Start the alternatives at an epoch, if it allows that, with the filter's estimated noise levels."""
        t_ns = int(rows.epoch_ns[epoch])
        lead = bank.state[bank.head[0].leader]
        self.starter.headings = self._headings(bank)
        opened, _, _ = self.starter.try_start(imu, rows, epoch, parameters[0])
        if opened is None:
            self.over = t_ns - self.since_ns > _PATIENCE_NS
            return
        for name in (
            "noise_factor",
            "noise_excess",
            "rates_out_ns",
            "rates_late_s",
            "dv_late",
            "swing_late",
            "level_epochs",
            "adapted_ns",
            "adapted_count",
            "weak_shown",
            "weak_rows",
            "cn0_level",
            "cn0_level_ns",
        ):
            opened.state[name] = lead[name]
        self.bank = joined_banks(bank, opened)
        self.bank.head["more_than_headings"] = 1
        clear_failures(self.bank)
        self.n_given, self.since_ns, self.settling = len(bank.state), t_ns, True

    def _headings(self, bank: Bank) -> list[StartHeading]:
        """Return the alternatives' headings: the filter's own, and those all around."""
        lead = int(bank.head[0].leader)
        _, _, yaw = attitude(bank.state[lead])
        sigma = min(float(_heading_sigmas(bank)[lead]), math.pi)
        n = self.setup.config.heading.hypotheses
        around = headings_around(yaw, [_OTHER_HEADING_WEIGHT] * n) if n > 1 else []
        return [StartHeading(yaw, sigma, _SAME_HEADING_WEIGHT), *around]

    def _update_bank(self, imu: ImuSamples, rows: GnssRows, epoch: int, parameters: npt.NDArray[Any]) -> None:
        """Carry all of them to an epoch and update them with it; nothing of that is written anywhere."""
        assert self.bank is not None
        alone = one_epoch(rows, epoch)
        self._work = roomy(self._work, alone, self.setup.layout)
        before = self.bank.state["log_weight"].copy()
        _, self.over = update_beside(self.bank, alone, imu, parameters, self._work, self.setup)
        if self.settling:
            self.bank.state["log_weight"] = before
            self.settling = int(alone.epoch_ns[0]) - self.since_ns < _SETTLING_NS

    def _thin_out(self) -> None:
        """Drop the alternatives without hope and those that have become one with a heavier alternative."""
        assert self.bank is not None
        weight = self.bank.state["log_weight"]
        hopeless = math.log(_OTHER_HEADING_WEIGHT) + _HOPELESS
        agreement, keep = _agreement(self.bank), list(range(self.n_given))
        for i in np.argsort(-weight, kind="stable"):
            alternative = i >= self.n_given and weight[i] >= hopeless
            if alternative and not agreement[i, keep[self.n_given :]].any():
                keep.append(int(i))
        self.over = bool(self._agreeing(agreement)[keep].all())
        if len(keep) < len(weight) and not self.over:
            self.bank = select_members(self.bank, np.array(sorted(keep), np.int64))


def validation(setup: FilterSetup, *, is_given: bool) -> StartValidation | None:
    """Return the validation of a filter that has started: of a given start or of a sensor's heading; None of neither.

    Where several antennas measure the attitude, they check it.
    """
    own = setup.own
    headings = () if own is None else own.headings
    if setup.aid is not None or not setup.config.health.recovery or not (is_given or headings):
        return None
    if own is not None and headings:
        setup = replace(setup, own=own.without(headings))
    return StartValidation(setup, headings, is_given)


def banks_of(bank: Bank | None, trial: StartValidation | None) -> list[Bank]:
    """Return everything carried along with the samples: the filter, if it has started, and its alternatives."""
    return [each for each in (bank, None if trial is None else trial.bank) if each is not None]


def refusal(trial: StartValidation, t_ns: int, was: Bank, now: Bank) -> Event:
    """Leave out the sensors that gave a heading to a filter whose place the alternatives take; return the event."""
    names = refute(now.head[0], trial.headings, was.head[0], is_given=trial.is_given)
    refuted = " and ".join(f"'{name}'" for name in names)
    contradicted = "the given start" if trial.is_given else refuted
    before, after = (
        ", ".join(f"{math.degrees(angle):.1f}" for angle in attitude(bank.state[bank.head[0].leader]))
        for bank in (was, now)
    )
    n = len(now.state)
    detail = (
        f"the measurements contradict {contradicted}: roll, pitch, yaw ({before}) deg become ({after}) deg, with"
        f" {'one heading' if n == 1 else f'{n} headings'} open"
    )
    until = " is not used until it agrees" if len(names) == 1 else " are not used until they agree"
    return Event(t_ns, "restart", f"{detail}; {refuted}{until}" if names else detail)


def _heading_sigmas(bank: Bank) -> Float64:
    """Return the sigma of each hypothesis' rotation about the vertical (m,) [rad]."""
    pairs = zip(bank.state, bank.P, strict=True)
    return np.array([math.sqrt(max(yaw_variance(m, P), 0.0)) for m, P in pairs])


def _agreement(bank: Bank) -> Bool:
    """Return whether hypothesis ``i`` has come to the attitude of ``j``, which it knows about as well, (m, m).

    The gyro biases belong to it: a wrong heading that they have explained away may pass the right one on its way.

    Equation: d^T (P + s^2)^-1 d < 6, d the rotation from the one to the other and the difference of gyro biases
    """
    sigma, C_eb, b_g = _heading_sigmas(bank), bank.state["C_eb"], bank.state["b_g"]
    turn = C_eb[:, None] @ C_eb.transpose(0, 2, 1)
    axis = np.stack([turn[..., k, j] - turn[..., j, k] for j, k in ((1, 2), (2, 0), (0, 1))], axis=-1)
    sine = 0.5 * np.linalg.norm(axis, axis=-1)
    cosine = 0.5 * (np.trace(turn, axis1=2, axis2=3) - 1.0)
    angle = np.arctan2(sine, cosine)
    least = [SMALLEST_DIFFERENCE_RAD**2] * 3 + [_SMALLEST_BIAS_RADPS**2] * 3
    P = bank.P[:, _TURNING, :][:, :, _TURNING] + np.diag(least)
    psi = 0.5 * axis * (angle / np.maximum(sine, 1e-12))[..., None]
    d = np.concatenate([psi, b_g[:, None] - b_g], axis=-1)
    distance2 = np.einsum("ijk,ikj->ij", d, np.linalg.solve(P, d.transpose(0, 2, 1)))
    known = sigma[:, None] <= np.maximum(SMALLEST_DIFFERENCE_RAD, _KNOWS_AS_WELL * sigma)
    near = angle**2 <= _SAME_ATTITUDE * np.trace(P[:, :3, :3], axis1=1, axis2=2)[:, None]
    opposite = (sine < 1e-9) & (cosine < 0.0)
    return np.asarray(known & near & ~opposite & (distance2 < _SAME_ATTITUDE))


def _log_sum(weights: Float64) -> float:
    """Return the logarithm of the sum of weights given by their logarithms."""
    top = float(weights.max())
    return top + math.log(float(np.exp(weights - top).sum()))
