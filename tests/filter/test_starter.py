"""When a vehicle counts as at rest at the start: gyros, accelerometers and range rates must all say so."""

from __future__ import annotations

import math

import numpy as np
import pytest

from insgnss.config.library import filter_config
from insgnss.constants import NS_PER_S
from insgnss.filter.setup import FilterSetup
from insgnss.filter.start.fix import Fix
from insgnss.filter.start.start import open_headings
from insgnss.filter.start.starter import Starter
from insgnss.inertial.alignment import AlignmentWindow
from tests.filter.scene import TACTICAL, TCXO

NOWHERE = np.zeros(0, np.int64)
UNUSED = np.zeros((2, 0), np.bool_)
CONFIG = filter_config("tight17")
DOWN_F = np.array([0.0, 0.0, -9.8])
STILL = AlignmentWindow(1.0, DOWN_F, DOWN_F, np.zeros(3), np.zeros(3), 0.02, 1e-4)
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
