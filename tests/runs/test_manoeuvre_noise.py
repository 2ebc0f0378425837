"""What a manoeuvre makes of scale factors and misalignments is in the sigma of the attitude."""

from __future__ import annotations

import numpy as np

import insgnss
from insgnss.config.library import imu_grade
from insgnss.simulation.sample_trajectories import car
from tests.runs.scenes import START_S, even_sky, flight, simulator

RUNS = 6


def test_level_car_in_corners_is_as_uncertain_in_roll_and_pitch_as_it_says() -> None:
    """Its corners and brakes hardly lengthen the specific force, yet 1 % of them tilts what levels it.

    Counted by the force's length alone, the mean squares of error over sigma are 3.3.
    """
    base = simulator(car(200.0), 200.0, navigation=even_sky(), grade=imu_grade("mems_consumer"))
    squares = []
    for seed in range(RUNS):
        run = insgnss.replay(flight(base, base.draw(np.random.default_rng(seed))))
        assert run.errors is not None
        driven = run.errors[run.errors["time_s"] > START_S + 60.0]
        ratios = [driven[f"d_{axis}"] / driven[f"sd_{axis}"] for axis in ("roll_deg", "pitch_deg")]
        squares.append([np.mean(ratio**2) for ratio in ratios])
    assert (np.mean(squares, axis=0) < 2.0).all(), squares
