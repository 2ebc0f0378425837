"""An incomplete run is refused, and following the advice overwrites no file of the user."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import pandas as pd
import pyarrow as pa
import pytest
from typer.testing import CliRunner

from insgnss.cli.main import app
from insgnss.errors import ResultError
from insgnss.results.record import RECORD
from insgnss.runs.result import Run
from tests.small_run import small_run


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_optional_table_that_was_lost_is_named(tmp_path: Path, form: Literal["parquet", "csv"]) -> None:
    folder = small_run().save(tmp_path / "run", form)
    (folder / f"errors.{form}").unlink()
    (folder / f"aiding.{form}").unlink()

    with pytest.raises(ResultError, match=f"aiding.{form}: this file of the run is missing") as refused:
        Run.load(folder)

    assert refused.value.message.endswith(f"also missing: errors.{form}")
    assert "copy the run's whole folder again" in refused.value.advice and RECORD in refused.value.advice


def test_table_that_was_removed_on_purpose_leaves_the_record_too(tmp_path: Path) -> None:
    folder = small_run().save(tmp_path / "run")
    (folder / "errors.parquet").unlink()
    record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    del record["errors.parquet"]
    (folder / RECORD).write_text(json.dumps(record), encoding="utf-8")

    assert Run.load(folder).errors is None


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda _: "",
        lambda _: "[]",
        lambda text: json.dumps({name: {"kind": entry["kind"]} for name, entry in json.loads(text).items()}),
        lambda text: json.dumps(dict.fromkeys(json.loads(text), "run")),
    ],
    ids=["cut", "empty", "list", "no hashes", "no entries"],
)
def test_record_that_was_cut_is_refused_and_not_taken_for_that_of_a_run_without_one(
    tmp_path: Path, damage: Callable[[str], str]
) -> None:
    folder = small_run().save(tmp_path / "run")
    record = folder / RECORD
    record.write_text(damage(record.read_text(encoding="utf-8")), encoding="utf-8")

    with pytest.raises(ResultError, match="record of the files in this folder is damaged") as refused:
        Run.load(folder)

    assert refused.value.file == str(record) and "copy the whole folder again" in refused.value.advice


def test_table_without_its_entry_in_the_record_is_not_of_the_run(tmp_path: Path) -> None:
    folder = small_run().save(tmp_path / "run")
    record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    del record["nav.parquet"]
    (folder / RECORD).write_text(json.dumps(record), encoding="utf-8")

    with pytest.raises(ResultError, match=r"nav.parquet: the file is not the one that was saved"):
        Run.load(folder)


@pytest.mark.parametrize("command", ["report", "compare"])
def test_nobody_is_advised_to_replay_over_logs(tmp_path: Path, command: str) -> None:
    run, logs = small_run().save(tmp_path / "run"), tmp_path / "logs"
    logs.mkdir()
    (logs / "imu.csv").write_text("mine", encoding="utf-8")
    told = CliRunner().invoke(app, [command, *([str(run)] if command == "compare" else []), str(logs)])

    assert told.exit_code == 5
    assert "--force" not in told.output
    assert "this folder holds no run; name the folder of a run" in told.output


@pytest.mark.parametrize(("marked", "place"), [(True, "FOLDER --force"), (False, "NEW_FOLDER")])
def test_replay_over_the_old_files_is_advised_for_a_run_of_ours_alone(
    tmp_path: Path, marked: bool, place: str
) -> None:
    folder = small_run().save(tmp_path / "run")
    (folder / "nav.parquet").write_bytes(b"damaged")
    if not marked:
        (folder / RECORD).unlink()

    with pytest.raises(ResultError, match="damaged") as refused:
        Run.load(folder)

    assert refused.value.advice.endswith(f"--output {place}")


def test_no_thread_of_the_table_library_holds_a_file_of_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # such a thread closes it when it likes: a command that ended just then was aborted (exit code 134), 4 times in 120
    folder = small_run().save(tmp_path / "run")
    read, handed = pd.read_parquet, []
    monkeypatch.setattr(pd, "read_parquet", lambda file, **more: [handed.append(file), read(file, **more)][1])

    Run.load(folder)

    assert handed and all(isinstance(file, pa.OSFile) for file in handed)
