"""A sensor whose own error is far beyond what the flight file declares is named, in a replay and live."""

from __future__ import annotations

from functools import cache

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.filter.layout import GaussMarkov, RandomWalk, StateBlock
from insgnss.log.flight import FlightInMemory
from insgnss.runs.declared_sigmas import _SensorState, beyond_declared
from tests.runs.scenes import kinds, true_start, turns
from tests.sensors.scenes import fault, flown, simulated, with_sensors
from tests.sensors.test_live import fed, live_engine


@cache
def turning(off_deg: float, seconds: float) -> FlightInMemory:
    """Return an aircraft in turns with a heading that is off by an angle."""
    wrong = [] if off_deg == 0.0 else [fault("sensor_step", 0.0, seconds, sensor="heading", size=(off_deg,))]
    base = with_sensors(turns(seconds), [simulated("heading", rate_hz=2.0)], wrong)
    return flown(base, 7, true_start(base, 2.0), gate_sigma=100.0)


# 12 deg end in a restart after 15 s, and ten seconds later in filters beside, twenty times the work of all before
@pytest.mark.parametrize(("off_deg", "seconds"), [(0.0, 60.0), (-8.0, 60.0), (-12.0, 25.0)])
def test_heading_from_magnetic_north_is_named(off_deg: float, seconds: float) -> None:
    run = insgnss.replay(turning(off_deg, seconds))
    told = run.events[run.events["kind"] == "sensor_beyond_sigma"]["detail"].tolist()
    if off_deg == 0.0:
        assert not told
        return
    assert len(told) == 1
    assert "'heading' is off by more than declared: heading_offset_deg is -" in told[0]
    assert "declination" in told[0]


def test_engine_names_it_once() -> None:
    engine = live_engine(turning(-12.0, 25.0))
    fed(engine, turning(-12.0, 25.0))
    engine.take_results(all_of_them=True)
    assert [event.kind for event in engine.events].count("sensor_beyond_sigma") == 1


def test_errors_that_may_grow_are_allowed_to() -> None:
    """A walk of 1 per sqrt(s) from 1: 4.4 sigma after 99 s are 10 sigma of the start."""
    walk = _SensorState("s", "", StateBlock("s_a", ("s_a",), "m", 1.0, RandomWalk(1.0)))
    held = _SensorState("s", "", StateBlock("s_b", ("s_b",), "m", 1.0, GaussMarkov(3.0, 10.0)))
    np.testing.assert_allclose(walk.sigma(np.array([0.0, 99.0])), [1.0, 10.0])
    np.testing.assert_allclose(held.sigma(np.array([0.0, 99.0])), [3.0, 3.0])
    assert beyond_declared(pd.DataFrame({"time_s": [0.0]}), None, 2385) == []
    assert "sensor_beyond_sigma" not in kinds(insgnss.replay(turning(0.0, 60.0)))
