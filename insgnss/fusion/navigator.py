"""A filter over one unbroken stretch of inertial samples: start, run, recover, tell what happened.

``replay`` hands it all epochs at once, the streaming engine one at a time: the same calls, the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S, WGS84_A_M
from insgnss.fusion.epoch_aid import EpochAid
from insgnss.fusion.fix import Fix, fix_epoch
from insgnss.fusion.lines import Lines
from insgnss.fusion.lockout import absorb, clock_steps, in_words, is_thin
from insgnss.fusion.loop import (
    COVARIANCE_LOST,
    DONE,
    HEADING_KNOWN,
    LOCKOUT,
    SUSPICION,
    THIN_OUT,
    Workspace,
    new_workspace,
    run_epochs,
    superfluous,
    write_row,
    yaw_variance,
)
from insgnss.fusion.output import N_USED, Output, event_in_words
from insgnss.fusion.past import Past
from insgnss.fusion.prediction import Imu
from insgnss.fusion.recovery import Doubt, contradicted_kind, open_doubt
from insgnss.fusion.recovery import in_words as reset_in_words
from insgnss.fusion.setup import FilterSetup
from insgnss.fusion.starter import Starter
from insgnss.fusion.state import Bank, copy_bank, select_members
from insgnss.fusion.suspects import IMU_TAGS, GNSS_TAGS, judge
from insgnss.fusion.verdict_words import in_words as verdict_in_words
from insgnss.fusion.trial import Trial, attitude, banks_of, refusal
from insgnss.gnss.observation_rows import ABSENT, Rows
from insgnss.status import NO_EPOCH_BEFORE, NOT_STARTED, REFUSED_AT_START, USED, USED_FOR_START
from insgnss.tables import Event, Int16

_WRONG_VERTICAL_RAD = math.radians(0.5)  # a reset that turns the vertical by more leaves no attitude to keep
_TELL_AGAIN_NS = 60 * NS_PER_S
_DOUBTED = math.log(0.5)  # a given start of less probability is given up rather than set right


class Snapshot(NamedTuple):
    """All of a navigator that changes with the data."""

    bank: Bank | None
    starter: Starter
    resets_ns: list[int]
    events: list[Event]
    started_ns: int | None
    aid: EpochAid | None
    trial: Trial | None
    doubt: Doubt | None
    past: Past
    told_ns: dict[str, int]

    @property
    def banks(self) -> list[Bank]:
        """As ``Navigator.banks``."""
        doubted = [] if self.doubt is None else [self.doubt.bank]
        return [*banks_of(self.bank, self.trial), *doubted, *self.past.banks]


@dataclass
class Navigator:
    """The filter and everything about it that is not in the compiled loop."""

    setup: FilterSetup
    before_loop: Callable[[], object] = lambda: None  # called when the compiled loop is needed
    starter: Starter = field(init=False)
    aid: EpochAid | None = field(init=False)  # by several antennas, None without
    bank: Bank | None = None
    resets_ns: list[int] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    started_ns: int | None = None
    trial: Trial | None = None  # of a given start
    doubt: Doubt | None = None  # whether the filter is lost
    past: Past = field(default_factory=Past)  # of the last minute
    told_ns: dict[str, int] = field(default_factory=dict)  # when something that lasts was told last
    _parameters: npt.NDArray[Any] = field(init=False)
    _work: Workspace | None = None

    def __post_init__(self) -> None:
        """Resolve the parameters and get ready to start."""
        self._parameters = self.setup.parameters()
        self.starter = Starter(self.setup, given=self.setup.start is not None)
        self.aid = None if self.setup.new_aid is None else self.setup.new_aid()

    @property
    def parameters(self) -> npt.NDArray[Any]:
        """The numbers of the compiled filter, (1,)."""
        return self._parameters

    @property
    def banks(self) -> list[Bank]:
        """All that is carried along with the samples: the filter, if it has started, and its rivals on trial."""
        doubted = [] if self.doubt is None else [self.doubt.bank]
        return [*banks_of(self.bank, self.trial), *doubted, *self.past.banks]

    def snapshot(self) -> Snapshot:
        """Return a copy of everything that changes with the data."""
        return Snapshot(
            bank=None if self.bank is None else copy_bank(self.bank),
            starter=self.starter.snapshot(),
            resets_ns=list(self.resets_ns),
            events=list(self.events),
            started_ns=self.started_ns,
            aid=None if self.aid is None else self.aid.snapshot(),
            trial=None if self.trial is None else self.trial.copied(),
            doubt=None if self.doubt is None else self.doubt.copied(),
            past=self.past,
            told_ns=dict(self.told_ns),
        )

    def restore(self, saved: Snapshot) -> None:
        """Return to a snapshot."""
        self.bank = None if saved.bank is None else copy_bank(saved.bank)
        self.starter = saved.starter.snapshot()
        self.resets_ns, self.events = list(saved.resets_ns), list(saved.events)
        self.started_ns = saved.started_ns
        self.aid = None if saved.aid is None else saved.aid.snapshot()
        self.trial = None if saved.trial is None else saved.trial.copied()
        self.doubt = None if saved.doubt is None else saved.doubt.copied()
        self.past = saved.past
        self.told_ns = dict(saved.told_ns)

    def run(self, imu: Imu, rows: Rows, first: int, last: int, out: Output) -> None:
        """Process the epochs ``first`` to ``last - 1``, all of them within the inertial samples."""
        epoch = first
        while epoch < last:
            if self.bank is None:
                epoch += self._try_start(imu, rows, epoch, out)
                continue
            work = self.workspace(rows)
            self.before_loop()
            stop = last if self.aid is None and self.doubt is None else epoch + 1
            if self.trial is not None:
                stop = min(stop, self.trial.epoch_after_look(rows, epoch, last))
            if self.past.banks or len(self.bank.state) == 1:
                due_ns = int(self.bank.head[0].doubted_ns) if self.past.unclear_ns else self.past.due_ns
                due = int(np.searchsorted(rows.epoch_ns, due_ns))
                stop = min(stop, max(due, epoch) + 1)
            begin = epoch
            code, epoch = run_epochs(
                self.bank, epoch, stop, rows, imu, self._parameters, self.setup.log_drop, out, work
            )
            self._collect_events(out)
            self.past = self.past.after(self.bank, rows, begin, epoch)
            t_ns = int(rows.epoch_ns[epoch - 1])
            if code == DONE and self.past.unclear_ns and t_ns >= self.bank.head[0].doubted_ns:
                code = SUSPICION
            doubt = self.doubt
            if self.trial is None:
                self._handle(code, imu, rows, epoch - 1, out)
            else:
                self._try(self.trial, code, imu, rows, epoch - 1, out)
            if doubt is not None and doubt is self.doubt:
                self._weigh(doubt, imu, rows, epoch - 1, out)
            if self.aid is not None:
                self._use_antennas(self.aid, imu, rows, epoch - 1, out)

    def _try(self, trial: Trial, code: int, imu: Imu, rows: Rows, epoch: int, out: Output) -> None:
        """Act on what stopped the compiled loop, and put the given start on trial with the epoch."""
        t_ns = int(rows.epoch_ns[epoch])
        if code == LOCKOUT and trial.standing() < _DOUBTED:
            self._refuse_start(t_ns, trial.rivals())  # rather than to set right what is not worth it
            return
        self._handle(code, imu, rows, epoch, out)
        if self.bank is None:
            self.trial = None
        else:
            found = trial.take(self.bank, imu, rows, epoch, self._parameters)
            if found is not None:
                self._refuse_start(t_ns, found)
            elif trial.over:
                self.trial = None

    def _refuse_start(self, t_ns: int, found: Bank) -> None:
        """Put the rivals of the given start in its place."""
        assert self.bank is not None
        self.events.append(refusal(t_ns, self.bank, found))
        self.bank, self.trial, self.doubt, self.resets_ns = found, None, None, []
        self.past = Past()
        found.head["renewed_ns"] = t_ns
        self._tell_heading()

    def _use_antennas(self, aid: EpochAid, imu: Imu, rows: Rows, epoch: int, out: Output) -> None:
        """Update with the phase differences of an epoch, and write its navigation row once more."""
        t_ns = int(rows.epoch_ns[epoch])
        if self.bank is None or self.bank.head[0].now_ns != t_ns:
            return
        k = min(int(self.bank.head[0].next), len(imu.t_ns) - 1)
        self.bank, used = aid.use(self.bank, t_ns, imu.w_ib_b[k], self._parameters[0])
        self.events += aid.take_events()
        count = out.counts[0]
        if used and count.nav and out.nav[count.nav - 1].t_ns == t_ns:
            count.nav -= 1
            n_used = int(out.nav[count.nav].value[N_USED])
            lead = int(self.bank.head[0].leader)
            write_row(self.bank, self.bank, lead, t_ns, n_used, out, self.workspace(rows))
        if used:
            self._tell_heading()

    def workspace(self, rows: Rows) -> Workspace:
        """Return work space that fits the largest epoch."""
        largest = int(np.diff(rows.first).max()) if len(rows.epoch_ns) else 1
        if self._work is None or len(self._work.epoch.lines) < largest:
            self._work = new_workspace(
                largest, self.setup.layout, self.setup.installation, self.setup.visibility_limits
            )
        return self._work

    def _try_start(self, imu: Imu, rows: Rows, epoch: int, out: Output) -> int:
        """Try to start at an epoch; return 1 when that used the epoch up.

        A fix that starts the filter is in its state: its rows are not used again. A given state leaves the epoch to
        the filter.
        """
        bank, fix, events = self.starter.try_start(imu, rows, epoch, self._parameters[0])
        self.events += events
        if bank is None:
            mark_rows(out, rows, epoch, None)
            return 1
        self.bank = bank
        self.started_ns = int(bank.head[0].now_ns)
        bank.head["renewed_ns"] = self.started_ns
        self._tell_heading()
        if fix is None:
            # where the attitude chooses the satellites, hypotheses cannot be judged by the same ones
            chooses = self.aid is not None or self._parameters[0].visibility != 0
            self.trial = None if chooses else Trial(self.setup)
            return 0
        mark_rows(out, rows, epoch, fix)
        self._write_start(bank, rows, epoch, fix, out)
        return 1

    def _write_start(self, bank: Bank, rows: Rows, epoch: int, fix: Fix | None, out: Output) -> None:
        """Write the navigation row of an automatic start."""
        t_ns = int(rows.epoch_ns[epoch])
        count = out.counts[0]
        while count.time < len(out.times_ns) and out.times_ns[count.time] < t_ns:
            count.time += 1
        at_time = count.time < len(out.times_ns) and out.times_ns[count.time] == t_ns
        if at_time:
            count.time += 1
        if at_time or len(out.times_ns) == 0:
            lead = int(bank.head[0].leader)
            used = 0 if fix is None else fix.n_used
            write_row(bank, bank, lead, t_ns, used, out, self.workspace(rows))

    def _tell_heading(self) -> None:
        """Say that the heading is known when the start already knows it."""
        bank = self.bank
        if bank is not None and len(bank.state) == 1:
            limit = self._parameters[0].heading_known_variance
            if yaw_variance(bank.state[0], bank.P[0]) < limit:
                self._heading_known()

    def _handle(self, code: int, imu: Imu, rows: Rows, epoch: int, out: Output) -> None:
        """Act on what stopped the compiled loop after ``epoch``."""
        if code == THIN_OUT:
            self._thin_out()
        elif code == HEADING_KNOWN:
            self._heading_known()
        elif code == LOCKOUT:
            self._recover(imu, rows, epoch)
        elif code == SUSPICION:
            self._suspect(imu, int(rows.epoch_ns[epoch]))
        elif code == COVARIANCE_LOST:
            t_ns = int(rows.epoch_ns[epoch])
            self._restart(t_ns, "a variance of the filter lost its sign")
        elif code != DONE:
            raise AssertionError(f"unknown code {code} of the compiled loop")

    def _thin_out(self) -> None:
        """Drop the hypotheses of negligible weight and those that have become one with a heavier one."""
        bank = self.bank
        if bank is None:
            return
        n = len(bank.state)
        keep = np.array([i for i in range(n) if not superfluous(bank, i, self.setup.log_drop)], np.int64)
        self.bank = select_members(bank, keep)
        if len(keep) == 1:
            t_ns = int(bank.head[0].now_ns)
            yaw, sd = self.heading_deg()
            self.events.append(
                Event(t_ns, "heading_single", f"one heading is left: {yaw:.1f} deg, sigma {sd:.1f} deg")
            )
            self._tell_heading()

    def heading_deg(self) -> tuple[float, float]:
        """Return the leader's heading and its sigma [deg]."""
        assert self.bank is not None
        m, P = self.bank.state[self.bank.head[0].leader], self.bank.P[self.bank.head[0].leader]
        _, _, yaw = attitude(m)
        return math.degrees(yaw) % 360.0, math.degrees(math.sqrt(yaw_variance(m, P)))

    def _heading_known(self) -> None:
        bank = self.bank
        if bank is None or bank.head[0].heading_open == 0:
            return
        bank.head["heading_open"] = 0
        t_ns = int(bank.head[0].now_ns)
        yaw, sd = self.heading_deg()
        after = (t_ns - (self.started_ns or t_ns)) / NS_PER_S
        detail = f"heading {yaw:.1f} deg, sigma {sd:.1f} deg, {after:.1f} s after the start"
        self.events.append(Event(t_ns, "heading_known", detail))

    def _suspect(self, imu: Imu, t_ns: int) -> None:
        """Look whether an inertial sensor has failed, and put the filter that knows of it in the place of this one."""
        bank = self.bank
        assert bank is not None
        was = self.past.banks[:1]
        verdict, self.past = judge(self.past, self.setup, imu, self._parameters)
        bank.head["doubted_ns"] = t_ns + self.past.respite_ns
        if verdict is None:
            return
        event = verdict_in_words(t_ns, was[0], verdict)
        if verdict.suspect in (IMU_TAGS, GNSS_TAGS):
            self._tell(t_ns, event.kind, event.detail)
            return
        self.events.append(event)
        verdict.bank.head[:] = bank.head
        verdict.bank.head["renewed_ns"] = t_ns
        self.bank, self.doubt = verdict.bank, None

    def _recover(self, imu: Imu, rows: Rows, epoch: int) -> None:
        """Put a fix of the epoch on trial, or absorb a step of the clock that the refused rows agree on."""
        bank = self.bank
        if bank is None:
            return
        t_ns = int(rows.epoch_ns[epoch])
        health = self.setup.config.health
        refusing = bank.head[0].locked_out >= health.lockout_epochs
        bank.head["locked_out"] = 0
        bank.head["strained_ns"] = 0
        reason = (
            f"most measurements refused for {health.lockout_epochs} epochs"
            if refusing
            else f"innovations far too large for {health.strain_s:.0f} s"
        )
        first, last = rows.first[epoch], rows.first[epoch + 1]
        lines, sv = self.workspace(rows).epoch.lines[: last - first], rows.observation["sv"][first:last]
        if len(bank.state) == 1 and t_ns >= bank.head[0].doubted_ns and health.recovery:
            self._suspect(imu, t_ns)
            if self.bank is not bank:
                return
        kind = contradicted_kind(lines)
        if kind is not None:
            self._tell(t_ns, "kind_refused", f"{reason}: {kind}")
        fix = None
        if not (refusing and is_thin(lines)):
            par, groups = self._parameters[0], self.setup.n_offsets + 1
            fix = fix_epoch(rows, epoch, par, groups, self.setup.config.start.max_gdop)
        if fix is None or not fix.checked:
            if not (refusing and self._absorb_steps(bank, lines, sv, t_ns)) and kind is None:
                self._tell(t_ns, "lockout", f"{reason}, and no fix to recover with")
        elif not health.recovery:
            self._tell(t_ns, "lockout", f"{reason}, and recovery is switched off")
        else:
            if self.doubt is None:
                k = min(int(bank.head[0].next), len(imu.t_ns) - 1)
                self.doubt = open_doubt(self.setup, bank, fix, imu.w_ib_b[k], t_ns, reason)

    def _weigh(self, doubt: Doubt, imu: Imu, rows: Rows, epoch: int, out: Output) -> None:
        """Let an epoch say what is wrong with the filter, and set it right when that is clear."""
        bank = self.bank
        assert bank is not None
        found = doubt.take(bank, imu, rows, epoch, self._parameters, out)
        if doubt.over:
            self.doubt = None
        if found is not None:
            self._set_right(bank, found, doubt, int(rows.epoch_ns[epoch]))

    def _set_right(self, was: Bank, found: Bank, doubt: Doubt, t_ns: int) -> None:
        """Put what the rows have borne out in the filter's place; start all over when that does not last."""
        health = self.setup.config.health
        if self.trial is not None:
            self.trial = Trial(self.setup)  # of the filter as it has been set right
        self.bank, self.past = found, self.past.forgotten()
        found.head["renewed_ns"] = t_ns
        recent = [t for t in self.resets_ns if t_ns - t <= health.lost_window_s * NS_PER_S]
        self.resets_ns = [*recent, t_ns]
        moved_m = float(np.linalg.norm(found.state["r_e"][0] - was.state["r_e"][0]))
        if len(self.resets_ns) > health.heading_lost_resets:
            self._restart(t_ns, f"{len(self.resets_ns)} resets within {health.lost_window_s:.0f} s")
        elif moved_m / WGS84_A_M > _WRONG_VERTICAL_RAD:  # by so much the vertical turns with the position
            self._restart(
                t_ns, f"the position is {moved_m / 1000.0:.0f} km away: the attitude was levelled elsewhere"
            )
        else:
            self.events.append(reset_in_words(t_ns, was, found, doubt))

    def _tell(self, t_ns: int, kind: str, detail: str) -> None:
        """Tell something that lasts, once a minute at most."""
        if t_ns - self.told_ns.get(kind, -_TELL_AGAIN_NS) >= _TELL_AGAIN_NS:
            self.events.append(Event(t_ns, kind, detail))
            self.told_ns[kind] = t_ns

    def _absorb_steps(self, bank: Bank, lines: Lines, sv: Int16, t_ns: int) -> bool:
        """Absorb the steps of the receiver clock that the refused rows agree on; return whether there was one."""
        assert self._work is not None
        par, P = self._parameters[0], bank.P[bank.head[0].leader]
        correction = self._work.epoch.vectors[0, : len(P)]
        steps = clock_steps(lines, sv, P, correction, (par.range_gate2, par.rate_gate2))
        for step in steps:
            absorb(bank, step, par.lever_b)
            self.events.append(in_words(t_ns, step, self.setup.config.health.lockout_epochs))
            bank.head["renewed_ns"] = t_ns
        return len(steps) > 0

    def _restart(self, t_ns: int, reason: str) -> None:
        """Give the filter up and wait for a new automatic start."""
        self.bank = self.doubt = None
        self.resets_ns, self.past = [], Past()
        self.starter = Starter(self.setup, given=False)
        self.events.append(Event(t_ns, "restart", f"{reason}: the filter starts anew"))

    def _collect_events(self, out: Output) -> None:
        """Turn the compiled loop's events into words."""
        count = out.counts[0]
        for row in out.events[: min(count.events, len(out.events))]:
            self.events.append(event_in_words(int(row["t_ns"]), int(row["kind"]), float(row["a"])))
        if count.events > len(out.events):
            self.events.append(Event(None, "events_lost", f"{count.events - len(out.events)} further events"))
        count.events = 0


def mark_rows(out: Output, rows: Rows, epoch: int, fix: Fix | None) -> None:
    """Write what became of an epoch's usable rows outside the filter: not started, or part of a fix."""
    ledger = out.ledger
    index = np.arange(rows.first[epoch], rows.first[epoch + 1])
    if len(out.carrier):
        carrier = out.carrier["status"][index]
        carrier[carrier == USED] = NOT_STARTED if fix is None else NO_EPOCH_BEFORE
        out.carrier["status"][index] = carrier
    status = ledger["status"][index]
    usable = rows.observation["status"][index] == USED
    if fix is None:
        status[usable] = NOT_STARTED
    else:
        status[usable & ~fix.used.T] = REFUSED_AT_START
        status[usable & fix.used.T] = USED_FOR_START
    status[rows.observation["status"][index] == ABSENT] = ABSENT
    ledger["status"][index] = status
