"""The streaming engine against replay: the same bits, also when epochs arrive late."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from insgnss.config.library import filter_config
from insgnss.filter.engine import FilterEngine
from insgnss.filter.engine_results import EpochResult
from insgnss.filter.navigator import Navigator
from insgnss.filter.output.total_sigmas import slow_sigmas, total_values
from insgnss.filter.output.writing import new_output
from insgnss.filter.prediction import ImuSamples
from insgnss.filter.whole_log import run_filter
from insgnss.log.flight import Flight, FlightInMemory, FlightLogs
from insgnss.runs.setup import engine_settings, setup_filter
from insgnss.simulation.faults import carrier_alone, cycle_slip, half_cycle, outage
from insgnss.simulation.observations import NoiseTerms
from insgnss.simulation.oscillator import MILLISECOND_M
from insgnss.status import (
    CLOCK_STEPPED,
    HALF_CYCLE,
    NAMES,
    NO_EPOCH_BEFORE,
    SLIP_GEOMETRY_FREE,
    SLIP_INDICATED,
    TOO_LATE,
    USED,
)
from insgnss.tables import GnssTable
from tests.runs.scenes import flight, turns, with_faults

SAMPLE = Path(__file__).parents[2] / "data" / "sample_flight" / "flight.toml"
SECONDS = 150  # of the sample flight: rest, run-up, take-off, the heading found


@pytest.fixture(scope="module")
def part() -> tuple[Flight, FlightLogs]:
    """The first minutes of the sample flight."""
    flight = Flight.load(SAMPLE)
    return flight, shortened(flight.read(), SECONDS)


def shortened(logs: FlightLogs, seconds: float) -> FlightLogs:
    """Return the first seconds of the logs."""
    stop = int(logs.imu.t_ns[0]) + int(seconds * 1e9)
    n = int(np.searchsorted(logs.imu.t_ns, stop))
    imu = type(logs.imu)(logs.imu.t_ns[:n], logs.imu.w_ib_b[:n], logs.imu.f_b[:n])
    gnss = logs.gnss.take(np.flatnonzero(logs.gnss.t_ns < stop))
    return FlightLogs(imu, gnss, logs.navigation, None, [], {})


def beginning(flown: FlightInMemory, seconds: float) -> FlightInMemory:
    """Return the first seconds of a flight with its reference: a stream takes far longer than a replay."""
    logs = dataclasses.replace(shortened(flown.logs, seconds), reference=flown.logs.reference)
    return dataclasses.replace(flown, logs=logs)


def epochs(gnss: GnssTable) -> list[GnssTable]:
    """Return the table epoch by epoch."""
    return [gnss.take(np.flatnonzero(gnss.t_ns == t)) for t in np.unique(gnss.t_ns)]


def stream(engine: FilterEngine, logs: FlightLogs, delays_ns: Iterator[int]) -> None:
    """Feed samples and epochs in the order in which they arrive, each epoch late by its delay."""
    arriving = sorted(((int(e.t_ns[0]) + next(delays_ns), i) for i, e in enumerate(epochs(logs.gnss))))
    tables = epochs(logs.gnss)
    waiting = iter(arriving)
    due = next(waiting, None)
    for t_ns, w, f in zip(logs.imu.t_ns, logs.imu.w_ib_b, logs.imu.f_b, strict=True):
        engine.imu(int(t_ns), w, f)
        while due is not None and due[0] <= t_ns:
            engine.gnss(tables[due[1]])
            due = next(waiting, None)


def no_delay() -> Iterator[int]:
    """Yield zero for every epoch."""
    while True:
        yield 0


def assert_same_bits(
    results: list[EpochResult],
    logs: FlightLogs,
    flight: Flight,
    settings: Mapping[str, float] | None = None,
) -> None:
    """Hold every epoch of a stream against the replay of the same logs."""
    setup = setup_filter(flight, logs, filter_config("tight17", settings))
    rows = setup.rows(logs.gnss, setup.navigation)
    out, _ = run_filter(setup, logs.imu, rows, "gnss")
    nav = out.nav[: out.counts[0].nav]
    by_time = {int(r.t_ns): r for r in results}
    written = [r for r in results if r.out.counts[0].nav == 1]
    assert len(written) == len(nav) > 60
    for row in nav:
        assert by_time[int(row["t_ns"])].out.nav[0].tobytes() == row.tobytes()
    for epoch, t_ns in enumerate(rows.epoch_ns):
        if int(t_ns) not in by_time:
            continue
        entries = out.ledger[rows.first[epoch] : rows.first[epoch + 1]]
        assert by_time[int(t_ns)].out.ledger.tobytes() == entries.tobytes()


def test_stream_in_order_gives_the_bits_of_replay(part: tuple[Flight, FlightLogs]) -> None:
    flight, logs = part
    engine = FilterEngine(setup_filter(flight, logs, filter_config("tight17")))
    stream(engine, logs, no_delay())
    assert_same_bits(engine.take_results(all_of_them=True), logs, flight)
    kinds = {event.kind for event in engine.events}
    assert {"start", "heading_known"} <= kinds


def test_snapshot_before_the_start_shares_the_setup_and_nothing_that_changes(
    part: tuple[Flight, FlightLogs],
) -> None:
    flight, logs = part
    setup = setup_filter(flight, logs, filter_config("tight17"))
    navigator = Navigator(setup)
    rows = setup.rows(logs.gnss, setup.navigation)
    out = new_output(rows, len(rows.epoch_ns), 64, np.zeros(0, np.int64), setup.layout.n_values)
    samples = ImuSamples(logs.imu.t_ns, logs.imu.w_ib_b, logs.imu.f_b)
    empty = navigator.snapshot()
    navigator.run(samples, rows, 0, 1, out)  # the first epoch has no window of samples before it: a fix alone
    saved = navigator.snapshot()
    assert saved[1].setup is setup and saved[1] is not navigator.starter
    assert navigator.bank is None and len(navigator.starter.fixes) == len(saved[1].fixes) == 1
    navigator.run(samples, rows, 1, 2, out)
    assert len(saved[1].fixes) == 1
    navigator.restore(empty)
    assert navigator.starter.fixes == [] and navigator.starter.first_try_ns is None


def test_epochs_late_within_the_latency_give_the_bits_of_replay(
    part: tuple[Flight, FlightLogs], rng: np.random.Generator
) -> None:
    flight, logs = part
    engine = FilterEngine(setup_filter(flight, logs, filter_config("tight17")))
    delays = iter(rng.integers(0, 990_000_000, 10_000).tolist())
    stream(engine, logs, delays)
    results = engine.take_results(all_of_them=True)
    assert all(TOO_LATE not in r.out.ledger["status"] for r in results)
    last = max(r.t_ns for r in results)
    kept = logs.gnss.t_ns <= last
    cut = FlightLogs(logs.imu, logs.gnss.take(np.flatnonzero(kept)), logs.navigation, None, [], {})
    assert_same_bits(results, cut, flight)


def test_epoch_later_than_the_latency_is_refused_with_an_event(part: tuple[Flight, FlightLogs]) -> None:
    flight, logs = part
    engine = FilterEngine(setup_filter(flight, logs, filter_config("tight17")))
    delays = iter([1_500_000_000 if i == 100 else 0 for i in range(1000)])
    stream(engine, logs, delays)
    refused = [r for r in engine.take_results(all_of_them=True) if (r.out.ledger["status"] == TOO_LATE).any()]
    assert len(refused) == 1
    assert NAMES[TOO_LATE] in {event.kind for event in engine.events}


def test_state_between_epochs_is_the_replay_at_the_imu_rate(part: tuple[Flight, FlightLogs]) -> None:
    flight, logs = part
    setup = setup_filter(flight, logs, filter_config("tight17"))
    out, _ = run_filter(setup, logs.imu, setup.rows(logs.gnss, setup.navigation), "imu")
    rows = out.nav[: out.counts[0].nav]
    shares = np.column_stack(list(slow_sigmas(rows).values()))
    further = (
        out.optional[: len(rows)].reshape(len(rows), 2, -1).swapaxes(1, 2)
    )  # each value before its sigma
    told = np.column_stack([total_values(rows), shares, further.reshape(len(rows), -1)])
    nav = dict(zip(rows["t_ns"].tolist(), told, strict=True))
    engine = FilterEngine(setup)
    tables = {int(e.t_ns[0]): e for e in epochs(logs.gnss)}
    compared = 0
    for t_ns, w, f in zip(logs.imu.t_ns, logs.imu.w_ib_b, logs.imu.f_b, strict=True):
        engine.imu(int(t_ns), w, f)
        if int(t_ns) in tables:
            engine.gnss(tables[int(t_ns)])
        elif int(t_ns) in nav and int(t_ns) % 370_000_000 == 0:
            state = engine.state
            assert state.started
            wanted = nav[int(t_ns)]
            same = np.array(list(state.values.values()))
            assert np.array_equal(same, wanted), (t_ns, same - wanted)
            compared += 1
    assert compared > 20


def test_sample_behind_the_newest_or_not_finite_is_refused_with_an_event(
    part: tuple[Flight, FlightLogs],
) -> None:
    flight, logs = part
    engine = FilterEngine(setup_filter(flight, logs, filter_config("tight17")))
    t = int(logs.imu.t_ns[0])
    still = np.array([0.0, 0.0, -9.8])
    engine.imu(t, np.zeros(3), still)
    engine.imu(t, np.zeros(3), still)
    engine.imu(t - 5_000_000, np.zeros(3), still)
    engine.imu(t + 5_000_000, np.array([np.nan, 0.0, 0.0]), still)
    assert [event.kind for event in engine.events] == ["imu_refused", "imu_refused", "imu_bad_sample"]
    assert not engine.state.started


def test_settings_from_the_flight_file_alone_are_those_of_the_replay(part: tuple[Flight, FlightLogs]) -> None:
    flight, logs = part
    wanted = setup_filter(flight, logs, filter_config("tight17"))
    found = engine_settings(SAMPLE, signals={("G", "C1C")})
    assert found.clock_groups == wanted.clock_groups == ("G",)
    assert found.lever_arm_m == wanted.lever_arm_m != (0.0, 0.0, 0.0)
    assert found.navigation is not None and wanted.navigation is not None
    assert np.array_equal(found.navigation.ephemerides.toe_ns, wanted.navigation.ephemerides.toe_ns)
    assert found.parameters().tobytes() == wanted.parameters().tobytes()


# ------------------------------------------------------------------------------------------------ carrier differences

CARRIER_NOISE = NoiseTerms(floor=0.0015, elevation=0.0007, cn0=0.0015)


@pytest.fixture(scope="module")
def with_carriers() -> tuple[Flight, FlightLogs]:
    """Ninety seconds in the air on two frequencies, with slips, a clock step, a half cycle and a carrier alone."""
    base = turns(90.0)
    receiver = dataclasses.replace(
        base.scenario.receiver, signals=("C1C", "C5Q"), carrier_noise=CARRIER_NOISE
    )
    faults = (
        cycle_slip(["G04"], 1.0, 40.0, signal="C5Q"),
        cycle_slip(["G20"], 100.0, 45.0, indicated=True),
        half_cycle(["G30"], 50.0, 55.0),
        outage(["G13"], 58.0, 60.0),
        carrier_alone(["G16"], 62.0, 65.0),
    )
    clock = dataclasses.replace(base.scenario.clock, jumps=((70.0, MILLISECOND_M),))
    faulty = with_faults(base, faults, clock)
    faulty.scenario = dataclasses.replace(faulty.scenario, receiver=receiver)
    flown = flight(faulty)
    return flown, flown.logs


def without_epochs(logs: FlightLogs, times_ns: list[int]) -> FlightLogs:
    """Return the logs as if these epochs had never been."""
    kept = np.flatnonzero(~np.isin(logs.gnss.t_ns, times_ns))
    return dataclasses.replace(logs, gnss=logs.gnss.take(kept))


def assert_same_carriers(results: list[EpochResult], logs: FlightLogs, flown: Flight) -> None:
    """Hold navigation rows, ledger and carrier ledger of a stream against the replay, bit for bit."""
    assert_same_bits(results, logs, flown)
    setup = setup_filter(flown, logs, filter_config("tight17"))
    rows = setup.rows(logs.gnss, setup.navigation)
    out, _ = run_filter(setup, logs.imu, rows, "gnss")
    by_time = {r.t_ns: r for r in results}
    used = 0
    for epoch, t_ns in enumerate(rows.epoch_ns):
        wanted = out.carrier[rows.first[epoch] : rows.first[epoch + 1]]
        found = by_time[int(t_ns)].out.carrier
        for name in wanted.dtype.names:
            assert found[name].tobytes() == wanted[name].tobytes(), (epoch, name)
        used += np.count_nonzero(wanted["status"] == USED)
    assert used > 1000


def test_stream_with_carriers_gives_the_bits_of_replay(with_carriers: tuple[Flight, FlightLogs]) -> None:
    flown, logs = with_carriers
    engine = FilterEngine(setup_filter(flown, logs, filter_config("tight17")))
    stream(engine, logs, no_delay())
    results = engine.take_results(all_of_them=True)
    assert_same_carriers(results, logs, flown)
    seen = {int(s) for r in results for s in r.out.carrier["status"]}
    assert {USED, SLIP_INDICATED, SLIP_GEOMETRY_FREE, HALF_CYCLE, NO_EPOCH_BEFORE, CLOCK_STEPPED} <= seen


def test_carriers_of_late_epochs_give_the_bits_of_replay(
    with_carriers: tuple[Flight, FlightLogs], rng: np.random.Generator
) -> None:
    """The epoch that a difference counts from may itself arrive after the one that needs it, or be settled long ago."""
    flown, logs = with_carriers
    setup = setup_filter(flown, logs, filter_config("tight17"))
    longer = setup.config.model_copy(update={"latency_s": 3.5})
    engine = FilterEngine(dataclasses.replace(setup, config=longer))
    stream(engine, logs, iter(rng.integers(0, 3_490_000_000, 1000).tolist()))
    results = engine.take_results(all_of_them=True)
    # still on their way at the end
    missing = sorted(set(logs.gnss.t_ns.tolist()) - {r.t_ns for r in results})
    assert_same_carriers(results, without_epochs(logs, missing), flown)


def test_epoch_refused_as_too_late_is_none_to_count_from(with_carriers: tuple[Flight, FlightLogs]) -> None:
    """What the stream says afterwards is what a replay says of a log without that epoch."""
    flown, logs = with_carriers
    engine = FilterEngine(setup_filter(flown, logs, filter_config("tight17")))
    stream(engine, logs, iter([2_600_000_000 if i in (30, 50, 51) else 0 for i in range(1000)]))
    results = engine.take_results(all_of_them=True)
    refused = [r for r in results if (r.out.ledger["status"] == TOO_LATE).any()]
    assert len(refused) == 3 and all((r.out.carrier["status"] == TOO_LATE).any() for r in refused)
    times = [r.t_ns for r in refused]
    taken = [r for r in results if r.t_ns not in times]
    assert_same_carriers(taken, without_epochs(logs, times), flown)
