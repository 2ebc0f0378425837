"""The strict reading of settings: every mistake is named with its line and the nearest valid key."""

from __future__ import annotations

from pathlib import Path

import pytest

from insgnss.config.flight import FlightConfig
from insgnss.config.strict import load_toml
from insgnss.errors import ConfigError, MissingFileError

GOOD = """\
gps_week = 2268

[imu]
files = ["imu.csv"]
gyro_unit = "deg/s"
accel_unit = "g"
grade = "tactical"

[gnss]
files = ["gnss.csv"]
lever_arm_m = [1.0, 0.0, -0.5]
"""


def load(folder: Path, text: str) -> FlightConfig:
    path = folder / "flight.toml"
    path.write_text(text)
    return load_toml(path, FlightConfig)


def failure(folder: Path, text: str) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        load(folder, text)
    return caught.value


def test_good_file_gives_its_values(tmp_path: Path) -> None:
    config = load(tmp_path, GOOD)
    assert config.imu.gyro_unit == "deg/s"
    assert config.gnss.lever_arm_m == (1.0, 0.0, -0.5)
    assert config.start == "automatic"


def test_byte_order_mark_is_no_error(tmp_path: Path) -> None:
    assert load(tmp_path, "\ufeff" + GOOD).gps_week == 2268


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "nearest"),
    [
        ("gyro_unit", "gyro_units", 5, "imu.gyro_units", "'imu.gyro_unit'"),
        ("lever_arm_m", "leverarm_m", 11, "gnss.leverarm_m", "'gnss.lever_arm_m'"),
        ("gps_week = 2268", "gps_week = 2268\nlever_arm = [0, 0, 0]", 2, "lever_arm", "'gnss.lever_arm_m'"),
        (
            'grade = "tactical"',
            'grade = "tactical"\ntime.unitt = "s"',
            8,
            "imu.time.unitt",
            "'imu.time.unit'",
        ),
    ],
)
def test_unknown_key_names_the_nearest_valid_key_and_its_line(
    tmp_path: Path, old: str, new: str, line: int, key: str, nearest: str
) -> None:
    error = failure(tmp_path, GOOD.replace(old, new))
    assert (error.line, error.key) == (line, key)
    assert "unknown key" in error.message
    assert nearest in error.advice
    assert error.file is not None and error.file.endswith("flight.toml")


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "words"),
    [
        ("gps_week = 2268", 'gps_week = "2268"', 1, "gps_week", "a whole number"),
        ("gps_week = 2268", "gps_week = -1", 1, "gps_week", "greater than or equal to 0"),
        ('"deg/s"', '"degrees"', 5, "imu.gyro_unit", "'deg/s'"),
        ("[1.0, 0.0, -0.5]", "[1.0, 0.0]", 11, "gnss.lever_arm_m", "entry 3"),
        ("[1.0, 0.0, -0.5]", '[1.0, "0", 0.0]', 11, "gnss.lever_arm_m", "a number"),
        ("[1.0, 0.0, -0.5]", "[1.0, nan, 0.0]", 11, "gnss.lever_arm_m", "a finite number"),
        ('"tactical"', "3", 7, "imu.grade", "a text in quotes"),
        ('accel_unit = "g"', 'accel_unit = "m/s"', 3, "imu", "increments"),
        ('files = ["imu.csv"]', "", 3, "imu.files", "missing key"),
        ('"tactical"', '"tactical"\naxes = ["+x", "+x", "-z"]', 8, "imu.axes", "x, y and z once each"),
    ],
)
def test_wrong_value_says_what_is_expected_and_where(
    tmp_path: Path, old: str, new: str, line: int, key: str, words: str
) -> None:
    error = failure(tmp_path, GOOD.replace(old, new))
    assert (error.line, error.key) == (line, key)
    assert words in str(error)


def test_all_errors_of_a_file_are_listed(tmp_path: Path) -> None:
    error = failure(
        tmp_path, GOOD.replace("gps_week = 2268", "gps_week = -5").replace("gyro_unit", "gyro_units")
    )
    assert error.key == "imu.gyro_units"  # the unknown key first: it often explains the others
    assert "gps_week" in str(error)


def test_grade_given_as_numbers_reports_only_errors_of_the_table(tmp_path: Path) -> None:
    error = failure(tmp_path, GOOD.replace('"tactical"', "{ gyro_bias_deg_per_h = -1.0 }"))
    assert "imu.grade.accel_bias_mg" in str(error)
    assert "a text in quotes" not in str(error)


def test_missing_file_names_the_nearest(tmp_path: Path) -> None:
    (tmp_path / "flight_a.toml").write_text(GOOD)
    with pytest.raises(MissingFileError) as caught:
        load_toml(tmp_path / "flight_b.toml", FlightConfig)
    assert "flight_a.toml" in caught.value.advice


def test_file_that_is_no_toml_gives_the_line(tmp_path: Path) -> None:
    assert failure(tmp_path, GOOD.replace("[imu]", "[imu")).line == 3


def test_file_that_is_no_text_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "flight.toml"
    path.write_bytes(b"\xff\xfe\x00g")
    with pytest.raises(ConfigError, match="UTF-8"):
        load_toml(path, FlightConfig)
