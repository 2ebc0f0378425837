"""The README's three steps with somebody else's CSV: other column names, degrees per second, g, as pasted."""

from __future__ import annotations

import gzip
import io
import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.constants import STANDARD_GRAVITY_MPS2
from tests.conftest import REPOSITORY

README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
SAMPLE = REPOSITORY / "data" / "sample_flight"
SECONDS = 240.0  # of the sample flight: rest, take-off and a turn, by which the heading is known


def pasted_flight_file() -> str:
    """Return the flight file of the section on one's own data."""
    match = re.search(r"## Your own data.*?```toml\n(.*?)```", README, re.DOTALL)
    assert match is not None
    return match.group(1)


def pasted_commands(folder: Path) -> list[list[str]]:
    """Return the commands of the section on CSV logs, their folder put in."""
    section = README.split("## Your own data")[1].split("\n## ")[0]
    found = re.findall(r"^    insgnss ((?:check|replay) .*)$", section, re.MULTILINE)
    return [shlex.split(command.replace("my/", f"{folder}/")) for command in found]


def write_foreign_logs(folder: Path) -> None:
    """Write the start of the sample flight as the README's example describes it."""
    with gzip.open(SAMPLE / "imu.csv.gz", "rt") as stream:
        imu = pd.read_csv(io.StringIO(stream.read()))
    imu = imu[imu["time_s"] < imu["time_s"].iloc[0] + SECONDS]
    foreign = pd.DataFrame({"Timestamp": imu["time_s"].map("{:.2f}".format)})
    for axis in "xyz":
        foreign[f"G{axis}"] = (imu[f"gyro_{axis}"] * 57.29577951308232).round(6)
        foreign[f"A{axis}"] = (imu[f"accel_{axis}"] / STANDARD_GRAVITY_MPS2).round(7)
    foreign.to_csv(folder / "imu.csv", index=False)
    names = {
        "time_s": "TOW",
        "sv": "PRN",
        "signal": "Signal",
        "pseudorange_m": "Range",
        "doppler_hz": "Doppler",
    }
    gnss = pd.read_csv(SAMPLE / "gnss.csv").rename(columns={**names, "cn0_dbhz": "CN0"})
    gnss["ADR"] = np.nan  # a receiver without carrier phase
    gnss.to_csv(folder / "gnss.csv", index=False)
    shutil.copy(SAMPLE / "nav.rnx", folder / "nav.rnx")
    (folder / "flight.toml").write_text(pasted_flight_file(), encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    there = tmp_path_factory.mktemp("my")
    write_foreign_logs(there)
    return there


def test_three_steps_work_as_pasted(folder: Path) -> None:
    check, replay = pasted_commands(folder)

    checked = CliRunner().invoke(app, [*check, "--json"])
    replayed = CliRunner().invoke(app, [*replay, "--json"])

    assert checked.exit_code == 0, checked.output
    assert json.loads(checked.stdout)["severity"] != "error"
    assert replayed.exit_code == 0, replayed.output
    assert (folder / "page.html").exists()


def test_foreign_names_and_units_give_the_flight_of_the_sample(folder: Path) -> None:
    # the flight is up and climbing by then: units taken wrong would be off by kilometres
    replayed = CliRunner().invoke(
        app, ["replay", str(folder / "flight.toml"), "-o", str(folder / "again"), "--json"]
    )
    truth = pd.read_csv(SAMPLE / "reference.csv").set_index("time_s")

    told = json.loads(replayed.stdout)
    nav = pd.read_parquet(folder / "again" / "nav.parquet")
    nav = nav[nav["time_s"].round(1).isin(truth.index)]
    last = nav.iloc[-1]
    height_m = truth.loc[round(last["time_s"], 1), "h_m"]

    assert told["nis"]["range_rate"]["mean_nis"] < 2.0
    # the sigma of the sample flight is 0.65 m; a grade that is not the sensor's own costs little in four minutes
    assert last["h_m"] == pytest.approx(height_m, abs=5.0)


def test_g_declared_as_metres_per_second_squared_is_refused_with_advice(folder: Path) -> None:
    text = pasted_flight_file().replace('accel_unit = "g"', 'accel_unit = "m/s^2"')
    wrong = folder / "wrong.toml"
    wrong.write_text(text, encoding="utf-8")

    checked = CliRunner().invoke(app, ["check", str(wrong)])

    assert checked.exit_code == 3
    assert "accel_unit = 'g' fits" in checked.output
