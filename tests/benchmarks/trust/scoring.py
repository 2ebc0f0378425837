"""Bounds and verdicts: what the runs of a row say of each of its checks.

A check of NEES takes the mean of the squared error over sigma at one instant of each run, over the runs and the axes of
a block. The runs are independent; the axes need not be, so the bounds are those of chi-square with one degree of freedom
a run: the widest that the mean can have, whatever the correlations between the axes. Every run gives one value, so no
correlation in time enters.

A heading's error is taken within half a circle. It cannot be larger than 180 deg, so a stated sigma beyond 60 deg is
judged from one side alone: the mean must not be above its upper bound. (An unknown heading is uniform: 104 deg rms.)
"""  # noqa: E501

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import Any, Final

import numpy as np

from insgnss.tables import Float64
from tests.benchmarks.trust.measuring import Record
from tests.benchmarks.trust.rows import BLOCKS, Check, Line, Mark, Row
from tests.statistics_bounds import mean_chi_square_bounds

# A page has some 300 checks of NEES: one in thirty pages of a consistent filter shows one beyond its bounds.
CONFIDENCE: Final = 0.9999
LINES: Final = "lines"  # the name of the row that the bounds over several rows make
WIDE_DEG: Final = 60.0
OK, EXPECTED, FAILED = "ok", "expected to fail", "FAILED"


@dataclass(frozen=True)
class Result:
    """What the runs say of one check."""

    name: str
    value: float  # NaN: nothing was measured, which fails
    low: float
    high: float
    reason: str = ""  # why it is expected to fail

    @property
    def holds(self) -> bool:
        """Whether the value lies inside its bounds."""
        return bool(self.low <= self.value <= self.high)

    @property
    def verdict(self) -> str:
        """Ok, expected to fail, or failed."""
        if self.holds:
            return OK
        return EXPECTED if self.reason else FAILED


@dataclass(frozen=True)
class Verdict:
    """What the runs say of a row."""

    row: Row
    results: tuple[Result, ...]
    runs: int
    errors: tuple[str, ...]  # of runs that raised

    @property
    def word(self) -> str:
        """The row's verdict: the worst of its checks'."""
        words = {result.verdict for result in self.results}
        if self.errors or FAILED in words:
            return FAILED
        return EXPECTED if EXPECTED in words else OK


def judged(row: Row, records: Sequence[Record]) -> Verdict:
    """Return the verdict of a row's runs."""
    sound = [record for record in records if not record.get("error")]
    errors = tuple(str(record["error"]) for record in records if record.get("error"))
    results = tuple(_result(row, check, sound) for check in row.checks)
    return Verdict(row, results, len(records), errors)


def _result(row: Row, check: Check, records: Sequence[Record]) -> Result:
    reason = next((mark.reason for mark in row.expected if fnmatch(check.name, mark.checks)), "")
    if check.statistic == "nees":
        value, low, high = nees_of(records, check.of, check.at, check.modest)
        low, high = (
            given if given is not None else own for given, own in ((check.low, low), (check.high, high))
        )
        return Result(check.name, value, low, high, reason)
    low = -math.inf if check.low is None else check.low
    high = math.inf if check.high is None else check.high
    return Result(check.name, _statistic(check, records), low, high, reason)


def _statistic(check: Check, records: Sequence[Record]) -> float:
    missing = 0.0 if check.of.startswith("events.") else math.nan
    values = np.array([float(record.get(check.of, missing)) for record in records])
    if not len(values):
        return math.nan
    if check.statistic == "rms":
        return float(np.sqrt(np.mean(values)))
    # a run that has not the number makes the whole unknown, and the check fails
    take: dict[str, Callable[[Float64], Any]] = {
        "most": np.max,
        "least": np.min,
        "mean": np.mean,
        "median": np.median,
    }
    return float(take[check.statistic](values))


def nees_of(
    records: Sequence[Record], block: str, look: str, modest: float = 1.0
) -> tuple[float, float, float]:
    """Return the mean of the squared error over sigma of a block at a look, and its bounds."""
    names = [f"{look}.{name}" for name in BLOCKS[block]]
    rows = [record for record in records if all(f"{name}.sigma" in record for name in names)]
    if len(rows) < len(records) or not rows:
        return math.nan, math.nan, math.nan
    error, sigma = (
        np.array([[float(record[f"{name}.{what}"]) for name in names] for record in rows])
        for what in ("error", "sigma")
    )
    low, high = mean_chi_square_bounds(1, len(rows), CONFIDENCE)
    low /= modest
    if block == "yaw" and float(np.median(sigma)) > WIDE_DEG:
        low = 0.0
    return float(np.mean((error / sigma) ** 2)), low, high


def needless(verdicts: Sequence[Verdict]) -> list[Mark]:
    """Return the marks whose checks all hold: what they waited for is mended, and they are to be taken away."""
    marks = list(dict.fromkeys(mark for verdict in verdicts for mark in verdict.row.expected))
    return [
        mark
        for mark in marks
        if not any(
            fnmatch(verdict.row.name, mark.rows) and fnmatch(result.name, mark.checks) and not result.holds
            for verdict in verdicts
            for result in verdict.results
        )
    ]


def judged_lines(
    lines: Sequence[Line], records: Mapping[str, Sequence[Record]], marks: tuple[Mark, ...]
) -> Verdict:
    """Return the verdict of the bounds over several rows, as that of a row of their own."""
    results = tuple(r for line in lines if (r := line_result(line, records, marks)) is not None)
    return Verdict(Row(LINES, "bounds over several rows", "", (), expected=marks), results, 0, ())


def line_result(
    line: Line, records: Mapping[str, Sequence[Record]], marks: tuple[Mark, ...] = ()
) -> Result | None:
    """Return what the runs of several rows together say; nothing where none of them was flown."""
    reason = next((mark.reason for mark in marks if fnmatch(line.name, mark.checks)), "")
    groups = [
        [
            record
            for name, runs in records.items()
            if fnmatch(name, pattern)
            for record in runs
            if not record.get("error")
        ]
        for pattern in line.rows
    ]
    if not all(groups):
        return None
    if line.statistic == "ratio":
        above, below = (np.mean([float(r.get(line.of[0], math.nan)) for r in group]) for group in groups)
        return Result(line.name, math.sqrt(above / below), line.low, line.high, reason)
    taken = [record for group in groups for record in group]
    if line.statistic == "nees":
        value = float(np.mean([nees_of(taken, block, line.at)[0] for block in line.of]))
    else:
        keys = [f"{line.at}.{block}.square" for block in line.of]
        value = math.sqrt(np.mean([[float(record.get(key, math.nan)) for key in keys] for record in taken]))
    return Result(line.name, value, line.low, line.high, reason)


def rms_ratios(row: Row, records: Sequence[Record]) -> dict[str, float]:
    """Return error over sigma (rms) of each block: at the row's last look, over runs and axes."""
    if not row.looks:
        return {}
    look = list(row.looks)[-1]
    sound = [record for record in records if not record.get("error")]
    return {block: math.sqrt(nees_of(sound, block, look)[0]) for block in BLOCKS}


def worst_ratio(records: Sequence[Record], window: str) -> tuple[float, str]:
    """Return the largest error over sigma of a window over all runs, and of which block it is."""
    found = [
        (float(record[f"{window}.{block}.worst"]), block)
        for record in records
        for block in BLOCKS
        if f"{window}.{block}.worst" in record
    ]
    return max(found, default=(math.nan, ""))
