"""When a vehicle counts as at rest at the start: gyros, accelerometers and range rates must all say so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S, STANDARD_GRAVITY_MPS2
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.fix import Fix
from insgnss.filter.start.rest import rate_in_doubt, samples_show_rest
from insgnss.filter.start.start import open_headings
from insgnss.filter.start.starter import Starter
from insgnss.inertial.alignment import AlignmentWindow
from insgnss.inertial.sensor_model import sensor_model
from tests.filter.scene import TACTICAL, TCXO

NOWHERE = np.zeros(0, np.int64)
UNUSED = np.zeros((2, 0), np.bool_)
CONFIG = filter_config("tight17")
DOWN_F = np.array([0.0, 0.0, -9.8])
STILL = AlignmentWindow(1.0, DOWN_F, DOWN_F, np.zeros(3), np.zeros(3), 0.02, 1e-4, 1e-5)
PLACE_E = np.array([6_378_137.0, 0.0, 0.0])  # at longitude 0 on the equator north is z, east is y


def fix(speed_mps: float | None, sd_mps: float, t_s: float = 10.0) -> Fix:
    """Return a fix with a velocity to the east, or none."""
    v_a = None if speed_mps is None else np.array([0.0, speed_mps, 0.0])
    P_v = np.eye(4) * sd_mps**2 / 3.0
    clocks = np.zeros(1)
    return Fix(int(t_s * NS_PER_S), PLACE_E, clocks, np.eye(4), v_a, 0.0, P_v, NOWHERE, UNUSED, UNUSED, True)


def at_rest(now: Fix, before: Fix | None) -> bool:
    return Starter(FilterSetup(CONFIG, TACTICAL, TCXO), given=False)._at_rest(STILL, now, before)


def test_steady_sensors_and_no_velocity_are_rest() -> None:
    assert at_rest(fix(0.1, 0.05), fix(0.0, 0.05, 9.0))


def test_a_poor_velocity_does_not_make_a_driving_car_rest() -> None:
    """8.6 m/s with a sigma of 5 m/s is within three sigmas of nothing, and still no rest."""
    assert not at_rest(fix(8.6, 5.0), fix(8.6, 5.0, 9.0))


def test_without_range_rates_nothing_says_that_it_stands() -> None:
    assert not at_rest(fix(None, 0.05), None)


def test_a_car_that_brakes_to_a_stop_is_not_at_rest_yet() -> None:
    """2 m/s^2 a second ago: the accelerometers still show the brake."""
    assert not at_rest(fix(0.3, 0.05), fix(2.3, 0.05, 9.0))


@pytest.mark.parametrize(("speed_mps", "sd_mps", "weight"), [(8.0, 0.2, 0.7), (8.0, 4.0, 1.0 / 12.0)])
def test_a_course_counts_only_where_the_velocity_has_a_direction(
    speed_mps: float, sd_mps: float, weight: float
) -> None:
    found = open_headings(PLACE_E, np.array([0.0, speed_mps, 0.0]), np.eye(3) * sd_mps**2, CONFIG)
    assert found[0].weight == pytest.approx(weight)
    assert sum(heading.weight for heading in found) == pytest.approx(1.0)
    if weight > 0.5:
        assert found[0].yaw == pytest.approx(math.pi / 2)


def window(about_degps: float, across_degps: float, tilting_degps: float, sd_degps: float) -> AlignmentWindow:
    """Return a quiet window in which the gyros read a rate about gravity and one across it."""
    w_ib_b, tilting_b = np.radians([across_degps, 0.0, about_degps]), np.radians([tilting_degps, 0.0, 0.0])
    return replace(STILL, w_ib_b=w_ib_b, tilting_b=tilting_b, sd_tilting=math.radians(sd_degps))


@pytest.mark.parametrize(("tilting_degps", "rests"), [(0.0, True), (0.3, False), (0.02, True)])
def test_boat_that_sways_is_not_at_rest(tilting_degps: float, rests: bool) -> None:
    """A tactical gyro (1 deg/h) that reads 0.3 deg/s across gravity, which turns as it says, or does not."""
    swaying = window(0.0, 0.3, tilting_degps, 0.01)
    assert samples_show_rest(swaying, CONFIG, TACTICAL) == rests
    turn, doubt = rate_in_doubt(swaying, TACTICAL)
    if rests:  # the gyro is worse than its grade
        assert not turn.any() and not doubt.any()


def test_rate_too_small_for_the_accelerometers_stays_in_doubt() -> None:
    turn, doubt = rate_in_doubt(window(0.0, 0.05, 0.05, 0.04), TACTICAL)
    assert np.degrees(turn) == pytest.approx([0.025, 0.0, 0.0])
    assert np.degrees(np.sqrt(np.diag(doubt))) == pytest.approx([0.025, 0.0, 0.0])


def test_slow_turn_about_gravity_stays_in_doubt() -> None:
    """Its direction is as uncertain as the level."""
    turn, doubt = rate_in_doubt(window(0.2, 0.0, 0.0, 0.01), TACTICAL)
    assert np.degrees(turn) == pytest.approx([0.0, 0.0, 0.1])
    leak = sensor_model(TACTICAL).accel_bias.sigma / STANDARD_GRAVITY_MPS2 * 0.2
    assert np.degrees(np.sqrt(np.diag(doubt))) == pytest.approx([leak, leak, 0.1], rel=1e-3)


def test_bias_of_the_grade_is_not_in_doubt() -> None:
    reads = TACTICAL.gyro_bias_deg_per_h / 3600.0
    turn, doubt = rate_in_doubt(window(reads, reads, 0.0, 0.01), TACTICAL)
    assert not turn.any() and not doubt.any()
