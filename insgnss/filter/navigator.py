"""A filter over one unbroken stretch of inertial samples: start, run, recover, report events.

``replay`` hands it all epochs at once, the streaming engine one at a time: the same calls, the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.diagnosis.health import FilterHealth, Remedy
from insgnss.filter.epoch_aid import EpochAid
from insgnss.filter.headings.heading_bank import heading_deg, pruned, split
from insgnss.filter.headings.heading_events import heading_known, heading_open, heading_single
from insgnss.filter.headings.headings import heading_variance, headings_wanted, needs_pruning
from insgnss.filter.loop import (
    COVARIANCE_LOST,
    DONE,
    HEADING_KNOWN,
    HEADING_OPEN,
    HEADING_WIDE,
    LOCKOUT,
    PRUNE,
    SILENCE_S,
    SUSPICION,
    TAGS_JUMPED,
    current_sample,
    run_epochs,
    run_to,
    write_row,
)
from insgnss.filter.loop_events import outage, take_events
from insgnss.filter.output.writing import N_USED, Output
from insgnss.filter.own_rows.carrying import doubt_events
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.watch import RefusalWatch
from insgnss.filter.own_update import OwnUpdate, before, use_own_rows
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.soundness import is_sound
from insgnss.filter.start.carried_start import CarriedState, left_behind
from insgnss.filter.start.fix import Fix
from insgnss.filter.start.ledger_marks import mark_rows
from insgnss.filter.start.starter import Starter
from insgnss.filter.start.trial import StartValidation, banks_of, refusal, validation
from insgnss.filter.state import Bank, HeadRecord, copy_bank
from insgnss.filter.update.epoch_space import FilterWorkspace
from insgnss.filter.update.masking import still_uncertain
from insgnss.gnss.observation_rows import GnssRows
from insgnss.tables import Event

_DOUBTED = math.log(0.5)  # a given start of less probability is given up rather than set right


class Snapshot(NamedTuple):
    """All of a navigator that changes with the data."""

    bank: Bank | None
    starter: Starter
    events: list[Event]
    started_ns: int | None
    aid: EpochAid | None
    trial: StartValidation | None
    health: FilterHealth
    watch: RefusalWatch

    @property
    def banks(self) -> list[Bank]:
        """Everything that counts samples: objects carried along with them, and the earlier filter."""
        return [*banks_of(self.bank, self.trial), *self.health.banks, *self.health.past.banks]


@dataclass
class Navigator:
    """The filter and everything about it that is not in the compiled loop."""

    setup: FilterSetup
    starter: Starter = field(init=False)
    aid: EpochAid | None = field(init=False)  # by several antennas, None without
    bank: Bank | None = None
    opened: Bank | None = None  # as a given start has opened it, before its first epoch
    health: FilterHealth = field(init=False)
    events: list[Event] = field(default_factory=list)
    started_ns: int | None = None
    trial: StartValidation | None = None  # of a given start, or of a sensor's heading
    own: dict[int, list[OwnEntry]] = field(default_factory=dict)  # status of a user's own rows, by time
    watch: RefusalWatch = field(default_factory=RefusalWatch)  # of them
    after_own: Callable[[OwnUpdate], object] = lambda _: None  # called when they have been used
    before_antennas: Callable[[Bank], object] = lambda _: None  # called before several antennas' rows
    parameters: npt.NDArray[Any] = field(init=False)  # the numbers of the compiled filter, (1,)
    _work: FilterWorkspace | None = None

    def __post_init__(self) -> None:
        """Resolve the parameters and get ready to start."""
        self.parameters = self.setup.parameters()
        self.starter = Starter(self.setup, given=self.setup.start is not None)
        self.health = FilterHealth(self.setup)
        self.aid = None if self.setup.aid is None else self.setup.aid.copied(self.setup.aid.log)

    @property
    def banks(self) -> list[Bank]:
        """Everything carried along with the samples: the filter, if it has started, and its alternatives."""
        return [*banks_of(self.bank, self.trial), *self.health.banks]

    def snapshot(self) -> Snapshot:
        """Return a copy of everything that changes with the data."""
        return Snapshot(
            bank=None if self.bank is None else copy_bank(self.bank),
            starter=self.starter.snapshot(),
            events=list(self.events),
            started_ns=self.started_ns,
            aid=None if self.aid is None else self.aid.copied(),
            trial=None if self.trial is None else self.trial.copied(),
            health=self.health.copied(),
            watch=self.watch.copied(),
        )

    def restore(self, saved: Snapshot) -> None:
        """Return to a snapshot."""
        self.bank = None if saved.bank is None else copy_bank(saved.bank)
        self.starter = saved.starter.snapshot()
        self.events, self.started_ns = list(saved.events), saved.started_ns
        self.aid = None if saved.aid is None or self.aid is None else saved.aid.copied(self.aid.log)
        self.trial = None if saved.trial is None else saved.trial.copied()
        self.health, self.watch = saved.health.copied(), saved.watch.copied()
        self._use(self.health.setup)

    def _use(self, setup: FilterSetup) -> None:
        """Switch to another setup: its states, numbers and work space."""
        if setup is not self.setup:
            self.setup, self.parameters, self._work = setup, setup.parameters(), None

    def forget_own(self, after_ns: int) -> None:
        """Drop the status of a user's own rows after a time."""
        self.own = {t_ns: entries for t_ns, entries in self.own.items() if t_ns <= after_ns}

    def run(self, imu: ImuSamples, rows: GnssRows, first: int, last: int, out: Output) -> None:
        """Process the epochs ``first`` to ``last - 1``, all of them within the inertial samples."""
        epoch = first
        while epoch < last:
            if self.bank is None:
                epoch += self._try_start(imu, rows, epoch, out)
                continue
            work = self.workspace(rows)
            self.use_own_rows(imu, rows, int(rows.epoch_ns[epoch]), out)
            if self.bank is None:
                continue
            stop = last if self.aid is None else epoch + 1
            if self.setup.own is not None:
                stop = min(stop, self.setup.own.epochs_before_next(rows.epoch_ns, epoch, last))
            if self.trial is not None:
                stop = min(stop, self.trial.epoch_after_look(rows, epoch, last))
            stop, begin = min(stop, self.health.stop(self.bank, rows, epoch, last)), epoch
            par, drop = self.parameters, self.setup.log_drop
            code, epoch = run_epochs(self.bank, (epoch, stop), rows, imu, par, drop, out, work)
            self.events += take_events(out, self.setup)
            self.health.past = self.health.past.after(self.bank, rows, begin, epoch)
            doubt = self.health.doubt
            if self.trial is None:
                self._handle(code, imu, rows, epoch - 1)
            else:
                self._try(self.trial, code, imu, rows, epoch - 1)
            if doubt is not None and doubt is self.health.doubt and self.bank is not None:
                self._accept(
                    self.health.weigh(doubt, self.bank, imu, rows, epoch - 1, self.parameters, out),
                    int(rows.epoch_ns[epoch - 1]),
                )
            if self.aid is not None:
                self._use_antennas(self.aid, imu, rows, epoch - 1, out)

    def use_own_rows(self, imu: ImuSamples, rows: GnssRows, until_ns: int, out: Output) -> None:
        """Carry the filter by way of own rows up to ``until_ns``, work space as for ``rows``; it stays at the last."""
        if self.setup.own is None or self.bank is None:
            return
        for t_ns in self.setup.own.due(int(self.bank.head[0].now_ns), until_ns):
            work = self.workspace(rows)
            run_to(self.bank, t_ns, imu, self.parameters, before(out, t_ns), work)
            own, head = self.setup.own, self.bank.head[0]
            update = use_own_rows(self.bank, t_ns, self.setup, imu, self.parameters, work.scratch)
            self.events += [*update.events, *doubt_events(head, own.kinds, t_ns)]
            self.events += self.watch.take(own, t_ns, update.entries)
            self.own[t_ns] = update.entries
            if not is_sound(self.bank.state[head.leader], self.bank.P[head.leader]):
                del self.own[t_ns]
                self._restart(t_ns, "the state is no longer finite, or a variance is not positive")
                return
            if needs_pruning(self.bank, self.setup.log_drop):
                self._prune()
            self._tell_heading()
            self.after_own(update)

    def leave(self, imu: ImuSamples) -> CarriedState | None:
        """Return the carried start at the end of the filter's samples, its own if it never started."""
        if self.bank is None:
            return self.starter.carried
        return left_behind(self.bank, imu, self.setup, self.parameters)

    def _try(self, trial: StartValidation, code: int, imu: ImuSamples, rows: GnssRows, epoch: int) -> None:
        """Handle the stop of the compiled loop, and update the validation of the start with the epoch."""
        t_ns = int(rows.epoch_ns[epoch])
        if code == LOCKOUT and trial.log_probability() < _DOUBTED:
            # rather than set right what is not worth it
            self._refuse_start(t_ns, trial.end_with_alternatives())
            return
        assert self.bank is not None
        if not trial.waits:
            self.bank.head["doubted_ns"] = t_ns + 1  # the start is in doubt, no inertial sensor
        self._handle(code, imu, rows, epoch)
        if self.bank is None:
            self.trial = None
        elif self.trial is trial:
            bank = trial.update(self.bank, imu, rows, epoch, self.parameters)
            if bank is not None:
                self._refuse_start(t_ns, bank)
            elif trial.over:
                self.trial = None

    def _refuse_start(self, t_ns: int, bank: Bank) -> None:
        """Replace the filter by the alternatives to its start."""
        assert self.bank is not None
        assert self.trial is not None
        self.events.append(refusal(self.trial, t_ns, self.bank, bank))
        self.bank, self.trial = bank, None
        self.health.forget()
        bank.head["renewed_ns"], bank.head["placed_ns"] = t_ns, 0
        self._tell_heading()

    def _use_antennas(self, aid: EpochAid, imu: ImuSamples, rows: GnssRows, epoch: int, out: Output) -> None:
        """Update with the phase differences of an epoch, and rewrite its navigation row."""
        t_ns = int(rows.epoch_ns[epoch])
        if self.bank is None or self.bank.head[0].now_ns != t_ns:
            return
        self.before_antennas(self.bank)
        k = current_sample(self.bank, imu)
        self.bank, used = aid.use(self.bank, t_ns, imu.w_ib_b[k], self.parameters[0])
        self.events += aid.take_events()
        count = out.counts[0]
        if used and count.nav and out.nav[count.nav - 1].t_ns == t_ns:
            count.nav -= 1
            self._write_row(self.bank, int(out.nav[count.nav].value[N_USED]), rows, epoch, out)
        if used:
            self._tell_heading()

    def workspace(self, rows: GnssRows) -> FilterWorkspace:
        """Return work space that fits the largest epoch."""
        largest = int(np.diff(rows.first).max()) if len(rows.epoch_ns) else 1
        if self._work is None or len(self._work.epoch.lines) < largest:
            self._work = self.setup.workspace(largest)
        return self._work

    def _try_start(self, imu: ImuSamples, rows: GnssRows, epoch: int, out: Output) -> int:
        """Try to start at an epoch; return 1 when that used the epoch up.

        A fix that starts the filter is in its state: its rows are not used again. A given state leaves the epoch to
        the filter.
        """
        bank, fix, events = self.starter.try_start(imu, rows, epoch, self.parameters[0])
        self.events += events
        if bank is None:
            mark_rows(out, rows, epoch, None)
            return 1
        self.bank = bank
        self.health.place_what_is_known(bank, self.starter.carried)
        self.started_ns = int(bank.head[0].now_ns)
        bank.head["renewed_ns"] = self.started_ns
        self._tell_heading()
        self.trial = validation(self.setup, is_given=fix is None)
        if fix is None:
            self.opened = copy_bank(bank)
            return 0
        mark_rows(out, rows, epoch, fix)
        self._write_start(bank, rows, epoch, fix, out)
        return 1

    def _write_start(self, bank: Bank, rows: GnssRows, epoch: int, fix: Fix | None, out: Output) -> None:
        """Write the navigation row of an automatic start."""
        t_ns = int(rows.epoch_ns[epoch])
        count = out.counts[0]
        while count.time < len(out.times_ns) and out.times_ns[count.time] < t_ns:
            count.time += 1
        at_time = count.time < len(out.times_ns) and out.times_ns[count.time] == t_ns
        count.time += at_time
        if at_time or len(out.times_ns) == 0:
            self._write_row(bank, 0 if fix is None else fix.n_used, rows, epoch, out)

    def _write_row(self, bank: Bank, n_used: int, rows: GnssRows, epoch: int, out: Output) -> None:
        lead, par, work = int(bank.head[0].leader), self.parameters[0], self.workspace(rows)
        write_row(bank, bank, lead, int(rows.epoch_ns[epoch]), n_used, par, out, work)

    def _tell_heading(self) -> None:
        """Say that the heading is known when the start already knows it."""
        if self.bank is not None and heading_variance(self.bank) < self.parameters[0].heading_known_variance:
            self._heading_known()

    def _handle(self, code: int, imu: ImuSamples, rows: GnssRows, epoch: int) -> None:
        """Handle the stop of the compiled loop after ``epoch``."""
        bank, t_ns = self.bank, int(rows.epoch_ns[epoch])
        assert bank is not None
        if code == TAGS_JUMPED:
            self._accept(self.health.follow_tags(bank), t_ns)
            return
        remedy = self.health.blame_rates(bank, code, imu, rows, epoch, self.parameters)
        if remedy is not None:
            self._accept(remedy, t_ns)
        elif (self.trial is None or self.trial.waits) and self.health.is_due(bank, code, t_ns):
            self._accept(self.health.suspect(bank, imu, t_ns, self.parameters), t_ns)
        elif code == PRUNE:
            self._prune()
        elif code == HEADING_WIDE:
            self._split()
        elif code == HEADING_OPEN:
            self._heading_open(bank, heading_deg(bank)[1])
        elif code == HEADING_KNOWN:
            self._heading_known()
        elif code == LOCKOUT:
            space = self.workspace(rows).epoch
            self._accept(self.health.recover(bank, imu, rows, epoch, self.parameters, space), t_ns)
        elif code == COVARIANCE_LOST:
            self._restart(t_ns, "the state is no longer finite, or a variance is not positive")
        elif code not in (DONE, SUSPICION):
            raise AssertionError(f"unknown code {code} of the compiled loop")

    def _prune(self) -> None:
        """Drop the hypotheses of negligible weight and merge those that have become one."""
        if self.bank is None:
            return
        self.bank = pruned(self.bank, self.setup.log_drop, self.setup.layout)
        if len(self.bank.state) == 1:
            self.events.append(heading_single(self.bank))
            self._tell_heading()

    def _split(self) -> None:
        """Put hypotheses in the place of those that are too uncertain of their heading for one filter."""
        bank = self.bank
        if bank is None:
            return
        heading, par = self.setup.config.heading, self.parameters[0]
        single, (_, sd) = len(bank.state) == 1, heading_deg(bank)
        n = headings_wanted(bank, heading.hypotheses, par.widest_heading_variance)
        self.bank = split(bank, n, self.setup.log_drop, par.lever_b, self.setup.layout)
        if single:
            self._heading_open(self.bank, sd)

    def _heading_open(self, bank: Bank, sd_deg: float) -> None:
        bank.head["heading_open"] = 1
        self.events.append(heading_open(bank, sd_deg))

    def _heading_known(self) -> None:
        bank = self.bank
        if bank is None or bank.head[0].heading_open == 0:
            return
        bank.head["heading_open"] = 0
        self.events.append(heading_known(bank, self.started_ns))

    def _accept(self, remedy: Remedy, t_ns: int) -> None:
        """Apply the remedy of the filter's health."""
        self.events += remedy.events
        if remedy.give_up:
            self._restart(t_ns, remedy.give_up)
        elif remedy.bank is not self.bank:
            self.bank = remedy.bank
            self._use(self.health.setup)
            if self.trial is not None:
                self.trial = validation(self.setup, is_given=self.trial.is_given)  # of the reset filter

    def note_silence(self, t_ns: int) -> None:
        """Report at ``t_ns`` that the measurements have ended, if no further epoch reports it."""
        if self.bank is None or self.started_ns is None:
            return
        head: HeadRecord = self.bank.head[0]
        last_ns = max(int(head.epoch_ns), self.started_ns)
        if head.silent_ns == 0 and t_ns - last_ns > SILENCE_S * NS_PER_S:
            head.silent_ns = last_ns
            self.events.append(outage(last_ns, self.setup))

    def _restart(self, t_ns: int, reason: str) -> None:
        """Give the filter up and wait for a new automatic start."""
        self.events += still_uncertain(self.bank, self.setup.config.visibility)
        self.bank = self.opened = None
        self.health.forget()
        self.starter = Starter(self.setup, given=False)
        self.events.append(Event(t_ns, "restart", f"{reason}: the filter restarts"))
