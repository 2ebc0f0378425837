"""A sensor that gives nothing from the first sample on: the state is honestly wide, and sound once it measures."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import insgnss
from insgnss.constants import NS_PER_S
from insgnss.simulation.sample_trajectories import AIRFIELD, static
from tests.runs.scenes import START_NS, assert_honest, assert_sound, flight, kinds, simulator, turns

SILENT_S = 40.0  # in the middle of the second turn


@pytest.mark.parametrize("sensor", ["w_ib_b", "f_b"])
@pytest.mark.parametrize("value", [None, 0.0], ids=["held", "zero"])
def test_sensor_dead_from_the_beginning_costs_no_honesty(sensor: str, value: float | None) -> None:
    base = turns(120.0)
    log = base.draw(np.random.default_rng(11))
    x = getattr(log.imu, sensor).copy()
    x[log.imu.t_ns < START_NS + SILENT_S * NS_PER_S] = x[0] if value is None else value
    flown = flight(base, log, imu=dataclasses.replace(log.imu, **{sensor: x}))
    run = insgnss.replay(flown)

    assert_sound(run, flown)
    assert {"imu_sensor_out", "imu_sensor_back", "restart"} <= set(kinds(run))
    assert "reset" not in kinds(run)
    assert_honest(run, 0.0)
    last = run.errors.iloc[-1]
    assert abs(last["d_yaw_deg"]) < 0.5 and last["sd_yaw_deg"] < 0.2


def test_accelerometers_that_feel_no_gravity_level_no_vehicle_at_rest() -> None:
    """Zero is along no direction: the level was 864 sigma off, until the sensor was out in the same second."""
    base = simulator(static(30.0, *AIRFIELD), 30.0)
    log = base.draw(np.random.default_rng(12))
    f_b = np.where((log.imu.t_ns < START_NS + 15 * NS_PER_S)[:, None], 0.0, log.imu.f_b)
    run = insgnss.replay(flight(base, log, imu=dataclasses.replace(log.imu, f_b=f_b)))

    assert "at rest" not in run.events.loc[run.events["kind"] == "start", "detail"].iloc[0]
    assert_honest(run, 0.0)
    assert run.nav["sd_roll_deg"].iloc[-1] < 1.0
