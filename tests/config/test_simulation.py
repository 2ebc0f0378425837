"""A scenario file with mistakes gets an error with file, line, key and what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.config.simulation import SimulationConfig
from insgnss.config.strict import load_toml
from insgnss.config.toml_lines import key_lines, line_of
from insgnss.errors import ConfigError, ModelError, NavigationDataError
from insgnss.runs.simulate import simulate

GOOD = """\
gps_week = 2385
start_s = 100000.0
speed_mps = 80.0
place = { lat_deg = 50.0, lon_deg = 8.0, h_m = 500.0 }

[[manoeuvre]]
kind = "straight"
duration_s = 10.0

[[manoeuvre]]
kind = "turn"
by_deg = 90.0
bank_deg = 30.0

[imu]
grade = "tactical"

[gnss]
pseudorange_noise_m = { floor = 0.5 }

[[fault]]
kind = "range_step"
sv = "G05"
size_m = 20.0
from_s = 5.0
"""


def failed(tmp_path: Path, old: str, new: str, *, count: int = -1) -> ConfigError:
    assert old in GOOD
    (tmp_path / "scenario.toml").write_text(GOOD.replace(old, new, count))
    with pytest.raises(ConfigError) as caught:
        simulate(tmp_path / "scenario.toml", duration_s=8.0)
    assert caught.value.file == str(tmp_path / "scenario.toml")
    return caught.value


def test_good_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "scenario.toml").write_text(GOOD)
    config = load_toml(tmp_path / "scenario.toml", SimulationConfig)
    assert [entry.kind for entry in config.manoeuvre] == ["straight", "turn"]


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "told"),
    [
        ('kind = "turn"', 'kind = "trun"', 11, "manoeuvre.kind", "nearest: 'turn'"),
        ('kind = "turn"\n', "", 10, "manoeuvre.kind", "say which kind"),
        ("bank_deg = 30.0", "bank_dg = 30.0", 13, "manoeuvre.bank_dg", "'manoeuvre.bank_deg'"),
        ("bank_deg = 30.0", "bank_deg = 95.0", 13, "manoeuvre.bank_deg", "less than 85"),
        ("by_deg = 90.0", "by_deg = 2.0", 10, "manoeuvre", "manoeuvre 2 (turn)"),
        ("speed_mps = 80.0", "speed_mps = 0.0", 10, "manoeuvre", "needs speed"),
        ("{ floor = 0.5 }", "{ floor = -0.5 }", 19, "gnss.pseudorange_noise_m.floor", "greater than or equal to 0"),
        ('kind = "range_step"', 'kind = "range_stap"', 22, "fault.kind", "nearest: 'range_step'"),
        ("from_s = 5.0", "from_s = 5.0\nto_s = 4.0", 21, "fault", "is not after"),
        ("from_s = 5.0", "from_s = -5.0", 25, "fault.from_s", "greater than or equal to 0"),
        ('sv = "G05"', 'sv = "G77"', 23, "fault.sv", "not in the sky"),
    ],
)  # fmt: skip
def test_mistake_is_told_with_line_and_key(
    old: str, new: str, line: int, key: str, told: str, tmp_path: Path
) -> None:
    error = failed(tmp_path, old, new)
    assert error.line == line
    assert error.key == key
    assert told in str(error)


def test_advice_for_an_unknown_key_names_only_keys_of_its_own_kind(tmp_path: Path) -> None:
    error = failed(tmp_path, "duration_s = 10.0", "duration_s = 10.0\nbank = 3.0", count=1)
    assert error.line == 9 and error.key == "manoeuvre.bank"
    assert "valid here" not in error.advice or "bank_deg" not in error.advice.split("valid here")[1]


def test_neither_manoeuvres_nor_reference_is_told(tmp_path: Path) -> None:
    (tmp_path / "scenario.toml").write_text("gps_week = 2385\nstart_s = 1.0\n")
    with pytest.raises(ConfigError, match="manoeuvres"):
        simulate(tmp_path / "scenario.toml")


def test_unknown_scenario_grade_and_duration_are_told(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no scenario named") as caught:
        simulate("fast_jit")
    assert "fast_jet" in caught.value.advice
    (tmp_path / "scenario.toml").write_text(GOOD.replace('"tactical"', '"tacticl"'))
    with pytest.raises(ModelError, match="tacticl"):
        simulate(tmp_path / "scenario.toml")
    with pytest.raises(ConfigError, match="duration"):
        simulate("at_rest", duration_s=0.0)


def test_scenario_longer_than_a_message_holds_is_told(tmp_path: Path) -> None:
    (tmp_path / "long.toml").write_text(GOOD.replace("duration_s = 10.0", "duration_s = 20000.0", 1))
    with pytest.raises(ConfigError, match="longer than one message"):
        simulate(tmp_path / "long.toml")


def test_sky_of_another_day_is_told(tmp_path: Path) -> None:
    simulate("at_rest", duration_s=5.0).save(tmp_path / "made")
    sky = '[sky]\nkind = "rinex"\nfiles = ["made/nav.rnx"]\n\n[imu]'
    (tmp_path / "scenario.toml").write_text(GOOD.replace("[imu]", sky))
    with pytest.raises(NavigationDataError, match="no healthy GPS message") as caught:
        simulate(tmp_path / "scenario.toml")
    assert "2025-" in caught.value.advice


def test_line_of_an_entry_of_an_array_is_its_own() -> None:
    lines = key_lines(GOOD)
    assert line_of(("manoeuvre", 0, "kind"), lines) == 7
    assert line_of(("manoeuvre", 1, "kind"), lines) == 11
    assert line_of(("manoeuvre", "kind"), lines) == 7
    assert line_of(("manoeuvre", 1), lines) == 10
    assert line_of(("gnss", "pseudorange_noise_m", "floor"), lines) == 19
