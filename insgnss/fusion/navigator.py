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
from insgnss.fusion.carried_start import Carried, left_behind
from insgnss.fusion.epoch_aid import EpochAid
from insgnss.fusion.fix import Fix, fix_epoch
from insgnss.fusion.heading_bank import heading_deg, pruned, split
from insgnss.fusion.headings import heading_variance
from insgnss.fusion.ledger_marks import mark_rows
from insgnss.fusion.lines import Lines
from insgnss.fusion.lockout import absorb, clock_steps, in_words, is_thin
from insgnss.fusion.loop import (
    COVARIANCE_LOST,
    DONE,
    HEADING_KNOWN,
    HEADING_WIDE,
    LOCKOUT,
    PRUNE,
    Workspace,
    new_workspace,
    run_epochs,
    write_row,
)
from insgnss.fusion.masking import became_of_uncertain, still_uncertain
from insgnss.fusion.output import MASKING_UNCERTAIN, N_USED, Output, event_in_words
from insgnss.fusion.prediction import Imu
from insgnss.fusion.resetting import doubt_sensors, reset_kinematics
from insgnss.fusion.setup import FilterSetup
from insgnss.fusion.starter import Starter
from insgnss.fusion.state import Bank, copy_bank
from insgnss.fusion.trial import Trial, banks_of, refusal
from insgnss.gnss.observation_rows import Rows
from insgnss.inertial.sensor_model import sensor_model
from insgnss.tables import Event, Int16

_WRONG_VERTICAL_RAD = math.radians(0.5)  # a reset that turns the vertical by more leaves no attitude to keep
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

    @property
    def banks(self) -> list[Bank]:
        """As ``Navigator.banks``."""
        return banks_of(self.bank, self.trial)


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
        return banks_of(self.bank, self.trial)

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
        )

    def restore(self, saved: Snapshot) -> None:
        """Return to a snapshot."""
        self.bank = None if saved.bank is None else copy_bank(saved.bank)
        self.starter = saved.starter.snapshot()
        self.resets_ns, self.events = list(saved.resets_ns), list(saved.events)
        self.started_ns = saved.started_ns
        self.aid = None if saved.aid is None else saved.aid.snapshot()
        self.trial = None if saved.trial is None else saved.trial.copied()

    def run(self, imu: Imu, rows: Rows, first: int, last: int, out: Output) -> None:
        """Process the epochs ``first`` to ``last - 1``, all of them within the inertial samples."""
        epoch = first
        while epoch < last:
            if self.bank is None:
                epoch += self._try_start(imu, rows, epoch, out)
                continue
            work = self.workspace(rows)
            self.before_loop()
            stop = last if self.aid is None else epoch + 1
            if self.trial is not None:
                stop = self.trial.epoch_after_look(rows, epoch, last)
            code, epoch = run_epochs(
                self.bank, epoch, stop, rows, imu, self._parameters, self.setup.log_drop, out, work
            )
            self._collect_events(out)
            if self.trial is None:
                self._handle(code, epoch - 1, rows, out)
            else:
                self._try(self.trial, code, imu, rows, epoch - 1, out)
            if self.aid is not None:
                self._use_antennas(self.aid, imu, rows, epoch - 1, out)

    def leave(self, imu: Imu) -> Carried | None:
        """Return what the filter leaves behind at the end of its samples, what it got itself where it never started."""
        if self.bank is None:
            return self.starter.carried
        return left_behind(self.bank, imu, self._parameters, self.setup.config)

    def _try(self, trial: Trial, code: int, imu: Imu, rows: Rows, epoch: int, out: Output) -> None:
        """Act on what stopped the compiled loop, and put the given start on trial with the epoch."""
        t_ns = int(rows.epoch_ns[epoch])
        if code == LOCKOUT and trial.standing() < _DOUBTED:
            self._refuse_start(t_ns, trial.rivals())  # rather than to set right what is not worth it
            return
        self._handle(code, epoch, rows, out)
        if self.bank is None:
            self.trial = None
        elif code == LOCKOUT:
            self.trial = Trial(self.setup)  # of the filter as it has been set anew
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
        self.bank, self.trial, self.resets_ns = found, None, []
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
        if self.bank is not None and heading_variance(self.bank) < self._parameters[0].heading_known_variance:
            self._heading_known()

    def _handle(self, code: int, epoch: int, rows: Rows, out: Output) -> None:
        """Act on what stopped the compiled loop after ``epoch``."""
        if code == PRUNE:
            self._prune()
        elif code == HEADING_WIDE:
            self._split()
        elif code == HEADING_KNOWN:
            self._heading_known()
        elif code == LOCKOUT:
            self._recover(epoch, rows, out)
        elif code == COVARIANCE_LOST:
            t_ns = int(rows.epoch_ns[epoch])
            self._restart(t_ns, "the state is not finite any more, or a variance not positive")
        elif code != DONE:
            raise AssertionError(f"unknown code {code} of the compiled loop")

    def _prune(self) -> None:
        """Drop the hypotheses of negligible weight and merge those that have become one."""
        if self.bank is None:
            return
        self.bank = pruned(self.bank, self.setup.log_drop, self.setup.layout)
        if len(self.bank.state) == 1:
            t_ns = int(self.bank.head[0].now_ns)
            yaw, sd = heading_deg(self.bank)
            self.events.append(
                Event(t_ns, "heading_single", f"one heading is left: {yaw:.1f} deg, sigma {sd:.1f} deg")
            )
            self._tell_heading()

    def _split(self) -> None:
        """Put hypotheses in the place of those that are too uncertain of their heading for one filter."""
        bank = self.bank
        if bank is None:
            return
        heading, par = self.setup.config.heading, self._parameters[0]
        single, (_, sd) = len(bank.state) == 1, heading_deg(bank)
        self.bank = split(bank, heading.hypotheses, self.setup.log_drop, par.lever_b, self.setup.layout)
        if single:
            self.bank.head["heading_open"] = 1
            detail = (
                f"the heading's sigma has grown to {sd:.0f} deg: {len(self.bank.state)} headings are open"
            )
            self.events.append(Event(int(bank.head[0].now_ns), "heading_open", detail))

    def _heading_known(self) -> None:
        bank = self.bank
        if bank is None or bank.head[0].heading_open == 0:
            return
        bank.head["heading_open"] = 0
        t_ns = int(bank.head[0].now_ns)
        yaw, sd = heading_deg(bank)
        after = (t_ns - (self.started_ns or t_ns)) / NS_PER_S
        detail = f"heading {yaw:.1f} deg, sigma {sd:.1f} deg, {after:.1f} s after the start"
        self.events.append(Event(t_ns, "heading_known", detail))

    def _recover(self, epoch: int, rows: Rows, out: Output) -> None:
        """Set position, velocity and clock anew from the epoch; start all over when that does not last."""
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
        fix = None
        if not (refusing and is_thin(lines)):
            par, groups = self._parameters[0], self.setup.n_offsets + 1
            fix = fix_epoch(rows, epoch, par, groups, self.setup.config.start.max_gdop)
        if fix is None or not fix.checked:
            if not (refusing and self._absorb_steps(bank, lines, sv, t_ns)):
                self.events.append(Event(t_ns, "lockout", f"{reason}, and no fix to recover with"))
            return
        recent = [t for t in self.resets_ns if t_ns - t <= health.lost_window_s * NS_PER_S]
        self.resets_ns = [*recent, t_ns]
        if len(self.resets_ns) > health.heading_lost_resets:
            self._restart(t_ns, f"{len(self.resets_ns)} resets within {health.lost_window_s:.0f} s")
            return
        lead = bank.state[bank.head[0].leader]
        delta_r = float(np.linalg.norm(fix.r_a - lead.r_e))
        tilt = delta_r / WGS84_A_M  # by how much the vertical turns with the position
        if tilt > _WRONG_VERTICAL_RAD:
            self._restart(
                t_ns, f"the position is {delta_r / 1000.0:.0f} km away: the attitude was levelled elsewhere"
            )
            return
        delta_clock = float(np.nan_to_num(fix.clocks[0] - lead.clock[0]))
        velocity = "kept" if fix.v_a is None else f"moved by {np.linalg.norm(fix.v_a - lead.v_e):.2f} m/s"
        for i in range(len(bank.state)):
            reset_kinematics(bank.state[i], bank.P[i], fix, self._parameters[0].lever_b, self.setup.n_offsets)
            bank.memory[i] = -np.inf  # innovations about another position
            if not refusing:
                doubt_sensors(bank.state[i], bank.P[i], sensor_model(self.setup.grade))
        bank.head["renewed_ns"] = t_ns
        mark_rows(out, rows, epoch, fix)
        detail = (
            f"{reason}: position moved by {delta_r:.1f} m,"
            f" velocity {velocity}, clock moved by {delta_clock:.1f} m; {fix.n_used} pseudoranges"
        )
        self.events.append(Event(t_ns, "reset", detail))

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
        self.events += still_uncertain(self.bank, self.setup.config.visibility)
        self.bank = None
        self.resets_ns = []
        self.starter = Starter(self.setup, given=False)
        self.events.append(Event(t_ns, "restart", f"{reason}: the filter starts anew"))

    def _collect_events(self, out: Output) -> None:
        """Turn the compiled loop's events into words."""
        count = out.counts[0]
        for row in out.events[: min(count.events, len(out.events))]:
            kind, became = int(row["kind"]), ""
            if kind == MASKING_UNCERTAIN:
                became = became_of_uncertain(self.setup.config.visibility)
            self.events.append(event_in_words(int(row["t_ns"]), kind, float(row["a"]), became))
        if count.events > len(out.events):
            self.events.append(Event(None, "events_lost", f"{count.events - len(out.events)} further events"))
        count.events = 0
