"""What goes wrong with inertial samples in the streaming engine: the bits of the replay, and wild tags refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from insgnss.filter.engine import FilterEngine
from insgnss.log.flight import Flight, FlightLogs
from insgnss.tables import ImuTable
from tests.filter.test_engine_arrivals import LATENCY_S, assert_replayed, epochs, feed, late, with_latency
from tests.runs.scenes import START_NS, flight, turns, without_samples

BASE = turns(60.0, imu_rate_hz=50.0)


@pytest.fixture(scope="module")
def flown() -> Flight:
    """A minute in the air."""
    return flight(BASE)


@pytest.fixture(scope="module")
def logs(flown: Flight) -> FlightLogs:
    """The logs of the flight."""
    return flown.read()


def changed(imu: ImuTable, sensor: str, from_s: float, to_s: float, value: float | None) -> ImuTable:
    """Return the log with a sensor at a value, or at its own first one."""
    values = getattr(imu, sensor).copy()
    a, b = np.searchsorted(imu.t_ns, START_NS + np.array([from_s, to_s]) * 1e9)
    values[a:b] = values[a] if value is None else value
    return dataclasses.replace(imu, **{sensor: values})


SAMPLES = {
    "missing_for_one_second": lambda imu: without_samples(imu, 30.2, 31.2),
    "missing_for_six_seconds": lambda imu: without_samples(imu, 30.2, 36.2),
    "missing_twice_and_one_alone": lambda imu: without_samples(without_samples(imu, 30.0, 36.0), 36.0, 42.5),
    "missing_twice_with_no_start_between": lambda imu: without_samples(
        without_samples(imu, 30.2, 34.2), 34.8, 40.2
    ),
    "impossible": lambda imu: changed(changed(imu, "w_ib_b", 30.0, 30.4, np.nan), "f_b", 41.0, 41.01, 1e9),
    "spikes": lambda imu: changed(imu, "f_b", 30.0, 30.01, 300.0),
    "of_gyros_that_are_out": lambda imu: changed(imu, "w_ib_b", 30.0, 45.0, None),
    "of_accelerometers_that_are_out": lambda imu: changed(imu, "f_b", 30.0, 45.0, 0.0),
}


@pytest.mark.parametrize("delayed", [False, True], ids=["in_order", "late"])
@pytest.mark.parametrize("samples", SAMPLES)
def test_engine_gives_the_bits_of_replay_with_samples(
    samples: str, delayed: bool, flown: Flight, logs: FlightLogs, rng: np.random.Generator
) -> None:
    spoilt = dataclasses.replace(logs, imu=SAMPLES[samples](logs.imu))
    engine = FilterEngine(with_latency(flown, spoilt))
    feed(
        engine,
        spoilt.imu,
        [(int(e.t_ns[0]) + (late(rng) if delayed else 0), e) for e in epochs(logs.gnss)],
    )
    assert_replayed(engine.take_results(all_of_them=True), flown, spoilt)
    assert {e.kind for e in engine.events} & {"imu_gap", "imu_bad_sample", "imu_spike", "imu_sensor_out"}


@pytest.mark.parametrize("wild_s", [30.0 + 1e6, 40.0, -1e6, 10.0])
def test_wild_tag_is_refused_told_once_and_changes_no_bit(
    wild_s: float, flown: Flight, logs: FlightLogs
) -> None:
    engine = FilterEngine(with_latency(flown, logs))
    cut_ns = START_NS + 30 * 10**9 + 5_000_000
    due = [(int(e.t_ns[0]), e) for e in epochs(logs.gnss)]
    at = int(np.searchsorted(logs.imu.t_ns, cut_ns))
    first = ImuTable(logs.imu.t_ns[:at], logs.imu.w_ib_b[:at], logs.imu.f_b[:at])
    rest = ImuTable(logs.imu.t_ns[at:], logs.imu.w_ib_b[at:], logs.imu.f_b[at:])
    feed(engine, first, [arrival for arrival in due if arrival[0] < cut_ns])
    engine.imu(START_NS + int(wild_s * 1e9), np.zeros(3), np.zeros(3))
    feed(engine, rest, [arrival for arrival in due if arrival[0] > cut_ns])
    assert_replayed(engine.take_results(all_of_them=True), flown, logs)
    assert [e.kind for e in engine.events].count("imu_refused") == 1


def test_stream_that_was_set_ahead_for_some_samples_is_taken_up_again(
    flown: Flight, logs: FlightLogs
) -> None:
    engine = FilterEngine(with_latency(flown, logs))
    at = int(np.searchsorted(logs.imu.t_ns, START_NS + 30 * 10**9))
    t_ns = logs.imu.t_ns.copy()
    t_ns[at : at + 5] += 10**15
    due = [(int(e.t_ns[0]), e) for e in epochs(logs.gnss)]
    for k in range(len(t_ns)):
        while due and due[0][0] < logs.imu.t_ns[k]:
            engine.gnss(due.pop(0)[1])
        engine.imu(int(t_ns[k]), logs.imu.w_ib_b[k], logs.imu.f_b[k])
    assert engine.state.started
    assert engine.state.t_ns == logs.imu.t_ns[-1]
    told = [e.kind for e in engine.events]
    assert told.count("restart") == 1 and told.count("imu_refused") == 1
    assert LATENCY_S > 1.0
