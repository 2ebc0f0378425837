"""``insgnss models`` and ``insgnss demo``: the library listed and copied, the sample flight without the repository."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from insgnss.cli import demo as demo_command
from insgnss.cli.main import app
from insgnss.config import library
from insgnss.simulation import sample_flight
from tests.conftest import REPOSITORY


def said(*arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, arguments)


@pytest.mark.parametrize("kind", library.KINDS)
def test_each_kind_is_listed_with_what_its_models_are(kind: str) -> None:
    told = json.loads(said("models", kind, "--json").stdout)["models"]

    assert [model["name"] for model in told] == library.names(kind)
    assert all(len(model["about"]) > 20 for model in told)
    listed = said("models", kind).stdout
    assert all(name in listed for name in library.names(kind))


def test_filter_is_listed_without_a_number_of_states_that_its_settings_decide() -> None:
    assert "states" not in library.about("filters", "tight")


def test_without_a_kind_all_are_listed() -> None:
    told = json.loads(said("models", "--json").stdout)["models"]

    assert {model["kind"] for model in told} == set(library.KINDS)


@pytest.mark.parametrize(
    ("kind", "name"), [("imus", "tactical"), ("antennas", "patch_l1"), ("scenarios", "at_rest")]
)
def test_model_is_printed_or_copied_byte_for_byte(tmp_path: Path, kind: str, name: str) -> None:
    source = library.find(kind, name)

    assert said("models", kind, name).stdout == source.read_text(encoding="utf-8")
    for output, copy in ((tmp_path / "my", source.name), (tmp_path / f"other{source.suffix}", "")):
        assert said("models", kind, name, "--output", str(output)).exit_code == 0
        assert (output / copy).read_bytes() == source.read_bytes()


def test_grades_are_found_by_the_name_that_a_flight_file_gives_them() -> None:
    assert said("models", "grades").stdout == said("models", "imus").stdout
    assert said("models", "grades", "tactical").stdout == said("models", "imus", "tactical").stdout


@pytest.mark.parametrize("inside", ["errors.csv", "errors.csv/deeper/my.toml"])
def test_copy_into_a_file_says_that_it_is_one(tmp_path: Path, inside: str) -> None:
    (tmp_path / "errors.csv").write_text("mine", encoding="utf-8")
    done = said("models", "imus", "tactical", "--output", str(tmp_path / inside))

    assert done.exit_code == 5 and "errors.csv' is a file" in " ".join(done.stderr.split())


def test_copy_overwrites_nothing(tmp_path: Path) -> None:
    mine = tmp_path / "tactical.toml"
    mine.write_text("mine", encoding="utf-8")
    done = said("models", "imus", "tactical", "--output", str(tmp_path))

    assert done.exit_code == 5 and "the file exists already" in done.stderr
    assert mine.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("fish",), "imus, oscillators"),
        (("imus", "tactica"), "nearest: tactical"),
        (("imus", "--output", "x"), "kind and name of one model"),
    ],
)
def test_wrong_name_is_answered_with_the_right_ones(arguments: tuple[str, ...], words: str) -> None:
    done = said("models", *arguments)

    assert done.exit_code == 2 and words in done.stderr


def test_copied_grade_is_found_beside_a_flight_file(tmp_path: Path) -> None:
    said("models", "imus", "tactical", "--output", str(tmp_path / "mine.toml"))

    assert library.imu_grade("mine", (tmp_path,)) == library.imu_grade("tactical")


@pytest.mark.slow
def test_demo_needs_no_file_and_its_flight_is_the_sample(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    first = said("demo", "--output", str(out))

    assert first.exit_code == 0, first.output
    assert "estimate minus reference" in first.stdout and str(out / "report.html") in first.stdout
    sample = REPOSITORY / "data" / "sample_flight"
    for name in ("flight.toml", "gnss.csv", "nav.rnx"):  # the last digit of a rate is not that of every NumPy
        assert (out / "flight" / name).read_bytes() == (sample / name).read_bytes()
    assert (out / "report.html").stat().st_size > 1_000_000
    assert (out / "nav.parquet").exists()


def test_demo_leaves_the_files_of_the_user_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample_flight, "write_sample_flight", lambda folder: pytest.fail("written"))
    folder = tmp_path / demo_command.FLIGHT_FOLDER
    folder.mkdir()
    (folder / "flight.toml").write_text("mine", encoding="utf-8")
    done = said("demo", "--output", str(tmp_path))

    assert done.exit_code == 5 and "other files" in done.stderr


def test_scenario_of_a_study_is_not_listed_as_one_to_simulate(tmp_path: Path) -> None:
    listed = said("models", "scenarios").stdout
    simulated, studied = listed.split("masking_study")

    assert "turning_flight" in simulated and "sokolov_2015" not in simulated
    assert "sokolov_2015" in studied and "turning_flight" not in studied
    copied = said("models", "scenarios", "sokolov_2015", "--output", str(tmp_path / "mine.toml")).stdout
    assert "masking_study" in copied and "simulate" not in copied
