"""A save is all there or not there, at any moment it is killed, and takes no file of somebody else."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
import pytest

from insgnss.errors import ResultError
from insgnss.results.record import RECORD
from insgnss.results.saving import check_replaceable, overwriting, saving, settle, write_file
from insgnss.runs.result import TABLES, Run
from tests.small_run import small_run

REPOSITORY = Path(__file__).resolve().parents[1]
WITH_TESTS = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
NAMES = ("a.txt", "b.txt", "c.txt")


def save(folder: Path, word: str, names: tuple[str, ...] = NAMES, kind: str = "run") -> None:
    with saving(folder, NAMES, kind) as new:
        for name in names:
            (new / name).write_text(word)


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if not path.name.startswith(".")}


def test_saved_files_replace_those_of_the_save_before_and_what_is_not_written_goes(tmp_path: Path) -> None:
    save(tmp_path, "old")
    (tmp_path / "mine.txt").write_text("mine")
    save(tmp_path, "new", NAMES[:2])

    assert contents(tmp_path) == {"a.txt": "new", "b.txt": "new", "mine.txt": "mine"}
    assert {p.name for p in tmp_path.iterdir() if p.name.startswith(".")} == {RECORD}


def test_save_that_fails_leaves_the_old_files_and_nothing_else(tmp_path: Path) -> None:
    save(tmp_path, "old")
    with pytest.raises(OSError, match="full"), saving(tmp_path, NAMES, "run") as new:
        (new / "a.txt").write_text("new")
        raise OSError("the disk is full")

    assert contents(tmp_path) == dict.fromkeys(NAMES, "old")
    assert {p.name for p in tmp_path.iterdir() if p.name.startswith(".")} == {RECORD}


@pytest.mark.parametrize("change", ["foreign", "changed", "other kind", "folder", "dangling link"])
def test_file_that_is_not_ours_is_refused_and_stays_until_it_is_forced(tmp_path: Path, change: str) -> None:
    if change == "changed":
        save(tmp_path, "old")
    if change == "other kind":
        save(tmp_path, "mine", kind="page")
    elif change == "folder":
        (tmp_path / "b.txt").mkdir()
    elif change == "dangling link":
        (tmp_path / "b.txt").symlink_to(tmp_path / "elsewhere")
    else:
        (tmp_path / "b.txt").write_text("mine")

    with pytest.raises(ResultError, match=r"[ab]\.txt") as refused:
        save(tmp_path, "new", NAMES[1:])
    if change == "folder":
        assert (tmp_path / "b.txt").is_dir()
        return
    assert "--force" in refused.value.advice
    assert change == "dangling link" or (tmp_path / "b.txt").read_text() == "mine"

    with overwriting():
        save(tmp_path, "new")
    assert contents(tmp_path) == dict.fromkeys(NAMES, "new")


def test_input_is_never_replaced(tmp_path: Path) -> None:
    save(tmp_path, "old")
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "b.txt")

    with overwriting(True, [link]), pytest.raises(ResultError, match="replace an input"):
        save(tmp_path, "new")
    assert contents(tmp_path)["b.txt"] == "old"


def test_copied_folder_is_still_known_as_ours(tmp_path: Path) -> None:
    save(tmp_path / "one", "old")
    (tmp_path / "one").rename(tmp_path / "two")
    save(tmp_path / "two", "new")
    assert contents(tmp_path / "two") == dict.fromkeys(NAMES, "new")


def test_saves_into_one_folder_inside_each_other_are_one(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="late"), saving(tmp_path, (), "study"):
        save(tmp_path, "table")
        write_file(tmp_path / "picture", b"picture", "picture")
        assert contents(tmp_path) == {}
        raise OSError("late")
    assert contents(tmp_path) == {}

    with saving(tmp_path, (), "study"):
        save(tmp_path, "table")
        write_file(tmp_path / "picture", b"picture", "picture")
    check_replaceable(tmp_path, ["picture"], "picture")
    check_replaceable(tmp_path, NAMES, "run")
    assert contents(tmp_path) == {**dict.fromkeys(NAMES, "table"), "picture": "picture"}


def test_pipe_is_written_to_and_stays_one(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        write_file(pipe, b"content", "page")
        assert reader.stdout is not None and reader.stdout.read() == b"content"
    assert pipe.is_fifo()


# a program that saves, without the package's face: its imports take thirty times as long as the rest
LIGHT = f"""
import os, sys, types
from pathlib import Path
from typing import Literal
face = sys.modules["insgnss"] = types.ModuleType("insgnss")
face.__path__ = [{str(REPOSITORY / "insgnss")!r}]
from insgnss.results import saving
"""


def interrupted(folder: Path, moves: int) -> None:
    """Leave a folder as a save does that is killed after so many of its files are in their places."""
    code = (
        f"{LIGHT}real, left = os.replace, [int(sys.argv[2])]\n"
        "def replace(a, b):\n"
        "    if not left[0]:\n        os.kill(os.getpid(), 9)\n"
        "    left[0] -= 1\n    real(a, b)\n"
        "saving.os.replace = replace\n"
        f"with saving.saving(Path(sys.argv[1]), {NAMES!r}, 'run') as new:\n"
        "    for name in ('a.txt', 'b.txt'):\n        (new / name).write_text('new')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, folder, str(moves)], check=False, cwd=REPOSITORY, env=WITH_TESTS
    )
    assert done.returncode == -signal.SIGKILL


@pytest.mark.parametrize("moves", [0, 1, 2])
def test_save_killed_among_its_last_moves_is_finished_by_the_next_reader(tmp_path: Path, moves: int) -> None:
    save(tmp_path, "old")
    interrupted(tmp_path, moves)

    settle(tmp_path)
    assert contents(tmp_path) == {"a.txt": "new", "b.txt": "new"}
    save(tmp_path, "newest")
    assert contents(tmp_path) == dict.fromkeys(NAMES, "newest")
    assert {p.name for p in tmp_path.iterdir() if p.name.startswith(".")} == {RECORD}


@pytest.mark.parametrize(
    "told", ['{"wrote": {}', "[]", '{"removed": ["../precious"], "wrote": {}}', '{"wrote": {"../x": {}}}']
)
def test_pending_save_that_is_damaged_or_leads_out_of_its_folder_is_refused(
    tmp_path: Path, told: str
) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine")
    pending = tmp_path / "run" / ".insgnss-pending"
    pending.mkdir(parents=True)
    (pending / RECORD).write_text(told)

    with pytest.raises(ResultError, match="interrupted save"):
        Run.load(tmp_path / "run")
    assert precious.read_text() == "mine"


def test_save_that_was_killed_while_it_wrote_leaves_nothing_behind_after_the_next(tmp_path: Path) -> None:
    code = f"{LIGHT}with saving.saving(Path(sys.argv[1]), {NAMES!r}, 'run') as new:\n    os.kill(os.getpid(), 9)\n"
    subprocess.run([sys.executable, "-c", code, tmp_path], check=False, cwd=REPOSITORY, env=WITH_TESTS)
    assert [p.name.startswith(".insgnss-new-") for p in tmp_path.iterdir()] == [True]

    save(tmp_path, "new")
    assert {p.name for p in tmp_path.iterdir()} == {*NAMES, RECORD}


# ------------------------------------------------------------------------------------------------ runs

# a copy of the process saves from each line on, so that only the first one has to import the package
SAVER = """
import os, sys
from tests.small_run import small_run
runs = [small_run(mark) for mark in (1.0, 2.0)]
print("ready", flush=True)
parent = os.getpid()
for _ in sys.stdin:
    child = os.fork()
    number = 0
    while not child:
        if os.getppid() != parent:
            os._exit(0)
        runs[number % 2].save(sys.argv[1], ("parquet", "csv")[number // 2 % 2])
        number += 1
    print(child, flush=True)
    os.waitpid(child, 0)
    print("ended", flush=True)
"""


def marks(run: Run) -> set[float]:
    """Return what tells in every table and in the settings of which run they are."""
    tables = [getattr(run, name) for name in TABLES if getattr(run, name) is not None]
    return {float(value) for table in tables for value in table["mark"]} | {float(run.settings["mark"])}


@contextmanager
def saver(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Let another process save two runs into a folder, one over the other, until the block ends."""
    process = subprocess.Popen(
        [sys.executable, "-c", SAVER, folder],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=REPOSITORY,
        env=WITH_TESTS,
    )
    try:
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def saving_child(process: subprocess.Popen[bytes]) -> int:
    """Let the other process start one that saves; return its number."""
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(b"\n")
    process.stdin.flush()
    return int(process.stdout.readline())


@pytest.mark.slow
def test_run_folder_is_the_old_or_the_new_run_at_any_kill(tmp_path: Path, rng: np.random.Generator) -> None:
    folder = tmp_path / "run"
    small_run(1.0).save(folder)
    with saver(folder) as process:
        for wait_s in rng.uniform(0.0, 0.2, 8):
            child = saving_child(process)
            time.sleep(wait_s)
            os.kill(child, signal.SIGKILL)
            assert process.stdout is not None and process.stdout.readline() == b"ended\n"
            found = marks(Run.load(folder))
            assert len(found) == 1
    small_run(3.0).save(folder)
    assert not [p.name for p in folder.iterdir() if p.name.startswith(".") and p.name != RECORD]


def test_run_read_while_another_process_saves_is_one_run(tmp_path: Path) -> None:
    small_run(1.0).save(tmp_path)
    with saver(tmp_path) as process:
        saving_child(process)
        seen = [marks(Run.load(tmp_path)) for _ in range(15)]
    assert {len(found) for found in seen} == {1}


def test_own_table_in_the_folder_is_not_taken_for_a_run_s(tmp_path: Path) -> None:
    own = tmp_path / "errors.csv"
    own.write_text("mine")
    with pytest.raises(ResultError, match="did not write"):
        small_run(1.0).save(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["errors.csv"] and own.read_text() == "mine"


@pytest.mark.parametrize(
    "name", ["nav.parquet", "measurements.parquet", "settings.json", "nav.csv", "columns.json"]
)
@pytest.mark.parametrize("damage", ["empty", "cut", "flipped", "text", "nested", "not utf-8"])
def test_damaged_run_is_an_error_of_ours_that_names_the_file(tmp_path: Path, name: str, damage: str) -> None:
    form = "csv" if name in ("nav.csv", "columns.json") else "parquet"
    path = small_run(1.0).save(tmp_path, form) / name  # type: ignore[arg-type]
    data = path.read_bytes()
    half = len(data) // 2
    path.write_bytes(
        {
            "empty": b"",
            "cut": data[:half],
            "flipped": data[:half] + bytes([data[half] ^ 0x55]) + data[half + 1 :],
            "text": b"time_s,what\n1,2\n",
            "nested": b"[" * 100_000,
            "not utf-8": b'{"a": "\xff"}',
        }[damage]
    )
    with pytest.raises(ResultError, match="replay the flight again") as caught:
        Run.load(tmp_path)
    assert caught.value.exit_code == 5
    assert path.stem in str(caught.value) or "columns.json" in str(caught.value)


@pytest.mark.parametrize("form", ["parquet", "csv"])
@pytest.mark.parametrize("name", ["nav", "settings.json"])
def test_folder_with_a_file_of_another_run_is_refused_by_its_name(
    tmp_path: Path, form: Literal["parquet", "csv"], name: str
) -> None:
    folder = small_run(1.0).save(tmp_path / "run", form)
    (folder / "notes.csv").write_text("mine")
    assert marks(Run.load(folder)) == {1.0}
    other = small_run(2.0).save(tmp_path / "other", form)
    file = name if "." in name else f"{name}.{form}"
    (other / file).replace(folder / file)
    with pytest.raises(ResultError, match=f"{file}: the file is not the one that was saved with this run"):
        Run.load(folder)
    (folder / RECORD).unlink()  # as of a version that kept none
    Run.load(folder)
    assert (folder / "notes.csv").read_text() == "mine"


@pytest.mark.parametrize(
    "keys, value",
    [
        (("flight",), 3),
        (("flight", "gnss"), []),
        (("flight", "gps_week"), 1e300),
        (("flight", "name"), {}),
        (("filter", "gates"), {"pseudorange_sigma": "x"}),
        (("took",), {"read_s": None}),
        (("took",), "x"),
    ],
)
def test_settings_of_another_kind_are_refused(tmp_path: Path, keys: tuple[str, ...], value: object) -> None:
    path = small_run(1.0).save(tmp_path) / "settings.json"
    settings = json.loads(path.read_text())
    table = settings
    for key in keys[:-1]:
        table = table[key]
    table[keys[-1]] = value
    path.write_text(json.dumps(settings))
    (tmp_path / RECORD).unlink()
    if value == {"read_s": None}:
        assert Run.load(tmp_path).settings["took"] == value
        return
    with pytest.raises(ResultError, match=keys[0]):
        Run.load(tmp_path)


def test_numbers_that_cannot_be_true_and_missing_columns_are_refused(tmp_path: Path) -> None:
    path = small_run(1.0).save(tmp_path) / "nav.parquet"
    good = pd.read_parquet(path)
    for column, value in (("lat_deg", 91.0), ("lat_deg", np.nan), ("time_s", 1e300), ("h_m", -np.inf)):
        bad = good.copy()
        bad.loc[1, column] = value
        bad.to_parquet(path)
        with pytest.raises(ResultError, match=f"{column}.*row 2 cannot be true"):
            Run.load(tmp_path)
    for changed in (good.drop(columns="h_m"), good.astype({"h_m": str})):
        changed.to_parquet(path)
        with pytest.raises(ResultError, match="h_m"):
            Run.load(tmp_path)


def test_folder_that_is_not_there_is_said_to_be_missing(tmp_path: Path) -> None:
    small_run(1.0).save(tmp_path / "first_run")
    with pytest.raises(ResultError, match=r"no such folder\n.*first_run"):
        Run.load(tmp_path / "frist_run")
    with pytest.raises(ResultError, match="this is a file"):
        Run.load(tmp_path / "first_run" / "nav.parquet")


def test_run_saved_by_an_earlier_version_opens_and_keeps_the_version_that_made_it(tmp_path: Path) -> None:
    path = small_run(1.0).save(tmp_path) / "settings.json"
    settings = json.loads(path.read_text(encoding="utf-8")) | {"versions": {"insgnss": "0.1.0"}}
    path.write_text(json.dumps(settings), encoding="utf-8")
    (tmp_path / RECORD).unlink()

    run = Run.load(tmp_path)

    assert run.settings["versions"] == {"insgnss": "0.1.0"}
    assert run.nav["mark"].eq(1.0).all()
