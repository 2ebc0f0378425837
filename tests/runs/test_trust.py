"""The reduced trust campaign: rows that show much for little time, few seeds; ``tests.benchmarks.trust`` flies them all.

Two faults of the sample flight, of which ``test_suspects.py`` asks more, are left to the whole campaign.

A row holds, or fails where ``tests/benchmarks/trust/expected.py`` says so. Once what a mark waits for is mended, the test
of the marks fails until the mark is taken away.
"""  # noqa: E501

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatch
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tests.benchmarks.trust.expected import LATER, NOW
from tests.benchmarks.trust.flying import fly
from tests.benchmarks.trust.lines import LINES
from tests.benchmarks.trust.page import Campaign, page
from tests.benchmarks.trust.running import one
from tests.benchmarks.trust.scoring import FAILED, Verdict, judged, judged_lines, needless
from tests.benchmarks.trust.scoring import LINES as LINES_ROW
from tests.benchmarks.trust.table import all_rows

SEEDS = range(101, 103)
# an rms over its sigma of two flights is beyond 1.5 one time in ten; flights of the others take long
OWN_SEEDS = {
    "gap_2s_turn": range(101, 107),
    "rest_industrial_carrier": range(101, 102),
}
# what a search for the faulty satellites finds is not what the levels claim, and takes a minute of processor
OWN_SETTINGS = {"levels_constellation": {"health.recovery": False}}
REDUCED = sorted(name for name, row in all_rows().items() if row.in_tests)


@cache
def verdict(name: str) -> Verdict:
    row = all_rows()[name]
    row = replace(row, settings={**row.settings, **OWN_SETTINGS.get(name, {})})
    return judged(row, [one(row, seed) for seed in OWN_SEEDS.get(name, SEEDS)])


@pytest.mark.slow
@pytest.mark.parametrize("name", REDUCED)
def test_row_is_inside_its_bounds_or_fails_as_expected(name: str) -> None:
    found = verdict(name)
    outside = [
        f"{r.name}: {r.value:.3g}, not in [{r.low:.3g}, {r.high:.3g}]" for r in found.results if not r.holds
    ]
    assert found.word != FAILED, (found.errors, outside)


@pytest.mark.slow
def test_marks_of_expected_failures_are_still_needed() -> None:
    """A mark that covers a row of this test must cover a check that fails."""
    gone = [mark for mark in needless([verdict(name) for name in REDUCED]) if mark.in_tests]
    assert not gone, f"mended: take these marks away: {gone}"


def test_every_mark_names_checks_that_there_are() -> None:
    names = {name: [check.name for check in row.checks] for name, row in all_rows().items()}
    names[LINES_ROW] = [line.name for line in LINES]
    for mark in (*LATER, *NOW):
        rows = [name for name in names if fnmatch(name, mark.rows)]
        assert any(fnmatch(check, mark.checks) for name in rows for check in names[name]), mark


def test_marks_of_expected_failures_have_no_equal() -> None:
    marks = [(mark.rows, mark.checks) for mark in (*LATER, *NOW)]
    assert len(set(marks)) == len(marks)


def test_errors_beyond_their_levels_are_counted_and_the_largest_is_kept() -> None:
    """Horizontal errors of 5 m, vertical ones of 1 m; an infinite level is never exceeded."""
    errors = pd.DataFrame({"time_s": np.arange(4.0), "d_n_m": 3.0, "d_e_m": 4.0, "d_d_m": -1.0})
    nav = pd.DataFrame({"time_s": np.arange(4.0), "hpl_m": [10.0, 4.0, 2.5, np.inf], "vpl_m": 2.0})
    flown = SimpleNamespace(run=SimpleNamespace(errors=errors, nav=nav))
    found = {name: measure(flown) for name, measure in all_rows()["levels"].measures.items()}
    assert found == {"rows": 4.0, "beyond_hpl": 2.0, "beyond_vpl": 0.0, "largest_h": 2.0, "largest_v": 0.5}


def test_page_counts_the_errors_beyond_their_levels_over_all_runs() -> None:
    row = all_rows()["levels"]
    record = {
        "error": "",
        "rows": 510.0,
        "beyond_hpl": 1.0,
        "beyond_vpl": 0.0,
        "largest_h": 1.25,
        "largest_v": 0.5,
    }
    records = {row.name: [record | {"seed": float(seed), "took_s": 1.0} for seed in range(3)]}
    lines = judged_lines((), {}, ())
    text = page(Campaign([judged(row, records[row.name])], lines, records, range(3), 1.0, 1))
    assert "| `levels` | no fault | 3 | 1530 | 3 | 0 | 1.25 | 0.50 |  | **FAILED** |" in text


@pytest.mark.slow
def test_four_wrong_satellites_of_eight_move_no_filter_that_more_have_placed() -> None:
    """Three sound ones are behind the wing for half a minute; the other eight agree on a place 113 m away."""
    run = fly(all_rows()["fault_four_ranges"], 45004).run
    assert run.errors is not None
    off = run.errors[["d_n_m", "d_e_m", "d_d_m"]].to_numpy()
    sigma = run.errors[["sd_n_m", "sd_e_m", "sd_d_m"]].to_numpy()
    assert abs(off / sigma).max() < 4.0
    assert "reset" not in set(run.events["kind"])
