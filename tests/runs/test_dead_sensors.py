"""A sensor that gives nothing from the first sample on: the state is honestly wide, and sound once it measures."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import insgnss
from insgnss.constants import NS_PER_S
from tests.runs.scenes import START_NS, assert_honest, assert_sound, flight, kinds, turns

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
