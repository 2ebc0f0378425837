"""What a worker of a campaign does: some seeds of one case, written into one file."""

from __future__ import annotations

import importlib
import os
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from insgnss.errors import ConfigError

AHEAD: Final = 4  # tasks a worker that wait for it: no worker idles, and a million tasks cost no memory

CAMPAIGN_FILE: Final = "campaign.json"
RESULTS: Final = "results"
SHIPPED: Final = "insgnss.studies.campaign.cases"
KEY_COLUMNS: Final = ("case", "seed", "error")
_FAILED_KEY: Final = b"failed"
Row = Mapping[str, float | int | str | bool]
CaseFunction = Callable[[Mapping[str, Any], int], Sequence[Row]]


@dataclass(frozen=True)
class Task:
    """Some seeds of one case."""

    key: str
    function: str
    number: int  # of the case
    case: Mapping[str, Any]
    seeds: tuple[int, ...]
    folder: str

    @property
    def path(self) -> Path:
        """The file that it writes."""
        return Path(self.folder) / RESULTS / f"{self.key}.parquet"

    def is_done(self, *, retry_failed: bool) -> bool:
        """Return whether its file is there; with ``retry_failed``, and no run in it failed."""
        if not self.path.exists():
            return False
        if not retry_failed:
            return True
        metadata = pq.read_schema(self.path).metadata or {}
        return int(metadata.get(_FAILED_KEY, b"0")) == 0


@dataclass(frozen=True)
class TaskReport:
    """A worker's report on a task: everything that returns to the client."""

    key: str
    n_runs: int
    n_failed: int
    took_s: float
    error: str = ""  # why the task itself could not be finished


def case_function(name: str) -> CaseFunction:
    """Return a case function by its name among the shipped ones, or as "package.module:function".

    Raises
    ------
    ConfigError : the case function does not exist
    """
    module_name, _, function_name = name.rpartition(":")
    module = importlib.import_module(SHIPPED) if not module_name else _module(module_name, name)
    names: dict[str, CaseFunction] = getattr(module, "CASES", {}) if not module_name else vars(module)
    function = names.get(function_name)
    if not callable(function):
        shipped = getattr(importlib.import_module(SHIPPED), "CASES", {})
        advice = f"give one of {', '.join(sorted(shipped))}, or 'package.module:function'"
        raise ConfigError(f"unknown case function '{name}'", key="case", advice=advice)
    return function


def _module(module_name: str, name: str) -> Any:
    try:
        return importlib.import_module(module_name)
    except ImportError as error:
        advice = "every worker must be able to import it: is it on PYTHONPATH?"
        raise ConfigError(f"'{name}': {error}", key="case", advice=advice) from error


def run_task(task: Task) -> TaskReport:
    """Run a task's seeds and write its file; a run that raises becomes a row with its error."""
    began = time.perf_counter()
    function = case_function(task.function)
    rows: list[dict[str, Any]] = []
    n_failed = 0
    for seed in task.seeds:
        start = {
            **{f"case_{key}": value for key, value in task.case.items()},
            "case": task.number,
            "seed": seed,
        }
        try:
            results = [dict(row) for row in function(task.case, seed)]
            rows += [{**start, "error": "", **row} for row in results]
        except Exception as error:  # whatever a case does, the campaign goes on and says so
            n_failed += 1
            rows.append({**start, "error": "".join(traceback.format_exception_only(error)).strip()})
    _write(task.path, rows, n_failed)
    return TaskReport(task.key, len(task.seeds), n_failed, time.perf_counter() - began)


def _write(path: Path, rows: list[dict[str, Any]], n_failed: int) -> None:
    """Write a file under another name and then give it its own: it is whole or not there."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.table({name: pa.array([row.get(name) for row in rows]) for name in columns})
    table = table.replace_schema_metadata({_FAILED_KEY: str(n_failed).encode()})
    # two workers may have the same task, when one was taken for dead: each writes a file of its own
    part = path.with_name(f".{path.name}.{os.getpid()}")
    pq.write_table(table, part)
    os.replace(part, path)
