"""Rows where and when they are wanted: at times, inside outages, before the heading was known, of any point."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pymap3d
import pytest

import insgnss
from insgnss.config.library import imu_grade
from insgnss.errors import ConfigError
from insgnss.filter.smoothing.body_points import local_levels_of
from insgnss.runs.result import Run
from insgnss.simulation.course import ManoeuvreSequence
from insgnss.simulation.sample_trajectories import AIRFIELD, KNOT_S, airborne_turns
from insgnss.simulation.simulated_log import Simulator
from tests.runs.scenes import (
    LEVER_ARM_B,
    START_NS,
    START_S,
    even_sky,
    filters_errors,
    flight,
    rows_where,
    simulator,
    true_start,
    turns,
)
from tests.statistics_bounds import mean_chi_square_bounds

SAMPLE = "data/sample_flight/flight.toml"
OUT_S, BACK_S = 100.0, 160.0  # of an outage
NO_LOOKS = {"health.suspicion_sigma": 0.0}  # of twenty runs one looks back by chance, which takes its time
SEEDS = 20
POSITION, VELOCITY = ("n_m", "e_m", "d_m"), ("vn_mps", "ve_mps", "vd_mps")


@cache
def industrial() -> Simulator:
    return simulator(airborne_turns(180.0), 180.0, grade=imu_grade("industrial"))


def inside(errors: pd.DataFrame | None, from_s: float, to_s: float) -> pd.DataFrame:
    """Return the errors of a part of a run."""
    assert errors is not None
    since = errors["time_s"] - START_S
    return errors[(since > from_s + 0.01) & (since < to_s - 0.01)]


@cache
def outages() -> tuple[list[pd.DataFrame], list[pd.DataFrame]]:
    """Return the errors of filter and smoother inside an outage of a minute, one table for each seed."""
    found: tuple[list[pd.DataFrame], list[pd.DataFrame]] = ([], [])
    for seed in range(SEEDS):
        log = industrial().draw(np.random.default_rng([2026, 11, seed]))
        since = (log.gnss.t_ns - START_NS) / 1e9
        flown = flight(industrial(), log, gnss=rows_where(log.gnss, ~((since > OUT_S) & (since < BACK_S))))
        run = insgnss.replay(flown, output=2.0, smooth=True, settings=NO_LOOKS)
        for tables, errors in zip(found, (filters_errors(run, flown), run.errors), strict=True):
            tables.append(inside(errors, OUT_S, BACK_S))
    return found


def rms(tables: list[pd.DataFrame], names: tuple[str, ...]) -> float:
    return float(np.sqrt(np.mean([np.mean(table[f"d_{name}"] ** 2) for table in tables for name in names])))


@pytest.mark.parametrize("names", [POSITION, VELOCITY])
def test_smoother_errs_a_third_of_the_filter_inside_a_minute_without_measurements(
    names: tuple[str, ...],
) -> None:
    filtered, smoothed = outages()

    assert all(len(table) == 2 * (BACK_S - OUT_S) - 1 for table in smoothed)
    assert rms(smoothed, names) <= 0.35 * rms(filtered, names)


def test_smoothed_sigma_inside_a_minute_without_measurements_is_what_it_errs() -> None:
    """Of the mean over an outage, whose rows err alike, chi^2 of one draw a seed is the widest it may spread."""
    _, smoothed = outages()
    low, high = mean_chi_square_bounds(len(POSITION), SEEDS)
    squares = [sum((t[f"d_{n}"] / t[f"sd_{n}"]) ** 2 for n in POSITION).mean() for t in smoothed]

    assert low < np.mean(squares) < high
    assert 0.7 < np.sqrt(low / len(POSITION)) < np.sqrt(high / len(POSITION)) < 1.31


@cache
def sample(smooth: bool) -> Run:
    return insgnss.replay(SAMPLE, output=5.0, smooth=smooth)


def test_smoothed_run_knows_the_heading_before_the_filter_did() -> None:
    filtered, smoothed = sample(smooth=False), sample(smooth=True)
    known = filtered.heading_known_s()
    assert known is not None
    assert filtered.errors is not None
    assert smoothed.errors is not None
    unknown = (filtered.nav["n_hypotheses"] > 1).to_numpy()
    before = smoothed.errors["time_s"] < known

    assert unknown.sum() > 30
    assert (smoothed.nav["n_hypotheses"] == 1).all()
    assert np.abs(filtered.errors["d_yaw_deg"][before]).max() > 10.0
    assert np.abs(smoothed.errors["d_yaw_deg"][before]).max() < 0.2
    ratio = (smoothed.errors["d_yaw_deg"] / smoothed.errors["sd_yaw_deg"])[before]
    assert 0.02 < np.sqrt(np.mean(ratio**2)) < 3.0  # one draw: the whole time before errs alike
    for name in ("n_m", "vn_mps", "roll_deg"):
        errors = [np.sqrt(np.mean(run.errors[f"d_{name}"][before] ** 2)) for run in (smoothed, filtered)]
        assert errors[0] < errors[1]


def test_smoother_goes_through_a_heading_that_was_lost_and_found() -> None:
    """A consumer's gyros lose the heading at rest: the filter opens it, the next corner finds it again."""
    course = ManoeuvreSequence().hold(5.0).change_speed(14.0, 8.0).hold(12.0).steer(90.0, 5.0).hold(10.0)
    course.change_speed(0.0, 5.0).hold(400.0).change_speed(14.0, 8.0).hold(12.0).steer(-90.0, 5.0).hold(15.0)
    drive = course.lay(*AIRFIELD, 80.0, knot_s=KNOT_S)
    base = simulator(drive, course.clock_s - 1.0, grade=imu_grade("mems_consumer"), navigation=even_sky())
    flown = flight(base, start=true_start(base, 1.0), seed=2)

    # without states of its sensors' errors the filter loses the heading three times as fast
    settings = {"process.sensor_error_states": []}
    filtered, smoothed = (
        insgnss.replay(flown, output=2.0, smooth=smooth, settings=settings) for smooth in (False, True)
    )

    assert {"heading_open", "heading_single"} <= set(filtered.events["kind"])
    assert (smoothed.nav["n_hypotheses"] == 1).all()
    tables = [inside(run.errors, 200.0, 440.0) for run in (filtered, smoothed)]
    assert rms([tables[1]], ("yaw_deg",)) < 0.25 * rms([tables[0]], ("yaw_deg",))
    assert (np.abs(tables[1]["d_yaw_deg"]) < 3.0 * tables[1]["sd_yaw_deg"]).all()
    assert tables[1]["sd_yaw_deg"].max() < 2.0
    steps_m = smoothed.nav["h_m"].diff().abs()
    assert steps_m.max() < 0.5  # no leap where one filter takes over from the other


def test_smoothed_rows_at_epochs_are_the_same_at_any_rate() -> None:
    at_epochs, often = insgnss.replay(SAMPLE, smooth=True), sample(smooth=True)
    both = often.nav.merge(at_epochs.nav, on="time_s", suffixes=("", "_epochs"))

    assert len(both) > 1000
    for name in ("lat_deg", "vd_mps", "yaw_deg", "sd_d_m", "gyro_bias_z_radps"):
        np.testing.assert_array_equal(both[name], both[f"{name}_epochs"])


def test_smoother_goes_on_across_a_step_that_the_filter_was_set_right_by() -> None:
    """A sensor lies for 5 s: the filter's sigma knows nothing of it, the smoother's does."""
    base = industrial()
    log = base.draw(np.random.default_rng([2026, 12]))
    since, since_imu = (log.gnss.t_ns - START_NS) / 1e9, (log.imu.t_ns - START_NS) / 1e9
    f_b = log.imu.f_b.copy()
    f_b[(since_imu > 125.0) & (since_imu < 130.0), 0] += 3.0
    gnss = rows_where(log.gnss, ~((since > 110.0) & (since < 150.0)))
    flown = flight(base, log, gnss=gnss, imu=replace(log.imu, f_b=f_b))

    run = insgnss.replay(flown, output=2.0, smooth=True)
    filtered, smoothed = (inside(e, 130.0, 155.0) for e in (filters_errors(run, flown), run.errors))

    ratio = {
        name: [float(np.sqrt(np.mean((t[f"d_{name}"] / t[f"sd_{name}"]) ** 2))) for t in (filtered, smoothed)]
        for name in (*POSITION[:2], *VELOCITY[:2])
    }
    assert all(one[0] > 5.0 for one in ratio.values())
    assert all(one[1] < 1.3 for one in ratio.values())
    assert rms([smoothed], POSITION) < 0.35 * rms([filtered], POSITION)


@cache
def steps() -> Run:
    """Return a run with a row at each inertial sample."""
    return insgnss.replay(flight(turns()), output="imu", point=LEVER_ARM_B)


def test_rows_at_times_are_those_of_the_filter_at_these_times() -> None:
    chosen = steps().nav.iloc[[2000, 2001, 3333, 7000]]
    early = [START_S + 0.3, START_S + 0.5]  # the filter starts with the first epoch

    run = insgnss.replay(flight(turns()), output=[*early, *chosen["time_s"]])

    pd.testing.assert_frame_equal(run.nav, chosen[run.nav.columns].reset_index(drop=True), check_exact=True)
    told = run.events[run.events["kind"] == "output_times"]
    assert told["detail"].str.startswith("2 of 6 output times have no row").tolist() == [True]
    assert run.settings["output"] == "times"


@pytest.mark.parametrize(
    ("times", "told"),
    [
        ([START_S + 5.0, START_S + 4.0], "do not increase"),
        ([START_S + 5.0, float("nan")], "value 2 of 2, nan, is not a finite number"),
        ([], "not one list"),
        (["noon"], "value 1 of 1, 'noon', is not a time"),
        (["2025-09-24 09:36:22"], "has no zone"),
        ([START_S, [START_S + 1.0]], "not one list"),
        ([START_S + 5.0, 1e300], "not seconds"),
        ([START_S - 50.0, START_S - 40.0], "no output time"),
        (True, "True is neither an output rate nor a time"),
    ],
)
def test_times_that_cannot_be_used_are_an_error(times: Any, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        insgnss.replay(flight(turns()), output=times)


def test_point_of_the_body_is_where_the_truth_says() -> None:
    """The truth of the antenna is the simulation's own motion; the filter knows it better than the IMU."""
    run = steps()
    rows = run.nav[run.nav["time_s"] > START_S + 60.0].iloc[::500]
    motion = turns().scenario.trajectory.motion(rows["time_s"].to_numpy() - START_S)
    arm_e = np.einsum("kij,j->ki", motion.C_eb, LEVER_ARM_B)
    about = np.einsum("kij,kj->ki", motion.C_eb, np.cross(motion.w_eb_b, LEVER_ARM_B))
    r_e = np.column_stack(pymap3d.geodetic2ecef(*(rows[f"point_{c}"] for c in ("lat_deg", "lon_deg", "h_m"))))
    C_ne = local_levels_of(r_e)[1]
    errors = np.einsum("kij,kj->ki", C_ne, r_e - motion.r_e - arm_e)
    v_n = np.einsum("kij,kj->ki", C_ne, motion.v_e + about)
    errors_v = rows[[f"point_{name}" for name in VELOCITY]].to_numpy() - v_n

    for found, names in ((errors, POSITION), (errors_v, VELOCITY)):
        ratio = found / rows[[f"sd_point_{name}" for name in names]].to_numpy()
        assert 0.2 < np.sqrt(np.mean(ratio**2)) < 2.0  # one draw
    assert np.abs(errors_v).max() < 0.06
    turning = np.linalg.norm(about, axis=1)
    assert turning.max() > 0.09  # a point that forgot to turn would be seen


def test_what_is_asked_for_beside_a_row_changes_no_bit_of_it() -> None:
    plain, more = (
        insgnss.replay(SAMPLE, output=2.0),
        insgnss.replay(SAMPLE, output=2.0, point="antenna", quaternion=True, covariance=True),
    )

    pd.testing.assert_frame_equal(more.nav[plain.nav.columns], plain.nav, check_exact=True)
    pd.testing.assert_frame_equal(more.measurements, plain.measurements, check_exact=True)
    nav = more.nav
    for axis in "ned":  # also while several headings are open
        np.testing.assert_allclose(np.sqrt(nav[f"cov_{axis}_{axis}_m2"]), nav[f"sd_{axis}_m"], rtol=1e-6)
        np.testing.assert_allclose(
            np.sqrt(nav[f"cov_v{axis}_v{axis}_m2ps2"]), nav[f"sd_v{axis}_mps"], rtol=1e-6
        )
    assert np.isfinite(nav.to_numpy(np.float64)).all()
    assert (nav["sd_point_n_m"] < nav["sd_n_m"] + 1.2).all()


def test_saved_run_keeps_what_was_asked_for(tmp_path: Path) -> None:
    run = insgnss.replay(
        flight(turns()), smooth=True, point=(1.0, 0.5, -2.0), quaternion=True, covariance=True
    )

    for form in ("parquet", "csv"):
        loaded = Run.load(run.save(tmp_path / form, form))  # type: ignore[arg-type]
        pd.testing.assert_frame_equal(loaded.nav, run.nav)
        assert loaded.settings["point"] == [1.0, 0.5, -2.0]


def test_point_has_a_name_of_the_flight_file() -> None:
    flown = flight(turns())
    named = replace(flown, config=flown.config.model_copy(update={"points": {"camera": (1.0, 2.0, 3.0)}}))

    by_name, by_place = (
        insgnss.replay(named, output=1.0, point=point).nav for point in ("camera", [1.0, 2.0, 3.0])
    )

    pd.testing.assert_frame_equal(by_name, by_place)
    with pytest.raises(
        ConfigError, match="no point 'radar' in the flight file; it names 'antenna', 'camera'"
    ):
        insgnss.replay(named, point="radar")
    with pytest.raises(ConfigError, match="invalid point of the body"):
        insgnss.replay(named, point=(1.0, 2.0))
    with pytest.raises(ConfigError, match="invalid point of the body"):
        insgnss.replay(named, point=(1.0, 2.0, 1e9))
