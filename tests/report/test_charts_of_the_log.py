"""What the page shows of the log itself: every satellite, reception, geometry, inertial sensors, and its events."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

from insgnss.receiver.tracking_state import STATE_NAMES
from insgnss.report import figures
from insgnss.report.charts import Chart, colour_of, dash_of, symbol_of, unpacked
from insgnss.report.event_marks import MOST, marked_events, with_events
from insgnss.report.sections import inertial, innovations, reception, satellites, smoothing
from insgnss.report.sections.reception import dilution_of_directions
from insgnss.runs.imu_summary import BINS, imu_spectrum, imu_table
from insgnss.runs.result import Run
from insgnss.status import NAMES
from insgnss.tables import ImuTable
from tests.report.runs import START_S, made_run


def chart_of(charts: object, name: str) -> Chart:
    return next(chart for chart in charts if chart.name == name)  # type: ignore[attr-defined]


def test_no_two_of_64_satellites_have_one_colour_and_neighbours_have_other_marks() -> None:
    assert len({colour_of(place) for place in range(64)}) == 64
    assert len({symbol_of(place) for place in range(40)}) == len({dash_of(place) for place in range(40)}) == 5


def test_innovations_of_twelve_satellites_have_twelve_colours() -> None:
    section = innovations.section(made_run(satellites=12))
    assert section is not None
    chart = chart_of(section.charts, "chart-innovation-pseudorange")
    styles = {
        (t["marker"]["color"], t["marker"]["symbol"])
        for t in chart.traces
        if t.get("mode") == "markers" and t["name"].startswith("G")
    }

    assert len(styles) == 12


def with_unplaced(run: Run) -> Run:
    """Return the run with a satellite in the ledger that had no ephemeris, and none in the table of satellites."""
    times = run.nav["time_s"].to_numpy()[:40]
    row = {
        "signal": "C1C",
        "kind": "pseudorange",
        "innovation": np.nan,
        "sd_innovation": np.nan,
        "nis": np.nan,
    }
    more = pd.DataFrame({"time_s": times, "sv": "E36", **row, "status": "no_ephemeris"})
    words = ["sv", "signal", "kind", "status"]
    ledger = pd.concat([run.measurements.astype(dict.fromkeys(words, "str")), more], ignore_index=True)
    return dataclasses.replace(run, measurements=ledger.astype(dict.fromkeys(words, "category")))


def test_satellite_without_ephemeris_has_its_line_in_the_timeline() -> None:
    run = with_unplaced(made_run())
    section = satellites.section(run)
    assert section is not None
    timeline = chart_of(section.charts, "chart-timeline")
    lines = {t["name"]: t for t in timeline.traces}

    assert "E36" in timeline.layout["yaxis"]["categoryarray"]
    assert set(lines["no ephemeris"]["y"]) == {"E36", None}
    assert "E36" not in lines["tracked"]["y"]


@pytest.mark.parametrize("states", [("tracked", *list(NAMES.values())[1:], "absent"), STATE_NAMES])
def test_no_two_states_of_a_timeline_have_one_colour(states: tuple[str, ...]) -> None:
    assert len({satellites.state_colour(state) for state in states}) == len(states)


def test_state_of_another_version_has_a_colour_too() -> None:
    assert satellites.state_colour("from_the_future").startswith("#")


def test_satellite_without_ephemeris_has_its_line_in_the_picture() -> None:
    figure = figures.satellites(with_unplaced(made_run()))

    assert "E36" in [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert "no ephemeris" in figure.axes[0].get_legend_handles_labels()[1]


def test_events_are_marked_on_every_chart_over_time_and_on_no_other() -> None:
    run = made_run()
    parts = [section for section in (satellites.section(run), inertial.section(run)) if section is not None]
    events = marked_events(run)
    charts = [chart for section in with_events(parts, events) for chart in section.charts]

    assert events["kind"].tolist() == ["start", "heading_known", "imu_gap"]
    assert {chart.linked for chart in charts} == {True, False}
    for chart in charts:
        lines = [shape["x0"] for shape in chart.layout.get("shapes", [])]
        marks = [t for t in chart.traces if t["name"] == "events"]
        assert (lines == [START_S, START_S + 20.0, START_S + 50.0]) is chart.linked
        assert len(marks) == int(chart.linked)
        assert not marks or (unpacked(marks[0]["x"]).tolist() == lines and "<" not in marks[0]["text"][2])


def test_of_very_many_events_each_kind_is_marked() -> None:
    run = made_run()
    gaps = pd.DataFrame({"time_s": START_S + np.linspace(1.0, 200.0, 500), "kind": "imu_gap", "detail": "x"})
    reset = pd.DataFrame({"time_s": [START_S + 150.0], "kind": "reset", "detail": "x"})
    marked = marked_events(dataclasses.replace(run, events=pd.concat([gaps, reset], ignore_index=True)))

    assert len(marked) == MOST and "reset" in set(marked["kind"])
    assert marked["time_s"].is_monotonic_increasing


def test_dilution_is_that_of_the_regular_tetrahedron() -> None:
    """One satellite at the zenith and three at -19.47 deg: H^T H is diagonal, 4/3 for each axis, 4 for the clock."""
    el = np.array([90.0, *[-np.degrees(np.arcsin(1.0 / 3.0))] * 3])
    time_s, dop = dilution_of_directions(np.zeros(4), np.array([0.0, 0.0, 120.0, 240.0]), el)

    assert time_s.tolist() == [0.0]
    assert dop[0] == pytest.approx([np.sqrt(9.0 / 4.0), np.sqrt(6.0 / 4.0), np.sqrt(3.0 / 4.0)])


def test_dilution_is_unknown_of_three_satellites_and_of_four_on_a_cone() -> None:
    az, el = np.array([0.0, 90.0, 180.0, 270.0]), np.full(4, 30.0)
    _, three = dilution_of_directions(np.zeros(3), az[:3], np.array([10.0, 40.0, 70.0]))
    _, cone = dilution_of_directions(np.zeros(4), az, el)

    assert np.isnan(three).all() and np.isnan(cone).all()


def test_reception_has_a_line_for_each_satellite() -> None:
    section = reception.section(made_run(satellites=12))
    assert section is not None
    lines = chart_of(section.charts, "chart-cn0").traces

    assert len({t["line"]["color"] for t in lines}) == len(lines) == 12
    assert {t["line"]["dash"] for t in lines} == {"solid", "dot"}
    assert [t["name"] for t in chart_of(section.charts, "chart-dop").traces] == ["PDOP", "HDOP", "VDOP"]


def test_run_without_cn0_and_inertial_tables_has_no_such_charts() -> None:
    run = made_run()
    bare = dataclasses.replace(
        run, satellites=run.satellites.drop(columns="cn0_dbhz"), imu=None, imu_spectrum=None
    )
    section = reception.section(bare)

    assert section is not None and [chart.name for chart in section.charts] == ["chart-dop"]
    assert inertial.section(bare) is None


def imu_log(w: np.ndarray, step_ns: int = 10_000_000) -> ImuTable:
    t_ns = (np.arange(len(w)) * step_ns).astype(np.int64)
    return ImuTable(t_ns, w, np.zeros_like(w))


def test_spectrum_of_white_noise_is_its_density(rng: np.random.Generator) -> None:
    """Of sigma s at f_s it is s sqrt(2 / f_s), one-sided; the mean of 2048 values of 64 segments is known to 0.2 %."""
    found = imu_spectrum(imu_log(np.radians(0.3) * rng.standard_normal((400_000, 3))))
    density = found[found["frequency_hz"] > 0.1]["gyro_y_degps_per_sqrt_hz"]

    assert float(np.sqrt((density**2).mean())) == pytest.approx(0.3 * np.sqrt(2.0 / 100.0), rel=0.01)
    assert found["frequency_hz"].iloc[-1] == 50.0


def test_line_of_an_engine_stands_at_its_frequency() -> None:
    t_s = np.arange(20_000) * 0.01
    w = np.column_stack([np.sin(2.0 * np.pi * 20.0 * t_s), np.zeros_like(t_s), np.zeros_like(t_s)])
    found = imu_spectrum(imu_log(w))

    assert found["frequency_hz"][found["gyro_x_degps_per_sqrt_hz"].idxmax()] == pytest.approx(20.0, abs=0.05)


def test_spectrum_leaves_out_what_has_lost_samples_and_short_logs() -> None:
    log = imu_log(np.ones((20_000, 3)))
    every_second = np.cumsum(np.where(np.arange(20_000) % 100 == 0, 20_000_000, 10_000_000)).astype(np.int64)

    assert imu_spectrum(dataclasses.replace(log, t_ns=every_second)).empty
    assert imu_spectrum(imu_log(np.ones((50, 3)))).empty
    assert imu_spectrum(dataclasses.replace(log, t_ns=log.t_ns // 3_000_000_000 * 3_000_000_000)).empty
    assert not imu_spectrum(log).empty


def test_extremes_keep_a_spike_of_one_sample() -> None:
    w = np.zeros((100_000, 3))
    w[54_321, 2] = np.radians(7.0)
    table = imu_table(imu_log(w), 0)

    assert len(table) == BINS
    assert table["gyro_z_max_degps"].max() == pytest.approx(7.0) and table["gyro_z_min_degps"].min() == 0.0
    assert table["time_s"][table["gyro_z_max_degps"].idxmax()] == pytest.approx(543.2, abs=0.7)
    assert len(imu_table(imu_log(w[:10]), 0)) == 10


@pytest.mark.parametrize("draw", [figures.track, figures.errors, figures.innovations, figures.satellites])
def test_figure_carries_name_and_utc(draw: object) -> None:
    words = draw(made_run()).get_suptitle()  # type: ignore[operator]

    assert "made (tight17)" in words and words.endswith(" UTC")


def test_filter_against_smoother_is_drawn_of_a_smoothed_run_alone(rng: np.random.Generator) -> None:
    run = made_run()
    assert smoothing.section(run) is None
    kept = [
        c
        for c in run.nav.columns
        if not c.startswith(("accel", "gyro", "clock", "n_", "sd_accel", "sd_gyro"))
    ]
    filtered = run.nav[kept].assign(
        h_m=run.nav["h_m"] - 2.0, sd_d_m=np.hypot(run.nav["sd_d_m"], 3.0), yaw_deg=run.nav["yaw_deg"] + 1.0
    )
    section = smoothing.section(dataclasses.replace(run, filtered=filtered))
    assert section is not None
    position = chart_of(section.charts, "chart-smoothing-position").traces
    down = next(t for t in position if t["name"] == "down" or t["name"].startswith("down"))
    band = [t for t in position if t["name"] == "3 sigma"][2]
    yaw = chart_of(section.charts, "chart-smoothing-attitude").traces[-1]

    assert unpacked(down["y"]) == pytest.approx(2.0, abs=1e-3)
    assert np.nanmax(unpacked(band["y"])) == pytest.approx(9.0, rel=1e-3)  # three times what was taken off
    assert unpacked(yaw["y"]) == pytest.approx(1.0, abs=1e-3)
