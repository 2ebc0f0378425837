"""The smoother over several antennas' rows: errors as large as they say, and smaller than the filter's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.log.flight import Flight
from insgnss.runs.result import Run
from insgnss.studies.outage.windows import OutageWindow, Removal
from tests.attitude.several_flights import SLALOM, events, normalised, scenario_text, write_flight
from tests.runs.scenes import filters_errors
from tests.statistics_bounds import CONFIDENCE, mean_chi_square_bounds
from tests.studies.flight_without import flight_without

RUNS = 10
LOOKS = (0, 4, 12, 24)  # epochs: the start with every heading open, some after it, and one near the end
ANGLES = ("d_roll_deg", "d_pitch_deg", "d_yaw_deg")


def both(path: Path) -> tuple[Run, pd.DataFrame]:
    """Return a flight smoothed, and the errors that the filter had."""
    run = insgnss.replay(path, smooth=True)
    return run, filters_errors(run, Flight.load(path))


def angles(errors: pd.DataFrame | None) -> np.ndarray:
    """Return the attitude errors of a run, (rows, 3) [deg]."""
    assert errors is not None
    return errors[list(ANGLES)].to_numpy()


def test_smoothed_attitude_at_rest_is_as_wrong_as_it_says_and_better_than_the_filters(tmp_path: Path) -> None:
    squares, smoothed, filtered = [], [], []
    for seed in range(RUNS):
        clocks = "separate" if seed % 2 else "common"
        text = scenario_text(clocks=clocks, clock_bias_m=60_000.0)
        run, forward = both(write_flight(tmp_path, text, seed=seed))
        squares.append(np.sum(normalised(run)[list(LOOKS)] ** 2, axis=1))
        smoothed.append(angles(run.errors))
        filtered.append(angles(forward))
        sd = [table[["sd_roll_deg", "sd_pitch_deg", "sd_yaw_deg"]] for table in (run.nav, forward)]
        assert (sd[0].to_numpy() <= sd[1].to_numpy() * (1.0 + 1e-6)).all()

    low, high = mean_chi_square_bounds(3, RUNS, 1.0 - (1.0 - CONFIDENCE) / len(LOOKS))
    nees = np.mean(squares, axis=0)
    assert (nees > low).all(), nees
    assert (nees < high).all(), nees
    # from the fourth epoch on the filter knows its heading too
    rms = [np.sqrt(np.mean(np.array(found)[:, 4:] ** 2, axis=(0, 1))) for found in (smoothed, filtered)]
    assert (rms[0] < 0.8 * rms[1]).all(), rms


@pytest.mark.parametrize("clocks", ["common", "separate"])
def test_smoothed_attitude_in_turns_is_within_its_sigma_and_not_worse_than_the_filters(
    tmp_path: Path, clocks: str
) -> None:
    """In turns the filter counts motion that its samples do not show: both sigmas may be too large."""
    text = scenario_text(clocks=clocks, manoeuvres=SLALOM, speed_mps=60.0, clock_bias_m=60_000.0)
    squares, smoothed, filtered = [], [], []
    for seed in range(4):
        run, forward = both(write_flight(tmp_path, text, seed=seed))
        squares.append(np.mean(np.sum(normalised(run) ** 2, axis=1)))
        smoothed.append(angles(run.errors)[5:])
        filtered.append(angles(forward)[5:])

    # of 68 epochs some ten are independent
    low, high = mean_chi_square_bounds(3, 4 * 68, effective_share=0.15)
    assert 0.5 * low < np.mean(squares) < high
    rms = [np.sqrt(np.mean(np.array(found) ** 2)) for found in (smoothed, filtered)]
    assert rms[0] < 0.9 * rms[1], rms


def test_smoothed_rows_between_epochs_have_no_step_at_them(tmp_path: Path) -> None:
    path = write_flight(tmp_path, scenario_text(manoeuvres=SLALOM, speed_mps=60.0))

    run, forward = insgnss.replay(path, smooth=True, output=20.0), insgnss.replay(path, output=20.0)

    assert run.filtered is not None and run.filtered["yaw_deg"].equals(forward.nav["yaw_deg"])
    steps = [np.diff(table["sd_yaw_deg"].to_numpy()[100:-20]) for table in (run.nav, forward.nav)]
    assert np.abs(steps[0]).max() < 0.1 * np.abs(steps[1]).max()
    error = [np.diff(found.errors["d_yaw_deg"].to_numpy()[100:-20]) for found in (run, forward)]
    assert np.abs(error[0]).max() < 0.25 * np.abs(error[1]).max()


def test_a_heading_that_the_antennas_set_anew_is_right_before_them_too(tmp_path: Path) -> None:
    """A given start is 36 deg off and says 10 deg: the antennas find the heading, the smoother goes back over it."""
    path = write_flight(tmp_path, scenario_text())
    text = path.read_text(encoding="utf-8")
    wrong = (
        "[start]\nlat_deg = 59.97\nlon_deg = 30.37\nh_m = 40.0\nv_ned_mps = [0.0, 0.0, 0.0]\n"
        "rpy_deg = [0.0, 0.0, 163.0]\nsd_yaw_deg = 10.0\n"
    )
    text = text.replace('start = "automatic"\n', "").replace("[imu]\n", wrong + "[imu]\n", 1)
    path.write_text(text, encoding="utf-8")

    run, forward = both(path)

    assert len(events(run, "attitude_found")) == 1
    assert np.abs(angles(forward)[0, 2]) > 35.0
    assert np.abs(angles(run.errors)[:, 2]).max() < 5.0
    assert np.abs(normalised(run)[:, 2]).max() < 3.3


def test_smoothed_attitude_in_an_outage_of_all_antennas_is_far_better_than_the_filters(
    tmp_path: Path,
) -> None:
    """Twenty seconds in turns without a measurement: the differences on both sides hold the attitude between them."""
    gone = OutageWindow(150_025.0, 150_045.0)
    errors_in, squares = [], []
    for seed in range(4):
        path = write_flight(tmp_path, scenario_text(manoeuvres=SLALOM, speed_mps=60.0), seed=seed)
        flight = flight_without(Flight.load(path), gone, Removal())
        run = insgnss.replay(flight, smooth=True, output=2.0)
        inside = run.nav["time_s"].between(150_025.5, 150_044.5).to_numpy()
        errors_in.append([angles(table)[inside] for table in (run.errors, filters_errors(run, flight))])
        squares.append(np.mean(np.sum(normalised(run)[inside] ** 2, axis=1)))

    smoothed, filtered = np.sqrt(np.mean(np.array(errors_in) ** 2, axis=(0, 2)))
    assert (smoothed < 0.6 * filtered).all(), (smoothed, filtered)
    # of each run some two independent values; in turns sigma may be too large
    low, high = mean_chi_square_bounds(3, 8)
    assert 0.5 * low < np.mean(squares) < high
