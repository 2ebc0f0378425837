"""Sensors that give a wrong heading from the start: the first motion refutes them, the satellites are not blamed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import insgnss
from insgnss.filter.own_rows.declared import own_measurements
from insgnss.runs.result import Run
from insgnss.sensors.attitude_fixes import AttitudeMeasurement
from insgnss.sensors.readings import LiveReadings
from tests.runs.scenes import START_S, kinds, true_start, turns
from tests.sensors.scenes import city_car, declared, fault, flown, simulated, with_sensors
from tests.sensors.test_live import bits_of_replay

MOVES_S = 34.0  # three seconds after the car pulls away
WRONG = {
    "antennas exchanged": ("heading", (180.0,)),
    "mounted across": ("heading", (-90.0,)),
    "one antenna short": ("heading", (25.0,)),
    "attitude of another axis": ("attitude", (0.0, 0.0, 90.0)),
}


def driven(kind: str, off: tuple[float, ...], seed: int, **more: Any) -> Run:
    wrong = fault("sensor_step", 0.0, 200.0, sensor=kind, size=off)
    base = with_sensors(city_car(), [simulated(kind, rate_hz=2.0, **more)], [wrong] if any(off) else [])
    return insgnss.replay(flown(base, seed), output=1.0)


@pytest.mark.parametrize("wrong", WRONG)
def test_first_motion_refutes_a_heading_that_is_wrong_from_the_start(wrong: str) -> None:
    kind, off = WRONG[wrong]
    run, right = driven(kind, off, 71), driven(kind, (0.0,), 71)
    assert run.errors is not None and right.errors is not None
    late = run.errors["time_s"] > START_S + MOVES_S
    yaw = run.errors[late]["d_yaw_deg"] / run.errors[late]["sd_yaw_deg"]
    assert yaw.abs().max() < 4.0 and run.errors[late]["sd_yaw_deg"].iloc[-1] < 2.0
    here, there = (each.errors[["d_n_m", "d_e_m"]].to_numpy() for each in (run, right))
    assert np.abs(here - there).max() < 1.0  # it was 140 to 340 m
    (restart,) = run.events[run.events["kind"] == "restart"]["detail"]
    assert (
        restart.startswith(f"the measurements contradict '{kind}'") and "not used until it agrees" in restart
    )
    assert not {"satellite_suspect", "sensor_suspect", "reset", "imu_distrusted"} & set(kinds(run))
    rows = run.measurements.query("kind == @kind and time_s > @START_S + @MOVES_S + 5.0")
    assert (rows["status"] == "contradicts").all() and len(rows) > 150


# that the size of its horizontal field does not show: the heading is mirrored, or turned by 180 deg
AXES = {
    "two columns exchanged": [[0, 1, 0], [1, 0, 0], [0, 0, 1]],
    "one sign": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "all signs": [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
}


@pytest.mark.parametrize("axes", AXES)
def test_first_motion_refutes_a_magnetometer_of_wrong_axes(axes: str) -> None:
    """At rest it leaves headings a few degrees apart; the alternatives are there when the car pulls away."""
    flight = flown(with_sensors(city_car(60.0), [simulated("magnetometer", rate_hz=2.0)]), 81)
    (table,) = flight.logs.sensors
    turned = replace(table, values=table.values @ np.array(AXES[axes], np.float64).T)
    run = insgnss.replay(replace(flight, logs=replace(flight.logs, sensors=(turned,))), output=1.0)
    (restart,) = run.events.query("kind == 'restart'").itertuples()
    assert restart.time_s < START_S + MOVES_S and "contradict 'magnetometer'" in restart.detail
    assert run.errors is not None
    late = run.errors[run.errors["time_s"] > START_S + MOVES_S]
    assert (late["d_yaw_deg"] / late["sd_yaw_deg"]).abs().max() < 5.0
    assert np.hypot(run.errors["d_n_m"], run.errors["d_e_m"]).max() < 5.0  # it was 21 to 41 m


@pytest.mark.parametrize("kind", ["heading", "attitude", "magnetometer"])
@pytest.mark.parametrize("noise_time_s", [0.0, 20.0])
def test_sound_headings_are_not_refuted(kind: str, noise_time_s: float) -> None:
    run = driven(kind, (0.0,), 72, noise_time_s=noise_time_s)
    assert not {"restart", "rows_contradict"} & set(kinds(run))
    assert (run.measurements.query("kind == @kind")["status"] == "used").mean() > 0.9


def test_sensor_that_contradicts_a_wrong_given_start_is_kept() -> None:
    """The given heading is wrong by 60 deg, the sensor is right: the start is refuted, not the sensor."""
    base = with_sensors(turns(60.0), [simulated("heading", rate_hz=2.0)])
    start = true_start(base, 2.0)
    roll, pitch, yaw = start.rpy_deg
    wrong = start.model_copy(update={"rpy_deg": (roll, pitch, yaw + 60.0)})
    run = insgnss.replay(flown(base, 73, wrong), output=1.0)
    (restart,) = run.events[run.events["kind"] == "restart"]["detail"]
    assert "contradict the given start" in restart and "'heading'" not in restart
    late = run.measurements.query("kind == 'heading' and time_s > @START_S + 40.0")
    assert (late["status"] == "used").mean() > 0.9
    assert run.errors is not None
    assert (run.errors["d_yaw_deg"] / run.errors["sd_yaw_deg"])[-30:].abs().max() < 4.0


def test_sensor_that_was_refuted_is_used_again_once_it_agrees() -> None:
    """Steel beside the compass on the ground, none any more in the air."""
    base = with_sensors(
        turns(110.0),
        [simulated("heading", rate_hz=2.0)],
        [fault("sensor_step", 0.0, 40.0, sensor="heading", size=(120.0,))],
    )
    run = insgnss.replay(flown(base, 74), output=1.0)
    assert "rows_agree" in kinds(run)
    late = run.measurements.query("kind == 'heading' and time_s > @START_S + 100.0")
    assert (late["status"] == "used").all() and len(late) > 15


def test_frozen_sensor_does_not_agree_where_the_vehicle_passes_its_value() -> None:
    """The car drives along the frozen heading for 20 s; roll and pitch were 8 sigma wrong afterwards."""
    flight = flown(with_sensors(city_car(), [simulated("attitude", rate_hz=2.0)]), 81)
    (table,) = flight.logs.sensors
    frozen = replace(table, values=np.broadcast_to(table.values[len(table.values) // 2], table.values.shape))
    run = insgnss.replay(replace(flight, logs=replace(flight.logs, sensors=(frozen,))), output=1.0)
    assert "restart" in kinds(run) and "rows_agree" not in kinds(run)


def test_of_two_sensors_the_wrong_one_is_left_out() -> None:
    pair = [simulated("attitude", rate_hz=2.0), simulated("heading", rate_hz=2.0)]
    wrong = fault("sensor_step", 0.0, 200.0, sensor="heading", size=(90.0,))
    run = insgnss.replay(flown(with_sensors(city_car(), pair, [wrong]), 75), output=1.0)
    late = run.measurements["time_s"] > START_S + MOVES_S + 20.0
    used = run.measurements[late].groupby("kind", observed=True)["status"].agg(lambda s: (s == "used").mean())
    assert used["attitude"] > 0.9 and used["heading"] == 0.0
    assert run.errors is not None
    assert (run.errors["d_yaw_deg"] / run.errors["sd_yaw_deg"])[-60:].abs().max() < 4.0


def test_attitude_without_yaw_gives_no_heading_to_validate() -> None:
    config = declared(simulated("attitude", rate_hz=2.0))
    columns = config.columns.model_copy(update={"attitude": ("roll_deg", "pitch_deg", "none")})
    level = config.model_copy(update={"columns": columns})
    readings = LiveReadings(config)
    assert AttitudeMeasurement(config, readings).tells_heading
    assert not AttitudeMeasurement(level, readings).tells_heading


def test_measurement_of_a_users_own_that_tells_the_heading_has_a_place_among_the_watched() -> None:
    source = SimpleNamespace(
        name="sun", times_ns=np.arange(3), rows=lambda state, layout: (), tells_heading=True
    )
    own = own_measurements([source])
    assert own is not None and own.kinds[0].watch == 0 and own.headings == own.kinds
    assert own.without(own.headings).kinds == () and len(own.without(own.headings).times_ns) == 0


def test_engine_gives_the_bits_of_replay_when_a_heading_is_refuted() -> None:
    """The alternatives do not stop at the readings of the sensor that they do not use, live or not."""
    sensors = [simulated("heading", rate_hz=3.0), simulated("barometer", rate_hz=2.0)]
    wrong = fault("sensor_step", 0.0, 200.0, sensor="heading", size=(90.0,))
    flight = flown(with_sensors(city_car(45.0), sensors, [wrong]), 76)
    assert bits_of_replay(flight, "restart") > 35
