"""Comparisons find a difference that was put in, with its sign."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insgnss.constants import NS_PER_S, NS_PER_WEEK
from insgnss.errors import ResultError
from insgnss.report.compare import compare, compare_runs, write_comparison
from insgnss.report.settings_compared import settings_that_differ
from insgnss.runs.result import Run
from tests.report.runs import START_S, WEEK, made_run

SECONDS_OF_WEEK = NS_PER_WEEK // NS_PER_S


def moved(run: Run, north_m: float) -> Run:
    # the ellipsoid's meridian radius at 45 deg is 6 367 382 m
    return replace(
        run, nav=run.nav.assign(lat_deg=run.nav["lat_deg"] + np.degrees(north_m / (6_367_382.0 + 300.0)))
    )


def row(run: Run, other: Run, component: str) -> dict[str, float]:
    table = compare_runs({"one": run, "two": other}).statistics.set_index(["run", "component"])
    return table.loc[("two", component)].to_dict()


def test_run_against_itself_differs_in_nothing() -> None:
    run = made_run()

    # ECEF coordinates of 6e6 m have a resolution of 1e-9 m
    assert row(run, run, "n_m")["max"] == pytest.approx(0.0, abs=5e-9)
    assert row(run, run, "yaw_deg")["max"] == pytest.approx(0.0, abs=1e-9)


def test_offset_to_the_north_is_found_with_its_sign() -> None:
    found = row(made_run(), moved(made_run(), 2.0), "n_m")

    assert found["mean"] == pytest.approx(2.0, abs=2e-3)  # the radius varies with the height by 20 m of 6.4e6
    assert found["rms"] == pytest.approx(2.0, abs=2e-3)
    assert abs(row(made_run(), moved(made_run(), 2.0), "e_m")["mean"]) < 1e-3


def test_run_of_another_rate_is_compared_at_its_own_rows() -> None:
    comparison = compare_runs({"slow": made_run(rate_hz=1.0), "fast": made_run(rate_hz=10.0)})

    table = comparison.differences["fast"]
    assert len(table) == 2991  # from the first to the last row of the slow one
    # 10 m/s on a circle of 500 m: chords of 1 s lie 0.2 m/s^2 / 8 = 25 mm inside it
    assert table["d_n_m"].abs().max() < 0.026


def test_run_that_counts_from_another_week_is_compared_at_the_same_time() -> None:
    run, other = made_run(), made_run()
    other.nav["time_s"] += SECONDS_OF_WEEK
    other.settings = {**other.settings, "flight": {"gps_week": WEEK - 1}}

    assert row(run, other, "n_m")["max"] == pytest.approx(0.0, abs=5e-9)


def test_statistics_are_from_the_known_heading_on() -> None:
    run, other = made_run(), made_run()
    other.nav.loc[other.nav["time_s"] < START_S + 20.0, "yaw_deg"] += 90.0

    assert row(run, other, "yaw_deg")["max"] == pytest.approx(0.0, abs=1e-9)


def heading_known_at(run: Run, time_s: float) -> Run:
    """Return a run with another time of its heading."""
    events = run.events.copy()
    events.loc[events["kind"] == "heading_known", "time_s"] = time_s
    return replace(run, events=events)


def test_errors_and_sigmas_of_all_runs_are_of_the_same_time() -> None:
    """The same estimates, whose heading counts as known earlier in one of them, compare as equal."""
    run = made_run()
    assert run.errors is not None
    early = run.nav["time_s"] < START_S + 20.0
    run.errors.loc[early, "d_yaw_deg"] = 30.0
    run.nav.loc[early, "sd_yaw_deg"] = 10.0
    soon = heading_known_at(run, START_S + 5.0)

    comparison = compare_runs({"soon": soon, "later": run})
    table = comparison.statistics.set_index(["component", "run"])[["median_sigma", "rms_error"]]

    assert table.loc[("yaw_deg", "soon")].tolist() == table.loc[("yaw_deg", "later")].tolist()
    assert table.loc[("yaw_deg", "soon"), "rms_error"] < 1.0
    assert comparison.span == (START_S + 20.0, START_S + 299.0, True)


def test_a_run_that_ends_early_is_compared_over_its_own_time_alone() -> None:
    run, short = made_run(), made_run(seconds=100.0)
    assert run.errors is not None
    run.errors.loc[run.errors["time_s"] > START_S + 100.0, "d_n_m"] = 50.0

    statistics = compare_runs({"whole": run, "short": short}).statistics

    assert statistics["rms_error"].max() < 1.0


def test_runs_that_never_knew_the_heading_are_compared_over_their_common_time() -> None:
    run = made_run()
    run.events = run.events[run.events["kind"] != "heading_known"]

    span = compare_runs({"one": run, "two": run}).span

    assert span == (START_S, START_S + 299.0, False)
    assert "heading" not in str(span)


def test_runs_without_common_time_are_refused() -> None:
    late = made_run()
    late.nav["time_s"] += 10_000.0

    with pytest.raises(ResultError, match="no time in common"):
        compare_runs({"one": made_run(), "two": late})


def test_one_run_is_no_comparison() -> None:
    with pytest.raises(ResultError, match="two runs"):
        compare_runs({"one": made_run()})


def test_run_without_a_week_is_refused() -> None:
    run = made_run()
    run.settings = {}

    with pytest.raises(ResultError, match="which GPS week"):
        compare_runs({"one": run, "two": made_run()})


def test_page_of_a_comparison_has_all_runs_and_json_is_plain(tmp_path: Path) -> None:
    comparison = compare_runs({name: made_run(seed=i) for i, name in enumerate(("a<b>", "b", "c"))})

    text = write_comparison(comparison, tmp_path / "page.html").read_text(encoding="utf-8")
    read = json.loads(json.dumps(comparison.as_json(), allow_nan=False))

    assert "a&lt;b&gt;" in text
    assert "<b>" not in text.split("<script")[0]
    assert read["first"] == "a<b>"
    assert len(read["statistics"]) == 27


def test_pictures_of_a_comparison_carry_the_runs_and_the_time_in_utc(tmp_path: Path) -> None:
    run = made_run()
    smoothed = replace(run, settings={**run.settings, "smooth": True})
    comparison = compare_runs({"one": run, "two": smoothed})
    content = write_comparison(comparison, tmp_path / "page.html").read_text(encoding="utf-8")

    assert 'data-about="Comparison: one, two, 2025-09-24 09:34:42 to 09:39:41 UTC"' in content
    assert "made (tight17), 300 rows" in content and "made (tight17, smoothed), 300 rows" in content


def test_settings_that_differ_are_listed_key_by_key(tmp_path: Path) -> None:
    first, second = made_run(), made_run()
    first.settings["filter"] = {"name": "tight17", "visibility": {"on": True}, "same": 1}
    second.settings["filter"] = {"name": "open", "visibility": {"on": False}, "same": 1, "more": [1, 2]}
    comparison = compare_runs({"masked": first, "open": second})

    assert settings_that_differ(comparison.runs) == [
        ("filter.name", "tight17", "open"),
        ("filter.visibility.on", "true", "false"),
        ("filter.more", "-", "[1, 2]"),
    ]
    page = write_comparison(comparison, tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<td>filter.visibility.on</td><td>true</td><td>false</td>" in page


def test_runs_of_the_same_settings_are_said_to_be(tmp_path: Path) -> None:
    comparison = compare_runs({"a": made_run(), "b": made_run(seed=2)})

    page = write_comparison(comparison, tmp_path / "page.html").read_text(encoding="utf-8")

    assert "Every setting is the same in all runs." in page


def read_from(folder: str, content: str = "abc") -> Run:
    """Return a run whose logs were in a folder, the inertial log with a content."""
    run = made_run()
    imu, gnss = f"{folder}imu.csv", f"{folder}gnss.csv"
    flight_ = {
        **run.settings["flight"],
        "imu": {"files": [imu]},
        "gnss": {"files": [gnss]},
        "reference": gnss,
    }
    run.settings = {**run.settings, "flight": flight_, "input_sha256": {imu: content, gnss: "def"}}
    return run


def test_inputs_are_compared_by_content_and_file_name() -> None:
    first, moved_, other = read_from("/a/"), read_from("C:\\b\\"), read_from("/a/", "ghi")

    assert settings_that_differ({"first": first, "moved": moved_}) == []
    assert settings_that_differ({"first": first, "other": other}) == [("input_sha256.imu.csv", "abc", "ghi")]


def test_line_of_a_comparison_names_five_settings_at_most() -> None:
    first, second = made_run(), made_run()
    second.settings = {**second.settings, **{f"more_{i}": i for i in range(7)}}

    assert repr(compare(first=first, second=second)).count("more_") == 5
    assert "more_4 and 2 more" in repr(compare(first=first, second=second))
