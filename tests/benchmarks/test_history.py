"""The table of benchmarks: what is written is read, and a comparison takes the newest of the same machine."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from tests.benchmarks.history import HISTORY, MEASURED, Entry, add, commit, compared, entries, read

ENTRY = Entry(
    "2026-11-25T10:00",
    "0123456789",
    "Processor, 2 cores, Python 3.11.7",
    0.3,
    "log/test_a.py::test_b",
    0.25,
    5,
)


def test_report_becomes_entries() -> None:
    report = {
        "machine_info": {"cpu": {"brand_raw": "Processor", "count": 2}, "node": "a name that is not kept"},
        "datetime": "2026-11-25T10:00:59.123456+00:00",
        "benchmarks": [
            {"fullname": "tests/log/test_a.py::test_b", "stats": {"median": 0.2500049, "rounds": 5}}
        ],
    }
    (made,) = entries(report, "0123456789", 0.31)

    assert replace(made, machine=ENTRY.machine) == ENTRY
    assert made.machine.startswith("Processor, 2 cores, Python 3.")


def test_table_grows_by_what_is_added(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    later = replace(ENTRY, date="2026-11-26T10:00", name='a "name", with a comma[x-1]')

    assert read(path) == []
    add([ENTRY], path)
    add([later, ENTRY], path)

    assert read(path) == [ENTRY, later, ENTRY]
    assert path.read_text(encoding="utf-8").count("median_s") == 1


def test_comparison_is_with_the_newest_of_the_same_machine() -> None:
    elsewhere = replace(ENTRY, machine="another", median_s=0.001)
    before = [replace(ENTRY, median_s=9.0), replace(ENTRY, median_s=0.5), elsewhere]
    lines = compared([ENTRY, replace(ENTRY, name="new")], before)

    assert "0.50 of 0.5 s (2026-11-25)" in lines[0]
    assert "first" in lines[1]


def test_commit_with_changes_is_marked(tmp_path: Path) -> None:
    assert commit(tmp_path) == "-"

    def git(*options: str) -> None:
        who = ("-c", "user.name=a", "-c", "user.email=a@b.c")
        subprocess.run(["git", *who, *options], cwd=tmp_path, check=True, capture_output=True)

    (tmp_path / MEASURED[1]).write_text("a = 1\n", encoding="utf-8")
    git("init")
    git("add", ".")
    git("commit", "-m", "first")
    clean = commit(tmp_path)
    (tmp_path / "history.csv").write_text("", encoding="utf-8")

    assert len(clean) == 10 and commit(tmp_path) == clean  # the table itself is not measured
    (tmp_path / MEASURED[1]).write_text("a = 2\n", encoding="utf-8")
    assert commit(tmp_path) == f"{clean}+"


def test_kept_table_is_sound() -> None:
    kept = read()
    if not kept:
        pytest.skip(f"{HISTORY.name} has no entry yet")

    assert all(entry.median_s > 0.0 and entry.rounds > 0 and entry.load >= 0.0 for entry in kept)
    assert [entry.date for entry in kept] == sorted(entry.date for entry in kept)
