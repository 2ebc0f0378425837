"""Protection levels of the live filter: those of a replay once all satellites are known, alerts, what is not known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.filter.engine_results import EpochProtection, EpochResult
from insgnss.filter.epoch_tables import empty_epoch
from insgnss.gnss.observation_rows import satellite_name
from insgnss.gnss.orbits.satellite_state import satellite_states
from insgnss.log.flight import FlightInMemory
from insgnss.runs.integrity.live import LiveProtection, SubFilter, _Monitored
from insgnss.runs.setup import setup_filter
from insgnss.simulation.simulated_log import Simulator
from insgnss.tables import GnssTable
from tests.filter.test_engine import no_delay, stream
from tests.runs.scenes import START_NS, flight, rows_where, turns
from tests.runs.test_protection_levels import OPEN, with_fault
from tests.sensors.test_live import fed, live_setup, made


def sampled(duration_s: float) -> Simulator:
    """Return turns with 25 samples a second: each goes to a dozen filters, and nothing here depends on their rate."""
    return turns(duration_s, imu_rate_hz=25.0)


def seconds(t_ns: int) -> float:
    return (t_ns - START_NS) / 1e9


@cache
def two_constellations() -> FlightInMemory:
    """Return a flight of which every other satellite is called a Galileo satellite; one rises after 25 s."""
    flown = flight(sampled(50.0), seed=911)
    gnss, navigation = flown.logs.gnss, flown.logs.navigation
    states = satellite_states(gnss, navigation)
    sat = np.column_stack([states.sat[:, :6], states.clock_m, states.drift_mps])
    names = tuple(("GE"[i % 2]) + sv[1:] for i, sv in enumerate(gnss.sv_names))
    gnss = replace(gnss, sat=sat, sv_names=names)
    stated = replace(flown, logs=replace(flown.logs, navigation=None))
    return with_log(stated, risen(gnss, names[-1], 25.0))


def risen(gnss: GnssTable, sv: str, at_s: float) -> GnssTable:
    """Return a log without a satellite before it rises."""
    hidden = (gnss.sv == gnss.sv_names.index(sv)) & (gnss.t_ns < START_NS + round(at_s * 1e9))
    return rows_where(gnss, ~hidden)


def with_log(flown: FlightInMemory, gnss: GnssTable) -> FlightInMemory:
    return replace(flown, logs=replace(flown.logs, gnss=gnss))


def engine_of(flown: FlightInMemory, settings: dict[str, object] | None = None) -> insgnss.Engine:
    config = filter_config("tight", settings)
    return insgnss.Engine(setup_filter(flown, flown.logs, config), integrity=True)


def streamed(
    flown: FlightInMemory, delays_ns: Iterator[int], settings: dict[str, object] | None = None
) -> tuple[insgnss.Engine, list[EpochResult]]:
    """Return an engine with protection levels that was fed a flight, and its results."""
    engine = engine_of(flown, settings)
    stream(engine, flown.logs, delays_ns)
    return engine, engine.take_results(all_of_them=True)


def levels_of(results: list[EpochResult], from_s: float) -> pd.DataFrame:
    """Return the levels of the results that have some, in seconds of the flight."""
    rows = [
        (seconds(r.t_ns), r.protection.hpl_m, r.protection.vpl_m) for r in results if r.protection is not None
    ]
    table = pd.DataFrame(rows, columns=["t", "hpl_m", "vpl_m"])
    return table[table["t"] >= from_s].reset_index(drop=True)


@cache
def late_stream() -> tuple[insgnss.Engine, list[EpochResult]]:
    """Return an engine that was fed the two constellations, some epochs late, and its results."""
    return streamed(two_constellations(), some_late())


@cache
def replayed_levels() -> pd.DataFrame:
    """Return the levels of a replay of the two constellations."""
    nav = insgnss.replay(two_constellations(), integrity=True).nav
    return pd.DataFrame(
        {"t": nav["time_s"] - START_NS / 1e9 % 604800, "hpl_m": nav["hpl_m"], "vpl_m": nav["vpl_m"]}
    )


def some_late() -> Iterator[int]:
    """Yield delays of 0, 0.7 and 0.35 s."""
    while True:
        yield from (0, 700_000_000, 350_000_000)


@pytest.mark.parametrize("late", [False, True])
def test_levels_are_those_of_replay_to_the_last_bit_once_all_satellites_have_risen(late: bool) -> None:
    """Two constellations, one satellite 25 s after the others: its sub-filter begins as a copy of the full one."""
    engine, results = late_stream() if late else streamed(two_constellations(), no_delay())
    live, replayed = levels_of(results, 26.0), replayed_levels()
    # an epoch that is late at the end has not come
    wanted = replayed[replayed["t"] >= 26.0 - 1e-6][: len(live)]
    assert len(live) > 20 and np.isfinite(live["hpl_m"]).all()
    np.testing.assert_array_equal(live["hpl_m"], wanted["hpl_m"])
    np.testing.assert_array_equal(live["vpl_m"], wanted["vpl_m"])
    before = [r.protection for r in results if r.protection is not None and seconds(r.t_ns) < 23.5]
    after = [r.protection for r in results if r.protection is not None and seconds(r.t_ns) > 26.0]
    assert {len(p.faults) for p in before} == {len(after[-1].faults) - 1}
    assert {"G", "E"} < set(after[-1].faults)
    assert engine.state.values["hpl_m"] == pytest.approx(live["hpl_m"].iloc[-1], rel=0.2)


def test_full_solution_is_that_of_an_engine_without_levels() -> None:
    flown = two_constellations()
    plain = insgnss.Engine(setup_filter(flown, flown.logs, filter_config("tight")))
    stream(plain, flown.logs, some_late())
    wanted = [r.out.nav.tobytes() for r in plain.take_results(all_of_them=True)]
    engine, results = late_stream()
    assert [r.out.nav.tobytes() for r in results] == wanted
    assert [str(e) for e in engine.events] == [str(e) for e in plain.events]
    assert not {"hpl_m", "vpl_m"} & set(plain.state.values)


def test_fault_that_the_filter_believes_is_told_once_with_its_suspect() -> None:
    flown = flight(sampled(50.0), seed=902)
    sv = sorted(flown.logs.gnss.sv_names)[1]
    wrong = with_fault(flown, sv, 30.0, -40.0)
    engine, results = streamed(wrong, no_delay(), OPEN)
    alerts = [event for event in engine.events if event.kind == "integrity_alert"]
    assert [event.detail.startswith(f"suspect {sv}: ") for event in alerts] == [True]
    events = insgnss.replay(wrong, settings=OPEN, integrity=True).events
    wanted = events[events["kind"] == "integrity_alert"]["time_s"].tolist()
    assert [seconds(alerts[0].t_ns or 0)] == pytest.approx([t - START_NS / 1e9 % 604800 for t in wanted])
    last = results[-1].protection
    assert last is not None
    k = last.faults.index(sv)
    assert (np.abs(last.separation_m[k]) > last.limit_m[k]).any()


def test_readings_of_further_sensors_reach_the_sub_filters_late_or_not() -> None:
    """A fault that no satellite of the log has: its sub-filter is the full filter, to the last bit."""
    flown = made(16.0, 25.0)
    engine = insgnss.Engine(live_setup(flown), integrity=True)
    assert engine._protection is not None
    absent = SubFilter(engine, engine._setup, np.array([0]))
    engine._protection._monitored.append(_Monitored(satellite_name(0), absent))
    fed(engine, flown, 430_000_000)
    assert len(engine.take_measurements()) > 50
    assert absent.newest_row().nav.tobytes() == engine.newest_row().nav.tobytes()


def test_level_is_infinite_where_a_sub_filter_has_no_solution() -> None:
    """Five satellites are enough for a filter; four of them start none."""
    flown = flight(sampled(40.0), seed=905)
    gnss = flown.logs.gnss
    few = with_log(flown, rows_where(gnss, np.isin(gnss.sv, [0, 1, 2, 3, 4])))
    _, results = streamed(few, no_delay())
    levels = levels_of(results, 0.0)
    assert len(levels) > 10 and np.isinf(levels["hpl_m"]).all()


def test_spent_risk_is_told_once() -> None:
    settings: dict[str, object] = {"integrity.risk": 1e-9, "integrity.satellite_fault": 1e-4}
    engine, results = streamed(flight(sampled(25.0), seed=906), no_delay(), settings)
    assert [event.kind for event in engine.events].count("integrity_risk_spent") == 1
    assert math.isinf(levels_of(results, 20.0)["hpl_m"].min())


def test_suspect_is_told_again_only_after_a_minute_without_an_alert_of_it() -> None:
    """An alert that comes and goes each second for half a minute, a quiet time, and the same again."""
    engine = engine_of(two_constellations())
    protection = LiveProtection(engine, engine._setup)
    for number in (0, 1):
        sub = SubFilter(engine, engine._setup, np.array([number]))
        protection._monitored.append(_Monitored(satellite_name(number), sub))

    def told(at_s: float, name: str | None) -> list[str]:
        names = tuple(each.name for each in protection._monitored)
        d = np.array([[3.0 if name == each else 0.5, 0.0, 0.0] for each in names])
        rows, out = engine._rows(empty_epoch()), engine.newest_row()
        result = EpochResult(START_NS + round(at_s * 1e9), empty_epoch(), rows, out)
        result.protection = EpochProtection(1.0, 1.0, names, d, np.ones((2, 3)))
        return [event.detail.split(":")[0] for event in protection._alerts(result, [None, None])]

    first, second = (each.name for each in protection._monitored)
    flapping = [told(t, first if t % 2 == 0 else None) for t in range(30)]
    assert flapping == [[f"suspect {first}"], *[[]] * 29]
    assert told(31.0, second) == [f"suspect {second}"]
    assert told(60.0, None) == [] and told(80.0, first) == []  # 52 s after its last alert
    assert told(141.0, first) == [f"suspect {first}"]
