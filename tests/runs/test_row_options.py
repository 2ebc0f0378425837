"""The options that say which rows a run is to have, and what of them cannot be used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.cli.rows import point_of, read_times, rows_wanted
from insgnss.constants import NS_PER_WEEK
from insgnss.errors import ColumnError, ConfigError, InputError, MissingFileError
from insgnss.runs.result import Run
from insgnss.runs.wanted_rows import output_of
from tests.conftest import REPOSITORY

SAMPLE = str(REPOSITORY / "data" / "sample_flight" / "flight.toml")


@pytest.mark.parametrize("command", ["replay", "smooth"])
def test_command_writes_rows_at_the_times_of_a_file_for_a_point(command: str, tmp_path: Path) -> None:
    times = tmp_path / "camera.csv"
    times.write_text("picture,time_s\na.jpg,293890.125\nb.jpg,293890.5017\n\nc.jpg,294100.0\n")
    options = ["--times", str(times), "--point=0.5,-0.2,1.0", "--quaternion", "--covariance"]

    told = CliRunner().invoke(app, [command, SAMPLE, "--output", str(tmp_path / "run"), *options])

    assert told.exit_code == 0, told.output
    nav = Run.load(tmp_path / "run").nav
    np.testing.assert_array_equal(nav["time_s"], [293890.125, 293890.5017, 294100.0])
    apart_m = np.hypot(111e3 * (nav["lat_deg"] - nav["point_lat_deg"]), nav["h_m"] - nav["point_h_m"])
    assert apart_m.between(0.0, 1.2).all()
    assert {"q_nb_w", "cov_n_e_m2", "cov_point_vn_vd_m2ps2"} <= set(nav.columns)


@pytest.mark.parametrize("rate", ["gnss", "10"])
def test_summary_counts_the_pseudoranges_of_each_epoch_at_any_rate(rate: str) -> None:
    told = CliRunner().invoke(app, ["replay", SAMPLE, "--rate", rate])

    assert "pseudoranges used per epoch, a satellite once for each band: 6 to 11, mean 10.3" in told.output


@pytest.mark.parametrize(
    "text", ["1.5\n2.5\n", "time_s\n1.5\n2.5\n", "\ufefftime_s,x\n1.5,a\n2.5,b\n", "seconds\n1.5\n\n2.5\n"]
)
def test_times_are_read_with_or_without_a_name(text: str, tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text(text, encoding="utf-8")

    assert read_times(path) == [1.5, 2.5]


@pytest.mark.parametrize(
    "text",
    [
        "time_s;frame\n293800,25;1\n293900,5;2\n",
        "# camera 1\n\nframe;time_s;\n1;293800.25;\n# battery changed\n2;293900.50;\n",
        "x\ttime_s\n7\t293800.25\n7\t293900.5\n",
        "frame  time_s\n1   293800.25\n22  293900.5\n",
        'time_s,frame\n"293800,25",1\n"293900,5",2\n',
    ],
)
def test_times_are_read_whatever_parts_the_columns(text: str, tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text(text, encoding="utf-8")

    assert read_times(path) == [293800.25, 293900.5]


@pytest.mark.parametrize(
    "text",
    [
        "utc\n2025-09-24T09:36:22.25Z\n2025-09-28T02:00:00+02:00\n",
        "2025-09-24T09:36:22.25Z\n2025-09-28T02:00:00+02:00\n",
        "2025-09-24 09:36:22.25Z\n2025-09-28 02:00:00 +02:00\n",
        "frame;time_s\n1;2025-09-24T09:36:22,25Z\n2;2025-09-28T00:00:00Z\n",
    ],
)
def test_dates_of_a_file_are_utc_also_in_the_next_week(text: str, tmp_path: Path) -> None:
    path = tmp_path / "times.csv"
    path.write_text(text, encoding="utf-8")

    t_ns = output_of(read_times(path), 2385)

    assert ((np.asarray(t_ns) - 2385 * NS_PER_WEEK) / 1e9).tolist() == [293800.25, 604818.0]


@pytest.mark.parametrize(
    ("text", "kind", "told"),
    [
        ("", InputError, "holds no times"),
        ("time_s\n", InputError, "holds no times"),
        ("t,x\n1,2\n", ColumnError, r"times.csv:1: no column 'time_s'"),
        ("1.5\nnoon\n", ColumnError, r"times.csv:2, column 'time_s': 'noon' is not a time"),
        ("x,time_s\n1,1.5\n2\n", ColumnError, r"times.csv:3"),
        ("time_s\nnan\n", ColumnError, r"times.csv:2"),
        ("time_s\n293800,25\n", ColumnError, r"times.csv:2.*has a comma"),
        ("time_s;x\n293,800;1\n", ColumnError, r"times.csv:2.*has a comma"),
        ("time_s,x\n\n293800,25,1\n", ColumnError, r"times.csv:3.*3 cells, but the header names 2"),
        ("293800,25\n293900,5\n", ColumnError, r"times.csv:1: no column"),
        ("1;2\n", ColumnError, r"times.csv:1: no column"),
        ("# a\nutc\n2025-09-24T09:36:22\n", ColumnError, r"times.csv:3, column 'time_s|utc': .* has no zone"),
        ("time_s\n1_000\n", ColumnError, r"times.csv:2"),
    ],
)
def test_times_that_cannot_be_read_are_an_error_with_their_line(
    text: str, kind: type[Exception], told: str, tmp_path: Path
) -> None:
    path = tmp_path / "times.csv"
    path.write_text(text)

    with pytest.raises(kind, match=told):
        read_times(path)


def test_file_of_times_that_is_none_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="no such file"):
        read_times(tmp_path / "times.csv")
    with pytest.raises(InputError, match="cannot be read"):
        read_times(tmp_path)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="cannot be read"):
        read_times(tmp_path / "binary")


def test_options_that_contradict_each_other_are_an_error() -> None:
    with pytest.raises(ConfigError, match="exclude each other"):
        rows_wanted("imu", Path("times.csv"), None, quaternion=False, covariance=False)
    with pytest.raises(ConfigError, match="invalid point"):
        point_of("1,2,x")
    assert point_of("camera") == "camera"
    assert point_of("1,-2.5,3") == [1.0, -2.5, 3.0]


def test_help_of_smooth_says_where_its_rows_lie() -> None:
    told = " ".join(CliRunner(env={"COLUMNS": "60"}).invoke(app, ["smooth", "--help"]).output.split())
    assert "one row per GNSS epoch, and so none inside an outage" in told and "--rate or --times" in told
