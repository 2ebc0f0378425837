"""Differing settings: the settings in which runs differ, key by key."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

from insgnss.runs.result import Run

_NOT_SETTINGS: Final = ("made", "took")  # different in every run
_ABSENT: Final = "-"


def settings_that_differ(runs: Mapping[str, Run]) -> list[tuple[str, ...]]:
    """Return a row for each setting that is not the same in all runs: its key, then each run's value as text."""
    flat = {name: dict(_flat(run.settings)) for name, run in runs.items()}
    keys = list(dict.fromkeys(key for of_run in flat.values() for key in of_run))
    rows = [(key, *(of_run.get(key, _ABSENT) for of_run in flat.values())) for key in keys]
    return [row for row in rows if len(set(row[1:])) > 1]


def _flat(settings: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield 'filter.visibility.on', 'true' and so on; a list of plain values is one value."""
    for key, value in settings.items():
        if key not in _NOT_SETTINGS:
            yield from _leaves(key, value)


def _leaves(key: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for inner, of_inner in value.items():
            yield from _leaves(f"{key}.{inner}", of_inner)
    elif isinstance(value, list | tuple) and any(isinstance(entry, Mapping) for entry in value):
        for place, entry in enumerate(value):
            yield from _leaves(f"{key}[{place}]", entry)
    elif value is not None:
        yield key, value if isinstance(value, str) else json.dumps(value, default=str)
