"""A wheel speed that is late while the car first accelerates: it must not choose the heading against GNSS."""

from __future__ import annotations

import json
import tomllib
from functools import cache
from pathlib import Path

import pytest

import insgnss
from insgnss.config.simulation import SimulationConfig
from insgnss.simulation.assembly import assemble
from insgnss.simulation.simulated_log import Simulator
from tests.benchmarks.trust.motions import accelerate, scenario, straight
from tests.sensors.scenes import flown, simulated, with_sensors

START_S = 300_000.0


@cache
def quick_start() -> Simulator:
    """Return a car that stands for 25 s, then gains 17 m/s in 9 s."""
    text = scenario("late odometer", straight(25.0), accelerate(17.0, 9.0), straight(12.0))
    config = SimulationConfig.model_validate_json(json.dumps(tomllib.loads(text)), strict=True)
    return Simulator(assemble(config, Path()))


@pytest.mark.parametrize("seed", [1, 9])
def test_odometer_that_is_late_does_not_outvote_the_range_rates(seed: int) -> None:
    """0.2 s late, ten readings a second: velocity and yaw were 50 to 480 sigma wrong in these draws."""
    late = simulated(
        "odometer",
        rate_hz=10.0,
        lever_arm_m=(-1.2, 0.6, 0.4),
        noise_mps=0.08,
        noise_time_s=0.7,
        time_offset_s=0.2,
    )
    run = insgnss.replay(flown(with_sensors(quick_start(), [late]), seed), output=1.0)

    known_s = run.heading_known_s()
    assert known_s is not None and known_s - START_S < 32.0
    assert run.errors is not None
    after = run.errors[run.errors["time_s"] > START_S + 28.0]
    for name in ("vn_mps", "ve_mps", "yaw_deg"):
        assert (after[f"d_{name}"].abs() < 4.0 * after[f"sd_{name}"]).all(), name
    assert not {"reset", "restart"} & set(run.events["kind"])
