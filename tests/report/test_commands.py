"""The commands: every example in a help works as pasted, ``--json`` is one object, nothing heavy is loaded unasked."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from insgnss.cli.main import EXAMPLES, app
from insgnss.report.export import FORMATS, _moved_to_point
from insgnss.report.netcdf import as_dataset
from insgnss.runs.result import Run
from insgnss.studies.campaign import study, task_runners
from insgnss.studies.campaign.study import CampaignConfig, load_campaign
from tests.report.runs import made_run

ROOT = Path(__file__).resolve().parents[2]
# what prints a summary: all but the page of columns
SUMMARIES = [text for text in EXAMPLES.values() if text.split()[1] != "columns"]
SAMPLE = "data/sample_flight/flight.toml"
# what a summary in JSON does not need: the option given last counts
FEWER = {
    "receiver": "--cn0 40 --runs 1 --duration 45",
    "simulate": "--duration 120",
    "iq": "--duration 0.5",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return a folder with the repository's data in it, gone into for these tests; campaigns have few seeds here.

    They have one worker too, as on a machine of one core: to start one takes longer than all of their flights.
    """
    there = tmp_path_factory.mktemp("pasted")
    (there / "data").symlink_to(ROOT / "data", target_is_directory=True)
    with pytest.MonkeyPatch.context() as patched:
        patched.chdir(there)
        patched.setattr(study, "load_campaign", few_seeds)
        patched.setattr(task_runners, "usable_cores", lambda: 1)
        yield there


def few_seeds(campaign: str | Path) -> CampaignConfig:
    """Return a campaign with two seeds a case: twenty flights of each show nothing else of the command."""
    return load_campaign(campaign).model_copy(update={"seeds": 2, "seeds_per_task": 1})


def called(command: str) -> Result:
    return CliRunner().invoke(app, shlex.split(command))


@cache
def answered(command: str) -> Result:
    """Return what a command that two tests look at gave, run once."""
    return called(command)


def test_every_command_has_an_example() -> None:
    assert {command.callback for command in app.registered_commands} == set(EXAMPLES)


@pytest.mark.parametrize("example", EXAMPLES.values(), ids=lambda text: text.split()[1])
def test_help_shows_the_example_on_a_line_of_a_narrow_terminal(example: str) -> None:
    narrow = CliRunner(env={"COLUMNS": "80", "TERMINAL_WIDTH": "80"})

    shown = narrow.invoke(app, [example.split()[1], "--help"])

    assert shown.exit_code == 0
    assert example in [line.strip() for line in shown.output.splitlines()]


def test_examples_work_as_pasted_one_after_the_other(folder: Path) -> None:
    for example in EXAMPLES.values():
        name, *arguments = shlex.split(example)
        done = CliRunner().invoke(app, arguments)

        assert name == "insgnss"
        assert done.exit_code == 0, f"{example}\n{done.output}"
    made = {path.name for path in (folder / "out").rglob("*")}
    assert {"report.html", "compare.html", "run.kmz", "nav.parquet", "gnss_obs.csv"} <= made


@pytest.mark.parametrize("example", SUMMARIES, ids=lambda text: text.split()[1])
def test_example_prints_one_json_object_and_says_nothing_in_a_pipe(folder: Path, example: str) -> None:
    if not (folder / "out" / "campaign").exists():
        pytest.skip("the examples before it were not run")

    name = example.split()[1]
    done = answered(" ".join([example.removeprefix("insgnss "), *FEWER.get(name, "").split(), "--json"]))

    assert done.exit_code == 0, done.output
    assert isinstance(json.loads(done.stdout), dict)
    assert done.stderr == ""


def test_campaign_tells_the_parameters_beside_the_case(folder: Path) -> None:
    if not (folder / "out" / "campaign").exists():
        pytest.skip("the examples before it were not run")

    told = json.loads(answered("campaign imu_grades --output out/campaign --json").stdout)

    cases = {(row["case"], row["imu"], row["noise_factor"]) for row in told["summary"]}
    assert len(cases) == told["cases"] == 6
    assert (0, "navigation", 1.0) in cases and (5, "industrial", 1.4) in cases


def test_replay_prints_one_json_object_and_writes_run_and_page(folder: Path) -> None:
    done = called(
        f"insgnss {SAMPLE}".replace("insgnss", "replay") + " -o out/j --report out/j/page.html --json"
    )

    read = json.loads(done.stdout)
    run = Run.load(folder / "out" / "j")
    assert done.exit_code == 0
    assert read["rows"] == len(run.nav)
    assert sum(sum(of_kind.values()) for of_kind in read["measurements"].values()) == len(run.measurements)
    assert read["errors"]["n_m"]["rms"] < 0.6  # m, the README's 0.34 with room
    assert read["wrote"] == ["out/j", "out/j/page.html"]
    assert (folder / "out" / "j" / "page.html").stat().st_size > 5e6


def test_check_prints_one_json_object(folder: Path) -> None:
    read = json.loads(answered(f"check {SAMPLE} --json").stdout)

    assert (read["flight"], read["severity"]) == ("sample flight", "ok")
    assert {finding["topic"] for finding in read["findings"]} >= {"imu", "gnss", "flight"}
    assert {finding["kind"] for finding in read["findings"]} >= {"axes_fit", "vertical_axis"}


def test_point_prints_one_json_object(folder: Path) -> None:
    read = json.loads(called(f"point {SAMPLE} --json").stdout)

    assert read["epochs"] == 1200
    assert sum(read["verdicts"]["position"].values()) == 1200
    assert read["wrote"] is None


def test_compare_prints_one_json_object(tmp_path: Path) -> None:
    for name in ("a", "b"):
        made_run().save(tmp_path / name)

    read = json.loads(called(f"compare {tmp_path / 'a'} {tmp_path / 'b'} --json").stdout)

    assert read["first"] == "a"
    assert set(read["runs"]) == {"a", "b"}


def test_runs_in_folders_of_one_name_are_told_apart(tmp_path: Path) -> None:
    paths = [tmp_path / name / "run" for name in ("x", "y")]
    for path in paths:
        made_run().save(path)

    assert set(json.loads(called(f"compare {paths[0]} {paths[1]} --json").stdout)["runs"]) == set(
        map(str, paths)
    )


def test_report_of_no_run_ends_with_the_code_of_a_result(tmp_path: Path) -> None:
    done = called(f"report {tmp_path}")

    assert done.exit_code == 5
    assert "no table 'nav'" in done.stderr
    assert "Traceback" not in done.output


def test_export_of_an_unknown_format_ends_with_the_code_of_a_setting(tmp_path: Path) -> None:
    made_run().save(tmp_path)

    assert called(f"export {tmp_path} -o {tmp_path / 'run.shp'}").exit_code == 2


def test_export_of_the_further_point_in_place_of_the_imu(tmp_path: Path) -> None:
    run = made_run(seconds=20.0)
    run.save(tmp_path / "without")
    refused = called(f"export {tmp_path / 'without'} -o {tmp_path / 'run.pos'} --at-point")
    assert refused.exit_code == 5 and "replay FLIGHT --point" in " ".join(refused.stderr.split())
    moved = {"lat_deg": 1e-3, "lon_deg": -2e-3, "h_m": 7.0, "vn_mps": 0.5, "ve_mps": 0.25, "vd_mps": -0.125}
    run.nav = run.nav.assign(
        **{f"point_{name}": run.nav[name] + by for name, by in moved.items()},
        **{f"sd_point_{name}_m": 3.0 for name in "ned"},
        **{f"sd_point_{name}_mps": 0.75 for name in ("vn", "ve", "vd")},
        cov_n_e_m2=4.0,
    )
    run.save(tmp_path / "run")

    for name in ("imu", "point"):
        assert not called(
            f"export {tmp_path / 'run'} -o {tmp_path / name}.pos" + " --at-point" * (name == "point")
        ).exit_code

    imu, point = (
        np.loadtxt(tmp_path / f"{name}.pos", comments="%", usecols=range(2, 21)) for name in ("imu", "point")
    )
    assert point[:, :3] - imu[:, :3] == pytest.approx(np.tile([1e-3, -2e-3, 7.0], (len(imu), 1)), abs=2e-4)
    assert (point[:, 5:8] == 3.0).all() and (point[:, 16:19] == 0.75).all()
    assert (imu[:, 8] == 2.0).all() and (point[:, 8] == 0.0).all()  # the root of the IMU's covariance
    about = as_dataset(_moved_to_point(run))
    assert about.attrs["comment"].startswith("position of the further point") and "point_h_m" not in about


def test_help_of_export_names_every_format() -> None:
    shown = called("export --help").output

    assert {name for name in FORMATS if re.search(rf"\b{name}\b", shown)} == set(FORMATS)


def test_commands_and_digest_load_neither_plotly_nor_matplotlib() -> None:
    script = (
        "import sys; import insgnss.cli.main, insgnss.report.digest, insgnss.report.page, insgnss.report.figures;"
        "print([name for name in ('plotly', 'matplotlib') if name in sys.modules])"
    )

    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT
    )

    assert done.stdout.strip() == "[]"
