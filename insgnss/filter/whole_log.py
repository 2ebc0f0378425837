"""A filter over a whole log: every unbroken stretch of inertial samples, each with a start of its own.

The rows of a big log come in blocks of whole epochs. A block is given up once the filter is through with it, so that
the ledger takes the room that the rows leave.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ConfigError, StartError, TimeError
from insgnss.filter.imu.inertial_stream import screened
from insgnss.filter.loop import run_to
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.trace_rows import TraceRoom, new_trace_room, no_trace, output_samples
from insgnss.filter.output.writing import Output, Table, mark_without_imu, new_ledger, new_output
from insgnss.filter.own_rows.ledger import OwnEntry, complete_ledger
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.setup import FilterSetup
from insgnss.filter.smoothing.body_points import PointColumnValues
from insgnss.filter.smoothing.row_covariances import RowCovariances
from insgnss.filter.smoothing.smoother import Smoother, smooth_back
from insgnss.filter.start.carried_start import CarriedState, kept_over
from insgnss.filter.start.without_gnss import TimedStart, opened_at
from insgnss.filter.state import MAX_RANGE_BIASES
from insgnss.filter.update.masking import still_uncertain
from insgnss.gnss.observation_rows import GnssRows, from_epoch
from insgnss.gpstime import ns_to_week_seconds
from insgnss.tables import Event, ImuTable, Int64

OutputRate = Literal["gnss", "imu"] | float | Int64  # the last: times themselves [ns]
MOST_OUTPUTS_PER_SAMPLE: Final = 10.0  # between two inertial samples a row adds nothing


class TraceIntervals(NamedTuple):
    """How often the filter is to leave its state behind, and how often its covariance at least."""

    rate_hz: float | None  # at inertial samples; None: at no rate
    sigma_interval_s: float = 1.0
    epoch_samples_ns: Int64 | None = None  # samples that are to bring both, beside those of the rate


class LedgerPart(NamedTuple):
    """The filter's output for a block's rows."""

    entries: Table  # (n,) of ``output.LEDGER_DTYPE``
    carriers: Table  # (n,) of ``output.CARRIER_LEDGER_DTYPE``, (0,) without carrier


def run_filter(
    setup: FilterSetup,
    table: ImuTable,
    rows: GnssRows,
    output: OutputRate,
    *,
    trace: TraceIntervals | None = None,
) -> tuple[Output, list[Event]]:
    """Run a filter over samples and rows; return the loop's output, all of its ledger in it, and the events."""
    out, (ledger,), events = run_blocks(setup, table, [rows], output, trace=trace)
    return out._replace(ledger=ledger.entries, carrier=ledger.carriers), events


def run_blocks(
    setup: FilterSetup,
    table: ImuTable,
    blocks: list[GnssRows],
    output: OutputRate,
    *,
    trace: TraceIntervals | None = None,
    smooth: bool = False,
    further: PointColumnValues | None = None,
    filtered: list[Table] | None = None,
    own: list[OwnEntry] | None = None,
) -> tuple[Output, list[LedgerPart], list[Event]]:
    """Run a filter over samples and the blocks of a log's rows.

    Returns
    -------
    out : the loop's output without a ledger
    ledger : a part for each block
    events : of the filter

    Parameters
    ----------
    blocks : one after the other in time; the list is emptied on the way
    trace : asks for states and covariances at inertial samples: ``aiding.trace.traced`` gives them out of ``out.trace``
    smooth : smooths the navigation rows with the rest of their stretch
    further : columns that are wanted beside those that every navigation row has; filled
    filtered : takes the filter's own navigation rows of each part before they are smoothed
    own : takes the status of a user's own rows

    The log is cut where inertial samples are missing for too long: each part restarts with what the one before it
    leaves behind.

    Raises
    ------
    ConfigError : the log has more satellites than a smoother has range biases for
    """
    _refuse_shared_states(setup, smooth=smooth)
    samples = screened(table, setup)
    times = output_times(samples.logged_ns, output)
    epoch_ns = np.concatenate([block.epoch_ns for block in blocks])
    n_epochs = len(epoch_ns)
    room = trace_room(trace, samples.logged_ns, n_epochs, setup.n_offsets)
    no_rows = from_epoch(blocks[-1], len(blocks[-1].epoch_ns))
    n_nav, n_shown = max(len(times), n_epochs), setup.layout.n_shown
    out = new_output(no_rows, n_nav, 4 * n_epochs + 16, times, n_shown, room)
    if further is not None:
        further.room(n_nav)
    passage = _Passage(blocks, out)
    events: list[Event] = list(samples.events)
    started, latest = False, setup  # the one that a look back may have changed
    carried: CarriedState | None = None
    own_by_time: dict[int, list[OwnEntry]] = {}
    spans_ns: list[tuple[int, int]] = []
    smoothers: list[Smoother] = []
    for part, cut in samples.stretches():
        carried = carried if cut is None else kept_over(carried, cut)
        if len(part.t_ns) < 2:
            continue
        spans_ns.append((int(part.t_ns[0]), int(part.t_ns[-1])))
        e0, e1 = np.searchsorted(epoch_ns, [part.t_ns[0], part.t_ns[-1] + 1])
        passage.without_imu(int(e0))
        navigator = Navigator(latest)
        navigator.starter.begin(given=setup.start is not None and not started, carried=carried)
        smoother = Smoother(navigator, part, further) if smooth else None
        first = int(out.counts[0].nav)
        if smoothers and carried is not None:
            smoothers[-1].end_before(carried.cut)
        for rows, begin, end, written in passage.until(int(e1)):
            if smoother is not None:
                smoother.forward(rows, begin, end, written)
            elif further is not None:
                RowCovariances(navigator, part, further).forward(rows, begin, end, written)
            else:
                navigator.run(part, rows, begin, end, written)
        _after_the_epochs(navigator, part, further, no_rows, out)
        own_by_time |= navigator.own
        if filtered is not None:
            filtered.append(out.nav[first : out.counts[0].nav].copy())
        if smoother is not None and navigator.started_ns is not None:
            smoothers.append(smoother)
        navigator.note_silence(int(part.t_ns[-1]))
        events += navigator.events + still_uncertain(navigator.bank, setup.config.visibility)
        carried = navigator.leave(part)
        started, latest = started or navigator.started_ns is not None, navigator.setup
    passage.without_imu(n_epochs)
    if not started:
        raise _no_start(setup, samples.logged_ns, epoch_ns)
    if smoothers:
        smooth_back(smoothers, times if len(times) else epoch_ns, out)
    if own is not None and setup.own is not None:
        own += complete_ledger(setup.own, own_by_time, spans_ns, (-(2**62), 2**62))
    return out, passage.ledger or [LedgerPart(*new_ledger(no_rows))], events


def _refuse_shared_states(setup: FilterSetup, *, smooth: bool) -> None:
    """Refuse to smooth where a state changes its satellite: the way back would give it what it learnt of another."""
    if smooth and setup.config.process.range_bias_states and setup.n_satellites > MAX_RANGE_BIASES:
        raise ConfigError(
            f"the log has {setup.n_satellites} satellites, and a smoother has room for the range biases of"
            f" {MAX_RANGE_BIASES}",
            key="process.range_bias_states",
            advice="use fewer constellations (measurements.constellations), cut the log, or switch the states off",
        )


def _after_the_epochs(
    navigator: Navigator, part: ImuSamples, further: PointColumnValues | None, no_rows: GnssRows, out: Output
) -> None:
    """Use the own rows up to the end of a stretch and write its last rows; without raw GNSS data it is opened here."""
    if navigator.setup.start_alone is not None:
        _open_alone(navigator, navigator.setup, part)
    if further is not None:
        RowCovariances(navigator, part, further).own_to_the_end(no_rows, out)
    else:
        navigator.use_own_rows(part, no_rows, int(part.t_ns[-1]), out)
    if navigator.bank is None or not (len(out.times_ns) or len(out.trace.times_ns)):
        return
    if further is not None:
        RowCovariances(navigator, part, further).to_the_end(navigator.bank, no_rows, out)
    else:
        work = navigator.workspace(no_rows)
        run_to(navigator.bank, int(part.t_ns[-1]), part, navigator.parameters, out, work)


def _open_alone(navigator: Navigator, setup: FilterSetup, part: ImuSamples) -> None:
    """Start a stretch that has no raw GNSS data."""
    start: TimedStart | None = None if setup.start_alone is None else setup.start_alone(part)
    if start is not None:
        navigator.bank = opened_at(start, setup, part, navigator.parameters[0])
        navigator.started_ns = start.t_ns
        navigator.events.append(Event(start.t_ns, "start", f"without raw GNSS data, {start.source}"))


def _no_start(setup: FilterSetup, t_ns: Int64, epoch_ns: Int64) -> StartError:
    """Return the error of a log on which the filter never started."""
    if setup.start_alone is not None:
        return StartError(
            "the filter without raw GNSS data cannot start: no two position fixes, half a second apart, follow a second"
            " of inertial samples",
            advice="check the time of the [[sensor]] of kind 'position', or give [start] with its time_s",
        )
    if setup.start is None:
        return StartError(
            "no epoch allowed the filter to start",
            advice="a start needs four satellites with ephemeris, at least a second of inertial samples before them,"
            " and range rates or two epochs; 'insgnss check' shows satellites and ephemeris per epoch, and finds time"
            " tags of another scale (UTC)",
        )
    if setup.start_ns is not None and not t_ns[0] <= setup.start_ns <= epoch_ns[-1]:
        early_s, late_s = (t_ns[0] - setup.start_ns) / NS_PER_S, (setup.start_ns - epoch_ns[-1]) / NS_PER_S
        where = f"{early_s:.1f} s before the first inertial sample"
        return StartError(
            f"the given start is {where if early_s > 0.0 else f'{late_s:.1f} s after the last epoch'}",
            key="start.time_s",
            advice="give a time inside both logs, or leave it out to start at the first epoch",
        )
    return StartError(
        "no epoch could be used from the given start: none has a satellite with ephemeris above its horizon",
        key="start",
        advice="check the place: 'insgnss check' shows satellites and ephemeris per epoch; without [start] the"
        " filter starts by itself",
    )


@dataclass
class _Passage:
    """The blocks of a log on their way through the filter."""

    waiting: list[GnssRows]  # a block that the filter is in the middle of stands first
    room: Output
    ledger: list[LedgerPart] = field(default_factory=list)  # a part for each block that was begun
    _epoch: int = 0  # the first of the log that is still to come
    _begin: int = 0  # epoch of the log at which the first block begins

    def until(self, last: int) -> Iterator[tuple[GnssRows, int, int, Output]]:
        """Yield a block, its epochs that come next and the one after them, and room for their ledger, up to ``last``.

        ``last`` counts the log's epochs. A block is given up when its last epoch is through.
        """
        while self._epoch < last:
            rows = self.waiting[0]
            if self._epoch == self._begin:
                self.ledger.append(LedgerPart(*new_ledger(rows)))
            begin, end = self._epoch - self._begin, min(last - self._begin, len(rows.epoch_ns))
            entries, carriers = self.ledger[-1]
            yield rows, begin, end, self.room._replace(ledger=entries, carrier=carriers)
            self._epoch = self._begin + end
            if end == len(rows.epoch_ns):
                del self.waiting[0]
                self._begin = self._epoch

    def without_imu(self, last: int) -> None:
        """Pass over the epochs before ``last``: what could be used of them has no inertial samples."""
        for rows, begin, end, written in self.until(last):
            passed = slice(int(rows.first[begin]), int(rows.first[end]))
            mark_without_imu(written.ledger[passed], written.carrier[passed])


def trace_room(trace: TraceIntervals | None, t_ns: Int64, n_epochs: int, n_offsets: int) -> TraceRoom:
    """Return space for the requested output of a log with inertial samples at ``t_ns``."""
    if trace is None:
        return no_trace(n_offsets)
    times_ns = t_ns[output_samples(t_ns, trace.rate_hz)] if trace.rate_hz is not None else t_ns[:0]
    if trace.epoch_samples_ns is not None:
        times_ns = np.union1d(times_ns, trace.epoch_samples_ns)
    return new_trace_room(times_ns, trace.sigma_interval_s, n_epochs, n_offsets, trace.epoch_samples_ns)


def _no_times(t_ns: Int64) -> ConfigError:
    first_s, last_s = (ns_to_week_seconds(t_ns[[0, -1]], int(t_ns[0] // NS_PER_WEEK))).tolist()
    return ConfigError(
        "no output time lies inside the inertial samples",
        key="output",
        advice=f"they reach from {first_s:.3f} to {last_s:.3f} s of the GPS week",
    )


def output_times(t_ns: Int64, output: OutputRate) -> Int64:
    """Return the output times: none for one row per epoch, every sample, multiples of a period, or times as given.

    Raises
    ------
    ConfigError : ``output`` is neither "gnss" nor "imu" nor a rate [Hz] from one in the log to ten in a sample, nor
        has it times inside the log
    TimeError : the samples run backwards
    """
    if len(t_ns) > 1 and t_ns[-1] < t_ns[0]:
        raise TimeError(
            f"the inertial time tags run backwards, by {(t_ns[0] - t_ns[-1]) / NS_PER_S:.6g} s from first to last",
            advice="give the samples in the order of their time",
        )
    if isinstance(output, np.ndarray):
        inside: Int64 = output[(output >= t_ns[0]) & (output <= t_ns[-1])]
        if not len(inside):
            raise _no_times(t_ns)
        return inside
    if output == "gnss":
        return np.zeros(0, np.int64)
    if output == "imu":
        return t_ns
    try:
        rate_hz = float(output)
    except (TypeError, ValueError):
        rate_hz = math.nan
    samples_hz = NS_PER_S / float(np.median(np.diff(t_ns)))
    slowest_hz = NS_PER_S / float(t_ns[-1] - t_ns[0])  # a whole multiple of such a period lies in the log
    fastest_hz = MOST_OUTPUTS_PER_SAMPLE * samples_hz
    if not slowest_hz <= rate_hz <= fastest_hz:
        raise ConfigError(
            f"invalid output rate {output!r} for inertial samples at {samples_hz:.6g} Hz",
            key="output",
            advice=f"give 'gnss', 'imu' or a number of Hz, as output=10, from {slowest_hz:.6g} to {fastest_hz:.6g}",
        )
    period = NS_PER_S / rate_hz
    # counted from the start of the GPS week: of all GPS time a double would hold only 256 ns
    origin = int(t_ns[0]) // NS_PER_WEEK * NS_PER_WEEK
    first, last = math.ceil((int(t_ns[0]) - origin) / period), math.floor((int(t_ns[-1]) - origin) / period)
    return np.asarray(origin + np.rint(np.arange(first, last + 1) * period).astype(np.int64))
