"""The main job: a flight and a filter in, a run out, with the settings that repeat it."""

from __future__ import annotations

import datetime as dt
import math
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pandas as pd

from insgnss.aiding.sources import AidingSources, aiding_sources
from insgnss.aiding.trace import FilterTrace, TraceSamples, at_times, traced
from insgnss.config.aiding import AidingConfig, aiding_config
from insgnss.config.filter import FilterConfig
from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S
from insgnss.filter.imu.inertial_stream import screened
from insgnss.filter.layout import StateBlock
from insgnss.filter.loop_calls import fetch_loop
from insgnss.filter.output.trace_rows import output_samples
from insgnss.filter.output.writing import Output, Table
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.own_rows.rows import Kind, Measurement
from insgnss.filter.setup import FilterSetup
from insgnss.filter.smoothing.body_points import PointColumnValues
from insgnss.filter.whole_log import LedgerPart, TraceIntervals, run_blocks
from insgnss.filter.whole_log import run_filter as run_filter
from insgnss.gnss.observation_rows import GnssRows
from insgnss.gnss.orbits.plausible_messages import refused_messages
from insgnss.kernels.compiled_ahead import is_complete
from insgnss.log.flight import Flight
from insgnss.receiver.sources import SupervisionSources, supervision_sources
from insgnss.runs.antennas_on_demand import Record, with_antennas
from insgnss.runs.contradiction import contradiction
from insgnss.runs.declared_sigmas import beyond_declared
from insgnss.runs.first_run import Compilation, compiled
from insgnss.runs.gnss_rows import MOST_ROWS, row_blocks
from insgnss.runs.imu_summary import imu_spectrum, imu_table
from insgnss.runs.installation import installation_events
from insgnss.runs.integrity.separation import Job, Separation, protection_of, separation_of
from insgnss.runs.reference_errors import errors_against
from insgnss.runs.result import Run
from insgnss.runs.result_tables import (
    LogNames,
    RowKeys,
    aiding_budget,
    aiding_table,
    event_table,
    filtered_table,
    ledger_tables,
    nav_table,
    row_keys,
    with_own_rows,
)
from insgnss.runs.setup import installed, setup_filter
from insgnss.runs.wanted_rows import (
    AtTimes,
    Point,
    described,
    further_of,
    output_of,
    refuse_integrity,
    refuse_smoothing,
    times_without_row,
    with_further,
)
from insgnss.sensors.reading_events import reading_events
from insgnss.tables import Event, ImuTable, ReferenceTable
from insgnss.version import __version__

Progress = Callable[[str], None]


def replay(
    flight: Flight | str | Path,
    filter: str | Path | FilterConfig = "tight",
    *,
    settings: Mapping[str, Any] | None = None,
    output: AtTimes = "gnss",
    point: Point | None = None,
    quaternion: bool = False,
    covariance: bool = False,
    aiding: float | AidingConfig | None = None,
    supervise: bool = False,
    smooth: bool = False,
    integrity: bool = False,
    states: Sequence[StateBlock] = (),
    measurements: Sequence[Measurement] = (),
    progress: Progress | None = None,
) -> Run:
    """Run the filter over a flight's logs.

    Parameters
    ----------
    flight : the flight or its file
    filter : a name in the library (``models/filters``), a file, or the settings themselves
    settings : changed settings of the filter, by dotted key or by tables: ``{"gates.pseudorange_sigma": 4.0}``
    output : navigation rows at each GNSS epoch ("gnss"), each inertial sample ("imu"), at a rate [Hz], or at given
        increasing times: seconds of the flight's GPS week, or dates with a zone as for ``run.at``. The filter is
        propagated to each time, so a camera's attitudes are correct even in turns; a time without a filter has
        no row, and an event reports this
    point : a point of the body (camera, radar, antenna) whose position, velocity and sigmas the rows include:
        forward, right, down from the IMU [m], or a name of the flight file: "antenna", an antenna's, one of [points]
    quaternion : whether the rows include the attitude as a quaternion, body to north-east-down, scalar first
    covariance : whether the rows include the covariances of position, velocity and attitude, and of the point
    aiding : rate [Hz] of ``run.aiding``, with the filter's other aiding settings, or all aiding settings; None: no
        aiding
    supervise : whether the search supervisor says at each epoch what the receiver should do about every satellite:
        ``run.supervision``, ``run.transitions``, ``run.search_times``; its settings are the filter's ``[search]``
    smooth : whether ``run.nav`` uses the whole log for each time, not only the data before it, also inside
        outages and while several headings were open (``filter.smoothing.smoother``); ``run.measurements`` are still
        those of the filter
    integrity : whether ``run.nav`` has protection levels ``hpl_m`` and ``vpl_m``, and ``run.integrity`` the separation
        of the solution without each satellite and constellation; the filter runs once more for each; its settings are
        the filter's ``[integrity]``
    states : further states for the filter to estimate, such as scale factors of a sensor: ``insgnss.StateBlock``
    measurements : the user's own, between epochs or at an epoch (applied before it): objects with ``name``,
        ``times_ns`` and ``rows(state, layout)``, see ``Measurement``. ``run.measurements`` has their rows by name
    progress : is called with a description of the current step

    Raises
    ------
    ConfigError : no such output, times or point; smoothing gives neither aiding nor supervision, which live on the
        past; protection levels are asked for and there is no raw GNSS data
    MeasurementError : a measurement's name, times or gate, or a row that it gives, cannot be used
    InsGnssError : a log or a setting cannot be used; StartError when no epoch allowed a start, NavigationDataError when
        aiding or supervision is asked for and nothing says where the satellites are
    """
    tell = progress or (lambda _: None)
    began = time.perf_counter()
    if not isinstance(flight, Flight):
        flight = Flight.load(flight)
    config = filter_config(filter, settings)
    aided = None if aiding is None else aiding_config(aiding, config.aiding)
    refuse_smoothing(smooth=smooth, beside=aided is not None or supervise)
    refuse_integrity(flight, integrity=integrity)
    rows_at = output_of(output, flight.config.gps_week, has_epochs=bool(flight.config.gnss.files))
    further = further_of(flight, point, quaternion=quaternion, covariance=covariance)
    setup, work, record = _prepared(flight, config, aided, supervise, (states, measurements), tell)
    read = time.perf_counter()
    tell("running the filter")
    wanted = _trace_wanted(aided, record.supervised)
    # a list of its own: the other is emptied
    job = Job(setup, work[0], list(work[1]), rows_at, smooth) if integrity else None
    forward: list[Table] | None = [] if smooth else None
    entries: list[OwnEntry] = []
    out, ledger, events = run_blocks(
        setup,
        *work,
        rows_at,
        trace=wanted,
        smooth=smooth,
        further=further,
        filtered=forward,
        own=entries,
    )
    events += reading_events(setup.own, entries)
    events += times_without_row(rows_at, out.nav["t_ns"][: out.counts[0].nav], flight.config.gps_week)
    separation = None if job is None else separation_of(job, out.nav[: out.counts[0].nav], ledger, tell)
    del job
    filtered = time.perf_counter()
    samples = TraceSamples(work[0].t_ns, work[0].w_ib_b, work[0].f_b)
    if wanted is not None:
        samples = TraceSamples(*screened(work[0], setup).imu[:3])  # as the filter took them
    filter_trace = traced(out.trace, samples)
    aids = None if record.aiding is None else _aiding(record, filter_trace, flight, tell)
    given = time.perf_counter()
    supervised = _supervised(record, filter_trace, flight, tell)
    settled = time.perf_counter()
    del work, filter_trace, samples  # a big log's samples take as much room as a table
    tell("writing the tables")
    run = _as_run(flight, record, setup, (out, ledger, separation), events, further)
    run.measurements = with_own_rows(run.measurements, entries, setup.own, flight.config.gps_week)
    run.events = _with_contradiction(run, out, flight.config.gps_week)
    run.filtered = None if forward is None else filtered_table(forward, flight.config.gps_week)
    run.aiding, run.aiding_budget = (None, None) if aids is None else aids
    for name, table in supervised.items():
        setattr(run, name, table)
    run.annotate()
    read_s = read - began - record.compilation.waited_s
    took = {**record.compilation.took, "read_s": read_s, "filter_s": filtered - read}
    took["tables_s"] = time.perf_counter() - settled
    took |= {} if aided is None else {"aiding_s": given - filtered}
    took |= {"supervision_s": settled - given} if supervise else {}
    run.settings = {**run.settings, "took": took, "output": described(output), "smooth": smooth}
    run.settings["aiding"] = None if aided is None else aided.model_dump(mode="json")
    run.settings["point"] = None if further is None else further.wanted.lever_b
    return run


def _with_contradiction(run: Run, out: Output, week: int) -> pd.DataFrame:
    """Return a run's events, with one at its end where its logs contradict each other."""
    end_ns = int(out.nav["t_ns"][out.counts[0].nav - 1])
    doubts = contradiction(run.events, run.measurements, run.status_counts(), end_ns)
    return pd.concat([run.events, event_table(doubts, week)], ignore_index=True) if doubts else run.events


def _trace_wanted(aided: AidingConfig | None, supervised: SupervisionSources | None) -> TraceIntervals | None:
    """Return when the filter is to leave its state behind, None for never."""
    samples_ns = None if supervised is None else supervised.samples_ns
    if aided is not None:
        return TraceIntervals(aided.rate_hz, aided.sigma_interval_s, samples_ns)
    return None if samples_ns is None else TraceIntervals(None, epoch_samples_ns=samples_ns)


def _aiding(
    record: _RunRecord, filter_trace: FilterTrace, flight: Flight, tell: Progress
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the aiding and its budget from the filter's trace."""
    assert record.aiding is not None
    tell("computing the aiding")
    if record.supervised is not None:  # which has rows of its own in the trace
        t_ns = filter_trace.samples.t_ns
        filter_trace = at_times(filter_trace, t_ns[output_samples(t_ns, record.aiding.setup.config.rate_hz)])
    table, week = record.aiding.table(filter_trace), flight.config.gps_week
    return aiding_table(table, week), aiding_budget(table, week)


def _supervised(
    record: _RunRecord, filter_trace: FilterTrace, flight: Flight, tell: Progress
) -> dict[str, Any]:
    """Return the supervisor's tables by their names, none where it is not asked for."""
    if record.supervised is None:
        return {}
    tell("supervising the search")
    return vars(record.supervised.run(filter_trace, flight.config.gps_week))


class _RunRecord(NamedTuple):
    """The parts of the logs kept for the result tables."""

    keys: list[RowKeys]  # of each block
    names: LogNames
    reference: ReferenceTable | None
    events: list[Event]
    input_hashes: dict[str, str]
    aiding: AidingSources | None
    supervised: SupervisionSources | None
    further: Record | None  # adds several antennas to the ledger
    imu: tuple[pd.DataFrame, pd.DataFrame]  # extremes over time, spectrum
    compilation: Compilation


def _prepared(
    flight: Flight,
    config: FilterConfig,
    aided: AidingConfig | None,
    supervise: bool,
    also: tuple[Sequence[StateBlock], Sequence[Measurement]],
    tell: Progress,
) -> tuple[FilterSetup, tuple[ImuTable, list[GnssRows]], _RunRecord]:
    """Return the filter's setup, its inputs, and the tables' inputs; nothing else of the logs is kept."""
    tell("reading the logs")
    with compiled(tell) as compilation, ThreadPoolExecutor(1) as beside:
        reading = beside.submit(flight.read)
        if is_complete():
            fetch_loop()  # from the cache, while the logs are parsed
        logs = reading.result()
        del reading  # it would keep the logs
    tell("computing the satellites")
    setup = setup_filter(flight, logs, config, several=False).with_further(*also)
    sources = None
    if aided is not None:
        sources = aiding_sources(setup, aided, logs.gnss.glonass_channels)
    # several antennas look at the log as a whole
    most_rows = MOST_ROWS if flight.config.attitude is None else None
    blocks, row_events = row_blocks(setup, logs, flight, most_rows)
    setup, ledger, more_events = with_antennas(setup, logs, flight, blocks[0])
    row_events = row_events + more_events
    supervised = None
    if supervise:
        supervised, more_events = supervision_sources(setup, logs, flight.config.gnss, flight.config.gps_week)
        row_events = row_events + more_events
    events = logs.events + installed(flight)[1] + refused_messages(logs.navigation) + row_events
    names = LogNames(logs.gnss.sv_names, logs.gnss.signal_names)
    keys = row_keys(logs.gnss, blocks)
    imu = imu_table(logs.imu, flight.config.gps_week), imu_spectrum(logs.imu)
    record = _RunRecord(
        keys, names, logs.reference, events, logs.input_hashes, sources, supervised, ledger, imu, compilation
    )
    return setup, (logs.imu, blocks), record


def _as_run(
    flight: Flight,
    record: _RunRecord,
    setup: FilterSetup,
    outputs: tuple[Output, list[LedgerPart], Separation | None],
    events: list[Event],
    further: PointColumnValues | None,
) -> Run:
    week, (out, ledger, separation) = flight.config.gps_week, outputs
    nav = with_further(nav_table(out, week, setup), further)
    protection = None
    if separation is not None:
        t_ns = out.nav["t_ns"][: len(nav)]
        protection = protection_of(separation, nav, t_ns, setup.config.integrity)
        nav = nav.assign(hpl_m=protection.hpl_m, vpl_m=protection.vpl_m)
        events = events + protection.events
    errors = None
    if record.reference is not None:
        point = flight.config.reference.point if flight.config.reference is not None else "imu"
        errors = errors_against(
            nav, record.reference, week, setup.lever_arm_m if point == "antenna" else None
        )
    settings = run_settings(flight, record.input_hashes, setup)
    by_states = [*installation_events(nav, settings, week), *beyond_declared(nav, setup.own, week)]
    measurements, satellites = ledger_tables(ledger, record.keys, record.names, week)
    if record.further is not None:
        measurements = record.further(measurements, week)
    return Run(
        nav=nav,
        measurements=measurements,
        satellites=satellites,
        events=event_table(record.events + events + by_states, week),
        errors=errors,
        imu=record.imu[0],
        imu_spectrum=record.imu[1],
        integrity=None if protection is None else protection.faults,
        settings=settings,
    )


def run_settings(flight: Flight, input_hashes: dict[str, str], setup: FilterSetup) -> dict[str, Any]:
    """Return everything needed to repeat the run."""
    settings: dict[str, Any] = {
        "flight": flight.config.model_dump(mode="json"),
        "filter": setup.config.model_dump(mode="json"),
        "imu_grade": setup.grade.model_dump(mode="json"),
        "oscillator": setup.oscillator.model_dump(mode="json"),
        "clock_groups": list(setup.clock_groups),
        "input_sha256": input_hashes,
        "versions": {
            "insgnss": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "numba": numba.__version__,
            "pandas": pd.__version__,
        },
        "made": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
    }
    if setup.own is not None:
        settings["measurements"] = [_described(kind) for kind in setup.own.kinds]
    return settings


def _described(kind: Kind) -> dict[str, Any]:
    """Return the settings of a user's own measurement, without its code."""
    gate = None if kind.gate2 is None else "none" if math.isinf(kind.gate2) else math.sqrt(kind.gate2)
    source = type(kind.source)
    count = {"period_s": kind.period_ns / NS_PER_S} if kind.period_ns else {"times": len(kind.times_ns)}
    times = {**count, "gate_sigma": gate, "unit": kind.unit}
    return {"name": kind.name, "class": f"{source.__module__}.{source.__qualname__}", **times}
