"""Scenario files: what they hold, and what a wrong one gives."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.config import library
from insgnss.errors import ConfigError
from insgnss.simulation.sky import PAPER_SKY

FILE = library.find("scenarios", "sokolov_2015")


def changed(folder: Path, old: str, new: str) -> Path:
    """Return a copy of the scenario with one text replaced, which must stand in it once."""
    text = FILE.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path = folder / "mine.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_sky_is_table_2_of_the_paper() -> None:
    tracks = library.scenario_config("sokolov_2015").satellites

    found = [(int(t.sv[1:]), t.azimuth_deg, t.elevation_deg) for t in tracks]
    assert found == [(t.number, t.azimuth_deg, t.elevation_deg) for t in PAPER_SKY]


def test_every_number_of_the_file_names_its_source() -> None:
    lines = FILE.read_text(encoding="utf-8").splitlines()
    headers = [k for k, line in enumerate(lines) if line.startswith("[") and line != "[search]"]
    table = ""
    for k, line in enumerate(lines):
        table = line if k in headers else table
        # false locks have theirs in the text above them, a satellite in that above the list
        if "=" in line and not line.startswith(("#", " ", "name", "satellites")) and "false" not in table:
            assert any(f"[{n}]" in line or f"[{n}]" in table for n in (1, 2, 3)), f"line {k + 1}: {line}"


@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        (
            "speed_mps = 250.0 ",
            "sped_mps = 250.0 ",
            "flight.sped_mps",
            "nearest valid key: 'flight.speed_mps'",
        ),
        ("until_s = 100.0", "until_s = 60.0", "outage", "until_s must be later than from_s"),
        ("until_s = 100.0", "until_s = 1300.0", "outage", "within the scenario"),
        ('sv = ["G01", "G16",', 'sv = ["G03", "G16",', "outage", "G03 is not"),
        ('{ sv = "G02"', '{ sv = "G01"', "satellites", "G01 appears twice"),
        ("offset_m = [20.0, 60.0]", "offset_m = [60.0, 20.0]", "false_locks", r"must be \[least, most\]"),
        ("duration_s = 240.0 ", "duration_s = 101.0 ", "flight", "roll in before the outage"),
        ("roll_deg = -43.5", 'roll_deg = "left"', "bank.roll_deg", "expected a number"),
    ],
)
def test_wrong_file_is_told_by_key_and_line(
    tmp_path: Path, old: str, new: str, key: str, message: str
) -> None:
    path = changed(tmp_path, old, new)
    lines = path.read_text(encoding="utf-8").splitlines()

    with pytest.raises(ConfigError, match=message) as error:
        library.scenario_config(path)

    told = error.value
    assert (str(told.file), told.key) == (str(path), key)
    assert told.line is not None
    # the line of the key itself, or of the table that it stands in
    assert key.rsplit(".", 1)[-1] in lines[told.line - 1]
