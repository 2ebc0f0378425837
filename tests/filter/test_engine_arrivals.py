"""What reaches the streaming engine in an odd way: packets repeated or in parts, epochs outside the samples."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from insgnss.config.library import filter_config
from insgnss.filter.engine import FilterEngine
from insgnss.filter.engine_results import EpochResult
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import run_filter
from insgnss.log.flight import Flight, FlightLogs
from insgnss.runs.setup import setup_filter
from insgnss.simulation.observations import NoiseTerms
from insgnss.status import DUPLICATE, NO_IMU, TOO_LATE, USED
from insgnss.tables import GnssTable, ImuTable
from tests.runs.scenes import START_NS, flight, true_start, turns, with_faults, without_samples

CARRIER_NOISE = NoiseTerms(floor=0.0015, elevation=0.0007, cn0=0.0015)
DURATION_S = 40.0
LATENCY_S = 2.5  # two epochs and a half may stand behind a late one
BASE = turns(DURATION_S, imu_rate_hz=50.0)
Arrivals = list[tuple[int, GnssTable]]  # when, and what


@pytest.fixture(scope="module")
def flown() -> Flight:
    """Forty seconds in the air, carriers on two frequencies: a start in motion looks back on earlier fixes."""
    receiver = dataclasses.replace(
        BASE.scenario.receiver, signals=("C1C", "C5Q"), carrier_noise=CARRIER_NOISE
    )
    scene = with_faults(BASE)
    scene.scenario = dataclasses.replace(scene.scenario, receiver=receiver)
    return flight(scene)


@pytest.fixture(scope="module")
def logs(flown: Flight) -> FlightLogs:
    """The logs of the flight."""
    return flown.read()


def with_latency(flown: Flight, logs: FlightLogs) -> FilterSetup:
    """Return the filter's setup with the longer latency."""
    setup = setup_filter(flown, logs, filter_config("tight17"))
    return dataclasses.replace(setup, config=setup.config.model_copy(update={"latency_s": LATENCY_S}))


def epochs(gnss: GnssTable) -> list[GnssTable]:
    """Return the table epoch by epoch."""
    return [gnss.take(np.flatnonzero(gnss.t_ns == t)) for t in np.unique(gnss.t_ns)]


def parts_of(epoch: GnssTable) -> tuple[GnssTable, GnssTable]:
    """Return the rows of an epoch in two packets, every other row in each."""
    return epoch.take(slice(0, None, 2)), epoch.take(slice(1, None, 2))


def late(rng: np.random.Generator, longest_s: float = LATENCY_S - 0.02) -> int:
    """Return a random delay [ns]."""
    return int(rng.integers(0, int(longest_s * 1e9)))


def feed(engine: FilterEngine, imu: ImuTable, arrivals: Arrivals) -> None:
    """Feed samples and packets in the order in which they arrive."""
    due = sorted(arrivals, key=lambda arrival: arrival[0])
    for t_ns, w, f in zip(imu.t_ns, imu.w_ib_b, imu.f_b, strict=True):
        while due and due[0][0] < t_ns:
            engine.gnss(due.pop(0)[1])
        engine.imu(int(t_ns), w, f)
    for _, packet in due:
        engine.gnss(packet)


def assert_replayed(results: list[EpochResult], flown: Flight, logs: FlightLogs) -> None:
    """Hold each epoch of a log, given out once, against the replay: navigation, ledger and carriers to the bit."""
    setup = with_latency(flown, logs)
    rows = setup.rows(logs.gnss, setup.navigation)
    out, _ = run_filter(setup, logs.imu, rows, "gnss")
    assert [r.t_ns for r in results] == rows.epoch_ns.tolist()
    nav = out.nav[: out.counts[0].nav]
    written = [r for r in results if r.out.counts[0].nav == 1]
    assert [r.t_ns for r in written] == nav["t_ns"].tolist() and len(nav) > 5
    assert all(r.out.nav[0].tobytes() == row.tobytes() for r, row in zip(written, nav, strict=True))
    for epoch, result in enumerate(results):
        part = slice(int(rows.first[epoch]), int(rows.first[epoch + 1]))
        assert result.out.ledger.tobytes() == out.ledger[part].tobytes(), epoch
        for name in ("innovation", "variance", "predicted", "status"):
            assert result.out.carrier[name].tobytes() == out.carrier[part][name].tobytes(), (epoch, name)


def counted(results: list[EpochResult], status: int) -> int:
    """Return how many pseudoranges ended with a status."""
    return sum(int(np.count_nonzero(r.out.ledger["status"][:, 0] == status)) for r in results)


# ------------------------------------------------------------------------------------------- one time tag, two packets


def test_repeated_packet_is_a_duplicate_of_its_epoch(
    flown: Flight, logs: FlightLogs, rng: np.random.Generator
) -> None:
    index = [np.flatnonzero(logs.gnss.t_ns == t_ns) for t_ns in np.unique(logs.gnss.t_ns)]
    twice = logs.gnss.take(np.concatenate([part for rows in index for part in (rows, rows)]))
    engine = FilterEngine(with_latency(flown, logs))
    feed(engine, logs.imu, [(int(e.t_ns[0]) + late(rng), e) for e in epochs(logs.gnss) for _ in range(2)])
    results = engine.take_results(all_of_them=True)
    assert_replayed(results, flown, dataclasses.replace(logs, gnss=twice))
    assert counted(results, DUPLICATE) >= len(logs.gnss.t_ns) // 2
    assert {event.kind for event in engine.events} <= {"start", "heading_single", "heading_known"}


def test_epoch_in_two_packets_is_one_epoch(flown: Flight, logs: FlightLogs, rng: np.random.Generator) -> None:
    """Rows stand in the order of their arrival, as they would in a log of it."""
    arrivals: Arrivals = []
    for epoch in epochs(logs.gnss):
        delays = sorted((late(rng), late(rng)))
        arrivals += [(int(epoch.t_ns[0]) + d, p) for d, p in zip(delays, parts_of(epoch), strict=True)]
    engine = FilterEngine(with_latency(flown, logs))
    feed(engine, logs.imu, arrivals)
    results = engine.take_results(all_of_them=True)
    index = [np.flatnonzero(logs.gnss.t_ns == t_ns) for t_ns in np.unique(logs.gnss.t_ns)]
    arrived = np.concatenate([part for rows in index for part in (rows[::2], rows[1::2])])
    assert_replayed(results, flown, dataclasses.replace(logs, gnss=logs.gnss.take(arrived)))
    assert counted(results, USED) > 300


def test_second_packet_after_the_latency_is_refused(flown: Flight, logs: FlightLogs) -> None:
    """The filter has what came in time, and says what a replay says of that alone."""
    tables = epochs(logs.gnss)
    first, second = parts_of(tables[20])
    arrivals = [(int(e.t_ns[0]), e) for e in [*tables[:20], first, *tables[21:]]]
    engine = FilterEngine(with_latency(flown, logs))
    feed(engine, logs.imu, [*arrivals, (int(second.t_ns[0]) + int((LATENCY_S + 0.5) * 1e9), second)])
    results = engine.take_results(all_of_them=True)
    refused = [r for r in results if counted([r], TOO_LATE)]
    assert [r.t_ns for r in refused] == [int(second.t_ns[0])]
    assert len(refused[0].gnss.t_ns) == len(second.t_ns)
    assert [event.t_ns for event in engine.events if event.kind == "too_late"] == [int(second.t_ns[0])]
    rows = np.flatnonzero(logs.gnss.t_ns == second.t_ns[0])
    kept = np.setdiff1d(np.arange(len(logs.gnss.t_ns)), rows[1::2])
    taken = [r for r in results if r is not refused[0]]
    assert_replayed(taken, flown, dataclasses.replace(logs, gnss=logs.gnss.take(kept)))


# ------------------------------------------------------------------------------------- epochs without inertial samples


def imu_between(imu: ImuTable, from_s: float, to_s: float) -> ImuTable:
    """Return the samples of a time [s]."""
    t = (imu.t_ns - START_NS) / 1e9
    kept = (t >= from_s) & (t <= to_s)
    return ImuTable(imu.t_ns[kept], imu.w_ib_b[kept], imu.f_b[kept])


def with_a_sample_alone(imu: ImuTable) -> ImuTable:
    """Return the samples with one left, at an epoch, between two gaps that are too long to bridge."""
    return without_samples(without_samples(imu, 12.5, 18.0), 18.0, 23.5)


SAMPLES = {
    "begin_after_the_epochs": lambda imu: imu_between(imu, 8.5, DURATION_S),
    "end_before_the_epochs": lambda imu: imu_between(imu, 0.0, 31.5),
    "are_missing_in_between": lambda imu: without_samples(imu, 15.3, 22.5),
    "are_missing_up_to_an_epoch": lambda imu: without_samples(imu, 15.0, 22.0),
    "are_a_single_one_between_gaps": with_a_sample_alone,
}


@pytest.mark.parametrize("delayed", [False, True], ids=["in_order", "late"])
@pytest.mark.parametrize("samples", SAMPLES)
def test_epochs_are_passed_over_where_samples(
    samples: str, delayed: bool, flown: Flight, logs: FlightLogs, rng: np.random.Generator
) -> None:
    """They never reach the starter: a start in motion would look back on their fixes."""
    cut = dataclasses.replace(logs, imu=SAMPLES[samples](logs.imu))
    engine = FilterEngine(with_latency(flown, cut))
    feed(
        engine,
        cut.imu,
        [(int(e.t_ns[0]) + (late(rng) if delayed else 0), e) for e in epochs(cut.gnss)],
    )
    early = engine.take_results()
    results = early + engine.take_results(all_of_them=True)
    assert_replayed(results, flown, cut)
    assert counted(results, NO_IMU) >= 6 * 8
    assert not engine.take_results(all_of_them=True)


def test_given_state_without_a_start_before_the_gap_is_tried_again_after_it(logs: FlightLogs) -> None:
    """It is of another place, and the gap comes between its refusal and the automatic start."""
    elsewhere = true_start(BASE, 2.0).model_copy(update={"time_s": None, "lat_deg": -35.0, "lon_deg": -60.0})
    flown = flight(BASE, start=elsewhere)
    cut = dataclasses.replace(logs, imu=without_samples(logs.imu, 1.3, 7.0))
    engine = FilterEngine(with_latency(flown, cut))
    feed(engine, cut.imu, [(int(e.t_ns[0]), e) for e in epochs(cut.gnss)])
    assert_replayed(engine.take_results(all_of_them=True), flown, cut)
    assert [event.kind for event in engine.events][:4] == [
        "start_refused",
        "imu_gap",
        "start_refused",
        "start",
    ]


def test_epoch_waits_for_samples_until_a_gap_is_certain(flown: Flight, logs: FlightLogs) -> None:
    """A gap that may still be bridged makes no epoch lost."""
    engine = FilterEngine(with_latency(flown, logs))
    before = imu_between(logs.imu, 0.0, 15.3)
    tables = epochs(logs.gnss)
    ahead = next(e for e in tables if int(e.t_ns[0]) > int(before.t_ns[-1]))
    feed(engine, before, [(int(e.t_ns[0]), e) for e in tables if int(e.t_ns[0]) <= int(before.t_ns[-1])])
    engine.gnss(ahead)
    started = engine.state
    assert int(ahead.t_ns[0]) not in {r.t_ns for r in engine.take_results()}
    last = engine.take_results(all_of_them=True)[-1]
    assert last.t_ns == int(ahead.t_ns[0]) and counted([last], NO_IMU) > 0
    assert engine.state == started and started.started


def test_all_results_taken_on_the_way_change_no_bit_of_the_rest(flown: Flight, logs: FlightLogs) -> None:
    """What was given out as final stays so: its tag is refused from then on."""
    engine = FilterEngine(with_latency(flown, logs))
    cut_s = 20.035
    cut_ns = START_NS + int(cut_s * 1e9)
    arrivals = [(int(e.t_ns[0]), e) for e in epochs(logs.gnss)]
    feed(engine, imu_between(logs.imu, 0.0, cut_s), [a for a in arrivals if a[0] < cut_ns])
    results = engine.take_results(all_of_them=True)
    engine.gnss(results[-1].gnss)
    (again,) = engine.take_results()
    assert again.t_ns == results[-1].t_ns and counted([again], TOO_LATE) > 0
    feed(engine, imu_between(logs.imu, cut_s, DURATION_S), [a for a in arrivals if a[0] > cut_ns])
    assert_replayed(results + engine.take_results(all_of_them=True), flown, logs)


# ------------------------------------------------------------------------------------------------ without a satellite


def test_entries_without_a_satellite_have_no_direction(flown: Flight, logs: FlightLogs) -> None:
    """What stands in the ledger is of its own epoch: nothing where no ephemeris says where the satellite is."""
    hidden = logs.gnss.sv_names.index("G20")
    names = tuple("G09" if i == hidden else name for i, name in enumerate(logs.gnss.sv_names))
    # it stands first in every other epoch, so that its line of the work space has been another satellite's
    rows = []
    for k, t_ns in enumerate(np.unique(logs.gnss.t_ns)):
        epoch = np.flatnonzero(logs.gnss.t_ns == t_ns)
        own = logs.gnss.sv[epoch] == hidden
        rows.append(np.concatenate([epoch[own], epoch[~own]]) if k % 2 else epoch)
    gnss = dataclasses.replace(logs.gnss.take(np.concatenate(rows)), sv_names=names)
    unknown = dataclasses.replace(logs, gnss=gnss)
    engine = FilterEngine(with_latency(flown, unknown))
    feed(engine, unknown.imu, [(int(e.t_ns[0]), e) for e in epochs(gnss)])
    results = engine.take_results(all_of_them=True)
    assert_replayed(results, flown, unknown)
    entries = np.concatenate([r.out.ledger[r.gnss.sv == hidden] for r in results])
    assert len(entries) > 60
    assert np.isnan(entries["u_n"]).all() and np.isnan(entries["u_b"]).all()
