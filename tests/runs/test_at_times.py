"""Rows of a run between its rows: right to what is told, and an error where more would be lost."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest

import insgnss
from insgnss.errors import ResultError
from insgnss.runs.between_rows import InterpolationLimits, rows_at
from insgnss.runs.result import Run
from insgnss.runs.wanted_times import week_seconds
from tests.runs.scenes import LEVER_ARM_B, START_S, flight, turns

ANY = InterpolationLimits(1e9, 1e9, 1e9)
FROM_S, TO_S = 60.0, 110.0  # the heading is known


@cache
def steps() -> Run:
    """Return a smoothed run with a row at each inertial sample: without the leaps of a filter's updates."""
    return insgnss.replay(
        flight(turns()), output="imu", smooth=True, point=LEVER_ARM_B, quaternion=True, covariance=True
    )


def every(n: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return each n-th row, and the rows between them."""
    nav = steps().nav
    nav = nav[(nav["time_s"] >= START_S + FROM_S) & (nav["time_s"] <= START_S + TO_S)]
    kept = np.arange(len(nav)) % n == 0
    last = len(nav) - 1 - (len(nav) - 1) % n
    return nav[kept].reset_index(drop=True), nav.iloc[:last][~kept[:last]].reset_index(drop=True)


def off_deg(found: pd.DataFrame, expected: pd.DataFrame, name: str) -> pd.Series:
    return (found[name] - expected[name] + 180.0) % 360.0 - 180.0


def test_rows_at_ten_a_second_give_those_between_them() -> None:
    nav, between = every(10)

    found = rows_at(nav, between["time_s"], InterpolationLimits(0.2, 0.2, 0.5))

    for name in ("roll_deg", "pitch_deg", "yaw_deg"):
        assert np.abs(off_deg(found, between, name)).max() < 0.04
    for name in ("vn_mps", "ve_mps", "vd_mps", "point_vn_mps", "point_vd_mps"):
        assert np.abs(found[name] - between[name]).max() < 0.03
    for name, metres in (("lat_deg", 111e3), ("lon_deg", 56e3), ("h_m", 1.0), ("point_lat_deg", 111e3)):
        assert np.abs(found[name] - between[name]).max() * metres < 2e-3
    np.testing.assert_allclose(found["cov_vn_ve_m2ps2"], between["cov_vn_ve_m2ps2"], atol=1e-5)
    np.testing.assert_allclose(found["q_nb_x"].abs(), between["q_nb_x"].abs(), atol=1e-3)


@pytest.mark.parametrize("n", [20, 50, 100])
def test_what_is_lost_between_rows_is_in_their_sigma(n: int) -> None:
    """The estimate is neither below what is lost nor ten times as large."""
    nav, between = every(n)

    found = rows_at(nav, between["time_s"], ANY)

    for names in (("roll_deg", "pitch_deg", "yaw_deg"), ("vn_mps", "ve_mps", "vd_mps")):
        lost2 = sum(off_deg(found, between, name) ** 2 for name in names)
        told2 = sum(found[f"sd_{name}"] ** 2 - between[f"sd_{name}"] ** 2 for name in names)
        share = np.sqrt(np.mean(lost2) / np.mean(told2))
        assert 0.1 < share < 1.0


def test_rows_a_second_apart_are_too_few_for_a_turn() -> None:
    nav, between = every(100)
    straight = np.abs(between["roll_deg"]) < 0.5

    with pytest.raises(
        ResultError, match=r"rows 1 s apart are too far for the motion at .*attitude may be"
    ) as error:
        rows_at(nav, between["time_s"], InterpolationLimits(0.2, 0.2, 0.5))

    assert "replay with output=times" in error.value.advice
    worst = np.abs(off_deg(rows_at(nav, between["time_s"], ANY), between, "roll_deg")).max()
    assert worst > 1.0  # as is told
    assert straight.any()


def test_row_at_the_time_of_a_row_is_that_row() -> None:
    run = steps()
    chosen = run.nav.iloc[[5000, 17, 5000, len(run.nav) - 1, 0]].reset_index(drop=True)

    found = run.at(chosen["time_s"])

    pd.testing.assert_frame_equal(found, chosen, check_exact=True)


@pytest.mark.parametrize("time_s", [START_S - 1.0, START_S + 1e4])
def test_time_outside_the_run_is_an_error(time_s: float) -> None:
    with pytest.raises(ResultError, match="is outside the run; 1 of 2 times are refused"):
        steps().at([START_S + 80.0, time_s])


def test_gap_of_the_rows_is_an_error() -> None:
    nav, _ = every(10)
    gap = nav[(nav["time_s"] < START_S + 80.0) | (nav["time_s"] > START_S + 83.0)].reset_index(drop=True)

    with pytest.raises(ResultError, match="no row between"):
        rows_at(gap, [START_S + 81.0], ANY)
    assert len(rows_at(gap, [START_S + 79.55], ANY)) == 1


def test_run_of_one_row_or_none_answers() -> None:
    nav = steps().nav
    one = nav.iloc[:1]

    pd.testing.assert_frame_equal(rows_at(one, one["time_s"], ANY), one)
    with pytest.raises(ResultError, match="outside the run"):
        rows_at(one, [float(one["time_s"].iloc[0]) + 0.1], ANY)
    with pytest.raises(ResultError, match="no navigation row"):
        rows_at(nav.iloc[:0], [START_S], ANY)


def test_yaw_goes_the_short_way_round() -> None:
    nav = steps().nav.iloc[6000:6002].reset_index(drop=True)
    nav["yaw_deg"] = [179.0, -179.0]
    middle = float(nav["time_s"].mean())

    found = rows_at(nav, [middle], ANY)

    assert abs(abs(float(found["yaw_deg"].iloc[0])) - 180.0) < 1e-6


def test_dates_of_the_run_give_its_rows_back() -> None:
    """The index of ``nav_with(utc=True)``, its texts and its ``datetime`` objects are the times of the rows."""
    run = steps()
    chosen = run.nav_with(utc=True).iloc[[17, 5000, 6000]]
    rows = chosen.reset_index(drop=True)
    east = chosen.index.tz_convert("Asia/Kolkata")
    texts = [f"{date:%Y-%m-%dT%H:%M:%S.%f}Z" for date in chosen.index]

    for dates in (
        chosen.index,
        east,
        east.to_series(),
        list(chosen.index),
        chosen.index.to_pydatetime(),
        texts,
    ):
        pd.testing.assert_frame_equal(run.at(dates), rows, check_exact=True)
    pd.testing.assert_frame_equal(run.at(texts[1]), rows.iloc[[1]].reset_index(drop=True), check_exact=True)
    pd.testing.assert_frame_equal(run.at(east[1]), rows.iloc[[1]].reset_index(drop=True), check_exact=True)


def test_leap_seconds_of_dates_are_those_in_force_at_each() -> None:
    week = 1929  # 2016-12-31 is its Saturday, with the leap second at its end
    dates = pd.DatetimeIndex(["2016-12-31T23:59:59.5", "2017-01-01T00:00:00"], tz="UTC")
    seconds = week_seconds(dates, week, ResultError)
    texts = ["2016-12-31T23:59:59.5Z", "2016-12-31T23:59:60.5Z", "2017-01-01T02:00:00+02:00"]

    assert seconds.tolist() == [604_800 + 16.5, 604_800 + 18.0]
    assert week_seconds(texts, week, ResultError).tolist() == [604_816.5, 604_817.5, 604_818.0]


@pytest.mark.parametrize(
    ("times", "told"),
    [
        (["noon"], "value 1 of 1, 'noon', is not a time"),
        ("noon", "'noon', is not a time"),
        ([START_S + 80.0, float("nan")], "value 2 of 2, nan, is not a finite number"),
        (["2025-09-24T09:36:22"], "value 1 of 1, '2025-09-24T09:36:22', has no zone"),
        (pd.DatetimeIndex(["2025-09-24T09:36:22"]), "has no zone"),
        (np.array(["2025-09-24T09:36:22"], "datetime64[ns]"), "has no zone"),
        ([START_S + 80.0, pd.Timestamp("2025-09-24T09:36:22")], "value 2 of 2, .* has no zone"),
        (pd.DatetimeIndex(["2025-09-24T09:36:22Z", None]), "value 2 of 2, NaT"),
        ([pd.NaT], "value 1 of 1, NaT, is not a time"),
        ([START_S, None], "value 2 of 2, None, is not a time"),
        (pd.TimedeltaIndex([1]), "neither numbers nor dates"),
        (["2024-09-24T09:36:22Z"], "outside the run"),
    ],
)
def test_value_that_is_not_a_time_is_an_error_that_names_it(times: Any, told: str) -> None:
    with pytest.raises(ResultError, match=told) as caught:
        steps().at(times)
    assert "zone" in caught.value.advice or "rows reach from" in caught.value.advice


def test_dates_need_the_week_of_the_run() -> None:
    nav = steps().nav.copy()
    nav.attrs = {}

    with pytest.raises(ResultError, match="GPS week"):
        rows_at(nav, ["2025-09-24T09:36:22Z"], ANY)


def with_gap(*kinds: str) -> Run:
    """Return a run without rows for three seconds, and with such events at the gap's start."""
    run = steps()
    t = run.nav["time_s"]
    begin = t[t < START_S + 80.0].max()
    nav = run.nav[(t <= begin) | (t > START_S + 83.0)].reset_index(drop=True)
    events = pd.DataFrame({"time_s": begin, "kind": list(kinds), "detail": "x"})
    return replace(run, nav=nav, events=events)


@pytest.mark.parametrize(("kinds", "helps"), [((), True), (("imu_gap",), False), (("restart",), False)])
def test_other_rows_are_advised_only_where_a_replay_gives_them(kinds: tuple[str, ...], helps: bool) -> None:
    with pytest.raises(ResultError, match="no row between") as refused:
        with_gap(*kinds).at([START_S + 81.0])

    assert ("replay with output=times" in refused.value.advice) is helps
    assert ("the inertial samples have a gap there" in refused.value.advice) is not helps


def test_refused_times_are_counted_and_the_first_are_named() -> None:
    times = START_S + np.array([81.0, 79.0, 81.5, 82.0, 82.5, 1e4])

    with pytest.raises(ResultError) as refused:
        with_gap().at(times)

    named = ", ".join(f"{time_s:.9g}" for time_s in times[[0, 2, 3]])
    assert f"5 of 6 times are refused: {named}, ... s" in refused.value.message


def test_refused_rows_hold_nothing_where_that_is_wanted() -> None:
    run = with_gap("imu_gap")
    times = START_S + np.array([81.0, 79.005, 1e4, -1e4])

    found = run.at(times, refuse=False)

    assert found["time_s"].tolist() == times.tolist()
    assert found.drop(columns="time_s").iloc[[0, 2, 3]].isna().all(axis=None)
    pd.testing.assert_frame_equal(
        found.iloc[[1]].reset_index(drop=True), run.at(times[1:2]), check_dtype=False, check_exact=True
    )
    assert found.attrs == run.nav.attrs
    sound = run.at(times[1:2], refuse=False)
    pd.testing.assert_frame_equal(sound, run.at(times[1:2]), check_exact=True)
