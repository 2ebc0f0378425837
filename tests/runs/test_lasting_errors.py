"""Errors of the sensors that last: scale factors and misalignments that a circling flight adds up.

Ten laps at 25 deg of bank turn a gyro's scale factor and misalignment into angles that no noise makes. The filter has
them as white noise: sixty seconds after the roll-out its attitude is off by more than it says, at other times by less.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import insgnss
from insgnss.runs.simulate import simulate
from tests.statistics_bounds import mean_chi_square_bounds

GRADES = ("mems_consumer", "industrial", "tactical")
SEEDS = (21, 22)
AFTER_S = 60.0  # after the roll-out
LAST_S = 120.0  # straight, to the end
LOITER = """\
gps_week = 2385
start_s = 300000.0
place = { lat_deg = 47.0, lon_deg = 8.0, h_m = 300.0, heading_deg = 35.0 }
speed_mps = 50.0
reference_rate_hz = 1.0
[[manoeuvre]]
kind = "straight"
duration_s = 40.0
[[manoeuvre]]
kind = "turn"
by_deg = 45.0
bank_deg = 25.0
[[manoeuvre]]
kind = "turn"
by_deg = -90.0
bank_deg = 25.0
[[manoeuvre]]
kind = "straight"
duration_s = 20.0
[[manoeuvre]]
kind = "turn"
by_deg = 3600.0
bank_deg = 25.0
[[manoeuvre]]
kind = "straight"
duration_s = 120.0
[imu]
grade = "GRADE"
rate_hz = 50.0
[gnss]
rate_hz = 1.0
lever_arm_m = [0.5, 0.1, -0.8]
"""


def normalised_attitude(folder: Path, grade: str) -> np.ndarray:
    """Return error over sigma of roll, pitch, yaw a minute after the roll-out, (seeds, 3)."""
    path = folder / "loiter.toml"
    path.write_text(LOITER.replace("GRADE", grade), encoding="utf-8")
    found = []
    for seed in SEEDS:
        simulate(path, seed).save(folder / "logs")
        errors = insgnss.replay(folder / "logs" / "flight.toml").errors
        assert errors is not None
        at_s = errors["time_s"].iloc[-1] - (LAST_S - AFTER_S)
        row = errors.iloc[int((errors["time_s"] - at_s).abs().argmin())]
        found.append([row[f"d_{angle}_deg"] / row[f"sd_{angle}_deg"] for angle in ("roll", "pitch", "yaw")])
    return np.array(found)


def test_attitude_a_minute_after_ten_laps_is_off_by_what_the_filter_says(tmp_path: Path) -> None:
    """Roll alone of all grades together, then the three angles of each; 2.8 sigma rms where turns leave noise alone."""
    squares = {grade: normalised_attitude(tmp_path, grade) ** 2 for grade in GRADES}

    low, high = mean_chi_square_bounds(1, len(GRADES) * len(SEEDS))
    assert low < np.mean([found[:, 0] for found in squares.values()]) < high
    for found in squares.values():
        low, high = mean_chi_square_bounds(3, len(SEEDS))
        assert low < found.sum(axis=1).mean() < high
