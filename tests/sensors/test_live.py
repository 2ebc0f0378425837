"""Readings that reach the streaming engine one by one: the bits of a replay, late ones, wrong ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.errors import MeasurementError
from insgnss.filter.own_rows.ledger import OwnEntry
from insgnss.filter.setup import FilterSetup
from insgnss.filter.whole_log import run_blocks
from insgnss.log.flight import FlightInMemory
from insgnss.runs.setup import setup_filter
from insgnss.sensors.fitting import fitted
from insgnss.simulation.faults import outage
from tests.conftest import REPOSITORY
from tests.filter.test_engine import epochs
from tests.runs.scenes import true_start, turns, with_faults
from tests.sensors.scenes import fault, flown, simulated, with_sensors

SENSORS = (
    simulated("odometer", rate_hz=2.0, noise_time_s=1.0),
    simulated("barometer", rate_hz=3.0),
    simulated("position", rate_hz=1.0),
)


def made(seconds: float = 30.0, imu_rate_hz: float = 100.0) -> FlightInMemory:
    """Return a flight with an outage in its middle, and a draught at the barometer that ends in it."""
    sampled = turns(seconds, imu_rate_hz=imu_rate_hz)
    base = with_faults(sampled, [outage(None, 0.4 * seconds, 0.4 * seconds + 8.0)])
    base = with_sensors(base, SENSORS, [fault("draught", 0.3 * seconds, 0.55 * seconds)])
    return flown(base, 1, true_start(base, 2.0))


def live_setup(flight: FlightInMemory, settings: dict[str, float] | None = None) -> FilterSetup:
    setup = setup_filter(flight, replace(flight.logs, sensors=()), filter_config("tight", settings))
    return setup.with_further(*fitted(flight.config, None))


def live_engine(flight: FlightInMemory) -> insgnss.Engine:
    return insgnss.Engine(live_setup(flight))


def fed(engine: insgnss.Engine, flight: FlightInMemory, late_ns: int = 0) -> None:
    """Feed samples, readings and epochs in the order of their times, readings late by some time."""
    logs = flight.logs
    arriving = sorted(
        [(int(t) + late_ns, 0, s, k) for s, one in enumerate(logs.sensors) for k, t in enumerate(one.t_ns)]
        + [(int(e.t_ns[0]), 1, 0, k) for k, e in enumerate(epochs(logs.gnss))]
    )
    tables, first = epochs(logs.gnss), 0
    for t_ns, w, f in zip(logs.imu.t_ns, logs.imu.w_ib_b, logs.imu.f_b, strict=True):
        engine.imu(int(t_ns), w, f)
        while first < len(arriving) and arriving[first][0] <= t_ns:
            _, is_epoch, s, k = arriving[first]
            if is_epoch:
                engine.gnss(tables[k])
            else:
                sensor = logs.sensors[s]
                engine.sensor(sensor.name, int(sensor.t_ns[k]), sensor.values[k])
            first += 1


def batch(flight: FlightInMemory, settings: dict[str, float]) -> tuple[dict[int, bytes], list[OwnEntry]]:
    entries: list[OwnEntry] = []
    setup = setup_filter(flight, flight.logs, filter_config("tight", settings))
    rows = setup.rows(flight.logs.gnss, setup.navigation)
    out, _, _ = run_blocks(setup, flight.logs.imu, [rows], "gnss", own=entries)
    return {int(row["t_ns"]): row.tobytes() for row in out.nav[: out.counts[0].nav]}, entries


def bits_of_replay(flight: FlightInMemory, event: str) -> int:
    """Compare the rows that an engine writes with a replay's; return how many, ``event`` among the engine's."""
    engine = live_engine(flight)
    fed(engine, flight)
    results = engine.take_results(all_of_them=True)
    written = {r.t_ns: r.out.nav[0].tobytes() for r in results if r.out.counts[0].nav == 1}
    wanted, _ = batch(flight, {})
    assert event in {each.kind for each in engine.events}
    assert written == {t_ns: wanted[t_ns] for t_ns in written}
    return len(written)


@pytest.mark.parametrize(
    ("late_ns", "settings"), [(0, {}), (430_000_000, {}), (430_000_000, {"process.imu_time_sigma_s": 0.02})]
)
def test_readings_that_come_live_give_the_bits_of_replay(late_ns: int, settings: dict[str, float]) -> None:
    """Between epochs and samples, in an outage of 8 s; in time, and 0.43 s late after the epochs they precede."""
    flight = made()
    engine = insgnss.Engine(live_setup(flight, settings))
    fed(engine, flight, late_ns)
    early = engine.take_measurements()
    results = engine.take_results(all_of_them=True)
    entries = [*early, *engine.take_measurements(all_of_them=True)]
    wanted_nav, wanted = batch(flight, settings)
    last_ns = int(flight.logs.imu.t_ns[-1]) - late_ns

    written = {r.t_ns: r.out.nav[0].tobytes() for r in results if r.out.counts[0].nav == 1}
    assert {t: b for t, b in written.items() if t <= last_ns} == {
        t: b for t, b in wanted_nav.items() if t <= last_ns
    }
    assert len(written) > 15 and len(early) > 50
    came = [entry for entry in wanted if entry.t_ns <= last_ns]
    assert [str(entry) for entry in entries][: len(came)] == [str(entry) for entry in came]
    assert len(came) > 180


def test_state_between_epochs_has_the_readings_that_have_come() -> None:
    flight = made()
    setup = live_setup(flight)
    engine, blind = insgnss.Engine(setup), insgnss.Engine(setup)  # readings of one are none of the other's
    fed(engine, flight)
    fed(blind, replace(flight, logs=replace(flight.logs, sensors=())))
    known, unknown = engine.state.values, blind.state.values
    assert known["sd_barometer_offset_m"] < 0.8 * unknown["sd_barometer_offset_m"]


def test_reading_beyond_the_latency_is_refused_with_an_event() -> None:
    flight = made()
    engine = live_engine(flight)
    fed(engine, flight)
    engine.sensor("odometer", int(flight.logs.imu.t_ns[0]) + 10**9, 70.0)
    assert "sensor_too_late" in [event.kind for event in engine.events]


def test_settings_of_an_engine_have_the_sensors_of_the_flight_file(tmp_path: Path) -> None:
    """``engine_settings`` opens no log: the readings are to come, whatever files the entry names."""
    path = tmp_path / "flight.toml"
    said = (REPOSITORY / "data" / "sample_flight" / "flight.toml").read_text(encoding="utf-8")
    said = said.replace('files = ["', f'files = ["{REPOSITORY}/data/sample_flight/')
    said = said.replace('navigation = ["', f'navigation = ["{REPOSITORY}/data/sample_flight/')
    path.write_text(f'{said}\n[[sensor]]\nkind = "barometer"\n', encoding="utf-8")
    engine = insgnss.Engine(insgnss.engine_settings(path))
    engine.sensor("barometer", 1_400_000_000_000_000_000, 350.0)
    assert "barometer_offset_m" in engine._setup.layout.columns


def test_unknown_sensor_and_wrong_number_of_values_are_errors() -> None:
    engine = live_engine(made())
    with pytest.raises(MeasurementError, match="no sensor 'compass' is fed live"):
        engine.sensor("compass", 0, 1.0)
    with pytest.raises(MeasurementError, match=r"'position' has 2 value\(s\)"):
        engine.sensor("position", 0, [0.1, 0.2])
