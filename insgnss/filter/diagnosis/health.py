"""The filter's health: its reaction to contradicting measurements, and the memory for it.

Four things can be wrong with a filter whose rows do not fit. Something failed a short while ago, a sensor or a
satellite: then the last minute is run once more (``suspects``). Or the filter is lost: then a fix is put on trial
in parallel (``recovery``). Neither touches the filter before the rows have decided. Or the range rates agree on no
velocity: then the pseudoranges' fix takes the filter's place, and the rates are left out. Or the inertial samples are
far noisier than their grade: then the filter goes on, or restarts, with more noise until the grade's explains them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, WGS84_A_M
from insgnss.filter.diagnosis.hindsight import NOISY
from insgnss.filter.diagnosis.inertial_credit import (
    DISTRUSTED_RESTART,
    GRADE_NOISE_AGAIN,
    NEVER_NS,
    TRUSTED,
    TRY_AGAIN,
    InertialCredit,
)
from insgnss.filter.diagnosis.jumps import GYRO
from insgnss.filter.diagnosis.lockout import apply_clock_step, clock_steps, in_words, is_thin, may_tell
from insgnss.filter.diagnosis.offset_state import with_gnss_time
from insgnss.filter.diagnosis.past import FilterHistory
from insgnss.filter.diagnosis.recovery import (
    RecoveryTest,
    contradicted_kind,
    is_at_another_place,
    is_elsewhere,
    is_lost,
    open_doubt,
    rates_disagree,
)
from insgnss.filter.diagnosis.recovery import in_words as reset_in_words
from insgnss.filter.diagnosis.supposed_faults import INERTIAL_NOISE, INSTALLATION, LATE_RATES, SENSORS
from insgnss.filter.diagnosis.suspects import judge, left_out, run_away, with_noise_of_grade
from insgnss.filter.diagnosis.verdict_words import (
    RATES_DISAGREE,
    STUCK_RATES,
    creeping_in_words,
    refused_in_words,
)
from insgnss.filter.diagnosis.verdict_words import in_words as verdict_in_words
from insgnss.filter.loop import COVARIANCE_LOST, DONE, SUSPICION, current_sample
from insgnss.filter.output.writing import Output
from insgnss.filter.own_rows.contradiction import leave_out
from insgnss.filter.parameters import Parameters
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.rows.late_rates import set_lag
from insgnss.filter.rows.lines import EpochWorkspace
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.carried_start import CarriedState
from insgnss.filter.start.fix import Fix, fix_epoch
from insgnss.filter.state import Bank
from insgnss.gnss.observation_rows import PSEUDORANGE, RANGE_RATE, GnssRows
from insgnss.tables import Event

_SEVERAL: Final = 3  # satellites that run away together, and by that look like noise of all
_WRONG_VERTICAL_RAD = np.radians(0.5)  # a fix that turns the vertical by more leaves no attitude to keep
_TELL_AGAIN_NS = 60 * NS_PER_S
# of the kept past before noise began: after less the attitude may come from noisy samples
_SOUND_NS = 20 * NS_PER_S
_RATES_LOOK_NS = 5 * NS_PER_S
_NO_VELOCITY_NS = 600 * NS_PER_S  # for which rates that agree on none stay out: a wrong wavelength lasts


class Remedy(NamedTuple):
    """The action on the filter."""

    bank: Bank  # that goes on: the same or another one
    events: list[Event]
    give_up: str = ""  # why it has to restart instead


@dataclass
class FilterHealth:
    """A filter's memory of its own health, and its recovery."""

    setup: FilterSetup  # a filter that has found tags or a lever arm to be off has further states
    resets_ns: list[int] = field(default_factory=list)
    doubt: RecoveryTest | None = None  # whether the filter is lost
    past: FilterHistory = field(default_factory=FilterHistory)  # the last minute
    told_ns: dict[str, int] = field(default_factory=dict)  # when a lasting condition was last reported
    credit: InertialCredit = field(default_factory=InertialCredit)
    rates_look_ns: int = 0  # when satellites that run away are looked at next, while headings are open
    # of a filter that restarts, too: until when range rates stay out, and by how much they were found to lag
    rates_out_ns: int = 0
    rates_late_s: float | None = None  # None: as the flight file says

    def copied(self) -> FilterHealth:
        """Return a copy that shares nothing that changes."""
        doubt = None if self.doubt is None else self.doubt.copied()
        resets_ns, told_ns = list(self.resets_ns), dict(self.told_ns)
        return replace(self, resets_ns=resets_ns, doubt=doubt, told_ns=told_ns, credit=self.credit.copied())

    @property
    def banks(self) -> list[Bank]:
        """Everything carried along with the samples."""
        return [] if self.doubt is None else [self.doubt.bank]

    def stop(self, bank: Bank, rows: GnssRows, epoch: int, last: int) -> int:
        """Return up to which epoch the filter may run before its health is checked."""
        if self.doubt is not None:
            return epoch + 1
        due_ns = min(self.credit.retry_ns, self._look_ns(bank))
        if len(bank.state) > 1:
            due_ns = min(due_ns, self.rates_look_ns)
        if self.past.banks or len(bank.state) == 1:
            due_ns = min(due_ns, self.past.due_ns)  # a stream keeps the filter then, too
            if self.past.unclear_ns:
                due_ns = min(due_ns, int(bank.head[0].doubted_ns))
        return min(max(int(np.searchsorted(rows.epoch_ns, due_ns)), epoch) + 1, last)

    def is_due(self, bank: Bank, code: int, t_ns: int) -> bool:
        """Return whether the loop, stopped with ``code``, calls for a look at what has failed or has recovered."""
        if code == SUSPICION or t_ns >= min(self.credit.retry_ns, self._look_ns(bank)):
            return True
        return code == DONE and self.past.unclear_ns != 0 and t_ns >= int(bank.head[0].doubted_ns)

    def place_what_is_known(self, bank: Bank, carried: CarriedState | None) -> None:
        """Write into a filter that starts what is known of its sensors and range rates, ``carried`` over a gap too."""
        if self.rates_late_s is None and carried is not None:
            self.rates_late_s = float(carried.state.rates_late_s)
        bank.state["noise_excess"] = self.credit.excess
        bank.state["rates_out_ns"] = self.rates_out_ns
        known = self.setup.range_rate_lag_s if self.rates_late_s is None else self.rates_late_s
        set_lag(bank, known)

    def forget(self) -> None:
        """Clear what concerns a filter that no longer exists."""
        self.doubt, self.past, self.resets_ns = None, self.past.forgotten(), []

    def suspect(self, bank: Bank, imu: ImuSamples, t_ns: int, parameters: npt.NDArray[Any]) -> Remedy:
        """Look whose fault it is that the satellites contradict the prediction."""
        if t_ns >= self.credit.retry_ns:
            self.credit.try_again(t_ns)
            return Remedy(bank, [], TRY_AGAIN)
        if t_ns >= self._look_ns(bank):
            return self._look_for_grade_noise(bank, imu, t_ns, parameters)
        if int(bank.state[0].stuck_since_ns) == t_ns:
            return Remedy(bank, [Event(t_ns, "kind_refused", STUCK_RATES)])
        if bank.head[0].heading_open == 1:
            bank.head["doubted_ns"] = t_ns + self.past.respite_ns
            return Remedy(bank, [])  # a heading that is not known yet explains what a sensor would
        was = self.past.banks[:1]
        crept = int(bank.state[0].crept_ns) == t_ns
        # where all range rates are noisy, a satellite or two that stand out for a while are not worth an event
        noisy = bank.state[0].noise_factor[RANGE_RATE] >= NOISY
        news = crept and (not noisy or len(left_out(bank, t_ns)) >= _SEVERAL)
        if t_ns < bank.head[0].doubted_ns:
            return Remedy(bank, self._creeping(bank, t_ns) if news else [])
        if crept and bank.state[0].suspicion <= parameters[0].suspicion_limit:
            verdict, self.past = run_away(self.past, bank, self.setup, imu, parameters)
        else:
            verdict, self.past = judge(self.past, self.setup, imu, parameters)
        bank.head["doubted_ns"] = t_ns + self.past.respite_ns
        if verdict is None:
            return Remedy(bank, self._creeping(bank, t_ns) if news else [])
        if verdict.suspect == INERTIAL_NOISE:
            from_the_start = verdict.onset_ns - int(was[0].head[0].now_ns) < _SOUND_NS
            self.credit.found_noise(t_ns, float(verdict.bank.state[0].noise_excess), from_the_start)
            event = self.credit.event(t_ns, parameters[0], found=True)
            if from_the_start:
                return Remedy(bank, [event], DISTRUSTED_RESTART)
        else:
            event = verdict_in_words(t_ns, was[0], verdict)
        if verdict.setup is not None:
            self.setup = verdict.setup
        elif verdict.suspect in INSTALLATION:
            return Remedy(bank, self._told(event))
        if verdict.suspect == LATE_RATES:
            self.rates_late_s = float(verdict.bank.state[0].rates_late_s)
        self._renew(verdict.bank, bank, t_ns)
        if self.setup.own is not None:
            kinds = [kind for kind in self.setup.own.kinds if kind.name in verdict.kinds]
            leave_out(verdict.bank.head[0], kinds, for_good=verdict.size != 0.0)
        if verdict.suspect in SENSORS and verdict.suspect != INERTIAL_NOISE:
            par, db2 = parameters[0], sum(moved * moved for moved in verdict.moved)
            density = par.gyro_density if verdict.suspect == GYRO else par.accel_density
            if self.credit.is_lost_by_jump(t_ns, db2, density):
                return self._distrust(bank, [event], t_ns, par)
        return Remedy(verdict.bank, [event])

    def follow_tags(self, bank: Bank) -> Remedy:
        """Go on with the offset of the GNSS tags as a state, where possible; no look back crosses their jump."""
        self.doubt, self.past = None, self.past.forgotten()
        bank, self.setup = with_gnss_time(bank, self.setup)
        return Remedy(bank, [])

    def _renew(self, new_bank: Bank, bank: Bank, t_ns: int) -> None:
        """Give a filter that a look back has computed the place of ``bank``; what was on trial beside that is over."""
        new_bank.head[:] = bank.head
        new_bank.head["renewed_ns"] = t_ns
        self.doubt = None

    def _look_ns(self, bank: Bank) -> int:
        """Return when it is asked whether the inertial samples are as good as their grade again."""
        return self.credit.look_ns if len(bank.state) == 1 else NEVER_NS

    def _look_for_grade_noise(
        self, bank: Bank, imu: ImuSamples, t_ns: int, parameters: npt.NDArray[Any]
    ) -> Remedy:
        """Return to the noise of the grade if it explains the last minute again."""
        verdict, self.past = with_noise_of_grade(self.past, self.setup, imu, parameters)
        if verdict is None:
            self.credit.look_later(t_ns)
            return Remedy(bank, [])
        self.credit.trust_again(t_ns)
        self._renew(verdict.bank, bank, t_ns)
        return Remedy(verdict.bank, [Event(t_ns, TRUSTED, GRADE_NOISE_AGAIN)])

    def _distrust(self, bank: Bank, events: list[Event], t_ns: int, par: Parameters) -> Remedy:
        """Restart with noise that explains the sensors' failures."""
        return Remedy(bank, [*events, self.credit.event(t_ns, par)], DISTRUSTED_RESTART)

    def recover(
        self,
        bank: Bank,
        imu: ImuSamples,
        rows: GnssRows,
        epoch: int,
        parameters: npt.NDArray[Any],
        space: EpochWorkspace,
    ) -> Remedy:
        """Validate a fix of the epoch, or absorb a step of the clock that the refused rows agree on.

        ``space`` holds the leader's lines and correction of the epoch.
        """
        t_ns = int(rows.epoch_ns[epoch])
        health = self.setup.config.health
        refusing = bool(bank.head[0].rejected_epochs >= health.lockout_epochs)
        bank.head["rejected_epochs"] = 0
        bank.head["diverged_ns"] = 0
        reason = (
            f"most measurements refused for {health.lockout_epochs} epochs"
            if refusing
            else f"innovations far too large for {health.strain_s:.0f} s"
        )
        events: list[Event] = []
        lines = space.lines[: rows.first[epoch + 1] - rows.first[epoch]]
        if may_tell(lines) and health.recovery:
            remedy = self._second_look(bank, imu, t_ns, parameters)
            if remedy.give_up or remedy.bank is not bank:
                return remedy
            events = remedy.events
        kind = contradicted_kind(lines)
        fix = None if refusing and is_thin(lines) else self._fix(rows, epoch, parameters[0])
        without = self._without_rates(bank, imu, fix, t_ns, parameters[0]) if health.recovery else None
        if without is not None:
            return without._replace(events=events + without.events)
        if kind is not None:
            events += self._told(Event(t_ns, "kind_refused", f"{reason}: {refused_in_words(kind)}"))
        if fix is None or not fix.checked:
            steps = self._steps(bank, rows, epoch, parameters, space) if refusing else []
            events += steps
            if not steps and kind is None:
                events += self._told(Event(t_ns, "lockout", f"{reason}, and no fix to recover with"))
        elif not health.recovery:
            events += self._told(Event(t_ns, "lockout", f"{reason}, and recovery is switched off"))
        elif self.doubt is None:
            w_ib_b = imu.w_ib_b[current_sample(bank, imu)]  # the next one a stream does not have yet
            doubt = open_doubt(self.setup, bank, fix, w_ib_b, t_ns, reason)
            if is_lost(lines, fix) or is_elsewhere(doubt):
                done = self._set_right(bank, doubt.at_once(bank, not refusing), doubt, t_ns, parameters[0])
                return done._replace(events=events + done.events)
            self.doubt = doubt
        return Remedy(bank, events)

    def blame_rates(
        self, bank: Bank, code: int, imu: ImuSamples, rows: GnssRows, epoch: int, parameters: npt.NDArray[Any]
    ) -> Remedy | None:
        """Look whether the satellites that run away have sound pseudoranges, and the range rates are wrong.

        With several headings open the loop raises no suspicion, so this looks every five seconds.
        """
        t_ns = int(rows.epoch_ns[epoch])
        if code == COVARIANCE_LOST:
            return None
        if len(bank.state) > 1:
            if t_ns < self.rates_look_ns:
                return None
            self.rates_look_ns = t_ns + _RATES_LOOK_NS
        elif code != SUSPICION:
            return None
        if not self.setup.config.health.recovery or not left_out(bank, t_ns):
            return None
        return self._without_rates(bank, imu, self._fix(rows, epoch, parameters[0]), t_ns, parameters[0])

    def _fix(self, rows: GnssRows, epoch: int, par: Parameters) -> Fix | None:
        return fix_epoch(rows, epoch, par, self.setup.ties, self.setup.config.start.max_gdop)

    def _without_rates(
        self, bank: Bank, imu: ImuSamples, fix: Fix | None, t_ns: int, par: Parameters
    ) -> Remedy | None:
        """Return the filter set to a fix without range rates, if these disagree and have led it astray."""
        if fix is None or not rates_disagree(fix):
            return None
        w_ib_b = imu.w_ib_b[current_sample(bank, imu)]
        doubt = open_doubt(self.setup, bank, fix, w_ib_b, t_ns, RATES_DISAGREE)
        if not is_at_another_place(doubt):
            return None
        new_bank = doubt.at_once(bank, doubtful=True)
        new_bank.state["rates_out_ns"] = self.rates_out_ns = t_ns + _NO_VELOCITY_NS
        self.doubt = None
        return self._set_right(bank, new_bank, doubt, t_ns, par)

    def _steps(
        self, bank: Bank, rows: GnssRows, epoch: int, parameters: npt.NDArray[Any], space: EpochWorkspace
    ) -> list[Event]:
        """Absorb the steps of the receiver clock that the refused rows agree on; return the events."""
        par, P, t_ns = parameters[0], bank.P[bank.head[0].leader], int(rows.epoch_ns[epoch])
        first, last = rows.first[epoch], rows.first[epoch + 1]
        sv, correction = rows.observation["sv"][first:last], space.vectors[0, : len(P)]
        steps = clock_steps(
            space.lines[: last - first],
            sv,
            P,
            correction,
            (par.kind[PSEUDORANGE].gate2, par.kind[RANGE_RATE].gate2),
        )
        for step in steps:
            apply_clock_step(bank, step, par.lever_b)
            bank.head["renewed_ns"] = t_ns
        return [in_words(t_ns, step, self.setup.config.health.lockout_epochs) for step in steps]

    def weigh(
        self,
        doubt: RecoveryTest,
        bank: Bank,
        imu: ImuSamples,
        rows: GnssRows,
        epoch: int,
        parameters: npt.NDArray[Any],
        out: Output,
    ) -> Remedy:
        """Let an epoch say whether the filter is lost, and set it right when that is clear."""
        t_ns = int(rows.epoch_ns[epoch])
        new_bank = doubt.take(bank, imu, rows, epoch, parameters, out)
        if doubt.over:
            self.doubt = None
        if new_bank is None:
            return Remedy(bank, [])
        remedy = self._second_look(bank, imu, t_ns, parameters)
        if remedy.give_up or remedy.bank is not bank:
            return remedy
        done = self._set_right(bank, new_bank, doubt, t_ns, parameters[0])
        return done._replace(events=remedy.events + done.events)

    def _second_look(self, bank: Bank, imu: ImuSamples, t_ns: int, parameters: npt.NDArray[Any]) -> Remedy:
        """Look whose fault it is before a reset, whatever came of the last look."""
        if len(bank.state) > 1 or t_ns < self.past.look_again_ns:
            return Remedy(bank, [])
        bank.head["doubted_ns"] = t_ns
        return self.suspect(bank, imu, t_ns, parameters)

    def _set_right(
        self, bank: Bank, new_bank: Bank, doubt: RecoveryTest, t_ns: int, par: Parameters
    ) -> Remedy:
        """Replace the filter by the copy that the rows support; restart if that does not last."""
        health = self.setup.config.health
        self.past = self.past.forgotten()
        new_bank.head["renewed_ns"], new_bank.head["placed_ns"] = t_ns, 0
        recent = [t for t in self.resets_ns if t_ns - t <= health.lost_window_s * NS_PER_S]
        self.resets_ns = [*recent, t_ns]
        moved_m = float(np.linalg.norm(new_bank.state["r_e"][0] - bank.state["r_e"][0]))
        dv = new_bank.state["v_e"][0] - bank.state["v_e"][0]
        if self.credit.is_lost_by_reset(t_ns, float(dv @ dv), par):
            return self._distrust(bank, [], t_ns, par)
        if len(self.resets_ns) > health.heading_lost_resets:
            return Remedy(bank, [], f"{len(self.resets_ns)} resets within {health.lost_window_s:.0f} s")
        if moved_m / WGS84_A_M > _WRONG_VERTICAL_RAD:  # by so much the vertical turns with the position
            far = (
                f"the fix is {moved_m / 1000.0:.0f} km away: roll and pitch, levelled here, do not hold there"
            )
            return Remedy(bank, [], far)
        return Remedy(new_bank, [reset_in_words(t_ns, bank, new_bank, doubt)])

    def _creeping(self, bank: Bank, t_ns: int) -> list[Event]:
        news = tuple(slot for slot in left_out(bank, t_ns) if self._is_news(f"left out {slot}", t_ns))
        return [creeping_in_words(t_ns, news)] if news else []

    def _told(self, event: Event) -> list[Event]:
        """Return an event of something that lasts, once a minute at most."""
        assert event.t_ns is not None
        return [event] if self._is_news(event.kind, event.t_ns) else []

    def _is_news(self, lasting: str, t_ns: int) -> bool:
        """Return whether a lasting condition was not reported within the last minute, and note that it is now."""
        if t_ns - self.told_ns.get(lasting, -_TELL_AGAIN_NS) < _TELL_AGAIN_NS:
            return False
        self.told_ns[lasting] = t_ns
        return True
