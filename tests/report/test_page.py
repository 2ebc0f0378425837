"""The page: whole, alone, small, true to the tables, and safe against what stands in a log."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest

from insgnss.errors import ResultError
from insgnss.report.page import report_html
from insgnss.report.sections import settings
from insgnss.runs.result import Run
from tests.report.runs import START_S, made_run, words

ALWAYS = ["summary", "map", "motion", "biases", "events", "ledger", "settings"]


class Page(HTMLParser):
    """Collects what a page is made of."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.loads: list[str] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if "id" in values:
            self.ids.append(values["id"] or "")
        if tag in ("script", "img", "iframe", "source") and values.get("src"):
            self.loads.append(values["src"] or "")
        if tag == "link":
            self.loads.append(values.get("href") or "")
        if tag not in ("meta", "link", "input", "br", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def charts_of(page: str) -> dict[str, Any]:
    match = re.search(r'<script type="application/json" id="charts">(.*?)</script>', page, re.DOTALL)
    assert match is not None
    return {chart["name"]: chart for chart in json.loads(match.group(1))}


def unpacked(packed: Any) -> np.ndarray:
    if isinstance(packed, list):
        return np.array(packed)
    return np.frombuffer(base64.b64decode(packed["bdata"]), "<" + packed["dtype"])


@pytest.fixture(scope="module")
def page() -> str:
    return report_html(made_run(aiding=True))


def test_page_is_well_formed_and_every_chart_has_its_place(page: str) -> None:
    parsed = Page(page)
    charts = charts_of(page)

    assert parsed.open == []
    assert len(parsed.ids) == len(set(parsed.ids))
    assert len(charts) > 15
    assert set(charts) <= set(parsed.ids)
    assert set(ALWAYS) <= set(parsed.ids)


def test_page_loads_nothing_from_anywhere(page: str) -> None:
    own = re.sub(r"<script>/\*\*\s*\* plotly.*?</script>", "", page, flags=re.DOTALL)

    assert Page(page).loads == ["data:,"]
    assert len(own) < len(page) - 4_000_000  # Plotly was there, and is cut out
    # but for the street map, which asks whether it can be reached once the reader opens it
    assert re.findall(r"https?://[\w.]+", own) == ["https://tile.openstreetmap.org"]
    assert page.count("plotly.js v") == 1


def test_every_chart_is_one_that_plotly_knows(page: str) -> None:
    for chart in charts_of(page).values():
        figure = go.Figure(data=chart["data"], layout=chart["layout"])  # raises on an unknown key or value

        assert len(figure.data) > 0
        axes = figure.layout.xaxis.title.text or figure.layout.polar.radialaxis.range
        assert axes or figure.layout.map.style == "open-street-map"


def test_line_of_the_height_has_the_extremes_of_the_table() -> None:
    run = made_run(seconds=20_000.0, satellites=2)
    run.nav.loc[7777, "h_m"] = 1234.5

    (band, line, events) = charts_of(report_html(run))["chart-height"]["data"]
    assert events["name"] == "events"

    x, y = unpacked(line["x"]), unpacked(line["y"])
    assert len(y) < 2000
    assert y.max() == pytest.approx(1234.5)
    assert x[y.argmax()] == run.nav["time_s"][7777]
    assert y.min() == pytest.approx(run.nav["h_m"].min(), abs=1e-4)
    assert np.nanmax(unpacked(band["y"])) == pytest.approx(1234.5 + 3.0 * run.nav["sd_d_m"][7777], abs=1e-3)


def test_track_stands_in_metres_from_the_start() -> None:
    run = made_run()
    track = next(t for t in charts_of(report_html(run))["chart-track"]["data"] if t["name"] == "track")

    # a circle of 500 m on a sphere of 6370 km; the ellipsoid's radii differ from it by 0.5 %
    assert np.ptp(unpacked(track["y"])) == pytest.approx(1000.0, rel=0.01)
    assert np.ptp(unpacked(track["x"])) == pytest.approx(1000.0, rel=0.01)
    assert unpacked(track["x"])[0] == 0.0


def test_timeline_shows_the_only_refused_epoch() -> None:
    run = made_run(seconds=9000.0)
    run.satellites["state"] = words(np.zeros(len(run.satellites), int), ["tracked", "gated"])
    row = 40_003
    run.satellites.loc[row, "state"] = "gated"

    traces = {t["name"]: t for t in charts_of(report_html(run))["chart-timeline"]["data"]}

    start, end = unpacked(traces["gated"]["x"])[:2]
    assert start - 1e-6 <= run.satellites["time_s"][row] <= end
    assert end - start < 7.0  # 9000 s in 1500 columns
    assert traces["gated"]["y"][0] == run.satellites["sv"][row]


def test_text_of_a_log_is_never_taken_for_html(page: str) -> None:
    assert "<script>window.broken" not in page
    assert "&lt;script&gt;window.broken" in page


def test_satellite_named_like_the_end_of_a_script_stays_inside_its_data() -> None:
    run = made_run(seconds=10.0)
    run.satellites["sv"] = run.satellites["sv"].cat.rename_categories({"G01": "</script><b>"})

    charts = charts_of(report_html(run))

    assert "</script><b>" in json.dumps(charts["chart-timeline"])


def test_sections_stand_only_where_the_run_has_something_for_them() -> None:
    bare, full = made_run(reference=False), made_run(aiding=True)
    full.supervision = full.satellites[["time_s", "sv", "state"]]

    assert {"errors", "aiding", "supervision"} & set(Page(report_html(bare)).ids) == set()
    assert {"errors", "aiding", "supervision"} <= set(Page(report_html(full)).ids)


def with_levels(run: Run, beyond: int) -> Run:
    """Return a run with protection levels; ``beyond`` rows have an error beyond the horizontal one."""
    assert run.errors is not None
    error = np.hypot(run.errors["d_n_m"], run.errors["d_e_m"]).to_numpy()
    hpl = np.where(np.arange(len(error)) < beyond, 0.5, 2.0) * error
    run.nav = run.nav.assign(hpl_m=hpl, vpl_m=np.inf)
    columns = ("fault", "separation_m", "axis", "time_s", "limit_m", "alert_rows")
    faults = [
        ("G07", np.nan, "n", 293_700.0, np.nan, 0),
        ("G02", 3.0, "n", 293_711.0, 2.0, 1),
        ("G05", -6.25, "e", 293_712.0, 2.5, 3),
    ]
    run.integrity = pd.DataFrame(faults, columns=list(columns))
    return run


def test_protection_levels_stand_against_the_errors_and_those_beyond_are_counted() -> None:
    """An infinite level is a gap of the line, and nothing else of the page minds it."""
    page = report_html(with_levels(made_run(), 7))
    charts = charts_of(page)

    assert "beyond its protection level in 7 (horizontal) and 0 (vertical) of 300 rows" in page
    horizontal = charts["chart-stanford"]["data"][0]
    below = unpacked(horizontal["x"]) > unpacked(horizontal["y"])
    assert below.sum() == 7
    assert "Infinite levels, in 300 rows, are not drawn." in page
    over_time = charts["chart-protection-levels"]
    assert np.isnan(unpacked(over_time["data"][1]["y"])).all()
    assert over_time["layout"]["xaxis"]["anchor"] == "y2"  # below the last row, as in other charts
    assert (
        page.index("<td>G05</td>") < page.index("<td>G02</td>") < page.index("<td>G07</td>")
    )  # suspects first
    assert "integrity" not in Page(report_html(made_run())).ids


def test_diagram_of_a_long_run_keeps_every_misleading_row() -> None:
    charts = charts_of(report_html(with_levels(made_run(seconds=9000.0), 7)))
    horizontal = charts["chart-stanford"]["data"][0]
    x, y = unpacked(horizontal["x"]), unpacked(horizontal["y"])
    assert (x > y).sum() == 7 and len(x) < 9000


def test_levels_without_a_reference_are_shown_without_a_diagram() -> None:
    run = with_levels(made_run(), 0)
    run.errors = None

    assert "chart-stanford" not in charts_of(report_html(run))


def test_sky_is_coloured_by_the_gain_where_it_is_known() -> None:
    with_gain = charts_of(report_html(made_run(gain=True)))["chart-sky-body"]
    without = charts_of(report_html(made_run()))["chart-sky-body"]

    assert with_gain["data"][0]["marker"]["colorbar"]["title"]["text"] == "gain, dBic"
    assert [t["name"] for t in without["data"]] == ["used", "not used", "names"]


def test_sky_of_the_body_lies_over_the_pattern_of_the_flight_s_antenna() -> None:
    run = made_run(gain=True)
    run.settings["flight"]["gnss"] = {"antenna": [{"name": "roof", "pattern": "patch_l1"}]}

    rings = [t for t in charts_of(report_html(run))["chart-sky-body"]["data"] if t["type"] == "barpolar"]

    gain = np.array([unpacked(ring["marker"]["color"]).mean() for ring in rings])
    assert [ring["base"][0] for ring in rings] == list(range(0, 180, 10))
    assert np.all(np.diff(gain[:9]) < 0.0)  # a patch: the lower, the weaker
    assert gain[0] == pytest.approx(5.0, abs=1.0)  # dBic towards the zenith, as its file says


def test_sky_does_without_the_pattern_whose_file_is_gone() -> None:
    run = made_run(gain=True)
    run.settings["flight"]["gnss"] = {"antenna": [{"name": "roof", "pattern": "gone.csv"}]}

    sky = charts_of(report_html(run))["chart-sky-body"]["data"]

    assert [t["name"] for t in sky] == ["gain", "names"]


def test_ledger_of_the_page_adds_up_to_the_input(page: str) -> None:
    row = re.search(r"<td>in the log</td>((?:<td class=\"number\">\d+</td>)+)", page)
    assert row is not None

    assert sum(int(n) for n in re.findall(r"\d+", row.group(1))) == len(made_run().measurements)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_run_of_few_rows_has_a_page(rows: int) -> None:
    assert "<h2>Map</h2>" in report_html(made_run(seconds=float(rows)))


def test_run_without_measurements_events_and_satellites_has_a_page() -> None:
    run = made_run()
    run.measurements, run.satellites, run.events = (
        t.iloc[:0] for t in (run.measurements, run.satellites, run.events)
    )

    assert "The log holds no measurement." in report_html(run)


def test_run_without_navigation_rows_is_refused() -> None:
    run = made_run()
    run.nav = run.nav.iloc[:0]

    with pytest.raises(ResultError, match="no navigation row"):
        report_html(run)


def test_page_of_an_hour_at_ten_hertz_is_below_ten_megabytes() -> None:
    run = made_run(seconds=3600.0, rate_hz=10.0, satellites=30, aiding=True, gain=True)

    assert len(report_html(run).encode()) < 10e6


def test_report_of_a_run_writes_the_page(tmp_path: Path) -> None:
    written = made_run().report(tmp_path / "new" / "page.html")

    assert written.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_report_that_cannot_be_written_says_where(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(ResultError, match="cannot be written") as raised:
        made_run().report(tmp_path / "file" / "page.html")
    assert raised.value.file == str(tmp_path / "file" / "page.html")


def test_charts_over_time_are_linked_and_the_others_are_not(page: str) -> None:
    charts = charts_of(page)

    assert {name for name, c in charts.items() if c["linked"]} >= {
        "chart-height",
        "chart-timeline",
        "chart-clock",
    }
    assert not any(
        charts[name]["linked"] for name in ("chart-track", "chart-sky-local", "chart-nis-pseudorange")
    )
    assert START_S <= unpacked(charts["chart-height"]["data"][1]["x"])[0]


def test_offset_of_a_band_that_was_never_used_is_not_drawn() -> None:
    run = made_run()
    run.nav["offset_E_m"], run.nav["offset_C_m"] = 3.0, 0.0

    drawn = [trace["name"] for trace in charts_of(report_html(run))["chart-offsets"]["data"]]

    assert drawn == ["offset E (3.00 m)", "events"]


def test_page_lists_the_columns_not_read_beside_the_input() -> None:
    run = made_run()
    unread = {
        "time_s": [float("nan")],
        "kind": ["columns_not_read"],
        "detail": ["gnss.csv has further columns: <snr>"],
    }
    run = replace(run, events=pd.concat([run.events, pd.DataFrame(unread)], ignore_index=True))

    assert "gnss.csv has further columns: &lt;snr&gt;" in settings.section(run).before
