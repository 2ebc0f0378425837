"""The strict reading of settings: every mistake is named with its line and the nearest valid key."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from insgnss.config.flight import FlightConfig
from insgnss.config.strict import load_toml
from insgnss.errors import ConfigError, MissingFileError
from insgnss.results.record import RECORD
from insgnss.results.saving import RUN_KIND

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


def test_folder_in_place_of_a_file_names_the_file_to_give(tmp_path: Path) -> None:
    (tmp_path / "flight.toml").write_text(GOOD)
    with pytest.raises(MissingFileError, match=r"name the file in it: flight\.toml"):
        load_toml(tmp_path, FlightConfig)
    entries = {"nav.parquet": {"kind": RUN_KIND, "sha256": ""}}
    (tmp_path / RECORD).write_text(json.dumps(entries))
    with pytest.raises(
        MissingFileError, match="a saved run: name the flight file from which the run was made"
    ):
        load_toml(tmp_path, FlightConfig)


def test_file_that_is_no_toml_gives_the_line(tmp_path: Path) -> None:
    assert failure(tmp_path, GOOD.replace("[imu]", "[imu")).line == 3


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('files = ["gnss.csv"]', 'files = ["gnss.csv", "a\\u0000b"]', "gnss.files"),
        ('grade = "tactical"', 'grade = "\\u0000"', "imu.grade"),
        ("[gnss]", '["\\u0000"]', "\0"),
    ],
)
def test_text_with_a_nul_character_names_its_key(tmp_path: Path, old: str, new: str, key: str) -> None:
    error = failure(tmp_path, GOOD.replace(old, new))
    assert "NUL character" in error.message and error.key == key


def test_file_that_is_no_text_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "flight.toml"
    path.write_bytes(b"\xff\xfe\x00g")
    with pytest.raises(ConfigError, match="UTF-8"):
        load_toml(path, FlightConfig)


START = """
[start]
lat_deg = -33.9
lon_deg = 151.2
h_m = 50.0
v_ned_mps = [0.0, 0.0, 0.0]
rpy_deg = [0.0, 0.0, 140.0]
sd_position_m = 3.0
sd_velocity_mps = 0.5
sd_roll_pitch_deg = 1.0
sd_yaw_deg = 5.0
"""


@pytest.mark.parametrize(
    ("old", "new", "key", "bound"),
    [
        ("h_m = 50.0", "h_m = 1e8", "start.h_m", "10000000"),
        ("h_m = 50.0", "h_m = -2e4", "start.h_m", "-10000"),
        ("v_ned_mps = [0.0", "v_ned_mps = [1e300", "start.v_ned_mps", "20000"),
        ("rpy_deg = [0.0", "rpy_deg = [1e5", "start.rpy_deg", "360"),
        ("sd_position_m = 3.0", "sd_position_m = 1e12", "start.sd_position_m", "10000000"),
        ("sd_velocity_mps = 0.5", "sd_velocity_mps = 1e12", "start.sd_velocity_mps", "20000"),
        ("sd_roll_pitch_deg = 1.0", "sd_roll_pitch_deg = 181.0", "start.sd_roll_pitch_deg", "180"),
        ("sd_yaw_deg = 5.0", "sd_yaw_deg = 1e6", "start.sd_yaw_deg", "180"),
        ("lever_arm_m = [1.0", "lever_arm_m = [1e300", "gnss.lever_arm_m", "1000"),
        (
            "sd_yaw_deg = 5.0",
            "sd_yaw_deg = 5.0\n[imu.time]\noffset_s = 1e10",
            "imu.time.offset_s",
            "1300000000",
        ),
        ("sd_yaw_deg = 5.0", "sd_yaw_deg = 5.0\ntime_s = 1e300", "start.time_s", "6100000"),
        (
            "sd_yaw_deg = 5.0",
            'sd_yaw_deg = 5.0\n[gnss.time]\nscale = "utc"\nleap_seconds = 100000000000000000000',
            "gnss.time.leap_seconds",
            "100",
        ),
        (
            "sd_yaw_deg = 5.0",
            'sd_yaw_deg = 5.0\n[imu.time]\nscale = "utc"\nleap_seconds = -18',
            "imu.time.leap_seconds",
            "0",
        ),
    ],
)
def test_value_that_no_vehicle_has_names_line_key_and_bound(
    tmp_path: Path, old: str, new: str, key: str, bound: str
) -> None:
    text = (GOOD + START).replace(old, new)
    assert load(tmp_path, GOOD + START).start != "automatic"
    error = failure(tmp_path, text)
    assert error.key == key and f"change {key}" in error.advice
    last = new.splitlines()[-1].split(" = ")[0]
    assert error.line == next(k for k, line in enumerate(text.splitlines(), 1) if line.startswith(last))
    assert f"equal to {bound};" in error.message


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        (
            "[gnss]",
            'axes = ["y", "x", "-z"]\nmounting_matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n[gnss]',
            "imu",
            "axes and mounting_matrix",
        ),
        ("[gnss]", '[imu.columns]\ngyro = ["w", "w", "v"]\n[gnss]', "imu.columns", "'w' is named for two"),
        (
            "[gnss]",
            '[imu.columns]\ngyro = ["w", "accel_x", "v"]\n[gnss]',
            "imu",
            "'accel_x' is named",
        ),
        (
            "lever",
            '[gnss.columns]\ndoppler = "cn0_dbhz"\n[gnss.base]\n#',
            "gnss.columns",
            "'cn0_dbhz' is named",
        ),
        ("[gnss]", "[imu.time]\nleap_seconds = 18\n[gnss]", "imu.time", "scale = 'utc'"),
    ],
)
def test_declaration_that_would_be_ignored_is_an_error(
    tmp_path: Path, old: str, new: str, key: str, words: str
) -> None:
    text = GOOD.replace(old, new)
    error = failure(tmp_path, text)
    assert words in str(error) and f"key '{key}'" in str(error)


def test_several_columns_may_be_none(tmp_path: Path) -> None:
    columns = load(tmp_path, GOOD + '[gnss.columns]\ndoppler = "none"\ncn0 = "none"\n').gnss.columns
    assert columns.chosen_names() == () and "none" not in columns.all_names()


def test_matrix_beside_the_usual_axes_and_leap_seconds_of_utc_are_no_error(tmp_path: Path) -> None:
    """A dumped configuration names every key; the usual axes turn nothing."""
    matrix = 'axes = ["+x", "+y", "+z"]\nmounting_matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n'
    text = GOOD.replace("[gnss]", f'{matrix}[imu.time]\nscale = "utc"\nleap_seconds = 18\n[gnss]')
    config = load(tmp_path, text)
    assert FlightConfig.model_validate(config.model_dump(mode="json")) == config


@pytest.mark.parametrize("number", ["1e16", "-1e300"])
def test_number_that_nothing_has_names_key_and_line(tmp_path: Path, number: str) -> None:
    error = failure(
        tmp_path,
        GOOD.replace("[gnss]", f"mounting_matrix = [[1, 0, 0], [0, {number}, 0], [0, 0, 1]]\n[gnss]"),
    )

    assert error.key == "imu.mounting_matrix"
    assert "too large or too small for any setting" in error.message


@pytest.mark.parametrize("text", ["", "# nothing but a comment\n", "[foo]\na = 1\n", 'name = "flight"\n'])
def test_flight_file_without_logs_says_what_one_needs(tmp_path: Path, text: str) -> None:
    error = failure(tmp_path, text)

    assert "a flight file needs [gnss] with files and navigation" in error.advice
    assert "[imu] with files and grade" in error.advice and "docs/flight-file.md" in error.advice
    assert "left out" not in str(error) and error.key in (None, "foo", "gnss")
