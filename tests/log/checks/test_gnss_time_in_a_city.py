"""Reflections of a street are no wrong time tags: wrong tags put satellites kilometres off."""

from __future__ import annotations

from pathlib import Path

import insgnss
from insgnss.runs.simulate import simulate


def test_check_of_a_sound_city_drive_finds_no_fault_of_the_tags(tmp_path: Path) -> None:
    """43 of 147 epochs of this drive do not pass the test of their pseudoranges."""
    simulate("city_car", seed=78).save(tmp_path)
    report = insgnss.check_flight(insgnss.Flight.load(tmp_path / "flight.toml"))
    assert [finding.text for finding in report.findings if finding.severity == "error"] == []
