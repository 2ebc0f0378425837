"""A user's own measurement kinds, as the settings of a run describe them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from insgnss.report.labels import KIND_UNITS
from insgnss.runs.result import Run


def own_kinds(run: Run) -> dict[str, Mapping[str, Any]]:
    """Return the settings of the user's own measurements, by name."""
    entries = run.settings.get("measurements") or []
    return {str(entry["name"]): entry for entry in entries if isinstance(entry, Mapping) and "name" in entry}


def unit_of(run: Run, kind: str) -> str:
    """Return the unit of a kind's innovations, '-' if none is stated."""
    own = own_kinds(run).get(kind, {})
    return KIND_UNITS.get(kind) or str(own.get("unit") or "-")
