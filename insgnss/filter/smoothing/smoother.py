"""The fixed-interval smoother: every epoch estimated from the whole log, not only from earlier data.

Rauch, Tung and Striebel's backward pass over the filter's own epochs. With e the smoothed state minus the filter's, and
kappa what the update of the next epoch added to its prediction,

    e_k   = A_k (kappa_k+1 + e_k+1)
    P^s_k = P_k + A_k (P^s_k+1 - P^-_k+1) A_k^T,     A_k = P_k Phi^T (P^-_k+1)^-1

where P_k Phi^T is read off a prediction that carries a copy of the state at k along (the copy's error is constant),
with the filter's own mechanization and covariance. A carrier difference at k+1 is about the clone of k as well, so the
next epoch is taken together with that clone; the clone follows from the smoothed state of k+1 by regression, for all
later measurements know it only by way of that state. [Rauch, Tung & Striebel 1965; Roumeliotis & Burdick 2002]
A user's own rows between epochs are a step of their own. The clone of the last epoch outlives it, so that step smooths
the clone as well. Several antennas' rows come after an epoch's others: the epoch is kept as it stood before them and
as they left it, two filters of one time.

Output times between epochs are smoothed by the transition (``between``). Where several headings were open, the one that
was found goes over those epochs alone (``open_phase``). A filter that was set right by a fix had been wrong for a
while: from the last epoch that fitted it to the reset the samples count as so unsure that the step is one sigma of
theirs, and of the clock nothing is carried back. A gap in the samples after which the filter started again has a step
of its own (``across_gap``). Smoothing stops where the filter was given up while the samples went on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.filter.imu.inertial_stream import Cut
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.writing import Output
from insgnss.filter.own_update import OwnUpdate
from insgnss.filter.prediction import ImuSamples, carry_bank, new_scratch, predict_covariance
from insgnss.filter.setup import FilterSetup
from insgnss.filter.smoothing.across_gap import last_sample, way_back, without_shown_motion
from insgnss.filter.smoothing.between import InterpolatedStates, one_hypothesis, smoothed, write_smoothed
from insgnss.filter.smoothing.body_points import PointColumnValues
from insgnss.filter.smoothing.open_phase import OpenPhase, gone_over_alone
from insgnss.filter.smoothing.row_covariances import RowCovariances, each_epoch
from insgnss.filter.smoothing.smoother_step import FilteredEpoch as FilteredEpoch
from insgnss.filter.smoothing.smoother_step import (
    SmoothedEpoch,
    keep,
    keep_own,
    kept_as_opened,
    last_of_all,
    one_back,
    same_time,
    stepped_tags,
)
from insgnss.filter.state import CLOCK, DRIFT, OFFSETS, Bank, HeadRecord, copy_bank
from insgnss.gnss.observation_rows import GnssRows
from insgnss.tables import Float64, Int64

_STEPPED_CLOCK: Final = {"clock_jump": CLOCK, "clock_drift_jump": DRIFT}
_BEGUN_ANEW: Final = frozenset({"restart", "start"})


@dataclass
class Smoother:
    """Keeps the filter at every epoch of a stretch, then runs back over them."""

    navigator: Navigator
    imu: ImuSamples
    further: PointColumnValues | None = None  # columns that are wanted beside those of a row
    kept: list[FilteredEpoch] = field(default_factory=list)
    phases: dict[int, OpenPhase] = field(default_factory=dict)  # by the time of the epoch at which each ended
    _end: tuple[FilteredEpoch, Cut] | None = None  # the filter at the last sample, and what came then
    _began_ns: int | None = None  # when the filter began that is kept first
    _linked: bool = False  # whether the next epoch follows from the one kept last
    _opened: bool = False  # whether a given start has been kept
    _phase: OpenPhase | None = None  # several headings are open
    _setup: FilterSetup = field(init=False)  # of the epochs kept
    _stood: Bank | None = None  # the filter as several antennas' rows of an epoch have found it

    def __post_init__(self) -> None:
        """Have the navigator report each update by own rows, and each epoch before several antennas' rows."""
        self._setup = self.navigator.setup
        self.navigator.after_own = self._take_own
        self.navigator.before_antennas = self._take_before_antennas

    def forward(self, rows: GnssRows, first: int, last: int, out: Output) -> None:
        """Process the epochs ``first`` to ``last - 1`` as ``Navigator.run`` does, one at a time, and keep each."""
        navigator = self.navigator
        for alone, written in each_epoch(rows, first, last, out):
            n_events, before = len(navigator.events), navigator.bank
            if self.further is None:
                navigator.run(self.imu, alone, 0, 1, written)
            else:
                RowCovariances(navigator, self.imu, self.further).run(alone, written)
            kinds = {event.kind for event in navigator.events[n_events:]}
            self._take(before, alone, kinds)

    def _take_own(self, update: OwnUpdate) -> None:
        """Keep the filter's update by a user's own rows; with several open headings nothing is kept."""
        bank, opened = self.navigator.bank, self.navigator.opened
        if bank is None:
            return
        if opened is not None and not self._opened:
            self._open(opened)
        if self._began_ns is None:
            self._began_ns = self.navigator.started_ns
        if self._phase is None and len(bank.state) == 1:
            fits = self.kept[-1].fits if self.kept else True
            self.kept.append(keep_own(bank, update, linked=self._linked, fits=fits))
            self._linked = True

    def _take_before_antennas(self, bank: Bank) -> None:
        """Keep the filter at an epoch as it stands before several antennas' rows."""
        self._stood = copy_bank(bank)

    def _take(self, before: Bank | None, rows: GnssRows, kinds: set[str]) -> None:
        """Keep an epoch's update of the filter ``before`` it, and the ``kinds`` of its events."""
        navigator, bank, stood = self.navigator, self.navigator.bank, self._stood
        self._stood = None
        if bank is None:
            self._linked, self._phase = False, None
            return
        if navigator.setup is not self._setup:  # no way leads back over a change of the states
            self._setup, self.kept, self.phases = navigator.setup, [], {}
            self._linked, self._phase = False, None
        if self._began_ns is None:
            self._began_ns = self.navigator.started_ns
        replaced = bank is not before and int(bank.head[0].renewed_ns) == int(rows.epoch_ns[0])
        if before is None and navigator.opened is not None:
            if not self._opened:
                self._open(navigator.opened)
        elif before is None or kinds & _BEGUN_ANEW or (replaced and self._phase is not None):
            self._linked, self._phase = False, None
        if self._phase is not None:
            self._phase.epochs.append(rows)
        work, layout = navigator.workspace(rows).epoch, navigator.setup.layout
        stepped = tuple(_STEPPED_CLOCK[kind] for kind in kinds & _STEPPED_CLOCK.keys())
        stepped += stepped_tags(bank, layout, int(rows.epoch_ns[0]))
        if len(bank.state) == 1:
            epoch = keep(
                bank, work, layout, linked=self._linked, stepped=stepped, fits=_fits(bank, navigator)
            )
            self._keep(epoch._replace(reset=replaced and self._linked), stood)
        elif self._phase is None:
            split = self._linked and before is not None and not replaced
            if split and before is not None:  # into several: it stands as the update has left it
                self.kept.append(keep(before, work, layout, linked=True, stepped=stepped))
            self._phase = OpenPhase(copy_bank(bank), linked=split)

    def _keep(self, epoch: FilteredEpoch, stood: Bank | None) -> None:
        """Keep an epoch after which one heading is left; ``stood``: the filter before several antennas' rows."""
        after = None
        if stood is not None and self._linked and self._phase is None:
            if len(stood.state) > 1:  # split and found at one epoch
                epoch = epoch._replace(linked=False)
            elif not np.array_equal(stood.P, epoch.bank.P):
                after = epoch._replace(linked=True, reset=False)
                epoch = epoch._replace(bank=one_hypothesis(stood.state, stood.P, stood.head))
        while epoch.reset and self.kept[-1].linked and not self.kept[-1].fits:
            if self.kept[-1].t_ns in self.phases:
                break
            self.kept.pop()
        if self._phase is not None:
            epoch = epoch._replace(linked=self._phase.linked)
            self.phases[epoch.t_ns] = self._phase
        self.kept += [epoch] if after is None else [epoch, after]
        self._linked, self._phase = True, None

    def _open(self, opened: Bank) -> None:
        """Keep a given start, at which there is no epoch."""
        self._opened = True
        if len(opened.state) > 1:
            self._phase = OpenPhase(opened, linked=False)
        else:
            self.kept.append(kept_as_opened(opened))
            self._linked = True

    def end_before(self, cut: Cut) -> None:
        """Keep the filter at its last sample, after which a ``cut`` comes, if it is one that later data may smooth."""
        bank, parameters = self.navigator.bank, self.navigator.parameters
        is_one = bank is not None and len(bank.state) == 1 and self._phase is None
        if bank is None or not (is_one and self._linked):
            return
        last = one_hypothesis(bank.state, bank.P, bank.head)
        scratch = new_scratch(last.P.shape[1])
        carry_bank(last, int(self.imu.t_ns[-1]), self.imu, parameters[0], scratch)
        predict_covariance(last.state[0], last.P[0], parameters[0], scratch)
        nothing = OwnUpdate([], np.zeros(len(last.P[0])))
        self._end = keep_own(last, nothing, linked=True, fits=True), cut

    def finish(self, out: Output, after: SmoothedEpoch | None = None) -> SmoothedEpoch | None:
        """Write the navigation rows of everything that ``forward`` kept, from the backward pass.

        Returns the epoch at which the filter began, smoothed; None where the way back does not lead there.

        Parameters
        ----------
        after : the first sample after the gap in which the stretch ends, smoothed
        """
        t_ns: Int64 = out.nav["t_ns"][: out.counts[0].nav].copy()
        last: SmoothedEpoch | None = None
        if after is not None and self._end is not None:
            filtered, cut = self._end
            last = last_sample(
                filtered, after, cut, self.imu, self.navigator.parameters, self.navigator.setup.layout
            )
            self._rewrite(last, t_ns, self.navigator.parameters, out)
        first: SmoothedEpoch | None = None
        for first in self._back(last):
            self._rewrite(first, t_ns, self.navigator.parameters, out)
        return first if first is not None and first.kept.t_ns == self._began_ns else None

    def before_the_first(self, epoch: SmoothedEpoch, times_ns: Int64, out: Output) -> SmoothedEpoch:
        """Return the stretch's first sample, smoothed by the ``epoch`` at which the filter began.

        Rows at ``times_ns`` from that sample up to the epoch follow those that are written.
        """
        parameters, layout = without_shown_motion(self.navigator.parameters), self.navigator.setup.layout
        begin, end = np.searchsorted(times_ns, [self.imu.t_ns[0], epoch.kept.t_ns])
        t_ns, written = times_ns[begin:end], int(out.counts[0].nav)
        nearest = min(int(np.searchsorted(out.nav["t_ns"][:written], epoch.kept.t_ns)), written - 1)
        new = slice(written, written + len(t_ns))
        out.nav["t_ns"][new], out.nav["slow"][new] = t_ns, out.nav["slow"][nearest]
        out.counts[0].nav += len(t_ns)
        first = epoch = epoch._replace(kept=epoch.kept._replace(anew=True))
        for first in way_back(epoch, self.imu, parameters, layout):
            self._rewrite(first, t_ns, parameters, out, written)
        return first

    def _rewrite(
        self, epoch: SmoothedEpoch, t_ns: Int64, parameters: npt.NDArray[Any], out: Output, first: int = 0
    ) -> None:
        """Write the row of an epoch and those up to the next, of the rows at ``t_ns``, which begin with ``first``."""
        n = OFFSETS + self.navigator.setup.layout.n_values
        row = int(np.searchsorted(t_ns, epoch.kept.t_ns))
        if epoch.onward is not None and epoch.onward.t_ns == epoch.kept.t_ns:
            return  # own rows at the time of an epoch, which was written already
        if row < len(t_ns) and t_ns[row] == epoch.kept.t_ns:
            if epoch.e.any():  # the last epoch of a part stays as the filter wrote it, to the bit
                state = epoch.kept.bank.state[:1].copy()
                at_epoch = InterpolatedStates(slice(0, 1), state, epoch.e[None, :n], epoch.P[None, :n, :n])
                self._write(first + row, at_epoch, out)
            row += 1
        if epoch.onward is None:
            return
        last = int(np.searchsorted(t_ns, epoch.onward.t_ns))
        if last > row:
            for part in smoothed(epoch.kept.bank, t_ns[row:last], epoch.onward, parameters, n):
                self._write(first + row + part.rows.start, part, out)

    def _write(self, first: int, states: InterpolatedStates, out: Output) -> None:
        states = states._replace(P=states.P.copy())  # what is written is carried to GPS time
        write_smoothed(out.nav, out.optional, first, states, self.navigator.parameters)
        if self.further is not None:
            rows = slice(first, first + len(states.state))
            self.further.write(rows, out.nav, states.P, self.imu, self.navigator.parameters[0])

    def backward(self) -> Iterator[tuple[FilteredEpoch, Float64, Float64]]:
        """Yield the epochs kept from the last to the first: what to add to the filter's state, and its covariance."""
        for epoch in self._back():
            yield epoch.kept, epoch.e, epoch.P

    def _back(self, later: SmoothedEpoch | None = None) -> Iterator[SmoothedEpoch]:
        """Yield the epochs from the last to the first, those of open headings in their place.

        ``later`` is what smooths the epoch before it: at first what comes behind the last.
        """
        layout = self.navigator.setup.layout
        for filtered in reversed(self.kept):
            at_once = later is not None and later.kept.t_ns == filtered.t_ns and not filtered.is_own
            if later is not None and at_once:  # as it was before its heading was split
                later = same_time(filtered, later, layout) if filtered.linked else None
                continue
            epoch = last_of_all(filtered, layout) if later is None else self._one_back(filtered, later)
            yield epoch
            later = epoch if filtered.linked else None
            phase = self.phases.get(filtered.t_ns)
            if phase is not None:
                later = None
                for later in self._through(phase, epoch):
                    yield later
                later = later if phase.linked else None

    def _through(self, phase: OpenPhase, epoch: SmoothedEpoch) -> Iterator[SmoothedEpoch]:
        """Yield the epochs of an open phase before the ``epoch`` that left one heading, the last first."""
        navigator = self.navigator
        chain = gone_over_alone(phase, epoch, navigator.setup, self.imu, navigator.parameters)
        if chain:
            later = same_time(chain[-1], epoch, navigator.setup.layout)
            for filtered in reversed(chain[:-1]):
                later = self._one_back(filtered, later)
                yield later

    def _one_back(self, filtered: FilteredEpoch, later: SmoothedEpoch) -> SmoothedEpoch:
        navigator = self.navigator
        return one_back(filtered, later, self.imu, navigator.parameters, navigator.setup.layout)


def smooth_back(stretches: list[Smoother], times_ns: Int64, out: Output) -> None:
    """Write the navigation rows of all stretches of a log, the last first, and those before a later stretch's first.

    Parameters
    ----------
    stretches : with a filter each
    times_ns : times of rows
    """
    after: SmoothedEpoch | None = None
    for at in range(len(stretches) - 1, -1, -1):
        first = stretches[at].finish(out, after)
        after = None if first is None or at == 0 else stretches[at].before_the_first(first, times_ns, out)
    count = int(out.counts[0].nav)
    t_ns = out.nav["t_ns"][:count]
    if (t_ns[1:] < t_ns[:-1]).any():  # rows of an earlier stretch stand behind those of a later one
        order = np.argsort(t_ns, kind="stable")
        further = stretches[0].further
        for rows in (out.nav, out.optional, *(() if further is None else (further.values,))):
            rows[:count] = rows[:count][order]


def _fits(bank: Bank, navigator: Navigator) -> bool:
    """Return whether a filter agreed with its latest epoch."""
    head: HeadRecord = bank.head[0]
    return bool(head.rejected_epochs == 0 and head.diverged_ns == 0 and navigator.health.doubt is None)
