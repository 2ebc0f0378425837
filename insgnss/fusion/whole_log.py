"""A filter over a whole log: every unbroken stretch of inertial samples, each with a start of its own."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ConfigError, StartError
from insgnss.fusion.loop import run_to
from insgnss.fusion.navigator import Navigator
from insgnss.fusion.output import Output, new_output
from insgnss.fusion.prediction import Imu
from insgnss.fusion.setup import FilterSetup
from insgnss.fusion.smoother import Smoother
from insgnss.fusion.trace_rows import TraceRoom, new_trace_room, no_trace, output_samples
from insgnss.gnss.observation_rows import Rows
from insgnss.status import NO_IMU, USED
from insgnss.tables import Event, ImuTable, Int64

OutputRate = Literal["gnss", "imu"] | float


class TraceWanted(NamedTuple):
    """How often the filter is to leave its state behind, and how often its covariance at least."""

    rate_hz: float | None  # at inertial samples; None: at no rate
    sigma_interval_s: float = 1.0
    epoch_samples_ns: Int64 | None = None  # samples that are to bring both, beside those of the rate


def run_filter(
    setup: FilterSetup,
    table: ImuTable,
    rows: Rows,
    output: OutputRate,
    *,
    trace: TraceWanted | None = None,
    before_loop: Callable[[], object] = lambda: None,
    smooth: bool = False,
) -> tuple[Output, list[Event]]:
    """Run a filter over samples and rows; return the loop's output and the events.

    ``trace`` asks for states and covariances at inertial samples: ``aiding.trace.traced`` gives them out of
    ``Output.trace``. ``before_loop`` is called when the compiled loop is needed, after the start. ``smooth`` gives the
    navigation rows, one an epoch then, what the rest of their stretch tells of them.

    The log is cut where inertial samples are missing for longer than the restart limit: each part starts anew.
    """
    imu = Imu(table.t_ns, np.ascontiguousarray(table.w_ib_b), np.ascontiguousarray(table.f_b))
    times = output_times(imu.t_ns, output)
    n_epochs = len(rows.epoch_ns)
    room = trace_room(trace, imu.t_ns, n_epochs, setup.n_offsets)
    out = new_output(rows, max(len(times), n_epochs), 4 * n_epochs + 16, times, setup.layout.n_values, room)
    events: list[Event] = []
    covered = np.zeros(n_epochs, np.bool_)
    started = False
    given = setup.start is not None
    for first, last in stretches(imu.t_ns, setup.config.gaps.restart_s):
        part = Imu(imu.t_ns[first:last], imu.w_ib_b[first:last], imu.f_b[first:last])
        e0, e1 = np.searchsorted(rows.epoch_ns, [part.t_ns[0], part.t_ns[-1] + 1])
        covered[e0:e1] = True
        navigator = Navigator(setup, before_loop)
        navigator.starter.given = given and not started
        if smooth:
            Smoother(navigator, part).run(rows, int(e0), int(e1), out)
        else:
            navigator.run(part, rows, int(e0), int(e1), out)
        if navigator.bank is not None and (len(times) or len(room.times_ns)):
            run_to(
                navigator.bank, int(part.t_ns[-1]), part, navigator.parameters, out, navigator.workspace(rows)
            )
        events += navigator.events + gap_events(part.t_ns, setup.config.gaps.longest_step_s)
        if first > 0:
            events.append(restart_event(int(imu.t_ns[first - 1]), int(imu.t_ns[first])))
        started = started or navigator.started_ns is not None
    _mark_without_imu(out, rows, covered)
    if not started:
        raise StartError(
            "no epoch allowed the filter to start",
            advice="a start needs four satellites with ephemeris, at least a second of inertial samples before them,"
            " and range rates or two epochs; 'insgnss check' shows satellites and ephemeris per epoch",
        )
    return out, events


def trace_room(trace: TraceWanted | None, t_ns: Int64, n_epochs: int, n_offsets: int) -> TraceRoom:
    """Return room for what is wanted of a log with inertial samples at ``t_ns``."""
    if trace is None:
        return no_trace(n_offsets)
    times_ns = t_ns[output_samples(t_ns, trace.rate_hz)] if trace.rate_hz is not None else t_ns[:0]
    if trace.epoch_samples_ns is not None:
        times_ns = np.union1d(times_ns, trace.epoch_samples_ns)
    return new_trace_room(times_ns, trace.sigma_interval_s, n_epochs, n_offsets, trace.epoch_samples_ns)


def stretches(t_ns: Int64, restart_s: float) -> list[tuple[int, int]]:
    """Return (first, last) of the unbroken stretches of samples."""
    cuts = np.flatnonzero(np.diff(t_ns) > restart_s * NS_PER_S) + 1
    edges = [0, *cuts.tolist(), len(t_ns)]
    return [(a, b) for a, b in itertools.pairwise(edges) if b - a >= 2]


def gap_events(t_ns: Int64, longest_s: float) -> list[Event]:
    """Return an event for each gap that the filter bridges."""
    step = np.diff(t_ns)
    return [
        Event(
            int(t_ns[k]),
            "imu_gap",
            f"no inertial sample for {step[k] / NS_PER_S:.3f} s: bridged, sigma grown",
        )
        for k in np.flatnonzero(step > longest_s * NS_PER_S)
    ]


def restart_event(last_ns: int, next_ns: int) -> Event:
    """Return the event of a gap too long to bridge."""
    gap = (next_ns - last_ns) / NS_PER_S
    return Event(
        last_ns, "imu_gap", f"no inertial sample for {gap:.3f} s: too long to bridge, the filter starts anew"
    )


def output_times(t_ns: Int64, output: OutputRate) -> Int64:
    """Return the output times: none for one row per epoch, every sample, or whole multiples of the given period.

    Raises
    ------
    ConfigError : ``output`` is neither "gnss" nor "imu" nor a positive rate [Hz]
    """
    if output == "gnss":
        return np.zeros(0, np.int64)
    if output == "imu":
        return t_ns
    try:
        rate_hz = float(output)
    except (TypeError, ValueError):
        rate_hz = math.nan
    if not 0.0 < rate_hz < math.inf:
        raise ConfigError(f"{output!r} is no output rate", advice="give 'gnss', 'imu' or a rate in Hz")
    period = NS_PER_S / rate_hz
    # counted from the start of the GPS week: of all GPS time a double would hold only 256 ns
    origin = int(t_ns[0]) // NS_PER_WEEK * NS_PER_WEEK
    first, last = math.ceil((int(t_ns[0]) - origin) / period), math.floor((int(t_ns[-1]) - origin) / period)
    return np.asarray(origin + np.rint(np.arange(first, last + 1) * period).astype(np.int64))


def _mark_without_imu(out: Output, rows: Rows, covered: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> None:
    """Write NO_IMU for the usable rows of epochs outside the inertial log."""
    outside = ~np.repeat(covered, np.diff(rows.first))
    for ledger in (out.ledger, out.carrier):
        if len(ledger):
            status = ledger["status"]
            status[outside] = np.where(status[outside] == USED, NO_IMU, status[outside])
