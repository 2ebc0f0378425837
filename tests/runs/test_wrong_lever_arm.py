"""A lever arm that is not as declared: found where the vehicle turns, then its error is a state."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import insgnss
from insgnss.config.library import filter_config
from insgnss.filter.layout import StateBlock
from insgnss.filter.state import MAX_OPTIONAL
from insgnss.log.flight import FlightInMemory
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from tests.filter.test_engine import beginning
from tests.runs.scenes import START_S, flight, kinds, turns
from tests.runs.test_gnss_tags import worst
from tests.runs.test_imu_tags_found import SURVEYED, assert_stream_has_the_same_bits

WRONG_M = (0.5, -2.0, 1.5)  # by which the flight file is off; the part along the way looks like a time offset
BLAMED = {"imu_distrusted", "satellite_suspect", "rates_late", "reset", "restart"}


@cache
def declared(wrong_m: tuple[float, float, float] = WRONG_M, seed: int = 61) -> FlightInMemory:
    flown = flight(turns(180.0), seed=seed)
    gnss = flown.config.gnss
    assert gnss.lever_arm_m is not None
    lever = tuple(own + wrong for own, wrong in zip(gnss.lever_arm_m, wrong_m, strict=True))
    config = flown.config.model_copy(update={"gnss": gnss.model_copy(update={"lever_arm_m": lever})})
    return replace(flown, config=config)


@cache
def replayed(wrong_m: tuple[float, float, float]) -> Run:
    return insgnss.replay(declared(wrong_m))


def found(run: Run) -> tuple[float, str]:
    """Return when the lever arm was found to be wrong [s of the flight], and what is said of it."""
    ((at_s, detail),) = run.events.loc[
        run.events["kind"] == "lever_arm_suspect", ["time_s", "detail"]
    ].to_numpy()
    return at_s - START_S, detail


@pytest.mark.parametrize("wrong_m", [WRONG_M, (0.0, 2.0, 0.0), (-1.0, 4.0, -3.0)])
def test_error_of_the_lever_arm_is_found_and_nothing_else_is_blamed(
    wrong_m: tuple[float, float, float],
) -> None:
    run = replayed(wrong_m)
    at_s, detail = found(run)
    assert not BLAMED & set(kinds(run))
    sensors = run.events.loc[run.events["kind"] == "sensor_suspect", "detail"]
    assert sensors.str.contains("not yet known which").all()
    stated = re.findall(r"([+-][\d.]+) \(sigma ([\d.]+)\)", detail)
    for (value, sigma), wrong in zip(stated, wrong_m, strict=True):
        assert abs(float(value) + wrong) < 4.0 * float(sigma) + 0.1
    assert float(stated[1][1]) < 0.5 and float(stated[2][1]) < 0.5
    assert at_s < 100.0
    assert worst(run, at_s + 1.0) < 5.0
    assert worst(insgnss.replay(declared(wrong_m), settings={"health.recovery": False}), at_s) > 6.0


@pytest.mark.parametrize("seed", range(71, 74))
def test_right_lever_arm_is_not_doubted(seed: int) -> None:
    run = insgnss.replay(declared((0.0, 0.0, 0.0), seed))
    assert not ({"lever_arm_suspect", "time_tag_suspect"} | BLAMED) & set(kinds(run))


def test_lever_arm_that_is_a_state_already_is_no_suspect() -> None:
    run = insgnss.replay(declared((0.0, 1.0, 0.0)), settings={"process.lever_arm_sigma_m": 2.0})
    assert "lever_arm_suspect" not in kinds(run)
    assert worst(run, 60.0) < 5.0
    assert "lever_arm_suspect" not in kinds(insgnss.replay(declared(), settings=SURVEYED))


def test_lever_arm_without_room_for_its_states_does_not_become_one() -> None:
    flown = declared()
    setup = setup_filter(flown, flown.logs, filter_config("tight17"))
    assert setup.may_estimate_lever_arm
    assert not setup.with_lever_arm().may_estimate_lever_arm
    room = MAX_OPTIONAL - setup.layout.n_optional - 2
    full = StateBlock("many", tuple(f"x_{i}" for i in range(room)), "m", 1.0)
    assert not setup.with_further([full]).may_estimate_lever_arm


def test_stream_has_the_same_bits() -> None:
    assert_stream_has_the_same_bits(beginning(declared(), 66.0), "lever_arm_suspect")


def test_smoother_goes_back_to_where_it_was_found() -> None:
    smoothed, filtered = insgnss.replay(declared(), smooth=True), replayed(WRONG_M)
    at_s, _ = found(filtered)
    before = [
        run.nav.loc[run.nav["time_s"] < START_S + at_s, "lat_deg"].to_numpy() for run in (smoothed, filtered)
    ]
    np.testing.assert_array_equal(*before)
    assert worst(smoothed, at_s + 1.0) < 5.0
