"""The page in a real browser: everything is drawn, nothing complains, axes are linked, tables filter and sort."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest

from insgnss.report.page import report_html
from tests.report.runs import START_S, made_run

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed"),
]

# done by the page itself once it is drawn, and told to the test
PROBE = """<script>
addEventListener("load", () => setTimeout(async () => {
  const told = {};
  const folded = [...document.querySelectorAll("details .chart")];
  const places = [...document.querySelectorAll(".chart")].filter((p) => !folded.includes(p));
  const drawn = () => places.filter((p) => p.layout && p.querySelector(".main-svg")).length;
  const pause = () => new Promise((done) => setTimeout(done, 200));
  for (let tries = 0; tries < 100 && drawn() < places.length; tries += 1) await pause();
  told.charts = places.length;
  told.drawn = drawn();
  told.folded = folded.map((p) => p.id);
  told.fetched = folded.filter((p) => p.layout).length;
  const timed = JSON.parse(document.getElementById("charts").textContent).filter((c) => c.linked)
    .map((c) => document.getElementById(c.name));
  const edges = () => new Set(timed.map((p) => [p.layout.margin.l, ...p.layout.xaxis.range].join()));
  told.spans = edges().size;
  told.span = timed[0].layout.xaxis.range;
  told.ink = document.getElementById("chart-height").layout.font.color;
  told.overflow = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  await Plotly.relayout("chart-height", {"xaxis.range": [293710, 293760]});
  const moved = () => places.filter((p) => p.layout.xaxis && p.layout.xaxis.range[0] === 293710).length;
  told.followers = JSON.parse(document.getElementById("charts").textContent).filter((c) => c.linked).length;
  for (let tries = 0; tries < 20 && moved() < told.followers; tries += 1) await pause();
  told.linked = moved();
  await Plotly.relayout("chart-height", {"xaxis.autorange": true});
  const whole = () => timed.filter((p) => p.layout.xaxis.range[0] === told.span[0]).length;
  for (let tries = 0; tries < 20 && whole() < timed.length; tries += 1) await pause();
  told.again = edges().size;
  const height = document.getElementById("chart-height"), labels = () => [...height.querySelectorAll(".xtick text")]
    .map((label) => label.textContent).filter((text) => text);
  document.getElementById("utc").click();
  await pause();
  told.utc = [height.layout.xaxis.type, height.layout.xaxis.range[0], height.data[1].x[0], labels()[0]];
  told.marked = [height.layout.shapes.map((line) => line.x0), [...height.data.at(-1).x]];
  await Plotly.relayout("chart-height", {"xaxis.range": ["2025-09-24 09:35:00", "2025-09-24 09:36"]});
  const dated = () => timed.filter((p) => p.layout.xaxis.range[0].startsWith("2025-09-24 09:35:00")).length;
  for (let tries = 0; tries < 20 && dated() < timed.length; tries += 1) await pause();
  told.dated = dated();
  document.getElementById("utc").click();
  await pause();
  told.seconds = [...new Set(timed.map((p) => p.layout.xaxis.range.join()))];
  told.labels = labels();
  const table = document.getElementById("events-table"), rows = () => [...table.tBodies[0].rows];
  const input = document.querySelector('input[data-table="events-table"]');
  input.value = "SAMPLE"; input.dispatchEvent(new Event("input"));
  told.found = rows().filter((r) => !r.hidden).map((r) => r.cells[1].textContent);
  input.value = ""; input.dispatchEvent(new Event("input"));
  const choice = document.querySelector('select[data-table="events-table"]');
  choice.value = "start"; choice.dispatchEvent(new Event("change"));
  told.chosen = rows().filter((r) => !r.hidden).map((r) => r.cells[1].textContent);
  const head = table.tHead.rows[0].cells[0];
  head.querySelector("button").click();
  head.querySelector("button").click();
  told.sorted = rows().map((r) => r.cells[1].textContent);
  told.broken = window.broken === 1;
  await fetch("http://127.0.0.1:PORT/", {method: "POST", mode: "no-cors", body: JSON.stringify(told)});
}));
</script>"""


# the fold of the street map where nothing answers, and the button that saves a picture
PICTURES = """<script>
addEventListener("load", () => setTimeout(async () => {
  const told = {}, pause = () => new Promise((done) => setTimeout(done, 200));
  const button = () => document.querySelector('#chart-height [data-title="Save as a picture"]');
  for (let tries = 0; tries < 100 && !button(); tries += 1) await pause();
  Plotly.downloadImage = (figure, options) => {
    Object.assign(told, { words: figure.layout.title.text, traces: figure.data.length, file: options.filename });
  };
  button().click();
  window.onerror = () => true;  // a browser without WebGL draws no map
  const fold = document.querySelector("details:has(#chart-tiles)");
  fold.open = true;
  fold.scrollIntoView();
  const unreachable = () => fold.querySelector(".unreachable");
  for (let tries = 0; tries < 100 && !unreachable(); tries += 1) await pause();
  told.unreachable = unreachable() && unreachable().textContent;
  await fetch("http://127.0.0.1:PORT/", {method: "POST", mode: "no-cors", body: JSON.stringify(told)});
}));
</script>"""


class Listener(HTTPServer):
    """Waits on the loopback for what the page tells of itself."""

    told: dict[str, Any] | None = None


class Answer(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        assert isinstance(self.server, Listener)
        self.server.told = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Say nothing."""


def opened(
    page: str, folder: Path, *options: str, width: int = 1200, probe: str = PROBE
) -> tuple[dict[str, Any], list[str]]:
    """Return what the page tells of itself, and the lines of the browser's console."""
    path, log = folder / "page.html", folder / "browser.log"
    listener = Listener(("127.0.0.1", 0), Answer)
    listener.timeout = 60.0  # s, of a machine that does much else
    probe = probe.replace("PORT", str(listener.server_port))
    path.write_text(page.replace("</body>", probe + "</body>"), encoding="utf-8")
    command = [str(BROWSER), "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += [f"--user-data-dir={folder / 'profile'}", f"--window-size={width},30000"]
    command += ["--enable-logging=stderr", *options, path.as_uri()]
    environment = {**os.environ, "HOME": str(folder)}
    with log.open("w") as stderr, listener:
        browser = subprocess.Popen(command, stdout=stderr, stderr=stderr, env=environment)
        try:
            listener.handle_request()
        finally:
            browser.terminate()
            browser.wait(timeout=30.0)
    text = log.read_text(errors="replace")
    assert listener.told is not None, text[-2000:]
    return listener.told, [line for line in text.splitlines() if "CONSOLE" in line]


@pytest.fixture(scope="module")
def page() -> str:
    return report_html(made_run(aiding=True))


def test_page_draws_links_filters_and_sorts_without_a_complaint(page: str, tmp_path: Path) -> None:
    told, console = opened(page, tmp_path)

    assert console == []
    assert told["charts"] > 15
    assert told["drawn"] == told["charts"]
    assert told["linked"] == told["followers"] > 8
    assert told["spans"] == told["again"] == 1  # as the page opens, and after a double click
    assert told["span"][0] <= START_S < START_S + 299.0 <= told["span"][1]
    assert told["found"] == ["imu_gap"]
    assert told["chosen"] == ["start"]
    assert told["sorted"][:3] == ["csv_delimiter", "imu_gap", "heading_known"]
    assert not told["broken"]
    # the street map's tiles: nothing is fetched until the reader asks
    assert (told["folded"], told["fetched"]) == (["chart-tiles"], 0)


def test_page_shows_utc_on_every_time_axis_when_asked(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", "America/New_York")  # of the reader: the axes are UTC all the same

    told, console = opened(page, tmp_path)

    kind, begin, first, tick = told["utc"]
    lines, marks = told["marked"]
    assert console == []
    assert kind == "date"
    assert begin.startswith("2025-09-24 09:34:40")
    assert first == "2025-09-24 09:34:42.000"
    assert tick.startswith("09:3")
    assert lines == marks == [f"2025-09-24 09:{moment}.000" for moment in ("34:42", "35:02", "35:32")]
    assert told["dated"] == told["followers"]
    assert told["seconds"] == [f"{START_S + 18.0:g},{START_S + 78.0:g}"]
    assert told["labels"][0].isdigit()


def test_page_is_dark_where_the_reader_asked_for_it(page: str, tmp_path: Path) -> None:
    light, _ = opened(page, tmp_path)
    dark, console = opened(page, tmp_path, "--blink-settings=preferredColorScheme=0")

    assert console == []
    assert (light["ink"], dark["ink"]) == ("#1b1f24", "#e4e7ea")


def test_page_is_no_wider_than_a_phone(page: str, tmp_path: Path) -> None:
    told, console = opened(page, tmp_path, width=500)  # the narrowest window that this browser opens

    assert console == []
    assert told["overflow"] == 0


def test_map_without_a_network_says_so_and_a_picture_carries_name_and_utc(page: str, tmp_path: Path) -> None:
    nowhere = "--host-resolver-rules=MAP *.openstreetmap.org 127.0.0.1:9"
    # without one the buttons are not there
    mouse = "--blink-settings=primaryHoverType=2,availableHoverTypes=2"
    told, _ = opened(page, tmp_path, nowhere, mouse, probe=PICTURES)

    assert "tiles cannot be fetched" in told["unreachable"]
    assert "Height above the ellipsoid" in told["words"] and "made (tight17), 20" in told["words"]
    assert told["words"].count(" UTC") == 1 and told["traces"] >= 2
    assert told["file"].startswith("made_tight17_20") and told["file"].endswith("_height")
