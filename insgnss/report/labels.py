"""Columns and measurement kinds in words: 'vn_mps' is drawn as 'velocity north' in 'm/s'."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from insgnss.runs.columns.sheet import UNITS
from insgnss.runs.result import Run


class Label(NamedTuple):
    """The label of an axis or a table's head."""

    words: str
    unit: str  # "" without one

    def axis(self) -> str:
        """Return the text of an axis: 'height, m'."""
        return f"{self.words}, {self.unit}" if self.unit else self.words


_WORDS: Final[dict[str, str]] = {
    "n": "north",
    "e": "east",
    "d": "down",
    "h": "height",
    "vn": "velocity north",
    "ve": "velocity east",
    "vd": "velocity down",
    "lat": "latitude",
    "lon": "longitude",
}
KIND_UNITS: Final[dict[str, str]] = {
    "pseudorange": "m",
    "range_rate": "m/s",
    "carrier_difference": "m",
    "attitude_difference": "m",
}


def label(column: str) -> Label:
    """Return the words and the unit of a column's name; a name without a known unit has none."""
    for ending, unit in UNITS.items():
        if column.endswith(f"_{ending}"):
            stem = column[: -len(ending) - 1]
            return Label(_WORDS.get(stem, stem.replace("_", " ")), unit)
    return Label(column.replace("_", " "), "")


def duration(seconds: float) -> str:
    """Return a span of time as people say it: '12.3 s', '4 min 05 s', '1 h 02 min'."""
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    if seconds < 7200.0:
        minutes, rest = divmod(round(seconds), 60)
        return f"{minutes} min {rest:02d} s"
    hours, rest = divmod(round(seconds / 60.0), 60)
    return f"{hours} h {rest:02d} min"


def number(value: float) -> str:
    """Return a number with three figures that count, '-' for a missing one."""
    if value != value:
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def row_of_numbers(values: Sequence[float], scale: float) -> list[str]:
    """Return numbers of one unit with the same number of decimals, so that ``scale`` has three figures that count."""
    size = abs(scale)
    known = size > 0.0 and math.isfinite(size)
    decimals = min(max(2 - math.floor(math.log10(size)), 0), 6) if known else 3
    return ["-" if value != value else f"{value:.{decimals}f}" for value in values]


def distance(metres: float) -> str:
    """Return a way as people say it: '129 m', '90.9 km'."""
    return f"{metres:.0f} m" if metres < 1000.0 else f"{number(metres / 1000.0)} km"


def own_kinds(run: Run) -> dict[str, Mapping[str, Any]]:
    """Return the settings of the user's own measurements, by name."""
    entries = run.settings.get("measurements") or []
    return {str(entry["name"]): entry for entry in entries if isinstance(entry, Mapping) and "name" in entry}


def unit_of(run: Run, kind: str) -> str:
    """Return the unit of a kind's innovations, '-' if none is stated."""
    own = own_kinds(run).get(kind, {})
    return KIND_UNITS.get(kind) or str(own.get("unit") or "-")
