"""The search supervisor of a streaming receiver: the rows that a replay of the same log gives, epoch by epoch.

A decision belongs to an epoch and rests on the filter just before the epoch's update. The rows of one time tag may
arrive in parts, so an epoch is decided when it is asked for or when the next one arrives. A decision stands: an epoch
older than the newest decision gives none of its own.

Where the receiver falls silent the samples show that an epoch is missing: it is decided half a usual interval after the
time at which it would have arrived, and not later than the latency. A receiver that tracks nothing but still has a
clock should hand over its epochs with rows without a pseudorange: the supervisor then knows that the signals are
missing, where silence says nothing.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from insgnss.aiding.satellite_arcs import SatelliteArcs
from insgnss.aiding.sources import AidingSources
from insgnss.aiding.trace import TraceSamples, traced
from insgnss.antenna.visibility import UNDECIDED
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.filter.output.trace_rows import new_trace_room
from insgnss.filter.output.tracing import write_trace
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.state import Bank
from insgnss.filter.update.epoch_space import FilterWorkspace
from insgnss.receiver.predictions import Outlook, SupervisionSetup, filter_alone, outlook, scales
from insgnss.receiver.supervised_run import (
    LATE_EPOCHS,
    Sightings,
    SupervisedRun,
    longest_gap_ns,
    presence,
    search_times,
    sightings_of,
    supervision_table,
    transition_table,
)
from insgnss.receiver.supervisor import Predictions, Supervision, Supervisor, Transitions
from insgnss.receiver.tracking_state import ABSENT
from insgnss.tables import GnssTable, Int8, Int64

_STEPS: Final = 101  # intervals that the usual one is the median of: some seconds to minutes of a receiver


class _Decision(NamedTuple):
    """One epoch and its decisions."""

    view: Outlook
    seen: Int8
    result: Supervision


class LiveSupervision:
    """The supervisor over the epochs of a live filter.

    Parameters
    ----------
    setup, satellites : as ``insgnss.receiver.sources.setup_and_satellites`` gives them
    n_offsets : inter-system clock offsets of the filter
    latency_ns : how late an epoch may arrive

    Raises
    ------
    ConfigError : as ``insgnss.receiver.supervisor.Supervisor``
    """

    def __init__(
        self, setup: SupervisionSetup, satellites: AidingSources, n_offsets: int, latency_ns: int
    ) -> None:
        self._setup, self._satellites, self._latency_ns = setup, satellites, latency_ns
        self._arcs: SatelliteArcs = satellites.arcs(0, 0)
        self._names = self._arcs.sv_names
        m = len(self._names)
        self._scale = scales(filter_alone(setup.aiding), self._names, setup.search.grid)
        self._supervisor = Supervisor(m, setup.search, self._scale)
        self._room = new_trace_room(np.zeros(1, np.int64), 1.0, 1, n_offsets)
        self._steps: deque[int] = deque(maxlen=_STEPS)
        self._usual_ns = 0.0  # the interval of the receiver's epochs; 0 before the second one
        self._sightings = Sightings(np.zeros(0, np.int64), np.zeros((0, 0), np.bool_), ())
        self._epoch_ns: int | None = None  # the receiver's newest
        self._slot_ns = 0  # the newest time looked at: that epoch, or one that is missing
        self._lag_ns = 0  # from that epoch's tag to its arrival
        self._pending: tuple[Outlook, Int8] | None = None  # not decided yet
        self._memory = np.full(m, UNDECIDED, np.int8)  # what the antennas decided last
        self._decided_ns: int | None = None  # the newest decision
        self._decided: list[_Decision] = []  # not taken yet
        self._predicted_ns = np.zeros(m, np.int64)
        self._week = 0

    @property
    def _wait_ns(self) -> float:
        """How long after its time tag an epoch counts as missing."""
        return min(self._lag_ns + (LATE_EPOCHS - 1.0) * self._usual_ns, self._latency_ns)

    def is_wanted(self, epoch: GnssTable, arrived_ns: int) -> bool:
        """Take an epoch's observations at the newest sample's time; return whether it is still to be decided."""
        sightings = sightings_of(epoch)
        t_ns, newest_ns = int(sightings.epoch_ns[0]), self._epoch_ns
        if newest_ns is not None and t_ns < newest_ns:
            return False
        if t_ns != newest_ns:
            self.decide()
            self._lag_ns = max(arrived_ns - t_ns, 0)
            if newest_ns is not None:
                self._steps.append(t_ns - newest_ns)
                self._usual_ns = float(np.median(self._steps))
            self._epoch_ns, self._slot_ns = t_ns, max(t_ns, self._slot_ns)
        self._sightings = sightings
        return self._decided_ns is None or t_ns > self._decided_ns

    def missing_epoch(self, now_ns: int) -> int | None:
        """Return the time of an epoch that is missing at a sample and is to be decided, None for none.

        Every sample is to be asked for, in its order.
        """
        self._end_predictions(now_ns - self._wait_ns)
        missing_ns = self._slot_ns + round(self._usual_ns)
        if not self._steps or now_ns - missing_ns < self._wait_ns:
            return None
        self.decide()
        self._slot_ns = missing_ns
        return missing_ns

    def expect(
        self, t_ns: int, bank: Bank, imu: ImuSamples, parameters: npt.NDArray[Any], work: FilterWorkspace
    ) -> None:
        """Take the prediction by a bank at the last sample at or before ``t_ns`` for an epoch at that time."""
        count, sample_ns = self._room.counts[0], int(bank.head[0].now_ns)
        count.rows = count.covariances = 0
        write_trace(bank, sample_ns, True, parameters[0], self._room, work.P_out, work.scratch)
        if not count.rows:
            return
        if not self._arcs.covers(sample_ns, sample_ns):
            self._arcs = self._satellites.arcs(sample_ns, sample_ns)
        found = traced(self._room, TraceSamples(imu.t_ns, imu.w_ib_b, imu.f_b))
        memory = self._memory.copy()
        view = outlook(self._setup, self._arcs, found, np.array([t_ns], np.int64), memory)
        self._pending = self._over_all(view), memory

    def decide(self) -> None:
        """Decide the epoch that is still open, if there is one."""
        if self._pending is None:
            return
        (view, self._memory), self._pending = self._pending, None
        self._end_predictions(int(view.predicted.t_ns[0]))
        self._advance(view)

    def taken(self) -> SupervisedRun:
        """Return the decisions since the last call, the open one too; ``search_times`` count from the beginning."""
        self.decide()
        decided, self._decided = self._decided, []
        nothing = self._nothing_at(np.zeros(0, np.int64))
        end = self._supervisor.epoch(nothing.predicted)
        rows = [*decided, _Decision(nothing, np.zeros((0, len(self._names)), np.int8), end)]
        view = _joined_views([row.view for row in rows])
        results = [row.result for row in rows]
        result = Supervision(
            np.concatenate([each.state for each in results]),
            Transitions(*map(np.concatenate, zip(*(each.transitions for each in results), strict=True))),
            end.totals,
            type(end.window)(*map(np.concatenate, zip(*(each.window for each in results), strict=True))),
        )
        seen = np.concatenate([row.seen for row in rows])
        source = np.arange(len(seen), dtype=np.int64)
        return SupervisedRun(
            supervision_table(view, source, result, seen, self._setup.search, self._week),
            transition_table(result.transitions, self._names, self._week),
            search_times(self._names, self._predicted_ns / NS_PER_S, end.totals),
        )

    def _advance(self, view: Outlook) -> None:
        """Let the supervisor decide one epoch."""
        t_ns, before = int(view.predicted.t_ns[0]), self._supervisor.state
        seen = presence(self._sightings, view.predicted.t_ns, self._names, self._usual_ns)
        result = self._supervisor.epoch(view.predicted, seen)
        self._week = self._week or t_ns // NS_PER_WEEK
        if self._decided_ns is not None:
            self._predicted_ns[before != ABSENT] += t_ns - self._decided_ns
        self._decided_ns = t_ns
        self._decided.append(_Decision(view, seen, result))

    def _end_predictions(self, now_ns: float) -> None:
        """End every satellite's prediction if the filter gave none for long: it restarted."""
        if self._decided_ns is None or now_ns - self._decided_ns <= longest_gap_ns(self._usual_ns):
            return
        if np.any(self._supervisor.state != ABSENT):
            self._advance(self._nothing_at(np.array([self._decided_ns + round(self._usual_ns)], np.int64)))

    def _nothing_at(self, t_ns: Int64) -> Outlook:
        """Return an outlook without any prediction."""
        shape = len(t_ns), len(self._names)
        unknown = np.full((5, *shape), np.nan)
        predicted = Predictions(t_ns, np.full(shape, UNDECIDED, np.int8), *unknown)
        elevation, gain = np.full(shape, np.nan), np.full((*shape, 2), np.nan)
        return Outlook(self._names, predicted, elevation, gain, self._scale)

    def _over_all(self, view: Outlook) -> Outlook:
        """Return an outlook of one time over all satellites, in their fixed places."""
        number = {name: i for i, name in enumerate(self._names)}
        place = np.array([number[name] for name in view.sv_names], np.int64)
        whole = self._nothing_at(view.predicted.t_ns)
        for name, values in view.predicted._asdict().items():
            if name != "t_ns":
                getattr(whole.predicted, name)[:, place] = values
        whole.elevation[:, place], whole.gain[:, place] = view.elevation, view.gain
        return whole


def _joined_views(views: list[Outlook]) -> Outlook:
    """Return outlooks of the same satellites one after another."""
    predicted = Predictions(*map(np.concatenate, zip(*(view.predicted for view in views), strict=True)))
    elevation = np.concatenate([view.elevation for view in views])
    return replace(
        views[0],
        predicted=predicted,
        elevation=elevation,
        gain=np.concatenate([view.gain for view in views]),
    )
