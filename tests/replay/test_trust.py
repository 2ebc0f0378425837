"""The reduced trust campaign: rows that show much for little time, few seeds; ``tests.benchmarks.trust`` flies them all.

A row holds, or fails where ``tests/benchmarks/trust/expected.py`` says so. Once what a mark waits for is mended, the test
of the marks fails until the mark is taken away.
"""  # noqa: E501

from __future__ import annotations

from functools import cache

import pytest

from tests.benchmarks.trust.expected import LATER, NOW
from tests.benchmarks.trust.running import one
from tests.benchmarks.trust.scoring import FAILED, Verdict, judged, needless
from tests.benchmarks.trust.table import all_rows

SEEDS = range(101, 105)
REDUCED = sorted(name for name, row in all_rows().items() if row.in_tests)


@cache
def verdict(name: str) -> Verdict:
    row = all_rows()[name]
    return judged(row, [one(row, seed) for seed in SEEDS])


@pytest.mark.slow
@pytest.mark.parametrize("name", REDUCED)
def test_row_is_inside_its_bounds_or_fails_as_expected(name: str) -> None:
    found = verdict(name)
    told = [
        f"{r.name}: {r.value:.3g}, not in [{r.low:.3g}, {r.high:.3g}]" for r in found.results if not r.holds
    ]
    assert found.word != FAILED, (found.errors, told)


@pytest.mark.slow
def test_marks_of_expected_failures_are_still_needed() -> None:
    """A mark that covers a row of this test must cover a check that fails."""
    gone = [mark for mark in needless([verdict(name) for name in REDUCED]) if mark.in_tests]
    assert not gone, f"mended: take these marks away: {gone}"


def test_every_mark_names_a_row_and_a_check_of_it() -> None:
    for mark in (*LATER, *NOW):
        named = [row for row in all_rows().values() if mark in row.expected]
        assert named, mark
        assert mark.reason
