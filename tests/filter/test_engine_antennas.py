"""Several antennas in the streaming engine against replay: the same bits, however the antennas' epochs arrive."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from insgnss.aiding.sources import aiding_sources
from insgnss.aiding.trace import TraceSamples, traced
from insgnss.config.aiding import AidingConfig
from insgnss.config.library import filter_config
from insgnss.errors import ConfigError, InputError
from insgnss.filter.antennas.phase_log import PhaseLog
from insgnss.filter.engine_results import EpochResult
from insgnss.filter.output.writing import Output
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import TraceIntervals, run_filter
from insgnss.log.flight import Flight, FlightLogs
from insgnss.runs.antennas_on_demand import with_antennas
from insgnss.runs.engine import Engine
from insgnss.runs.setup import engine_settings, setup_filter
from insgnss.status import NO_DIFFERENCE, NOT_STARTED, TOO_LATE, USED
from insgnss.tables import Event, GnssTable
from tests.aiding.arriving import Collected
from tests.attitude.several_flights import SLALOM, scenario_text, write_flight

LATENCY_S = 2.5  # two epochs and a half may stand behind a late one
MAIN_FIRST, MAIN_LAST = 1, -1  # ns by which the main epoch's packet comes before those of the others
Arrivals = list[tuple[int, GnssTable, str | None]]  # when, what, and of which antenna


class Flown(NamedTuple):
    """A flight with its logs."""

    flight: Flight
    logs: FlightLogs
    imu_time_sigma_s: float = 0.0

    @property
    def settings(self) -> dict[str, float]:
        """The longer latency, and what is known of the tags."""
        return {"latency_s": LATENCY_S, "process.imu_time_sigma_s": self.imu_time_sigma_s}

    def setup(self) -> FilterSetup:
        """Return the filter's setup."""
        return setup_filter(self.flight, self.logs, filter_config("tight", self.settings))

    def replayed(self, trace: TraceIntervals | None = None) -> tuple[Output, PhaseLog, list[Event]]:
        """Return what a replay writes: the loop's output, the phases with their ledger, and the events."""
        setup = self.setup()
        rows = setup.rows(self.logs.gnss, setup.navigation)
        setup, _, _ = with_antennas(setup, self.logs, self.flight, rows)
        out, events = run_filter(setup, self.logs.imu, rows, "gnss", trace=trace)
        assert setup.aid is not None
        assert setup.aid.log is not None
        return out, setup.aid.log, events


def flown(folder: Path, text: str, seed: int = 1) -> Flown:
    """Return a drawn flight."""
    # a stream takes a step for each sample
    text = text.replace("[imu]\n", "[imu]\nrate_hz = 25.0\n")
    flight = Flight.load(write_flight(folder, text, seed=seed))
    return Flown(flight, flight.read())


@pytest.fixture(scope="module")
def at_rest(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Half a minute at rest with a triangle of 1 m: the antennas alone find the heading."""
    return flown(tmp_path_factory.mktemp("rest"), scenario_text())


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """A minute of turns, two carriers, receivers with clocks of their own, slips that are told and that are not."""
    slips = '[gnss]\nsignals = ["C1C", "C5Q"]\nslips_per_hour = 30.0\n'
    text = scenario_text(clocks="separate", clock_bias_m=250_000.0, manoeuvres=SLALOM, speed_mps=60.0)
    return flown(tmp_path_factory.mktemp("moving"), text.replace("[gnss]\n", slips), seed=5)


def epochs(gnss: GnssTable) -> list[GnssTable]:
    """Return the table epoch by epoch."""
    return [gnss.take(np.flatnonzero(gnss.t_ns == t)) for t in np.unique(gnss.t_ns)]


def named(of: Flown) -> list[tuple[str | None, GnssTable]]:
    """Return each antenna's observations with its name in the flight file, None for the main one."""
    assert of.flight.config.attitude is not None
    names = [antenna.name for antenna in of.flight.config.attitude.antenna]
    return [(None, of.logs.gnss), *zip(names, of.logs.further, strict=True)]


def arrivals(of: Flown, main_first: int, rng: np.random.Generator | None = None) -> Arrivals:
    """Return every antenna's epochs at their time tags; with ``rng`` each late by a time of its own."""
    found: Arrivals = []
    for name, table in named(of):
        for epoch in epochs(table):
            late = 0 if rng is None else int(rng.integers(0, int((LATENCY_S - 0.02) * 1e9)))
            found.append((int(epoch.t_ns[0]) + late - (main_first if name is None else 0), epoch, name))
    return found


def stream(of: Flown, packets: Arrivals, *, engine: Engine | None = None) -> tuple[Engine, list[EpochResult]]:
    """Feed samples and packets in the order in which they arrive; return the engine and all results."""
    engine = Engine(of.setup()) if engine is None else engine
    due, results = sorted(packets, key=lambda packet: packet[0]), []
    for t_ns, w, f in zip(of.logs.imu.t_ns, of.logs.imu.w_ib_b, of.logs.imu.f_b, strict=True):
        while due and due[0][0] < t_ns:
            engine.gnss(*due.pop(0)[1:])
        engine.imu(int(t_ns), w, f)
        results += engine.take_results()
    for _, epoch, antenna in due:
        engine.gnss(epoch, antenna)
    return engine, results + engine.take_results(all_of_them=True)


def assert_replayed(of: Flown, engine: Engine, results: list[EpochResult], *, at_least: int = 20) -> None:
    """Hold the stream against the replay to the bit: navigation rows, events, and every antenna's ledger."""
    out, log, events = of.replayed()
    nav = out.nav[: out.counts[0].nav]
    mains = sorted((r for r in results if len(r.gnss.t_ns)), key=lambda r: r.t_ns)
    written = [r for r in mains if r.out.counts[0].nav == 1]
    assert [r.t_ns for r in written] == nav["t_ns"].tolist()
    assert len(nav) > at_least
    assert all(r.out.nav[0].tobytes() == row.tobytes() for r, row in zip(written, nav, strict=True))
    assert [r.t_ns for r in mains] == log.phases.epoch_ns.tolist()
    for epoch, result in enumerate(mains):
        assert differences(result.differences, 0) == differences(log, epoch), epoch
    alone = sorted(line for r in results if not len(r.gnss.t_ns) for line in differences(r.differences, 0))
    assert alone == sorted(differences(log, len(log.phases.epoch_ns)))
    told = [
        event for event in engine.events if event.kind != "installation_known"
    ]  # a replay's are of its nav
    assert told == sorted(events, key=lambda e: -1 if e.t_ns is None else e.t_ns)


def differences(log: PhaseLog | None, epoch: int) -> list[tuple[object, ...]]:
    """Return what became of every phase of an epoch, antenna by antenna; behind the last epoch those of none."""
    assert log is not None
    phases, ledger = log.phases, log.ledger
    last = phases.first[epoch + 1] if epoch + 1 < len(phases.first) else len(phases.t_ns)
    return [
        (
            *(int(phases.antenna[i]), phases.names[phases.channel[i]], int(phases.t_ns[i])),
            *(phases.phase_m[i].tobytes(), phases.sat[i].tobytes(), int(ledger.status[i])),
            *(ledger.innovation[i].tobytes(), ledger.variance[i].tobytes()),
        )
        for i in range(phases.first[epoch], last)
    ]


def counted(results: list[EpochResult], status: int) -> int:
    """Return how many phases of further antennas ended with a status."""
    found = [r.differences for r in results if r.differences is not None]
    return sum(int(np.count_nonzero(d.ledger.status[d.phases.antenna > 0] == status)) for d in found)


@pytest.mark.parametrize("main_first", [MAIN_FIRST, MAIN_LAST])
def test_epochs_of_all_antennas_in_time_give_the_bits_of_a_replay(at_rest: Flown, main_first: int) -> None:
    engine, results = stream(at_rest, arrivals(at_rest, main_first))

    assert_replayed(at_rest, engine, results)
    assert counted(results, USED) > 500
    assert [event.kind for event in engine.events].count("attitude_found") == 1


def test_late_epochs_of_any_antenna_give_the_bits_of_a_replay(
    at_rest: Flown, rng: np.random.Generator
) -> None:
    """Whole cycles, held candidates, and the pause of the search are as they were before the epoch."""
    engine, results = stream(at_rest, arrivals(at_rest, 0, rng))

    assert_replayed(at_rest, engine, results)
    assert counted(results, USED) > 500


@pytest.mark.parametrize("imu_time_sigma_s", [0.0, 0.02])
def test_late_epochs_among_slips_and_turns_give_the_bits_of_a_replay(
    moving: Flown, rng: np.random.Generator, imu_time_sigma_s: float
) -> None:
    moving = moving._replace(imu_time_sigma_s=imu_time_sigma_s)
    engine, results = stream(moving, arrivals(moving, 0, rng))

    assert_replayed(moving, engine, results)
    assert counted(results, USED) > 2000
    kinds = [event.kind for event in engine.events]
    assert kinds.count("attitude_slip") > 10
    assert "attitude_cycles_wrong" in kinds


def test_tags_apart_and_epochs_of_no_main_one_are_matched_as_in_a_replay(
    at_rest: Flown, rng: np.random.Generator
) -> None:
    """One antenna tags its epochs 1.5 ms later; the other one logs at 2 Hz."""
    ahead, right = at_rest.logs.further
    between = dataclasses.replace(right, t_ns=right.t_ns + 500_000_000)
    order = np.argsort(np.concatenate([right.t_ns, between.t_ns]), kind="stable")
    twice = {
        field.name: np.concatenate([getattr(right, field.name)] * 2)[order]
        for field in dataclasses.fields(right)
        if isinstance(getattr(right, field.name), np.ndarray) and field.name != "bad_cells"
    }
    twice["t_ns"] = np.sort(np.concatenate([right.t_ns, between.t_ns]))
    tables = (dataclasses.replace(ahead, t_ns=ahead.t_ns + 1_500_000), dataclasses.replace(right, **twice))
    of = Flown(at_rest.flight, dataclasses.replace(at_rest.logs, further=tables))

    engine, results = stream(of, arrivals(of, 0, rng))

    assert_replayed(of, engine, results)
    assert sum(not len(r.gnss.t_ns) for r in results) == len(np.unique(right.t_ns))
    assert counted(results, NO_DIFFERENCE) >= len(right.t_ns)


def test_a_main_epoch_between_takes_the_rows_that_are_nearer_to_it(
    at_rest: Flown, rng: np.random.Generator
) -> None:
    """Two main epochs 2.4 ms apart, one each second: a further antenna's row belongs to the one that comes later."""
    gnss = at_rest.logs.gnss
    late = (gnss.t_ns - gnss.t_ns[0]) % 2_000_000_000 != 0
    doubled = gnss.take(np.sort(np.concatenate([np.arange(len(late)), np.flatnonzero(late)])))
    index = np.sort(np.concatenate([np.arange(len(late)), np.flatnonzero(late)]), kind="stable")
    again = np.concatenate([[False], index[1:] == index[:-1]])
    tags = np.where(again, doubled.t_ns + 2_400_000, doubled.t_ns)
    main = doubled.take(np.argsort(tags, kind="stable"))
    main = dataclasses.replace(main, t_ns=np.sort(tags))
    tables = tuple(dataclasses.replace(t, t_ns=t.t_ns + 1_500_000) for t in at_rest.logs.further)
    of = Flown(at_rest.flight, dataclasses.replace(at_rest.logs, gnss=main, further=tables))

    engine, results = stream(of, arrivals(of, 0, rng))

    assert_replayed(of, engine, results)


def test_satellites_that_come_later_leave_the_order_of_the_rows(moving: Flown) -> None:
    """The rows of one epoch are whitened in an order that does not depend on what the rest of the log has."""
    tables = []
    for table in (moving.logs.gnss, *moving.logs.further):
        early = table.t_ns - table.t_ns[0] < 15e9
        tables.append(table.take(np.flatnonzero(~(early & (table.sv % 2 == 0)))))
    of = Flown(moving.flight, dataclasses.replace(moving.logs, gnss=tables[0], further=tuple(tables[1:])))

    engine, results = stream(of, arrivals(of, MAIN_LAST))

    assert_replayed(of, engine, results)
    assert counted(results, USED) > 1500


def test_settings_of_a_flight_file_take_the_antennas_and_say_what_they_leave(at_rest: Flown) -> None:
    pairs = {("G", "C1C")}
    setup = engine_settings(at_rest.flight, settings=at_rest.settings, signals=pairs)

    engine, results = stream(at_rest, arrivals(at_rest, MAIN_LAST), engine=Engine(setup))

    assert_replayed(at_rest, engine, results)
    assert engine.state.values["sd_yaw_deg"] < 0.03


def test_without_the_further_antennas_the_heading_at_rest_stays_open(at_rest: Flown) -> None:
    packets = [packet for packet in arrivals(at_rest, 0) if packet[2] is None]

    engine, results = stream(at_rest, packets)

    assert engine.state.values["sd_yaw_deg"] > 20.0
    assert counted(results, USED) == 0


def test_two_antennas_say_which_angle_they_leave(tmp_path: Path) -> None:
    two = flown(tmp_path, scenario_text((("ahead", (1.4, 0.1, -1.3)),)))

    told = [event.detail for event in Engine(two.setup()).events if event.kind == "attitude_collinear"]

    assert len(told) == 1
    assert "(roll)" in told[0]


def test_an_epoch_behind_the_latency_is_refused_with_its_antenna(at_rest: Flown) -> None:
    packets = arrivals(at_rest, MAIN_LAST)
    late = [i for i, packet in enumerate(packets) if packet[2] == "right"][20]
    packets[late] = (packets[late][0] + int(4e9), *packets[late][1:])

    engine, results = stream(at_rest, packets)

    told = [event for event in engine.events if event.kind == "too_late"]
    assert [event.t_ns for event in told] == [int(packets[late][1].t_ns[0])]
    assert "an epoch of antenna 'right' 4.0" in told[0].detail
    refused = [r for r in results if not len(r.gnss.t_ns)]
    assert [r.t_ns for r in refused] == [told[0].t_ns]
    assert counted(refused, TOO_LATE) == len(packets[late][1].t_ns)
    assert counted(results, TOO_LATE) == counted(refused, TOO_LATE)


def test_epochs_outside_the_samples_are_told_as_in_a_replay(at_rest: Flown) -> None:
    imu = at_rest.logs.imu
    part = slice(0, int(0.8 * len(imu.t_ns)))
    shorter = type(imu)(imu.t_ns[part], imu.w_ib_b[part], imu.f_b[part])
    of = Flown(at_rest.flight, dataclasses.replace(at_rest.logs, imu=shorter))

    engine, results = stream(of, arrivals(of, MAIN_LAST))

    assert_replayed(of, engine, results)
    assert counted(results, NOT_STARTED) > 100


def test_a_gap_in_the_samples_begins_anew_as_in_a_replay(at_rest: Flown, rng: np.random.Generator) -> None:
    """Five seconds without samples: the whole cycles are looked for again on the other side."""
    imu = at_rest.logs.imu
    left = np.abs(imu.t_ns - imu.t_ns[0] - 15_000_000_000) > 2_500_000_000
    cut = type(imu)(imu.t_ns[left], imu.w_ib_b[left], imu.f_b[left])
    of = Flown(at_rest.flight, dataclasses.replace(at_rest.logs, imu=cut))

    engine, results = stream(of, arrivals(of, 0, rng))

    assert_replayed(of, engine, results, at_least=15)
    kinds = [event.kind for event in engine.events]
    assert kinds.count("start") == kinds.count("attitude_found") == 2


def test_live_aiding_with_several_antennas_has_the_bits_of_a_replay(at_rest: Flown) -> None:
    config = AidingConfig(rate_hz=20.0, latency_s=0.01, sigma_interval_s=0.4)
    setup, imu = at_rest.setup(), at_rest.logs.imu
    out, _, _ = at_rest.replayed(TraceIntervals(config.rate_hz, config.sigma_interval_s))
    table = aiding_sources(setup, config).table(
        traced(out.trace, TraceSamples(imu.t_ns, imu.w_ib_b, imu.f_b))
    )
    wanted = table.columns(at_rest.flight.config.gps_week, parts=True)
    sink = Collected()

    stream(at_rest, arrivals(at_rest, MAIN_LAST), engine=Engine(setup, aiding=config, on_aiding=sink))

    found = sink.columns()
    assert len(wanted["time_s"]) > 5000
    for name in set(wanted) - {"sv"}:
        np.testing.assert_array_equal(found[name], wanted[name], err_msg=name)


def test_an_unknown_antenna_and_one_without_phases_are_typed_errors(at_rest: Flown) -> None:
    engine, epoch = Engine(at_rest.setup()), epochs(at_rest.logs.further[0])[0]

    with pytest.raises(ConfigError, match=r"(?s)no antenna 'tail'.*main, ahead, right"):
        engine.gnss(epoch, "tail")
    with pytest.raises(InputError, match="antenna 'ahead' has no carrier phase"):
        engine.gnss(dataclasses.replace(epoch, carrier_cycles=None), "ahead")
    alone = Engine(dataclasses.replace(at_rest.setup(), aid=None))
    with pytest.raises(ConfigError, match=r"(?s)no antenna 'ahead'.*\[attitude\]"):
        alone.gnss(epoch, "ahead")
