"""The main job: a flight and a filter in, a run out."""

from __future__ import annotations

import datetime as dt
import itertools
import math
import platform
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numba
import numpy as np
import pandas as pd

from insgnss.antenna.equipment import installation, limits_of
from insgnss.antenna.installation import Installation
from insgnss.comparison import errors_against
from insgnss.config.filter import FilterConfig
from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.corrected_rows import corrected_rows
from insgnss.errors import ConfigError, StartError
from insgnss.fusion import compile_loop
from insgnss.fusion.loop import Imu, run_epochs, run_to
from insgnss.fusion.navigator import Navigator
from insgnss.fusion.output import Output, new_output
from insgnss.fusion.setup import FilterSetup
from insgnss.gnss.clock_groups import Pair, clock_groups, pairs_of
from insgnss.gnss.observation_rows import Rows
from insgnss.gpstime import week_seconds_to_ns
from insgnss.jit import compiled_beside, is_compiled
from insgnss.library import filter_config
from insgnss.log.flight import Flight, FlightLogs
from insgnss.log.rinex import read_navigation
from insgnss.result_tables import (
    RowKeys,
    event_table,
    measurement_table,
    nav_table,
    row_keys,
    satellite_table,
)
from insgnss.run import Run
from insgnss.status import NO_IMU, USED
from insgnss.tables import Event, ImuTable, Int64, NavigationData, ReferenceTable
from insgnss.version import __version__

OutputRate = Literal["gnss", "imu"] | float
Progress = Callable[[str], None]


def setup_filter(flight: Flight, logs: FlightLogs, config: FilterConfig) -> FilterSetup:
    """Return the filter's setup for a flight's logs: what the streaming engine must be given to repeat a replay."""
    navigation = None if logs.gnss.sat is not None else logs.navigation
    with_carrier = logs.gnss.carrier_cycles is not None
    setup = _setup(flight, config, navigation, pairs_of(logs.gnss), with_carrier=with_carrier)
    return replace(setup, products=logs.products, antennas=logs.antennas)


def engine_settings(
    flight: Flight | str | Path,
    filter: str | Path | FilterConfig = "tight17",
    *,
    signals: Iterable[Pair] | None = None,
    carrier: bool = False,
) -> FilterSetup:
    """Return what ``Engine`` needs, from a flight file: its equipment, its start and its navigation files.

    The inertial and GNSS logs are not opened: they are what the engine will be fed.

    Parameters
    ----------
    flight : the flight or its file
    filter : a name in the library, a file, or the settings themselves
    signals : constellation and RINEX code of all that the receiver will send, as ("G", "C1C"); when None every band of
        the filter's settings gets its clock, for each constellation that has an ephemeris
    carrier : whether the epochs will bring carrier phases
    """
    if not isinstance(flight, Flight):
        flight = Flight.load(flight)
    config = filter_config(filter)
    wanted = config.measurements.signals_of()
    if not flight.config.gnss.navigation:
        return _setup(flight, config, None, _all_pairs(wanted, set(wanted)), with_carrier=carrier)
    navigation, _ = read_navigation(flight.config.gnss.navigation)
    states = navigation.state_vectors
    seen = (*navigation.ephemerides.sv_names, *(() if states is None else states.sv_names))
    pairs = _all_pairs(wanted, {name[0] for name in seen}) if signals is None else set(signals)
    return _setup(flight, config, navigation, pairs, with_carrier=carrier)


def _installed(flight: Flight) -> tuple[Installation, list[Event]]:
    """Return the vehicle's antennas, and what is worth telling of their files."""
    gnss = flight.config.gnss
    return installation(gnss.antenna, flight.path.absolute().parent, gnss.lever_b)


def _all_pairs(signals: dict[str, tuple[str, ...]], letters: set[str]) -> set[Pair]:
    return {(letter, code) for letter in letters for code in signals.get(letter, ())}


def _setup(
    flight: Flight,
    config: FilterConfig,
    navigation: NavigationData | None,
    pairs: set[Pair],
    *,
    with_carrier: bool,
) -> FilterSetup:
    gnss, start, use = flight.config.gnss, flight.config.start, config.measurements
    given = None if start == "automatic" else start
    start_ns = None
    if given is not None and given.time_s is not None:
        start_ns = int(week_seconds_to_ns(flight.config.gps_week, given.time_s))
    return FilterSetup(
        config=config,
        grade=flight.imu_grade,
        oscillator=flight.oscillator,
        lever_arm_m=gnss.lever_b or (0.0, 0.0, 0.0),
        clock_groups=clock_groups(use.constellations, use.signals_of(), pairs, every_band=use.every_band),
        start=given,
        start_ns=start_ns,
        navigation=navigation,
        with_carrier=with_carrier,
        installation=_installed(flight)[0],
        visibility_limits=limits_of(config.visibility),
    )


def replay(
    flight: Flight | str | Path,
    filter: str | Path | FilterConfig = "tight17",
    *,
    output: OutputRate = "gnss",
    progress: Progress | None = None,
) -> Run:
    """Run the filter over a flight's logs.

    Parameters
    ----------
    flight : the flight or its file
    filter : a name in the library (``models/filters``), a file, or the settings themselves
    output : navigation rows at each GNSS epoch ("gnss"), each inertial sample ("imu"), or at a rate [Hz]
    progress : is told in words what is being done

    Raises
    ------
    InsGnssError : a log or a setting cannot be used; StartError when no epoch allowed a start
    """
    tell = progress or (lambda _: None)
    began = time.perf_counter()
    if not isinstance(flight, Flight):
        flight = Flight.load(flight)
    config = filter_config(filter)
    with compiled_beside(run_epochs, compile_loop.MODULE) as loop_is_compiled:
        setup, work, record = _prepared(flight, config, tell)
        read = time.perf_counter()
        tell("running the filter")
        out, events = run_filter(setup, *work, output, before_loop=loop_is_compiled)
    filtered = time.perf_counter()
    del work  # a big log's samples and rows take as much room as the tables
    tell("writing the tables")
    run = _as_run(flight, record, setup, out, events)
    took = {"read_s": read - began, "filter_s": filtered - read, "tables_s": time.perf_counter() - filtered}
    run.settings = {**run.settings, "took": took, "output": output}
    return run


class _Record(NamedTuple):
    """What is kept of the logs for the result tables."""

    keys: RowKeys
    reference: ReferenceTable | None
    events: list[Event]
    input_hashes: dict[str, str]


def _prepared(
    flight: Flight, config: FilterConfig, tell: Progress
) -> tuple[FilterSetup, tuple[ImuTable, Rows], _Record]:
    """Return the filter's setup, what it works on, and what the tables need; nothing else of the logs is kept."""
    tell("reading the logs")
    with ThreadPoolExecutor(1) as beside:
        reading = beside.submit(flight.read)
        if is_compiled(run_epochs):
            compile_loop.compile_loop()  # fetched from the cache while the logs are parsed
        logs = reading.result()
        del reading  # it would keep the logs
    tell("computing the satellites")
    setup = setup_filter(flight, logs, config)
    rows, found = corrected_rows(setup, logs, flight)
    events = logs.events + _installed(flight)[1] + found
    record = _Record(row_keys(logs.gnss, rows), logs.reference, events, logs.input_hashes)
    return setup, (logs.imu, rows), record


def run_filter(
    setup: FilterSetup,
    table: ImuTable,
    rows: Rows,
    output: OutputRate,
    *,
    before_loop: Callable[[], object] = lambda: None,
) -> tuple[Output, list[Event]]:
    """Run a filter over samples and rows; return the loop's output and the events.

    ``before_loop`` is called when the compiled loop is needed, after the start.

    The log is cut where inertial samples are missing for longer than the restart limit: each part starts anew.
    """
    imu = Imu(table.t_ns, np.ascontiguousarray(table.w_ib_b), np.ascontiguousarray(table.f_b))
    times = output_times(imu.t_ns, output)
    out = new_output(
        rows, max(len(times), len(rows.epoch_ns)), 4 * len(rows.epoch_ns) + 16, times, setup.layout.n_values
    )
    events: list[Event] = []
    covered = np.zeros(len(rows.epoch_ns), np.bool_)
    started = False
    given = setup.start is not None
    for first, last in stretches(imu.t_ns, setup.config.gaps.restart_s):
        part = Imu(imu.t_ns[first:last], imu.w_ib_b[first:last], imu.f_b[first:last])
        e0, e1 = np.searchsorted(rows.epoch_ns, [part.t_ns[0], part.t_ns[-1] + 1])
        covered[e0:e1] = True
        navigator = Navigator(setup, before_loop)
        navigator.starter.given = given and not started
        navigator.run(part, rows, int(e0), int(e1), out)
        if navigator.bank is not None and len(times):
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


def _as_run(flight: Flight, record: _Record, setup: FilterSetup, out: Output, events: list[Event]) -> Run:
    week = flight.config.gps_week
    nav = nav_table(out, week, setup)
    errors = None
    if record.reference is not None:
        point = flight.config.reference.point if flight.config.reference is not None else "imu"
        errors = errors_against(
            nav, record.reference, week, setup.lever_arm_m if point == "antenna" else None
        )
    with ThreadPoolExecutor(1) as beside:  # NumPy leaves Python's lock free
        satellites = beside.submit(satellite_table, out, record.keys, week)
        measurements = measurement_table(out, record.keys, week)
    return Run(
        nav=nav,
        measurements=measurements,
        satellites=satellites.result(),
        events=event_table(record.events + events, week),
        errors=errors,
        settings=_settings(flight, record.input_hashes, setup),
    )


def _settings(flight: Flight, input_hashes: dict[str, str], setup: FilterSetup) -> dict[str, Any]:
    """Return all that is needed to repeat the run."""
    return {
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
