"""Many outages for little more than one pass: the filter's state before each is stored, and a branch starts from it.

An outage changes nothing before it begins. So one undisturbed pass over the log leaves a copy of the filter at the
beginning of each window, and from each a branch runs over the log without the rows taken away, to some time after their
return. What a branch gives is, bit for bit, what the whole log without those rows would give.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from insgnss.config.filter import FilterConfig
from insgnss.constants import NS_PER_S
from insgnss.errors import ConfigError
from insgnss.filter.antennas.phase_log import KIND, PhaseLog
from insgnss.filter.imu.inertial_stream import screened
from insgnss.filter.loop import run_to
from insgnss.filter.navigator import Navigator, Snapshot
from insgnss.filter.output.writing import Output, new_output
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.carried_start import CarriedState, kept_over
from insgnss.filter.whole_log import output_times
from insgnss.gnss.antenna_phases import MATCH_NS
from insgnss.gnss.observation_rows import GnssRows
from insgnss.gpstime import week_seconds_to_ns
from insgnss.log.flight import Flight, FlightLogs
from insgnss.runs.antennas_on_demand import require_common_epochs
from insgnss.runs.gnss_rows import row_corrections
from insgnss.runs.result_tables import nav_table
from insgnss.runs.setup import setup_filter
from insgnss.studies.outage.windows import (
    OutageWindow,
    Removal,
    further_without,
    switch_off,
    switched_off,
    window_ns,
)
from insgnss.tables import Event, Float64, GnssTable, Int64


@dataclass(frozen=True)
class OutageLog:
    """A flight read and set up once, for as many passes and branches as are wanted."""

    flight: Flight
    logs: FlightLogs
    setup: FilterSetup
    ionosphere_l1: Float64 | None
    correction_m: Float64 | None
    times_ns: Int64  # of the output

    @classmethod
    def of(cls, flight: Flight, config: FilterConfig, rate_hz: float) -> OutageLog:
        """Return a flight with its logs read and everything computed that does not depend on a window."""
        logs = flight.read()
        setup = setup_filter(flight, logs, config)
        ionosphere_l1, correction_m, _ = row_corrections(setup, logs, flight)
        require_common_epochs(logs, flight)
        times_ns = output_times(logs.imu.t_ns, rate_hz)
        return cls(flight, logs, setup, ionosphere_l1, correction_m, times_ns)

    @property
    def week_ns(self) -> int:
        """GPS time at which the flight's week begins."""
        return int(week_seconds_to_ns(self.flight.config.gps_week, 0.0))

    def rows(self, taken: npt.NDArray[np.intp] | slice) -> GnssRows:
        """Return rows of the log as the filter's."""
        index = np.arange(len(self.logs.gnss.t_ns))[taken]
        parts = (None if m is None else m[index] for m in (self.ionosphere_l1, self.correction_m))
        ionosphere_l1, correction_m = parts
        return self.setup.rows(
            self.logs.gnss.take(index),
            self.setup.messages,
            ionosphere_l1=ionosphere_l1,
            correction_m=correction_m,
        )

    def setup_with(self, phases: PhaseLog | None) -> FilterSetup:
        """Return the setup of a filter that is given the phases of several antennas, None with one antenna."""
        aid = self.setup.aid
        return self.setup if aid is None else replace(self.setup, aid=aid.copied(phases))

    def nav(self, out: Output) -> pd.DataFrame:
        """Return the navigation table of an output."""
        return nav_table(out, self.flight.config.gps_week, self.setup)


@dataclass(frozen=True)
class Checkpoint:
    """The filter before the first epoch of a window."""

    window: OutageWindow
    saved: Snapshot
    imu: ImuSamples  # of the unbroken stretch


@dataclass(frozen=True)
class Branch:
    """Output of a filter without a window's rows, from the window's beginning on."""

    window: OutageWindow
    nav: pd.DataFrame
    n_taken: int  # rows taken away
    events: list[Event]


def undisturbed(
    log: OutageLog, windows: Sequence[OutageWindow]
) -> tuple[pd.DataFrame, list[Checkpoint], list[OutageWindow]]:
    """Run the filter over the whole log; return its solution, a checkpoint a window, and the windows without one.

    A window has none where the filter is not started, or no inertial sample is, at its beginning.
    """
    rows = log.rows(slice(None))
    setup = log.setup
    if setup.aid is not None:
        setup = log.setup_with(setup.phases(log.logs.gnss, rows, log.logs.further))
    imu, n_epochs = log.logs.imu, len(rows.epoch_ns)
    samples = screened(imu, log.setup)
    out = new_output(rows, len(log.times_ns) + 16, 4 * n_epochs + 16, log.times_ns, log.setup.layout.n_shown)
    ordered = sorted((window_ns(window, log.week_ns)[0], window) for window in windows)
    checkpoints: list[Checkpoint] = []
    started, latest = False, setup  # the one that a look back may have changed
    carried: CarriedState | None = None
    for part, cut in samples.stretches():
        carried = carried if cut is None else kept_over(carried, cut)
        if len(part.t_ns) < 2:
            continue
        e0, e1 = (int(e) for e in np.searchsorted(rows.epoch_ns, [part.t_ns[0], part.t_ns[-1] + 1]))
        navigator = Navigator(latest)
        navigator.starter.begin(given=log.setup.start is not None and not started, carried=carried)
        for from_ns, window in ordered:
            if not part.t_ns[0] <= from_ns <= part.t_ns[-1]:
                continue
            at = int(np.searchsorted(rows.epoch_ns, from_ns))
            navigator.run(part, rows, e0, at, out)
            e0 = at
            if navigator.bank is not None:
                checkpoints.append(Checkpoint(window, navigator.snapshot(), part))
        navigator.run(part, rows, e0, e1, out)
        if navigator.bank is not None:
            _carry_on(navigator, part, int(part.t_ns[-1]), rows, out)
        carried, latest = navigator.leave(part), navigator.setup
        started = started or navigator.started_ns is not None
    has_one = {checkpoint.window for checkpoint in checkpoints}
    return log.nav(out), checkpoints, [window for window in windows if window not in has_one]


def _carry_on(navigator: Navigator, imu: ImuSamples, stop_ns: int, rows: GnssRows, out: Output) -> None:
    if navigator.bank is not None:
        run_to(navigator.bank, stop_ns, imu, navigator.parameters, out, navigator.workspace(rows))


def branch(log: OutageLog, checkpoint: Checkpoint, removal: Removal, after_s: float) -> Branch:
    """Run from a checkpoint over the log without a window's rows, to ``after_s`` after the window's end."""
    from_ns, until_ns = window_ns(checkpoint.window, log.week_ns)
    imu = checkpoint.imu
    end_ns = min(until_ns + round(after_s * NS_PER_S), int(imu.t_ns[-1]))
    rows, phases, n_taken = _rows_without(log, removal, from_ns, until_ns, end_ns)
    a, b = np.searchsorted(log.times_ns, [from_ns, end_ns + 1])
    n_events = 4 * len(rows.epoch_ns) + 16
    out = new_output(rows, b - a + 16, n_events, log.times_ns[a:b], log.setup.layout.n_shown)
    navigator = Navigator(log.setup_with(phases))
    navigator.restore(checkpoint.saved)
    n_before = len(navigator.events)
    first, last = (int(e) for e in np.searchsorted(rows.epoch_ns, [from_ns, end_ns + 1]))
    navigator.run(imu, rows, first, last, out)
    _carry_on(navigator, imu, end_ns, rows, out)
    return Branch(checkpoint.window, log.nav(out), n_taken, navigator.events[n_before:])


def _rows_without(
    log: OutageLog, removal: Removal, from_ns: int, until_ns: int, end_ns: int
) -> tuple[GnssRows, PhaseLog | None, int]:
    """Return rows and phases of the epochs from the one before a window to ``end_ns``, and how many rows were taken."""
    gnss = log.logs.gnss
    before = int(np.searchsorted(gnss.t_ns, from_ns))
    # the carriers of a window's first epoch are differenced against the epoch before it
    first = int(np.searchsorted(gnss.t_ns, gnss.t_ns[before - 1])) if before > 0 else 0
    last = int(np.searchsorted(gnss.t_ns, end_ns + 1))
    chosen = removal.rows_of(gnss)
    within = chosen & (gnss.t_ns >= from_ns) & (gnss.t_ns < until_ns)
    left = np.arange(first, last)
    if not removal.kinds:
        left = left[~within[first:last]]
    rows = log.rows(left)
    switch_off(rows, removal.kinds, chosen[left], from_ns, until_ns)
    n_taken = 0 if removal.kinds == (KIND,) else int(np.count_nonzero(within))
    if log.setup.aid is None:
        if KIND in removal.kinds:
            message, advice = (
                "the flight has one antenna, so it has no antenna differences to remove",
                "choose other kinds",
            )
            raise ConfigError(message, key="kinds", advice=advice)
        return rows, None, n_taken
    further = [_around(table, gnss.t_ns[first:last]) for table in log.logs.further]
    if not removal.kinds:
        further, n_further = further_without(further, gnss, removal, from_ns, until_ns)
        return rows, log.setup.phases(gnss.take(left), rows, further), n_taken + n_further
    phases = log.setup.phases(gnss.take(left), rows, further)
    if KIND in removal.kinds:
        phases, n_further = switched_off(phases, removal, from_ns, until_ns)
        n_taken += n_further
    return rows, phases, n_taken


def _around(table: GnssTable, epoch_ns: Int64) -> GnssTable:
    """Return a further antenna's rows near a span of main epochs."""
    first, last = np.searchsorted(table.t_ns, [epoch_ns[0] - MATCH_NS, epoch_ns[-1] + MATCH_NS + 1])
    return table.take(slice(int(first), int(last)))


def branches(
    log: OutageLog, checkpoints: Sequence[Checkpoint], removal: Removal, after_s: float, threads: int
) -> list[Branch]:
    """Return the branch of each checkpoint; the kernels leave Python's lock free, so threads share the work."""
    with ThreadPoolExecutor(max(threads, 1)) as pool:
        return list(pool.map(lambda checkpoint: branch(log, checkpoint, removal, after_s), checkpoints))
