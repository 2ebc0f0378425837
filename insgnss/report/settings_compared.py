"""Differing settings: the settings in which runs differ, key by key.

Inputs are compared by content and file name, whatever folders they were read from.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import PureWindowsPath
from typing import Any, Final

from insgnss.runs.result import Run

_NOT_SETTINGS: Final = ("made", "took")  # different in every run
_ABSENT: Final = "-"
_INPUTS: Final = "input_sha256"


def settings_that_differ(runs: Mapping[str, Run]) -> list[tuple[str, ...]]:
    """Return a row for each setting that is not the same in all runs: its key, then each run's value as text."""
    flat = {name: dict(_flat(run.settings)) for name, run in runs.items()}
    keys = list(dict.fromkeys(key for of_run in flat.values() for key in of_run))
    rows = [(key, *(of_run.get(key, _ABSENT) for of_run in flat.values())) for key in keys]
    return [row for row in rows if len(set(row[1:])) > 1]


def _flat(settings: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield 'filter.visibility.on', 'true' and so on; a list of plain values is one value."""
    inputs = settings.get(_INPUTS) or {}
    for key, value in settings.items():
        if key not in (*_NOT_SETTINGS, _INPUTS):
            yield from _leaves(key, value, inputs)
    hashes: dict[str, list[str]] = {}  # of two inputs of one name both
    for path, digest in inputs.items():
        hashes.setdefault(_file_name(path), []).append(str(digest))
    for name, digests in hashes.items():
        yield f"{_INPUTS}.{name}", ", ".join(sorted(digests))


def _leaves(key: str, value: Any, inputs: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the settings of a table or value; of a path that is an input's the file name is kept."""
    if isinstance(value, Mapping):
        for inner, of_inner in value.items():
            yield from _leaves(f"{key}.{inner}", of_inner, inputs)
    elif isinstance(value, list | tuple) and any(isinstance(entry, Mapping) for entry in value):
        for place, entry in enumerate(value):
            yield from _leaves(f"{key}[{place}]", entry, inputs)
    elif value is not None:
        if isinstance(value, list | tuple):
            value = [_file_name(entry) if _is_input(entry, inputs) else entry for entry in value]
        elif _is_input(value, inputs):
            value = _file_name(value)
        yield key, value if isinstance(value, str) else json.dumps(value, default=str)


def _is_input(value: Any, inputs: Mapping[str, Any]) -> bool:
    return isinstance(value, str) and value in inputs


def _file_name(path: str) -> str:
    """Return the last part of a path of any system."""
    return PureWindowsPath(path).name
