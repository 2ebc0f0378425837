"""The steps of tutorial and README with somebody else's CSV: other column names, degrees per second, g, as pasted."""

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
TUTORIAL = (REPOSITORY / "docs" / "tutorial.md").read_text(encoding="utf-8")
SAMPLE = REPOSITORY / "data" / "sample_flight"
SECONDS = 240.0  # of the sample flight: rest, take-off and a turn, by which the heading is known


def section(page: str) -> str:
    """Return a page's section on one's own data."""
    return re.split(r"^#+ Your own data", page, flags=re.MULTILINE)[1].split("\n## ")[0]


def pasted_flight_file(page: str = TUTORIAL) -> str:
    """Return the flight file of the section on one's own data."""
    match = re.search(r"```toml\n(.*?)```", section(page), re.DOTALL)
    assert match is not None
    return match.group(1)


def pasted_commands(folder: Path, page: str = TUTORIAL) -> list[list[str]]:
    """Return the commands of the section on CSV logs, their folder put in."""
    found = re.findall(r"^    insgnss ((?:check|replay) .*)$", section(page), re.MULTILINE)
    return [shlex.split(command.replace("my/", f"{folder}/")) for command in found]


def write_foreign_logs(folder: Path) -> None:
    """Write the start of the sample flight as the tutorial's example describes it."""
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


def test_readme_has_the_tutorial_s_steps_for_logs_with_the_usual_names(tmp_path: Path) -> None:
    with gzip.open(SAMPLE / "imu.csv.gz", "rb") as stream:
        (tmp_path / "imu.csv").write_bytes(stream.read())
    for name in ("gnss.csv", "nav.rnx"):
        shutil.copy(SAMPLE / name, tmp_path / name)
    (tmp_path / "flight.toml").write_text(pasted_flight_file(README), encoding="utf-8")
    check, _ = commands = pasted_commands(tmp_path, README)

    checked = CliRunner().invoke(app, [*check, "--json"])

    assert commands == pasted_commands(tmp_path)
    assert checked.exit_code == 0, checked.output
    assert json.loads(checked.stdout)["severity"] != "error"
