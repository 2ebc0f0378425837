"""All rows of the trust campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

from tests.benchmarks.trust.expected import marks_of
from tests.benchmarks.trust.faults import fault_rows
from tests.benchmarks.trust.levels import level_rows
from tests.benchmarks.trust.rates_and_gaps import rate_and_gap_rows
from tests.benchmarks.trust.rows import Row
from tests.benchmarks.trust.situations import situation_rows


@lru_cache(maxsize=1)
def all_rows() -> Mapping[str, Row]:
    """Return every row by its name."""
    rows = (*situation_rows(), *rate_and_gap_rows(), *fault_rows(), *level_rows())
    named = {row.name: replace(row, expected=marks_of(row.name)) for row in rows}
    if len(named) != len(rows):
        raise ValueError("two rows have the same name")
    return named
