"""What nobody can observe stays unknown: the heading at rest and on a straight, and what hangs on it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import insgnss
from insgnss.config.flight import GivenStart, ImuGrade
from insgnss.config.library import imu_grade
from insgnss.runs.result import Run
from insgnss.simulation.sample_trajectories import AIRFIELD, car, circle, static
from tests.runs.scenes import even_sky, flight, kinds, simulator, true_start

CONSUMER = ImuGrade(
    gyro_bias_deg_per_h=300.0,
    gyro_bias_instability_deg_per_h=30.0,
    gyro_correlation_time_s=300.0,
    gyro_arw_deg_per_sqrt_h=1.0,
    accel_bias_mg=20.0,
    accel_bias_instability_mg=1.0,
    accel_correlation_time_s=300.0,
    accel_vrw_mps_per_sqrt_h=0.6,
)
SECONDS = 200.0
RUNS = 24
ANGLES = ["roll_deg", "pitch_deg", "yaw_deg"]


@cache
def ratios() -> np.ndarray:
    """Return error over sigma of the attitude at the end of rests that begin with a drawn attitude (runs, 3)."""
    base = simulator(static(SECONDS, *AIRFIELD), SECONDS, navigation=even_sky(), grade=CONSUMER)
    truth = true_start(base, 2.0)
    found = []
    for seed in range(RUNS):
        drawn = np.random.default_rng(900 + seed).standard_normal(3) * [2.0, 2.0, 10.0]
        rpy_deg = tuple((np.array(truth.rpy_deg) + drawn + 180.0) % 360.0 - 180.0)
        start = GivenStart(
            **(truth.model_dump() | {"rpy_deg": rpy_deg, "sd_roll_pitch_deg": 2.0, "sd_yaw_deg": 10.0})
        )
        run = insgnss.replay(flight(base, base.draw(np.random.default_rng(seed)), start=start))
        assert run.errors is not None
        last = run.errors.iloc[-1]
        found.append([last[f"d_{name}"] / last[f"sd_{name}"] for name in ANGLES] + [last["sd_yaw_deg"]])
    return np.array(found)


def test_attitude_at_rest_is_as_uncertain_as_it_says() -> None:
    """0.1 and 99.9 % of chi-square with 24 degrees of freedom are 8.1 and 51.2."""
    mean = np.mean(ratios()[:, :3] ** 2, axis=0)
    assert (mean < 51.2 / RUNS).all(), mean
    assert (mean > 8.1 / RUNS).all(), mean


def test_sigma_of_the_heading_grows_at_rest_by_the_gyro_bias() -> None:
    """Nothing shows the vertical gyro's bias, 300 deg/h over 200 s beside the start's 10 deg."""
    bias = 300.0 / 3600.0 * 198.0
    assert ratios()[:, 3].min() > 0.8 * np.hypot(10.0, bias)


def test_accelerations_show_the_heading_as_before() -> None:
    base = simulator(car(100.0), 100.0, navigation=even_sky(), grade=CONSUMER)
    run = insgnss.replay(flight(base))
    assert run.heading_known_s() is not None
    assert run.nav["sd_yaw_deg"].iloc[-1] < 5.0


# ------------------------------------------------------------------------------------------------ automatic start

UNIFORM_DEG = 90.0  # of 104 for a heading that may be anything


def assert_heading_open(run: Run) -> None:
    """Fail where the run claims to know anything of its heading."""
    assert run.nav["sd_yaw_deg"].min() > UNIFORM_DEG
    assert not {"heading_single", "heading_known"} & set(kinds(run))


@pytest.mark.parametrize("grade", ["mems_consumer", "industrial", "tactical_low"])
def test_no_heading_is_found_at_rest(grade: str) -> None:
    """Ten minutes; in each of them the likelihood of twelve headings is a random walk that says nothing."""
    base = simulator(static(600.0, *AIRFIELD), 600.0, grade=imu_grade(grade), imu_rate_hz=20.0)
    assert_heading_open(insgnss.replay(flight(base, seed=11)))


def test_no_heading_is_found_at_rest_by_a_sensor_five_times_noisier_than_its_grade() -> None:
    base = simulator(static(400.0, *AIRFIELD), 400.0, grade=imu_grade("mems_consumer"), imu_rate_hz=20.0)
    assert_heading_open(insgnss.replay(flight(base, grade=imu_grade("industrial"), seed=13)))


def test_no_heading_is_found_on_a_straight_beyond_the_course() -> None:
    """The start gives the course 70 %, sigma 15 deg; ten minutes of straight flight add nothing to that."""
    straight = circle(400.0, *AIRFIELD[:2], 1500.0, radius_m=1e7, speed_mps=30.0, bank_deg=0.0)
    base = simulator(straight, 400.0, grade=imu_grade("mems_consumer"), imu_rate_hz=20.0)
    for seed in (21, 22):
        run = insgnss.replay(flight(base, seed=seed))
        assert run.nav["sd_yaw_deg"].min() > 50.0
        assert not {"heading_single", "heading_known"} & set(kinds(run))


# ------------------------------------------------------------------------------------------------ what is rest


def start_of(run: Run) -> str:
    return str(run.events["detail"][run.events["kind"] == "start"].iloc[0])


def test_rest_needs_range_rates() -> None:
    """Positions alone know a velocity to metres a second: a car may be driving."""
    base = simulator(static(60.0, *AIRFIELD), 60.0, imu_rate_hz=50.0)
    log = base.draw(np.random.default_rng(2))
    silent = np.full(len(log.gnss.t_ns), np.nan)
    without = replace(log.gnss, doppler_hz=silent, range_rate_mps=silent)
    assert "in motion" in start_of(insgnss.replay(flight(base, log, gnss=without)))
    assert "at rest" in start_of(insgnss.replay(flight(base, log)))
