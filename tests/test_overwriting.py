"""No command replaces a file that this program did not write, or that it reads, and each ends with its exit code."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.log.detect import Format, beginning
from insgnss.log.receiver import LogDeclarations, ReceiverLog
from insgnss.log.receiver_files import read_receiver
from tests.log.ubx_writing import TOW_S, rawx
from tests.small_run import small_run

SAMPLE = Path(__file__).resolve().parents[1] / "data" / "sample_flight"


def ended(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.output


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Return the sample flight's file in a folder of its own, beside files of the user."""
    shutil.copytree(SAMPLE, tmp_path / "flight")
    for name in ("errors.csv", "notes.html"):
        (tmp_path / "flight" / name).write_text("mine")
    return tmp_path / "flight" / "flight.toml"


@pytest.mark.parametrize("command", ["replay", "smooth"])
def test_own_table_stops_a_replay_before_it_begins(flight: Path, command: str) -> None:
    before = {path.name: path.read_bytes() for path in flight.parent.iterdir()}
    code, told = ended(command, flight, "--output", flight.parent)
    assert code == 5 and "errors.csv" in told and "--force" in told

    for page in (flight, flight.parent / "notes.html", flight.parent / "imu.csv.gz"):
        code, told = ended(command, flight, "--report", page)
        assert code == 5 and page.name in told
    code, told = ended(command, flight, "--report", flight, "--force")
    assert code == 5 and "input" in told
    assert {path.name: path.read_bytes() for path in flight.parent.iterdir()} == before


def test_simulation_takes_no_recorded_flight_and_no_edited_one(tmp_path: Path) -> None:
    arguments = ("simulate", "at_rest", "--duration", 20, "--output", tmp_path)
    (tmp_path / "imu.csv").write_text("recorded")
    code, told = ended(*arguments)
    assert code == 5 and "imu.csv" in told
    assert [path.name for path in tmp_path.iterdir()] == ["imu.csv"]

    (tmp_path / "imu.csv").unlink()
    assert ended(*arguments)[0] == 0 and ended(*arguments)[0] == 0
    (tmp_path / "flight.toml").write_text("# mine\n" + (tmp_path / "flight.toml").read_text())
    code, told = ended(*arguments)
    assert code == 5 and "changed" in told
    assert (tmp_path / "flight.toml").read_text().startswith("# mine")
    assert ended(*arguments, "--force")[0] == 0
    assert not (tmp_path / "flight.toml").read_text().startswith("# mine")


def test_export_and_report_replace_their_own_files_alone(tmp_path: Path) -> None:
    run = small_run().save(tmp_path / "run")
    saved = {path.name: path.read_bytes() for path in run.iterdir()}
    mine = tmp_path / "track.kml"
    mine.write_text("mine")
    assert ended("export", run, "--output", mine)[0] == 5 and mine.read_text() == "mine"
    for _ in range(2):
        assert ended("export", run, "--output", tmp_path / "ours.gpx")[0] == 0
        assert ended("report", run)[0] == 0
    for name in ("nav.parquet", "settings.json"):
        assert ended("export", run, "--output", run / name, "--format", "csv", "--force")[0] == 5
        assert ended("report", run, "--output", run / name)[0] == 5
    assert {name: (run / name).read_bytes() for name in saved if name[0] != "."} == {
        name: data for name, data in saved.items() if name[0] != "."
    }


def test_conversion_takes_no_file_of_the_user(tmp_path: Path) -> None:
    (tmp_path / "gnss_obs.csv").write_text("mine")
    rover = SAMPLE.parent / "sample_receiver" / "rover.obs"
    code, told = ended("convert", rover, "--output", tmp_path)
    assert code == 5 and "gnss_obs.csv" in told
    assert (tmp_path / "gnss_obs.csv").read_text() == "mine"
    assert ended("convert", rover, "--output", tmp_path / "new")[0] == 0
    assert ended("convert", rover, "--output", tmp_path / "new")[0] == 0


def rover_log(path: Path) -> Path:
    """Return a UBX log without inertial samples, longer than the part that shows its format."""
    path.write_bytes(b"".join(rawx(TOW_S + k) for k in range(6000)))
    assert path.stat().st_size > len(beginning(path))
    return path


def test_foreign_file_stops_a_conversion_before_the_whole_log_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_a_part(kind: Format, paths: Sequence[Path], declared: LogDeclarations) -> ReceiverLog:
        assert all(path.stat().st_size < log.stat().st_size for path in paths), "a whole log was read"
        return read_receiver(kind, paths, declared)

    log, out = rover_log(tmp_path / "rover.ubx"), tmp_path / "out"
    out.mkdir()
    (out / "gnss_obs.csv").write_text("mine")
    monkeypatch.setattr("insgnss.log.convert.read_receiver", read_a_part)
    code, told = ended("convert", log, "--output", out)
    assert code == 5 and "gnss_obs.csv" in told and "--force" in told
    assert [path.read_text() for path in out.iterdir()] == ["mine"]


def test_conversion_leaves_foreign_files_that_it_does_not_write(tmp_path: Path) -> None:
    log, out = rover_log(tmp_path / "rover.ubx"), tmp_path / "out"
    out.mkdir()
    (out / "imu.csv").write_text("mine")
    code, told = ended("convert", log, "--output", out)
    assert code == 0 and (out / "gnss_obs.csv").exists(), told
    assert (out / "imu.csv").read_text() == "mine"


def test_existing_file_stops_a_check_that_writes_before_it_begins(
    flight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_work(*_: object, **__: object) -> None:
        raise AssertionError("the command began its work")

    monkeypatch.setattr("insgnss.runs.check.examine", no_work)
    code, told = ended("check", flight, "--write", flight)
    assert code == 5 and "exists already" in told
    code, told = ended("check", flight, "--write", flight.parent / "none" / "new.toml")
    assert code == 5 and "missing" in told


@pytest.mark.parametrize("command", ["report", "compare", "consistency"])
def test_damaged_and_missing_runs_end_with_the_code_of_a_result(tmp_path: Path, command: str) -> None:
    run = small_run().save(tmp_path / "run")
    code, told = ended(command, tmp_path / "rum", *([run] if command == "compare" else []))
    assert code == 5 and "no such folder" in told and "nearest: run" in told

    (run / "nav.parquet").write_bytes(b"PAR1 and nothing else")
    code, told = ended(command, run, *([run] if command == "compare" else []))
    assert code == 5 and "nav.parquet" in told and "Traceback" not in told


@pytest.mark.parametrize(
    "command",
    [
        ("receiver",),
        ("simulate", "at_rest"),
        ("iq", "at_rest"),
        ("margin",),
        ("outage", SAMPLE / "flight.toml", "--every", 60),
        ("replay", SAMPLE / "flight.toml"),
        ("smooth", SAMPLE / "flight.toml"),
        ("point", SAMPLE / "flight.toml"),
        ("allan", SAMPLE / "imu.csv.gz"),
        ("visibility", "no_run", "--flight", SAMPLE / "flight.toml"),
        ("consistency", "no_run"),
        ("convert", "no_log.ubx"),
        ("models", "imus", "tactical"),
        ("export", "no_run"),
        ("report", "no_run"),
        ("compare", "no_run", "no_other"),
        ("demo",),
    ],
    ids=lambda command: command[0],
)
def test_place_that_cannot_be_written_stops_a_command_before_it_begins(
    tmp_path: Path, command: tuple[object, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_work(*_: object, **__: object) -> None:
        raise AssertionError("the command began its work")

    for work in ("studies.receiver.comparison.receiver_study", "runs.simulate.simulate"):
        monkeypatch.setattr(f"insgnss.{work}", no_work)
    for work in ("replay", "demo"):  # smooth runs its filter by the module of replay
        monkeypatch.setattr(f"insgnss.cli.{work}.run_replay", no_work)
    monkeypatch.setattr("insgnss.simulation.sample_flight.write_sample_flight", no_work)
    (tmp_path / "file").write_text("mine")
    code, told = ended(*command, "--output", tmp_path / "file" / "study")
    assert code == 5 and "is a file" in told and "--output" in told
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (("receiver",), "receiver_settings.json"),
        (("simulate", "at_rest"), "flight.toml"),
        (("iq", "at_rest"), "searches.csv"),
        (("iq", "at_rest", "--record"), "samples.bin"),
        (("margin", "--simulate"), "margin_thresholds.png"),
        (("margin", "no_run", "-e", "jammed_approach"), "margin_flown.png"),
        (("outage", SAMPLE / "flight.toml", "--every", 60), "outage.png"),
        (("allan", SAMPLE / "imu.csv.gz"), "grade.toml"),
        (("visibility", "no_run", "--flight", SAMPLE / "flight.toml"), "visibility_dop.csv"),
        (("consistency", "no_run"), "consistency_kinds.csv"),
        (("export", "no_run"), "track.kml"),
        (("compare", "no_run", "no_other"), "page.html"),
        (("report", "no_run"), "page.html"),
        (("demo",), "report.html"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else str(value),
)
def test_own_file_stops_a_command_before_it_begins(
    tmp_path: Path, command: tuple[object, ...], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_work(*_: object, **__: object) -> None:
        raise AssertionError("the command began its work")

    works = ("studies.receiver.comparison.receiver_study", "runs.simulate.simulate", "cli.demo.run_replay")
    works += ("simulation.sample_flight.write_sample_flight", "studies.outage.study.outage_study")
    for work in works:
        monkeypatch.setattr(f"insgnss.{work}", no_work)
    (tmp_path / name).write_text("mine")
    is_file = command[0] in ("export", "compare", "report") or command[-1] == "--record"
    option = () if command[-1] == "--record" else ("--output",)
    code, told = ended(*command, *option, tmp_path / name if is_file else tmp_path)
    assert code == 5 and name in told and "--force" in told
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_figures_that_cannot_be_written_stop_a_report_before_its_page(tmp_path: Path) -> None:
    run = small_run().save(tmp_path / "run")
    page, figures = tmp_path / "page.html", tmp_path / "figures"
    figures.mkdir()
    (figures / "track.pdf").write_text("mine")
    code, told = ended("report", run, "--output", page, "--figures", figures)
    assert code == 5 and "track.pdf" in told and "--force" in told
    code, told = ended("report", run, "--output", page, "--figures", figures, "--form", "tiff8")
    assert code == 2 and "tiff8" in told and "svg" in told
    assert not page.exists()
