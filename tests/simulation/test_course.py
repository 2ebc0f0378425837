"""Courses lead where their manoeuvres say, at any place, and are smooth."""

from __future__ import annotations

import numpy as np
import pytest
from pymap3d.vincenty import vreckon

from insgnss.errors import ConfigError
from insgnss.simulation import sample_trajectories
from insgnss.simulation.course import ManoeuvreSequence, smoothstep
from insgnss.simulation.trajectory import Trajectory, reference_table
from insgnss.tables import ReferenceTable


def reference(trajectory: Trajectory, *times: float) -> ReferenceTable:
    return reference_table(trajectory.motion(np.array(times)), 0)


def test_smoothstep_is_twice_continuously_differentiable() -> None:
    x = np.linspace(-0.2, 1.2, 14_001)
    second = np.diff(smoothstep(x), 2) / (x[1] - x[0]) ** 2
    assert smoothstep(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])) == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0])
    assert np.max(np.abs(np.diff(second))) < 0.01  # 60 at most times the step; a kink would jump by units


@pytest.mark.parametrize(("lat", "heading"), [(59.97, 40.0), (0.0, 90.0), (-75.0, 200.0)])
def test_a_straight_leg_is_a_geodesic(lat: float, heading: float) -> None:
    trajectory = ManoeuvreSequence(200.0).hold(600.0).lay(lat, 20.0, 0.0, heading)
    end = reference(trajectory, 600.0)
    wanted_lat, wanted_lon = vreckon(lat, 20.0, 120_000.0, heading)
    assert end.lat_deg[0] == pytest.approx(float(np.squeeze(wanted_lat)), abs=1e-8)  # 1 mm
    assert end.lon_deg[0] == pytest.approx(float(np.squeeze(wanted_lon)), abs=5e-8)
    assert end.h_m[0] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("by_deg", [90.0, -270.0, 360.0])
def test_a_turn_ends_on_its_heading(by_deg: float) -> None:
    course = ManoeuvreSequence(100.0).hold(5.0).turn(by_deg, 35.0).hold(5.0)
    end = reference(course.lay(0.0, 0.0, 500.0, 10.0), course.clock_s)
    off = (end.rpy_deg[0, 2] - 10.0 - by_deg + 180.0) % 360.0 - 180.0
    assert off == pytest.approx(0.0, abs=1e-4)


def test_a_right_turn_banks_right_and_is_coordinated() -> None:
    trajectory = ManoeuvreSequence(100.0).hold(5.0).turn(180.0, 40.0).lay(60.0, 30.0, 500.0, 0.0)
    t = np.arange(0.0, 40.0, 0.1)
    truth = reference_table(trajectory.motion(t), 0)
    assert truth.rpy_deg[:, 0].max() == pytest.approx(40.0, abs=1e-3)
    assert truth.rpy_deg[200, 2] > 20.0
    # the Earth's rotation and the difference of gravity from 9.80665 remain: 2 w v = 0.015 m/s^2
    assert np.max(np.abs(trajectory.specific_force_b(t)[:, 1])) < 0.03


def test_climb_and_descent_reach_their_heights_with_the_nose_along_the_way() -> None:
    course = ManoeuvreSequence(80.0).hold(5.0).climb(500.0, 8.0).hold(10.0).climb(-200.0, 5.0).hold(5.0)
    trajectory = course.lay(60.0, 30.0, 100.0, 0.0)
    truth = reference(trajectory, 0.0, 40.0, 80.0, course.clock_s)
    assert truth.h_m[[0, 2, 3]] == pytest.approx([100.0, 600.0, 400.0], abs=1e-3)
    assert truth.rpy_deg[1, 1] == pytest.approx(np.rad2deg(np.arctan2(8.0, 80.0)), abs=1e-6)


def test_the_sample_flight_rests_first_and_last_and_has_its_turns() -> None:
    trajectory = sample_trajectories.level_turns()
    t = np.arange(0.0, 1200.5, 0.5)
    truth = reference_table(trajectory.motion(t), 0)
    speed = np.linalg.norm(truth.v_n, axis=1)
    assert np.all(speed[t <= 69.0] < 1e-9) and np.all(speed[t >= 1110.0] < 1e-9)
    assert speed.max() == pytest.approx(100.3, abs=0.1)
    assert truth.rpy_deg[:, 0].max() == pytest.approx(40.0, abs=0.1)
    assert truth.rpy_deg[:, 0].min() == pytest.approx(-45.0, abs=0.1)
    assert (truth.h_m[0], truth.h_m.max(), truth.h_m[-1]) == pytest.approx((20.0, 1520.0, 20.0), abs=0.01)


def test_the_car_stops_and_stays_level() -> None:
    trajectory = sample_trajectories.car(600.0)
    t = np.arange(0.0, 600.0, 0.5)
    truth = reference_table(trajectory.motion(t), 0)
    speed = np.linalg.norm(truth.v_n, axis=1)
    starts = np.count_nonzero((speed[1:] > 0.01) & (speed[:-1] <= 0.01))
    assert starts >= 4 and speed.max() == pytest.approx(14.0, abs=0.01)
    assert np.max(np.abs(truth.rpy_deg[:, :2])) < 1e-6
    assert np.max(np.abs(np.diff(np.unwrap(truth.rpy_deg[:, 2], period=360.0)))) > 5.0


def test_impossible_manoeuvres_are_refused() -> None:
    with pytest.raises(ConfigError, match="needs speed"):
        ManoeuvreSequence().turn(90.0, 30.0)
    with pytest.raises(ConfigError, match="rolling in"):
        ManoeuvreSequence(100.0).turn(3.0, 45.0)
    with pytest.raises(ConfigError, match="ramp"):
        ManoeuvreSequence(100.0).climb(10.0, 8.0)
    with pytest.raises(ConfigError, match="already"):
        ManoeuvreSequence().hold(10.0).hold_until(5.0)
