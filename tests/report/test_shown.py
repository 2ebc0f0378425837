"""What a result shows of itself: a short line in a terminal, folded tables in Jupyter, a report that can be printed."""

from __future__ import annotations

import dataclasses
import html.parser
from pathlib import Path

import numpy as np
import pytest

import insgnss
from insgnss.errors import ResultError
from insgnss.log.checks.report import CheckReport, Finding
from insgnss.runs.simulate import simulate
from insgnss.studies.consistency.study import consistency_study
from insgnss.studies.receiver.slips import SlipRuns
from tests.conftest import REPOSITORY
from tests.report.runs import made_run

FLIGHT = REPOSITORY / "data" / "sample_flight" / "flight.toml"


class Balanced(html.parser.HTMLParser):
    """Finds tags that are not closed, or closed twice."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.parametrize(
    "result",
    [
        made_run(),
        insgnss.Flight.load(FLIGHT),
        consistency_study(made_run()),
        insgnss.compare(made_run(), made_run(seed=2)),
    ],
)
def test_result_is_one_short_line_and_whole_html(result: object) -> None:
    line = repr(result)
    shown = result._repr_html_()  # type: ignore[attr-defined]

    assert line.startswith(type(result).__name__) and "\n" not in line
    assert len(line) < 400
    assert len(shown) < 50_000
    assert Balanced(shown).open == []


def test_engine_and_simulation_are_one_short_line() -> None:
    engine = insgnss.Engine(insgnss.engine_settings(FLIGHT))
    made = simulate("at_rest", duration_s=3.0)

    assert repr(engine) == "Engine(not started; 0 events)"
    assert repr(made).startswith("Simulation('at rest'; 3 s; 300 inertial samples; ")


def test_slips_are_a_share_and_an_error() -> None:
    runs = SlipRuns(np.array([[np.inf, 2.0], [np.inf, np.inf]]), 0.125)

    assert repr(runs) == (
        "SlipRuns(2 runs of 2 channels; 50.0% of the runs slip; phase error 0.125 rad rms in the others)"
    )


def test_run_tells_flight_filter_and_rows() -> None:
    line = repr(made_run())

    assert "'made', filter 'tight17'" in line and "heading known at" in line and "nav 300" in line


def test_names_of_the_user_are_no_markup_in_jupyter() -> None:
    run = made_run()
    named = dataclasses.replace(run, settings={**run.settings, "flight": {"name": "<script>x</script>"}})

    assert "<script>" not in named._repr_html_()


def test_report_of_a_check_can_be_printed(capsys: pytest.CaptureFixture[str]) -> None:
    report = CheckReport("flight", (Finding("warning", "imu", "a gap of <3 s", "look at it"),))
    print(report)

    assert capsys.readouterr().out.splitlines() == report.lines()
    assert repr(report) == "CheckReport(flight: 0 error(s), 1 warning(s), 0 ok)"
    assert "&lt;3 s" in report._repr_html_()


def test_verdict_of_a_study_can_be_printed() -> None:
    study = consistency_study(made_run())

    assert str(study).splitlines() == list(study.verdict)


def test_runs_are_compared_by_filter_folder_or_given_name(tmp_path: Path) -> None:
    first, second = made_run(), made_run(seed=2)
    smoothed = dataclasses.replace(second, settings={**second.settings, "smooth": True})
    first.save(tmp_path / "one")

    assert list(insgnss.compare(first, smoothed).runs) == ["tight17", "tight17, smoothed"]
    assert list(insgnss.compare(first, second).runs) == ["tight17 (1)", "tight17 (2)"]
    assert list(insgnss.compare(tmp_path / "one", gps=second).runs) == ["one", "gps"]
    assert (insgnss.compare(first, second).write(tmp_path / "page.html")).stat().st_size > 10_000
    with pytest.raises(ResultError, match="needs two runs"):
        insgnss.compare(first)
    with pytest.raises(ResultError, match="have the same name"):
        insgnss.compare(tmp_path / "one", one=second)


def test_smoother_against_filter_is_a_setting_that_differs() -> None:
    first, second = made_run(), made_run(seed=2)
    smoothed = dataclasses.replace(second, settings={**second.settings, "smooth": True})

    assert ["smooth", "-", "true"] in insgnss.compare(first, smoothed).as_json()["settings_that_differ"]
