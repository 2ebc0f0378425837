"""A smoothed run over gaps in the inertial samples: what comes after a gap tells of what came before it."""

from __future__ import annotations

import copy
import itertools
from dataclasses import replace
from functools import cache
from typing import Any, Final

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.config.library import imu_grade
from insgnss.constants import NS_PER_S
from insgnss.log.flight import FlightInMemory
from insgnss.runs.result import Run
from insgnss.simulation.simulated_log import Simulator
from insgnss.tables import Bool, Float64
from tests.runs.scenes import LEVER_ARM_B, START_NS, START_S, filters_errors, flight, turns
from tests.statistics_bounds import CONFIDENCE, mean_chi_square_bounds, nees

GAP_S: Final = 110.0  # since the flight's beginning
OUTAGE_S: Final = 60.0  # before the gap
SEEDS: Final = range(9100, 9112)
SIGMAS: Final = [f"sd_{name}" for name in ("n_m", "e_m", "d_m", "vn_mps", "vd_mps", "roll_deg", "yaw_deg")]
BLOCKS: Final = {  # the errors' columns, and those of their covariance
    "position": (("n_m", "e_m", "d_m"), "cov_{}_{}_m2", "ned"),
    "velocity": (("vn_mps", "ve_mps", "vd_mps"), "cov_v{}_v{}_m2ps2", "ned"),
    "heading": (("yaw_deg",), "", ""),
}


@cache
def in_turns(duration_s: float, grade: str) -> Simulator:
    base = copy.copy(turns(duration_s))
    base.scenario = replace(base.scenario, grade=imu_grade(grade))
    return base


def rows(table: Any, keep: Bool) -> Any:
    """Return these rows of a table whose columns are as long."""
    columns = {name: getattr(table, name) for name in table.__dataclass_fields__}
    whole = [
        name for name, value in columns.items() if isinstance(value, np.ndarray) and len(value) == len(keep)
    ]
    return replace(table, **{name: columns[name][keep] for name in whole})


def spoilt(
    seed: int,
    gaps: tuple[tuple[float, float], ...],
    wait_s: float,
    outage_s: float = OUTAGE_S,
    after_s: float = 20.0,
    grade: str = "industrial",
) -> FlightInMemory:
    """Return a flight without inertial samples in the gaps, and without fixes before the first and after each."""
    base = in_turns(gaps[-1][1] + wait_s + after_s, grade)
    log = base.draw(np.random.default_rng(seed))
    t_imu, t_gnss = ((one.t_ns - START_NS) / NS_PER_S for one in (log.imu, log.gnss))
    sampled, seen = np.ones(len(t_imu), np.bool_), np.ones(len(t_gnss), np.bool_)
    for begin, end in gaps:
        sampled &= (t_imu <= begin) | (t_imu >= end)
        seen &= (t_gnss < begin) | (t_gnss >= end + wait_s)
    seen &= (t_gnss <= gaps[0][0] - outage_s) | (t_gnss > gaps[0][0])
    return flight(base, log, imu=rows(log.imu, sampled), gnss=rows(log.gnss, seen))


def between(table: pd.DataFrame, first_s: float, last_s: float) -> pd.DataFrame:
    """Return the rows from one time since the first sample up to another, both inside."""
    t = table["time_s"] - START_S
    return table[(t > first_s - 1e-6) & (t < last_s + 1e-6)]


def errors_of(run: Run, block: str, first_s: float, last_s: float) -> tuple[Float64, Float64]:
    """Return the errors (m, k) of a run in a span of time, and its covariances (m, k, k) of them."""
    assert run.errors is not None
    names, covariance, axes = BLOCKS[block]
    off = between(run.errors, first_s, last_s)[[f"d_{name}" for name in names]].to_numpy()
    told = between(run.nav, first_s, last_s)
    if not axes:
        return off, told[[f"sd_{names[0]}"]].to_numpy()[:, :, None] ** 2
    P = np.zeros((len(told), 3, 3))
    for i, j in itertools.combinations_with_replacement(range(3), 2):
        P[:, i, j] = P[:, j, i] = told[covariance.format(axes[i], axes[j])]
    return off, P


OUTAGE_AND_GAP: Final = (((GAP_S, GAP_S + 3.0),), 2.0)


@cache
def after_an_outage() -> list[tuple[pd.DataFrame, Run]]:
    """Return the filter's errors, and runs: a minute without fixes, then a gap of 3 s, and 2 s later the next fix."""
    found = []
    for seed in SEEDS:
        flown = spoilt(seed, *OUTAGE_AND_GAP)
        run = insgnss.replay(flown, smooth=True, output=5.0, covariance=True)
        found.append((filters_errors(run, flown), run))
    return found


def test_outage_that_ends_in_a_gap_is_smoothed_from_behind_the_gap() -> None:
    """Without the way over the gap the smoothed rows would be the filter's."""
    names = [f"d_{name}" for name in BLOCKS["position"][0]]
    squares = [
        [between(table, GAP_S - OUTAGE_S, GAP_S)[names].to_numpy() ** 2 for table in (errors, run.errors)]
        for errors, run in after_an_outage()
    ]

    filtered, smoothed = np.sqrt(np.mean(squares, axis=(0, 2, 3)))

    assert smoothed < 0.35 * filtered


def test_data_after_a_gap_make_no_sigma_before_it_larger() -> None:
    for filtered, smoothed in after_an_outage():
        tables = (filtered, smoothed.nav)
        sd = [between(table, GAP_S - OUTAGE_S, GAP_S)[SIGMAS].to_numpy() for table in tables]
        assert (sd[1] <= sd[0] * (1.0 + 1e-6)).all()


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize("at_s", [GAP_S - 20.0, GAP_S, GAP_S + 3.0, GAP_S + 4.0])
def test_errors_before_and_after_a_gap_are_as_large_as_their_covariance_says(block: str, at_s: float) -> None:
    dof, tests = len(BLOCKS[block][0]), 4 * len(BLOCKS)
    low, high = mean_chi_square_bounds(dof, len(SEEDS), 1.0 - (1.0 - CONFIDENCE) / tests)

    found = [nees(*errors_of(smoothed, block, at_s, at_s))[0] for _, smoothed in after_an_outage()]

    if (block, at_s) == ("position", GAP_S):
        low = 0.0  # its sigma is that of the motion in the gap, where less was flown than could have been
    assert low < np.mean(found) < high


def test_rows_begin_with_the_first_sample_after_the_gap() -> None:
    filtered, (_, smoothed) = (
        insgnss.replay(spoilt(SEEDS[0], *OUTAGE_AND_GAP), output=5.0),
        after_an_outage()[0],
    )

    added = between(smoothed.nav, GAP_S + 3.0, GAP_S + 5.0 - 0.1)

    assert len(between(filtered.nav, GAP_S + 3.0, GAP_S + 5.0 - 0.1)) == 0
    np.testing.assert_allclose(added["time_s"] - START_S, GAP_S + 3.0 + 0.2 * np.arange(10), atol=1e-6)
    assert (added["n_used"] == 0).all() and (added["n_hypotheses"] == 1).all()
    assert (np.diff(smoothed.nav["time_s"]) > 0.0).all()
    assert smoothed.filtered is not None
    pd.testing.assert_series_equal(smoothed.filtered["lat_deg"], filtered.nav["lat_deg"])


def test_long_gap_leaves_the_sensors_errors_alone() -> None:
    """A minute and a half later a bias still tells of what it was; the place does not."""
    flown = spoilt(9200, ((30.0, 120.0),), 2.0, outage_s=5.0, after_s=60.0)
    filtered, smoothed = (insgnss.replay(flown, smooth=smooth) for smooth in (False, True))

    before = [run.nav[run.nav["time_s"] < START_S + 30.0].iloc[-1] for run in (filtered, smoothed)]

    assert 0.99 < before[1]["sd_n_m"] / before[0]["sd_n_m"] <= 1.0
    for name in ("sd_accel_bias_x_mps2", "sd_accel_bias_z_mps2", "sd_gyro_bias_x_radps"):
        assert 0.2 < before[1][name] / before[0][name] < 0.9


def test_way_back_from_a_late_fix_is_as_long_as_the_samples() -> None:
    """An aircraft that has turned by 180 deg until the first fix: a straight line back would be kilometres off."""
    runs = [
        insgnss.replay(
            spoilt(seed, ((30.0, 34.0),), 60.0, outage_s=0.0), smooth=True, output=1.0, covariance=True
        )
        for seed in range(9210, 9214)
    ]
    low, high = mean_chi_square_bounds(3, len(runs), 1.0 - (1.0 - CONFIDENCE) / 3)

    for at_s in (35.0, 60.0, 90.0):
        found = [errors_of(run, "position", at_s, at_s) for run in runs]
        assert low < np.mean([nees(off, P)[0] for off, P in found]) < high
        assert all(np.linalg.norm(off) < 1000.0 for off, _ in found)


def test_every_gap_of_a_log_is_crossed() -> None:
    gaps = ((GAP_S, GAP_S + 3.0), (GAP_S + 20.0, GAP_S + 24.0))
    run = insgnss.replay(spoilt(9201, gaps, 1.0), smooth=True, output=5.0, point=LEVER_ARM_B)
    assert run.errors is not None

    t = np.asarray(run.nav["time_s"]) - START_S

    missing = [t[i : i + 2] for i in np.flatnonzero(np.diff(t) > 0.3)]
    np.testing.assert_allclose(missing, gaps, atol=1e-6)
    for _, end in gaps:
        rows_after = between(run.nav, end, end + 0.8)
        assert len(rows_after) == 5
        off = between(run.errors, end, end + 0.8)[["d_n_m", "d_e_m", "d_d_m"]].to_numpy()
        assert np.abs(off / rows_after[["sd_n_m", "sd_e_m", "sd_d_m"]].to_numpy()).max() < 4.0
        assert (rows_after["sd_point_n_m"] < 2.0).all()


@pytest.mark.parametrize("seed", [9220, 9221, 9222])
def test_heading_that_is_corrected_by_much_leaves_the_tilt_right(seed: int) -> None:
    """After a gap in a turn the heading has a sigma of 16 deg, and gyros of navigation grade know the tilt at once."""
    flown = spoilt(seed, ((22.7, 27.7),), 1.3, outage_s=0.0, grade="navigation")
    run = insgnss.replay(flown, smooth=True)
    assert run.errors is not None

    errors, told = (between(table, 27.7, 45.0) for table in (run.errors, run.nav))

    for name in ("roll_deg", "pitch_deg", "yaw_deg"):
        assert (errors[f"d_{name}"].abs() < 5.0 * told[f"sd_{name}"]).all()


def test_gap_before_which_the_heading_was_open_stays_as_it_was() -> None:
    """Which of the headings was right the later filter does not say: it has a heading of its own."""
    flown = spoilt(9202, ((9.0, 13.0),), 0.0, outage_s=0.0)
    filtered, smoothed = (insgnss.replay(flown, smooth=smooth) for smooth in (False, True))

    before = [between(run.nav, 0.0, 9.0) for run in (filtered, smoothed)]

    assert len(before[0]) and (before[0]["n_hypotheses"] > 1).all()
    pd.testing.assert_frame_equal(*before)
