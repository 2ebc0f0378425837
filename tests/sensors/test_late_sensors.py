"""Sensors that pass the gate and pull the filter away: a look back blames them, not the inertial sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import insgnss
from insgnss.constants import NS_PER_S
from insgnss.simulation.simulated_log import Simulator
from tests.runs.scenes import START_S, kinds, true_start, turns
from tests.sensors.scenes import city_car, flown, simulated, with_sensors
from tests.sensors.test_live import bits_of_replay

BLAMED = {"sensor_suspect", "satellite_suspect", "time_tag_suspect", "imu_distrusted", "reset", "restart"}


@pytest.mark.parametrize(
    ("kind", "base", "late_s", "words"),
    [
        ("odometer", city_car, 1.0, "its errors are larger than its sigma"),
        ("attitude", lambda: turns(60.0), 1.0, "its readings are about 1.0 s late"),
    ],
)
def test_sensor_whose_tags_are_late_is_left_out(
    kind: str, base: Callable[[], Simulator], late_s: float, words: str
) -> None:
    """The odometer was 43 sigma of yaw, the attitude 20, and the inertial sensors were blamed."""
    late = simulated(kind, rate_hz=2.0, time_offset_s=late_s)
    run = insgnss.replay(flown(with_sensors(base(), [late]), 81), output=1.0)
    (told,) = run.events[run.events["kind"] == "rows_contradict"]["detail"]
    assert told.startswith(f"'{kind}' contradicts the satellites and the inertial sensors")
    assert words in told
    assert not BLAMED & set(kinds(run))
    told_s = float(run.events[run.events["kind"] == "rows_contradict"]["time_s"].iloc[0])
    rows = run.measurements[run.measurements["kind"] == kind]
    rows = rows[(rows["time_s"] > told_s) & (rows["time_s"] < rows["time_s"].max() - 2.0)]
    assert (rows["status"] == "contradicts").all() and len(rows) > 5
    assert run.errors is not None
    after = run.errors[run.errors["time_s"] > START_S + 20.0]
    assert (after["d_yaw_deg"] / after["sd_yaw_deg"]).abs().max() < 6.5


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer"])
def test_sound_sensors_are_not_blamed_for_an_inertial_one(sensor: str) -> None:
    pair = [simulated("odometer", rate_hz=2.0), simulated("heading", rate_hz=2.0)]
    base = with_sensors(city_car(), pair)
    flight = flown(base, 82, true_start(base, 2.0))
    imu = flight.logs.imu
    w_ib_b, f_b = imu.w_ib_b.copy(), imu.f_b.copy()
    late = imu.t_ns > imu.t_ns[0] + 80 * NS_PER_S
    if sensor == "gyro":
        w_ib_b[late, 2] += np.radians(0.5)
    else:
        f_b[late, 0] += 0.5
    wrong = replace(imu, w_ib_b=w_ib_b, f_b=f_b)
    run = insgnss.replay(replace(flight, logs=replace(flight.logs, imu=wrong)), output=1.0)
    told = run.events[run.events["kind"] == "sensor_suspect"]["detail"].tolist()
    assert f"{sensor} " in told[-1]
    assert "rows_contradict" not in kinds(run)


def test_engine_gives_the_bits_of_replay_when_a_sensor_is_left_out() -> None:
    late = simulated("attitude", rate_hz=2.0, time_offset_s=1.0)
    flight = flown(with_sensors(turns(60.0), [late]), 81)
    assert bits_of_replay(flight, "rows_contradict") > 50
