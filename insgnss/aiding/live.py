"""The aiding of a live filter, sample by sample: the numbers that a replay of the same log gives, to the last bit.

A span's satellites, air and sigma are found at its first output and held, as in the table of a whole run; each output
is computed as a table of two times, the span's first and its own.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from insgnss.aiding.satellite_arcs import PIECE_NS, SatelliteArcs
from insgnss.aiding.sources import AidingSources
from insgnss.aiding.table import AidingTable, compute_aiding
from insgnss.aiding.trace import Covariances, Trace, TraceSamples, joined, traced
from insgnss.filter.output.trace_rows import new_trace_room, output_period
from insgnss.filter.output.tracing import write_trace
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.state import Bank
from insgnss.filter.update.epoch_space import FilterWorkspace


class AidingSink(Protocol):
    """An object that takes the aiding of one instant, as ``AidingStream`` does."""

    def send(self, table: AidingTable, week: int) -> None:
        """Take a table of one time; ``week`` is the GPS week that its seconds are to count from."""


class LiveAiding:
    """Says at which samples there is an output, and computes it."""

    def __init__(self, sources: AidingSources, n_offsets: int) -> None:
        """Begin without a sample; ``n_offsets`` is the number of the filter's inter-system clock offsets."""
        self._sources = sources
        config = sources.setup.config
        # one row, written again and again; the newest covariance stays
        self._room = new_trace_room(np.zeros(1, np.int64), config.sigma_interval_s, 1, n_offsets)
        self._rate_hz = config.rate_hz
        self._first_sample_ns: int | None = None
        self._period = -1
        self._begin: Trace | None = None  # the span's first row
        self._arcs: SatelliteArcs | None = None

    def is_due(self, t_ns: int) -> bool:
        """Return whether the sample at ``t_ns`` is an output; every sample is to be asked for, once, in its order."""
        if self._first_sample_ns is None:
            self._first_sample_ns = t_ns
        period = int(output_period(t_ns - self._first_sample_ns, self._rate_hz))
        due = period > self._period
        self._period = period
        return due

    def output(
        self, bank: Bank, imu: ImuSamples, parameters: npt.NDArray[Any], work: FilterWorkspace
    ) -> AidingTable:
        """Return the aiding of a bank at the newest sample of ``imu``."""
        t_ns = int(imu.t_ns[-1])
        count = self._room.counts[0]
        count.rows = count.covariances = 0
        never = False  # beyond what is due
        write_trace(bank, t_ns, never, parameters[0], self._room, work.P_out, work.scratch)
        samples = TraceSamples(imu.t_ns, imu.w_ib_b, imu.f_b)
        now, begin = traced(self._room, samples).trace, self._begin
        if begin is None or count.covariances or t_ns // PIECE_NS != int(begin.t_ns[0]) // PIECE_NS:
            self._begin = joined(now)  # the room is written again
            trace = self._begin
        else:
            trace = joined(begin, now)
            trace.sample[0] = np.searchsorted(samples.t_ns, begin.t_ns[0])
        covariances = Covariances(self._room.covariance_ns[:1], self._room.P[:1])
        table = compute_aiding(self._sources.setup, self._arcs_at(t_ns), trace, samples, covariances)
        return table.at_last_time()

    def _arcs_at(self, t_ns: int) -> SatelliteArcs:
        """Return the pieces that hold ``t_ns``."""
        if self._arcs is None or not self._arcs.covers(t_ns, t_ns):
            self._arcs = self._sources.arcs(t_ns, t_ns)
        return self._arcs
