"""The command ``insgnss margin``: its numbers, its pictures, a saved run, and how it ends when something is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from tests.runs.margin.scene import flown

EMITTERS = """
[[emitter]]
name = "mast"
lat_deg = 60.05
lon_deg = 30.1
h_m = 50.0
eirp_dbw = 0.0
bandwidth_hz = 20e6
"""
PAPER = ["--signal", "GLONASS G1 C/A", "--oscillator", "3167", "--imu", "2", "--threshold", "0.076"]


def test_margin_of_the_paper_is_printed_and_drawn(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["margin", *PAPER, "--output", str(tmp_path)])

    assert result.exit_code == 0, result.output
    assert "33.40" in result.stdout and "41.87" in result.stdout
    names = {"margin_drift.png", "margin_diagram.png", "margin_type_1.png", "margin_type_2.png"}
    assert {path.name for path in tmp_path.glob("[!.]*")} == names | {"margin.parquet"}


def test_margin_table_is_written_without_pictures(tmp_path: Path) -> None:
    options = ["--output", str(tmp_path / "out"), "--no-pictures", "--format", "csv"]
    result = CliRunner().invoke(app, ["margin", *PAPER, *options])

    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "out" / "margin.csv").set_index("discriminator")
    assert f"{table.loc['Q', 'margin_db']:.2f}" in result.stdout
    assert {"margin_oscillator_alone_db", "margin_ins_alone_db"} <= set(table.columns)


def test_options_that_would_not_be_used_are_refused(tmp_path: Path) -> None:
    told = CliRunner().invoke(app, ["margin", "--step", "2"])
    assert told.exit_code == 2 and "--step is not used without a run" in told.stderr
    with_run = ["margin", str(tmp_path), "-e", "jammed_approach", "--oscillator", "ocxo", "--seed", "2"]
    told = CliRunner().invoke(app, with_run)
    assert told.exit_code == 2 and "--oscillator, --seed are not used with a run" in told.stderr


def test_loop_without_inertial_system_follows_the_acceleration_with_the_better_order() -> None:
    options = ["--oscillator", "100", "--imu", "1", "--threshold", "0.076", "--accumulation", "0.001"]
    motion = ["--acceleration", "49.03325", "--lasting", "3.3333333", "--bandwidth", "1.022e6"]
    result = CliRunner().invoke(app, ["margin", *options, *motion, "--json"])

    assert result.exit_code == 0, result.output
    first = json.loads(result.stdout)["loops"][0]
    # the independent number is for 1600 MHz; at L1 the same turn is 0.02 dB less
    assert (first["discriminator"], first["unaided_order"]) == ("IQ", 3)
    assert first["unaided_db"] == pytest.approx(30.33, abs=0.01)
    told = CliRunner().invoke(app, ["margin", *options, *motion])
    assert "30.33" in told.stdout
    assert CliRunner().invoke(app, ["margin", *options, "--acceleration", "-1"]).exit_code != 0


def test_library_names_stand_for_sensors() -> None:
    result = CliRunner().invoke(app, ["margin", "--oscillator", "ocxo", "--imu", "navigation", "--cn0", "45"])

    assert result.exit_code == 0, result.output
    assert "oscillator ocxo" in result.stdout and "nothing was written" in result.stdout


def test_emitters_may_be_a_name_in_the_library(tmp_path: Path) -> None:
    folder = flown().save(tmp_path / "run")
    result = CliRunner().invoke(app, ["margin", str(folder), "--emitters", "jammed_approach"])
    assert result.exit_code == 0, result.output


def test_saved_run_is_flown_past_the_emitters(tmp_path: Path) -> None:
    folder = flown().save(tmp_path / "run")
    (tmp_path / "emitters.toml").write_text(EMITTERS)
    options = ["--emitters", str(tmp_path / "emitters.toml"), "-o", str(tmp_path / "out"), "--format", "csv"]
    result = CliRunner().invoke(app, ["margin", str(folder), *options])

    assert result.exit_code == 0, result.output
    assert "G05" in result.stdout and "in lock" in result.stdout
    names = {"margin_satellites.csv", "margin_emitters.csv", "margin_events.csv", "margin_flown.png"}
    assert {path.name for path in (tmp_path / "out").glob("[!.]*")} == names


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--signal", "GPS L1CB"], "nearest: GPS L1C"),
        (["--discriminator", "atn"], "nearest: atan"),
        (["--threshold", "7.6"], "'--threshold': 7.6 is not"),
        (["--oscillator", "-3"], "above zero"),
        (["--oscillator", "tcx"], "tcxo"),
        (["--bandwidth", "0"], "'--bandwidth': 0 is not"),
        (["--accumulation", "-1"], "'--accumulation': -1 is not"),
        (["--interval", "0"], "'--interval': 0 is not"),
        (["--emitters", "nowhere.toml"], "belong together"),
        (["--format", "xls"], "parquet"),
    ],
)
def test_wrong_options_end_with_code_2_and_advice(options: list[str], told: str) -> None:
    result = CliRunner().invoke(app, ["margin", *options])

    assert result.exit_code == 2
    assert told in result.output
