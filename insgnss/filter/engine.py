"""The streaming engine: the same filter as ``replay``, fed sample by sample, with GNSS epochs that may arrive late.

It keeps the filter as it stood after each recent epoch. An epoch that arrives late is put in its place: the filter goes
back to the state before it and runs forward again over the samples and epochs since. Rows of a time tag that it knows
already join that epoch, which is done again in the same way. An epoch outside the inertial samples is passed over, once
it is certain that none will come. So the engine's final result for an epoch is, bit for bit, that of ``replay``.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from typing import Any

import numpy as np
import numpy.typing as npt

from insgnss.constants import NS_PER_S
from insgnss.filter.engine_results import EpochResult, FilterSnapshot, NavState, one_row, rows_of
from insgnss.filter.epoch_tables import empty_epoch, epochs_of, tag_of
from insgnss.filter.further_arrivals import FurtherArrivals, main_of
from insgnss.filter.imu.inertial_stream import Cut, Sample, SampleStream
from insgnss.filter.imu.samples import ImuBuffer
from insgnss.filter.imu.tag_guard import TagGuard
from insgnss.filter.loop import write_between
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import Output, mark_without_imu
from insgnss.filter.own_rows.ledger import OwnResults
from insgnss.filter.own_update import carry_through
from insgnss.filter.prediction import carry_bank
from insgnss.filter.setup import FilterSetup
from insgnss.filter.soundness import is_finite
from insgnss.filter.start.carried_start import CarriedState, kept_over
from insgnss.filter.state import Bank, copy_bank
from insgnss.filter.update.masking import still_uncertain
from insgnss.gnss.antenna_phases import MATCH_NS
from insgnss.gnss.observation_rows import GnssRows
from insgnss.gnss.orbits.plausible_messages import refused_messages
from insgnss.gnss.table_joining import joined
from insgnss.tables import Event, GnssTable, Int64

_LONG_AGO_NS = -(2**62)
_HISTORY_S = 6.0  # of samples before the oldest state kept: the memory of a start


class FilterEngine:
    """A live filter: the part of ``insgnss.Engine`` that knows neither further sensors nor aiding."""

    def __init__(self, setup: FilterSetup) -> None:
        """Make an engine for a filter's setup (``insgnss.runs.replay.setup_filter`` makes one from a flight)."""
        self._setup = setup
        self._further = FurtherArrivals(setup)
        self._samples = ImuBuffer()
        self._stream = SampleStream(setup)
        self._tags = TagGuard()
        self._arrived: deque[Sample | Cut | Event] = deque()  # screened, not used yet
        self._latency_ns = int(setup.config.latency_s * NS_PER_S)
        # events of stretches that have ended, and of refusals
        self._done: list[Event] = refused_messages(setup.navigation) + self._further.remarks
        self._final: list[EpochResult] = []
        self._waiting: list[GnssTable] = []  # epochs ahead of the samples, in the order of time
        self._recent: list[EpochResult] = []  # processed, but still within the latency
        self._own = OwnResults(setup.own)
        self._last_settled: GnssTable | None = None  # the newest epoch older than those
        self._closed_ns = _LONG_AGO_NS  # epochs up to here are final, whatever the latency
        self._first_ns = _LONG_AGO_NS  # first sample of the unbroken stretch
        self._started = False  # in a stretch that has ended
        self._begin(setup)

    def _begin(self, setup: FilterSetup, carried: CarriedState | None = None) -> None:
        """Start over with an empty filter: at first, and after a gap too long to bridge."""
        self._navigator = Navigator(setup)
        given = self._setup.start is not None and not self._started
        self._navigator.starter.begin(given=given, carried=carried)
        self._kept: list[FilterSnapshot] = []
        self._live: Any = None
        self._keep(_LONG_AGO_NS)

    def imu(self, t_ns: int, gyro_radps: npt.ArrayLike, accel_mps2: npt.ArrayLike) -> None:
        """Take one inertial sample: the mean over the interval since the sample before, body axes.

        A sample that is not later than the one before is refused with an event, and so is a tag far ahead of those that
        follow. What the values say of a sample may have to wait for the next ones: the filter takes it then.
        """
        w, f = np.asarray(gyro_radps, np.float64), np.asarray(accel_mps2, np.float64)
        tagged = self._tags.take(int(t_ns), w, f)
        self._done += tagged.events
        if tagged.set_back:
            self._set_back()
        for sample in tagged.samples:
            self._arrived += self._stream.take(*sample)
            self._process(sample[0])

    def _process(self, now_ns: int) -> None:
        """Use what has arrived; before a cut wait for the epochs that may still come from the time before it."""
        while self._arrived:
            item = self._arrived[0]
            if isinstance(item, Cut) and now_ns <= item.last_ns + self._latency_ns:
                return
            self._arrived.popleft()
            if isinstance(item, Event):
                self._done.append(item)
            elif isinstance(item, Cut):
                self._cut(item)
            else:
                self._accept(item)

    def _accept(self, sample: Sample) -> None:
        """Take a sample that has been found sound."""
        if self._samples.last_ns is None:
            self._first_ns = sample.t_ns
        self._samples.append(*sample[:4])
        self._insert_waiting(sample.t_ns - 1)
        self._carry_live()
        if sample.logged:
            self._at_sample(sample.t_ns)
        if self._insert_waiting(sample.t_ns):
            self._carry_live()
        self._settle()

    def _insert_waiting(self, until_ns: int) -> bool:
        """Process the epochs that were ahead of the samples; return whether there was one."""
        some = False
        while self._waiting:
            t_ns = tag_of(self._waiting[0])
            if t_ns > until_ns or self._waits(t_ns):
                break
            self._insert(self._waiting.pop(0))
            some = True
        return some

    def _waits(self, t_ns: int) -> bool:
        """Return whether samples are still to come at or after a time.

        A filter cannot run over a single sample between gaps: its epoch waits for the second sample.
        """
        newest = self._samples.last_ns
        return newest is None or t_ns > newest or t_ns == newest == self._first_ns

    def _at_sample(self, t_ns: int) -> None:
        """Hook at each sample, with the filter carried to it; here nothing."""

    def _finish(self, results: list[EpochResult]) -> None:
        """Take the results of epochs that no late epoch can change any more."""
        self._final += results

    def _before_epoch(self, epoch: GnssTable) -> None:
        """Hook before an epoch's update, with the filter at the epoch before; here nothing."""

    def gnss(self, epoch: GnssTable, antenna: str | None = None) -> None:
        """Take one or more GNSS epochs, whole or in parts: rows of one time tag make one epoch, in the order they come.

        What is older than the latency is refused with an event.

        Parameters
        ----------
        antenna : of several antennas the name of the one that received them, None for the main one. A further
            antenna's rows belong to the main epoch nearest in time, at most 2 ms away; what comes before that epoch
            costs nothing more, what comes after it lets the filter go back

        Raises
        ------
        ConfigError : the settings have no such antenna
        InputError : a further antenna's epoch has no carrier phases
        """
        number = self._further.number(antenna)
        for part in epochs_of(epoch):
            t_ns = tag_of(part)
            if antenna is not None and number > 0:
                self._take_further(antenna, number, part)
            elif self._is_final(t_ns):
                self._refuse(EpochResult.unused(self._setup, part, t_ns), "a GNSS epoch")
            elif self._waits(t_ns):
                at = bisect_left(self._waiting, t_ns, key=tag_of)
                known = [e for e in self._waiting[at : at + 1] if tag_of(e) == t_ns]
                self._waiting[at : at + len(known)] = [joined([*known, part])]
            else:
                known = [r.gnss for r in self._recent if r.t_ns == t_ns]
                self._insert(joined([*known, part]))
                self._carry_live()

    def _is_final(self, t_ns: int) -> bool:
        """Return whether nothing of a time is taken any more."""
        newest = self._samples.last_ns
        return t_ns <= self._closed_ns or (newest is not None and t_ns < newest - self._latency_ns)

    def _take_further(self, antenna: str, number: int, part: GnssTable) -> None:
        """Take an epoch of a further antenna, and do the main epoch again that it belongs to."""
        t_ns, main_ns = tag_of(part), main_of(tag_of(part), self._mains_ns())
        settled_ns = None if self._last_settled is None else tag_of(self._last_settled)
        if (main_ns is not None and main_ns == settled_ns) or self._is_final(t_ns + MATCH_NS):
            self._refuse(self._further.alone(number, part), f"an epoch of antenna '{antenna}'")
            return
        self._further.add(number, part)
        for known in [r.gnss for r in self._recent if r.t_ns == main_ns]:
            self._insert(known)
            self._carry_live()

    def again_from(self, t_ns: int) -> None:
        """Do again what follows ``t_ns``, at which an own row has arrived; nothing where no sample is as late."""
        if self._samples.last_ns is None or t_ns > self._samples.last_ns:
            return
        for first in [result.gnss for result in self._recent if result.t_ns >= t_ns][:1]:
            self._insert(first)
        self._live = None
        self._carry_live()

    def _mains_ns(self) -> Int64:
        """Return the time tags of the main epochs that further antennas' rows may belong to."""
        settled = () if self._last_settled is None else (self._last_settled,)
        return np.array(
            sorted(map(tag_of, (*settled, *self._waiting, *(r.gnss for r in self._recent)))), np.int64
        )

    @property
    def state(self) -> NavState:
        """The navigation state at the newest inertial sample."""
        return NavState.of(self._setup, self.newest_row(), self._samples.last_ns or 0)

    def newest_row(self) -> Output:
        """Return the output at the newest inertial sample: one navigation row, or none before a start."""
        newest = self._samples.last_ns
        rows = self._rows(empty_epoch())
        out = one_row(self._setup, rows)
        if self._live is not None and newest is not None:
            work = self._navigator.workspace(rows)
            write_between(self._live, newest, self._samples.view(), self._navigator.parameters[0], out, work)
        return out  # empty where it is lost, which the next epoch will say

    @property
    def events(self) -> list[Event]:
        """All events so far, in the order of their time."""
        return sorted(self._done + self._told(), key=lambda e: -1 if e.t_ns is None else e.t_ns)

    def _told(self) -> list[Event]:
        """Return the events of this stretch's filter so far."""
        return self._navigator.events + still_uncertain(self._navigator.bank, self._setup.config.visibility)

    def take_results(self, *, all_of_them: bool = False) -> list[EpochResult]:
        """Return the epochs that have become final (older than the latency), each once; or all, at the end of a log.

        At the end of a log the epochs after the last sample have no inertial samples.
        """
        if all_of_them:
            self._process(2**62)
            if self._samples.last_ns is not None:
                self._use_own_rows(self._samples.last_ns)
                self._navigator.note_silence(self._samples.last_ns)
            while self._waiting:
                self._insert(self._waiting.pop(0))
            self._close(self._recent[-1].t_ns if self._recent else self._closed_ns)
            self._final += self._further.take_final(2**62, self._mains_ns)
        taken, self._final = self._final, []
        return taken

    def _use_own_rows(self, until_ns: int) -> None:
        """Carry the filter by way of the own rows that no epoch comes before any more, and use them."""
        if self._setup.own is not None:
            rows = self._rows_for_size()
            self._navigator.use_own_rows(self._samples.view(), rows, until_ns, one_row(self._setup, rows))

    def _rows(self, epoch: GnssTable, before: GnssTable | None = None) -> GnssRows:
        """Return an epoch's rows; the carrier's differences need the epoch before it."""
        return rows_of(self._setup, epoch, before)

    def _cut(self, cut: Cut) -> None:
        """Restart with the filter's carried start."""
        last_ns = self._samples.last_ns
        assert last_ns is not None  # a cut has a sample before it
        self._started = self._started or self._navigator.started_ns is not None
        self._done += self._told()
        while self._waiting and tag_of(self._waiting[0]) <= last_ns:  # at a sample that stayed alone
            self._insert(self._waiting.pop(0))
        self._use_own_rows(last_ns)
        carried = self._navigator.leave(self._samples.view())
        self._own.keep(self._navigator.own, (self._first_ns, last_ns))
        self._close(last_ns)
        self._samples.clear()
        self._begin(self._navigator.setup, None if carried is None else kept_over(carried, cut))

    def _set_back(self) -> None:
        """Restart after wrong tags: the filter that they produced is dropped."""
        self._done += self._told()
        self._close(self._recent[-1].t_ns if self._recent else self._closed_ns)
        self._own.keep(self._navigator.own, (self._first_ns, self._samples.last_ns or self._first_ns))
        self._samples.clear()
        self._arrived.clear()
        self._stream = SampleStream(self._setup)
        self._begin(self._setup)

    def _close(self, t_ns: int) -> None:
        """Make all epochs that were processed final; none up to ``t_ns`` is taken any more."""
        self._final += self._further.take_final(t_ns + 1, self._mains_ns)
        if self._recent:
            self._last_settled = self._recent[-1].gnss
        self._finish(self._recent)
        self._recent = []
        del self._kept[:-1]
        self._closed_ns = max(self._closed_ns, t_ns)

    def _insert(self, epoch: GnssTable) -> None:
        """Insert an epoch, also replacing its own earlier rows, and run forward over it and those after it.

        One outside the inertial samples leaves the filter as it is, and no state is kept of it.
        """
        t_ns, n_kept = tag_of(epoch), len(self._kept)
        from_ns = t_ns - self._further.reach_ns
        again = [r.gnss for r in self._recent if r.t_ns >= from_ns and r.t_ns != t_ns]
        mains_ns = np.union1d(self._mains_ns(), [t_ns])
        self._recent = [r for r in self._recent if r.t_ns < from_ns]
        while len(self._kept) > 1 and self._kept[-1].t_ns >= from_ns:
            self._kept.pop()
        if len(self._kept) < n_kept:
            self._navigator.restore(self._kept[-1].saved)
            self._navigator.forget_own(self._kept[-1].t_ns)
        for gnss in sorted([epoch, *again], key=tag_of):
            rows = self._rows(gnss, self._recent[-1].gnss if self._recent else self._last_settled)
            result = EpochResult(tag_of(gnss), gnss, rows, one_row(self._setup, rows))
            if self._navigator.aid is not None:
                result.differences = self._navigator.aid.log = self._further.phases(gnss, rows, mains_ns)
            if result.t_ns < self._first_ns or self._waits(result.t_ns):
                mark_without_imu(result.out.ledger, result.out.carrier)
            else:
                self._before_epoch(gnss)
                self._navigator.run(self._samples.view(), rows, 0, 1, result.out)
                self._keep(result.t_ns)
                self._live = None
            self._recent.append(result)

    def _keep(self, t_ns: int) -> None:
        self._kept.append(FilterSnapshot(t_ns, self._navigator.snapshot()))

    def _carry_live(self) -> None:
        """Bring the copy that answers ``state`` to the newest sample."""
        bank = self._navigator.bank
        newest = self._samples.last_ns
        if bank is None or newest is None:
            self._live = None
            return
        if self._live is None:
            self._live = copy_bank(bank)
        if not self._carry(self._live, newest):
            self._live = None  # a wild sample: there is no answer until an epoch restarts the filter

    def _carry(self, bank: Bank, t_ns: int) -> bool:
        """Carry a bank to a sample, by way of the own rows; return whether it is finite there."""
        work, samples = self._navigator.workspace(self._rows_for_size()), self._samples.view()
        carry_through(bank, t_ns, self._navigator.setup, samples, self._navigator.parameters, work.scratch)
        carry_bank(bank, t_ns, samples, self._navigator.parameters[0], work.scratch)
        lead = bank.head[0].leader
        return is_finite(bank.state[lead], bank.P[lead])

    def _rows_for_size(self) -> GnssRows:
        return self._recent[-1].rows if self._recent else self._rows(empty_epoch())

    def _settle(self) -> None:
        """Drop states, epochs and samples that no late epoch can reach any more."""
        newest = self._samples.last_ns
        if newest is None:
            return
        horizon = newest - self._latency_ns
        self._navigator.note_silence(horizon)
        while len(self._kept) > 1 and self._kept[1].t_ns < horizon:
            self._kept.pop(0)
        self._final += self._further.take_final(horizon, self._mains_ns)
        while self._recent and self._recent[0].t_ns < horizon:
            self._last_settled = self._recent[0].gnss
            self._finish([self._recent.pop(0)])
        bank = self._navigator.bank
        if len(self._kept) == 1 and bank is not None and horizon - bank.head[0].now_ns > NS_PER_S:
            # a long outage: carry the filter itself on, at whole samples, which changes no bit
            stop = self._samples.last_before(horizon)
            self._use_own_rows(stop)
            for each in self._navigator.banks:
                self._carry(each, stop)
            self._kept = []
            self._keep(stop)
        if bank is None and self._navigator.starter.given:
            return  # the given state's own time is still to be reached
        banks = [*self._kept[0].saved.banks, *self._navigator.banks]
        oldest = min([horizon, *(int(each.head[0].now_ns) for each in banks)])
        dropped = self._samples.drop_before(oldest - int(_HISTORY_S * NS_PER_S))
        if dropped:
            self._shift(dropped)

    def _shift(self, dropped: int) -> None:
        """Let every kept state count its samples from the buffer's new first one."""
        banks = [
            *self._navigator.banks,
            *self._navigator.health.past.banks,
            *(bank for checkpoint in self._kept for bank in checkpoint.saved.banks),
        ]
        if self._live is not None:
            banks.append(self._live)
        for bank in {id(bank): bank for bank in banks}.values():  # what is never changed is shared
            bank.head["next"] -= dropped

    def _refuse(self, result: EpochResult, what: str) -> None:
        self._done.append(result.refuse(what, self._samples.last_ns or result.t_ns, self._latency_ns))
        self._final.append(result)
