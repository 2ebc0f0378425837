"""The judge of the trust campaign is judged: a known error over sigma gets the known verdict."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.trust.measuring import Record
from tests.benchmarks.trust.page import Campaign, page
from tests.benchmarks.trust.rows import BLOCKS, Check, Line, Mark, Row, nees
from tests.benchmarks.trust.scoring import (
    EXPECTED,
    FAILED,
    OK,
    judged,
    judged_lines,
    line_result,
    needless,
    nees_of,
)

RUNS = 24
LOOK = "end"


def records(ratio: float, sigma_deg: float = 1.0, seed: int = 1) -> list[Record]:
    """Return runs whose errors are Gaussian with ``ratio`` times the stated sigma."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(RUNS):
        kept: Record = {"row": "row", "seed": float(number), "error": "", "took_s": 0.1}
        for block, names in BLOCKS.items():
            for name in names:
                sigma = sigma_deg if block == "yaw" else 1.0
                kept[f"{LOOK}.{name}.sigma"] = sigma
                kept[f"{LOOK}.{name}.error"] = ratio * sigma * float(rng.standard_normal())
        found.append(kept)
    return found


def row(*checks: Check, **more: object) -> Row:
    return Row("row", "a row", "", checks, looks={LOOK: 0.0}, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("block", list(BLOCKS))
@pytest.mark.parametrize(("ratio", "word"), [(1.0, OK), (2.5, FAILED), (0.2, FAILED)])
def test_errors_of_a_known_multiple_of_sigma_get_their_verdict(block: str, ratio: float, word: str) -> None:
    """Too confident fails, and too modest too."""
    assert judged(row(*nees(block, modest={})), records(ratio)).word == word


def test_modesty_with_a_reason_is_allowed_by_its_factor_alone() -> None:
    """A variance 2.5 times too large is e/s = 0.63."""
    assert judged(row(*nees("position", modest={"position": 2.5})), records(0.63)).word == OK
    low = nees_of(records(0.63), "position", LOOK, 2.5)[1]
    assert low == pytest.approx(nees_of(records(0.63), "position", LOOK)[1] / 2.5)


def test_wide_heading_is_judged_from_the_confident_side_alone() -> None:
    """A sigma of 104 deg and an error of 5 deg is no modesty: an unknown heading may be right by chance."""
    assert judged(row(*nees("yaw")), records(0.05, sigma_deg=104.0)).word == OK
    assert judged(row(*nees("yaw")), records(0.05, sigma_deg=10.0)).word == FAILED
    assert judged(row(*nees("yaw")), records(2.5, sigma_deg=104.0)).word == FAILED


def test_uniform_heading_with_its_own_sigma_is_right() -> None:
    rng = np.random.default_rng(3)
    runs = records(1.0)
    for kept in runs:
        kept[f"{LOOK}.yaw_deg.sigma"] = 104.0
        kept[f"{LOOK}.yaw_deg.error"] = float(rng.uniform(-180.0, 180.0))
    assert judged(row(*nees("yaw")), runs).word == OK
    for kept in runs:
        kept[f"{LOOK}.yaw_deg.sigma"] = 27.0
    assert judged(row(*nees("yaw")), runs).word == FAILED


@pytest.mark.parametrize(
    ("statistic", "low", "high", "word"),
    [
        ("most", None, 3.0, OK),
        ("most", None, 2.9, FAILED),
        ("least", 1.0, None, OK),
        ("least", 1.1, None, FAILED),
    ],
)
def test_extreme_of_all_runs_decides(
    statistic: str, low: float | None, high: float | None, word: str
) -> None:
    runs = [{**kept, "number": 1.0 + 2.0 * (k == 7)} for k, kept in enumerate(records(1.0))]
    check = Check("number", statistic, "number", low=low, high=high)  # type: ignore[arg-type]
    assert judged(row(check), runs).word == word


def test_number_that_a_run_has_not_fails_and_an_event_that_it_has_not_is_none() -> None:
    runs = [{**kept, "number": 1.0} for kept in records(1.0)]
    del runs[3]["number"]
    assert judged(row(Check("number", "most", "number", high=2.0)), runs).word == FAILED
    assert judged(row(Check("no reset", "most", "events.reset", high=0.0)), runs).word == OK
    runs[3]["events.reset"] = 1.0
    assert judged(row(Check("no reset", "most", "events.reset", high=0.0)), runs).word == FAILED


def test_number_that_is_none_fails() -> None:
    runs = [{**kept, "number": math.nan} for kept in records(1.0)]
    for statistic in ("most", "least", "mean", "median", "rms"):
        check = Check("number", statistic, "number", high=2.0)
        assert judged(row(check), runs).word == FAILED


def test_run_that_raises_fails_its_row() -> None:
    runs: list[Record] = [
        *records(1.0),
        {"row": "row", "seed": 99.0, "error": "ValueError: no", "took_s": 0.1},
    ]
    found = judged(row(*nees("yaw")), runs)
    assert found.word == FAILED and found.errors == ("ValueError: no",)


def test_expected_failure_is_no_failure_and_needless_once_it_holds() -> None:
    marked = row(*nees("yaw", "tilt"), expected=(Mark("row", "nees yaw*", "not mended yet"),))
    wrong = judged(marked, records(3.0, seed=5))
    assert wrong.word == FAILED, "tilt is wrong too, and has no mark"
    both = replace(marked, expected=(Mark("row", "nees *", "not mended yet"),))
    assert judged(both, records(3.0)).word == EXPECTED
    assert needless([judged(both, records(3.0))]) == []
    assert judged(both, records(1.0)).word == OK
    assert needless([judged(both, records(1.0))]) == list(both.expected)


@pytest.mark.parametrize(("ratio", "word"), [(1.0, OK), (1.6, FAILED), (0.5, FAILED)])
def test_line_takes_the_runs_of_its_rows_as_one_sample(ratio: float, word: str) -> None:
    line = Line("line", ("a*", "b"), ("yaw",), LOOK, "nees", 0.4, 2.0)
    found = line_result(line, {"a1": records(ratio), "b": records(ratio, seed=2), "c": records(9.0)})
    assert found is not None and found.verdict == word
    assert line_result(line, {"c": records(1.0), "b": records(1.0)}) is None
    marked = judged_lines([line], {"a1": records(ratio), "b": records(ratio)}, (Mark("lines", "l*", "why"),))
    assert marked.word == (EXPECTED if word == FAILED else OK)


def test_page_names_each_row_and_what_does_not_hold() -> None:
    marked = row(*nees("yaw"), expected=(Mark("row", "*", "mended another day"),))
    verdict = judged(marked, records(3.0))
    text = page(
        Campaign([verdict], judged_lines([], {}, ()), {"row": records(3.0)}, range(1, 1 + RUNS), 60.0, 2)
    )
    assert "`row`" in text and EXPECTED in text and "mended another day" in text
    assert FAILED not in text.replace(f"| {FAILED} |", "")
