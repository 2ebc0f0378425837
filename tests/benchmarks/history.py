"""Runs the benchmarks and adds their medians to a kept table: ``make bench``, ``python -m tests.benchmarks.history``.

``tests/benchmarks/history.csv`` has one row for each benchmark and run: when, of which commit, on which machine and how
busy it was, the median, and from how many rounds. What was measured before on the same machine is printed beside it.
Options go to pytest; ``-k loop`` chooses.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
HISTORY = Path(__file__).with_name("history.csv")
MEASURED = ("insgnss", "pyproject.toml")  # a change in these makes it other code than the commit's
PYTEST = (
    *("--benchmark-only", "-o", "addopts=--import-mode=importlib --strict-markers --strict-config"),
    *("-W", "ignore::pytest_benchmark.logger.PytestBenchmarkWarning"),  # that nothing was chosen
)


@dataclass(frozen=True)
class Entry:
    """One benchmark of one run."""

    date: str  # ISO 8601, UTC
    commit: str  # '+' at its end: with changes that were not committed
    machine: str
    load: float  # average of the minute before the run: processes that were running
    name: str
    median_s: float
    rounds: int


def machine(cpu: Mapping[str, Any]) -> str:
    """Return what decides how fast it is: processor, number of cores, Python."""
    return (
        f"{cpu.get('brand_raw', 'unknown')}, {cpu.get('count', 0)} cores, Python {platform.python_version()}"
    )


def commit(folder: Path = ROOT) -> str:
    """Return the commit's short name, with '+' if what is measured was changed since; '-' outside of a checkout."""
    head, changed = (
        subprocess.run(["git", *options], cwd=folder, capture_output=True, text=True, check=False)
        for options in (("rev-parse", "--short=10", "HEAD"), ("status", "--porcelain", "--", *MEASURED))
    )
    return "-" if head.returncode else head.stdout.strip() + ("+" if changed.stdout else "")


def entries(report: Mapping[str, Any], commit: str, load: float) -> list[Entry]:
    """Return the entries of a report of pytest-benchmark."""
    here = machine(report["machine_info"].get("cpu", {}))
    return [
        Entry(
            date=report["datetime"][:16],
            commit=commit,
            machine=here,
            load=round(load, 1),
            name=found["fullname"].removeprefix("tests/"),
            median_s=float(f"{found['stats']['median']:.4g}"),
            rounds=found["stats"]["rounds"],
        )
        for found in report["benchmarks"]
    ]


def read(path: Path = HISTORY) -> list[Entry]:
    """Return what was measured, oldest first; nothing if there is no table yet."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as stream:
        return [
            Entry(
                **{
                    **row,
                    "load": float(row["load"]),
                    "median_s": float(row["median_s"]),
                    "rounds": int(row["rounds"]),
                }
            )
            for row in csv.DictReader(stream)
        ]


def add(new: Sequence[Entry], path: Path = HISTORY) -> None:
    """Append entries to the table; a new table gets its header."""
    begins = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, [field.name for field in fields(Entry)], lineterminator="\n")
        if begins:
            writer.writeheader()
        writer.writerows(asdict(entry) for entry in new)


def compared(new: Sequence[Entry], before: Sequence[Entry]) -> list[str]:
    """Return a line for each entry, with the newest one before it of the same name and machine."""
    newest = {(entry.name, entry.machine): entry for entry in before}
    lines = []
    for entry in new:
        old = newest.get((entry.name, entry.machine))
        change = (
            f"{entry.median_s / old.median_s:.2f} of {old.median_s:.4g} s ({old.date[:10]})"
            if old
            else "first"
        )
        lines.append(f"{entry.median_s:10.4g} s  {change:34s}  {entry.name}")
    return lines


def main(arguments: Sequence[str]) -> int:
    """Run the benchmarks, show and keep their medians; return pytest's exit code."""
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.json"
        options = ["tests", *PYTEST, f"--benchmark-json={file}", *arguments]
        code = subprocess.run([sys.executable, "-m", "pytest", *options], cwd=ROOT, check=False).returncode
        text = file.read_text(encoding="utf-8") if file.exists() else ""
    if text:
        new = entries(json.loads(text), commit(), load)
        print(
            f"medians, load average {load:.1f} on {os.cpu_count()} cores before the run",
            *compared(new, read()),
            sep="\n",
        )
        add(new)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
