"""The summary says what the tables say, in words and in plain numbers."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from insgnss.report.digest import digest
from insgnss.report.epochs import satellites_used, used_at
from insgnss.report.sentences import figures, sentences, way_m
from insgnss.runs.result import Run
from tests.report.runs import START_S, made_run, words


def said(run: Run) -> str:
    return "\n".join(sentences(run))


def with_events(run: Run, *kinds: str) -> Run:
    run.events = pd.DataFrame({"time_s": START_S, "kind": list(kinds), "detail": ""})
    return run


def test_summary_tells_span_and_date_in_utc() -> None:
    # GPS week 2385 began on 2025-09-21; 293700 s later it is Wednesday 09:35:00 GPS time, 18 s ahead of UTC
    assert "2025-09-24 09:34:42 to 09:39:41 UTC (GPS week 2385)" in said(made_run(seconds=300.0))


def test_summary_tells_when_the_heading_became_known() -> None:
    assert "became known 20.0 s after the start, at 293720.0 s" in said(made_run())


def test_summary_tells_that_the_heading_never_became_known() -> None:
    run = with_events(made_run(), "start")
    run.nav["sd_yaw_deg"] = 90.0

    assert "never became known: its sigma was 90° at best" in said(run)


def test_summary_names_trouble_by_its_number_and_not_what_is_none() -> None:
    text = said(with_events(made_run(), "start", "imu_gap", "imu_gap", "reset"))

    assert "imu gap (2), reset (1)" in text
    assert "No gaps, resets or clock jumps." not in text
    assert "No gaps, resets or clock jumps." in said(with_events(made_run(), "start", "heading_known"))


def test_summary_tells_errors_of_known_size() -> None:
    run = made_run()
    side = np.where(np.arange(len(run.errors)) % 2, 1.0, -1.0)
    run.errors["d_n_m"], run.errors["d_e_m"], run.errors["d_d_m"] = 3.0 * side, 4.0 * side, -2.0 * side
    run.errors["sd_n_m"] = run.errors["sd_e_m"] = 1.0

    text = said(run)

    assert "within 5 m (50 %), 5 m (95 %), 5 m at most; the height is within 2 m (95 %)" in text
    # sqrt((9 + 16) / 2)
    assert "horizontal errors are 3.5 times their sigma (rms of error over sigma 3.54, 1 is right)" in text


def test_summary_tells_a_constant_offset_apart() -> None:
    run = made_run()
    side = np.where(np.arange(len(run.errors)) % 2, 1.0, -1.0)
    run.errors["d_n_m"], run.errors["d_e_m"], run.errors["d_d_m"] = 6.0 + 0.3 * side, -8.0 + 0.4 * side, -2.0
    run.errors["sd_n_m"] = run.errors["sd_e_m"] = 0.5

    text = said(run)

    assert "one constant offset, 6 m north, 8 m west, 2 m up" in text
    assert "Without this offset the horizontal position is within 0.5 m (50 %)" in text
    # sqrt((0.09 + 0.16) / 2) / 0.5
    assert "Without the constant offset they are 0.71 times their sigma (rms 0.707)" in text


def test_summary_judges_a_constant_offset_as_the_table_of_errors_does() -> None:
    """The sentence gave the ratio without the offset, the table beside it and ``consistency`` the one with it."""
    run = made_run()
    side = np.where(np.arange(len(run.errors)) % 2, 1.0, -1.0)
    run.errors["d_n_m"], run.errors["d_e_m"] = 6.0 + 0.3 * side, 6.0 + 0.3 * side
    run.errors["sd_n_m"] = run.errors["sd_e_m"] = 5.0
    run.errors["sd_slow_n_m"] = run.errors["sd_slow_e_m"] = 4.99
    run.errors["sd_slow_d_m"] = 0.0

    ratio = run.error_summary().loc["n_m", "rms_over_sigma"]
    text = said(run)

    assert f"horizontal errors are {ratio:.2g} times their sigma" in text
    # 0.3 / sqrt(5^2 - 4.99^2)
    assert "they are 0.95 times their sigma without the part of slowly varying errors (rms 0.949)" in text


def test_figures_are_those_of_the_tables() -> None:
    run = made_run()
    told = {name: (value, about) for name, value, about in figures(run)}

    assert told["Navigation"] == ("4 min 59 s", "2.99 km travelled")
    used = 100.0 * (run.measurements["status"] == "used").mean()
    assert told["Measurements used"] == (f"{used:.1f} %", "of 4800 in the log")
    assert told["Heading"][1] == "sigma at the end, known after 20.0 s"


def test_summary_without_a_reference_tells_the_sigma() -> None:
    run = made_run(reference=False)
    run.nav["sd_n_m"], run.nav["sd_e_m"] = 0.6, 0.8

    assert "By the filter's own sigma the position is good to 1 m horizontally" in said(run)


def test_satellite_with_two_signals_counts_once() -> None:
    run = made_run(seconds=2.0, satellites=3)
    run.measurements["status"] = words(np.array([0] * 4 + [1] * 2 + [1] * 6), ["used", "gated"])

    times, count = satellites_used(run)

    assert times.tolist() == [START_S, START_S + 1.0]
    assert count.tolist() == [2, 0]
    assert used_at(run, np.array([START_S - 1.0, START_S + 0.5, START_S + 9.0])).tolist() == [0.0, 2.0, 0.0]
    assert "fewer than four for 1.0 s" in said(run)


def test_way_is_speed_times_time() -> None:
    assert way_m(made_run(seconds=101.0).nav) == pytest.approx(1000.0)  # 10 m/s over 100 s


def test_digest_is_plain_json_and_agrees_with_the_tables() -> None:
    run = made_run()
    run.nav["sd_n_m"] = np.nan

    read = json.loads(json.dumps(digest(run), allow_nan=False))

    assert read["rows"] == 300
    assert read["heading_known_s"] == START_S + 20.0
    assert read["median_sigma"]["n_m"] is None
    counts = {kind: sum(of_kind.values()) for kind, of_kind in read["measurements"].items()}
    assert counts == {"pseudorange": 2400, "range_rate": 2400}
    assert read["nis"]["pseudorange"]["mean_nis"] == pytest.approx(
        run.nis_summary()["mean_nis"]["pseudorange"]
    )
    assert read["events"]["imu_gap"] == 1
