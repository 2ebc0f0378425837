"""Reflections of a street are no wrong time tags: wrong tags put satellites kilometres off, though many agree."""

from __future__ import annotations

from pathlib import Path

import pytest

import insgnss
from insgnss.runs.simulate import simulate

WALK = "walk_boulder_20250828"


def test_check_of_a_sound_city_drive_finds_no_fault_of_the_tags(tmp_path: Path) -> None:
    """43 of 147 epochs of this drive do not pass the test of their pseudoranges."""
    simulate("city_car", seed=78).save(tmp_path)
    report = insgnss.check_flight(insgnss.Flight.load(tmp_path / "flight.toml"))
    assert [finding.text for finding in report.findings if finding.severity == "error"] == []


def test_check_of_a_file_is_that_of_its_flight(tmp_path: Path) -> None:
    simulate("at_rest", seed=3, duration_s=60.0).save(tmp_path)
    path = tmp_path / "flight.toml"
    assert str(insgnss.check_flight(path)) == str(insgnss.check_flight(insgnss.Flight.load(path)))


@pytest.mark.real_data
def test_leap_seconds_are_found_though_thirteen_ranges_agree(tmp_path: Path, data_root: Path) -> None:
    """With tags in UTC a robust solution of this log keeps 13 to 15 of 24 ranges, which agree to 0.2 sigma."""
    text = (Path(__file__).parents[2] / "flights" / "walk.toml").read_text(encoding="utf-8")
    folder = data_root / WALK
    if not folder.is_dir():
        pytest.skip(f"no real log at {folder}")
    text = text.replace(f"../../../shared/data/{WALK}", folder.as_posix())
    (tmp_path / "flight.toml").write_text(text.replace("[gnss]\n", "[gnss]\ntime = { offset_s = -18.0 }\n"))
    report = insgnss.check_flight(insgnss.Flight.load(tmp_path / "flight.toml"))
    (finding,) = [one for one in report.findings if "+18 leap seconds" in one.text]
    assert finding.severity == "error" and finding.proposals
