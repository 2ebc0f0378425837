"""The page of results: one file in Markdown, short tables first, the numbers behind them after."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from insgnss.version import __version__
from tests.benchmarks.trust.levels import BEYOND, LARGEST
from tests.benchmarks.trust.measuring import Record
from tests.benchmarks.trust.rows import ALL, BLOCKS, MOTION
from tests.benchmarks.trust.scoring import (
    CONFIDENCE,
    EXPECTED,
    FAILED,
    OK,
    Result,
    Verdict,
    needless,
    nees_of,
    rms_ratios,
    worst_ratio,
)
from tests.statistics_bounds import mean_chi_square_bounds

_SHORT = {"accel_bias": "accel. bias", "gyro_bias": "gyro bias"}
_ORDINARY = {"start", "heading_single", "heading_known"}


@dataclass(frozen=True)
class Campaign:
    """All that the page says."""

    verdicts: Sequence[Verdict]
    lines: Verdict
    records: Mapping[str, Sequence[Record]]
    seeds: range
    took_s: float
    workers: int


def page(campaign: Campaign) -> str:
    """Return the page."""
    rows = campaign.verdicts
    levels = [v for v in rows if v.row.integrity]
    situations = [v for v in rows if not v.row.fault and not v.row.integrity]
    faults = [v for v in rows if v.row.fault]
    parts = [
        "# Trust campaign",
        _summary(campaign),
        "## Bounds over several rows",
        _table(("what", "value", "bounds", "verdict"), map(_line_cells, campaign.lines.results)),
        "## Situations",
        "Error over stated sigma (rms over runs and axes) at the last instant that the row looks at. 1 is right.",
        _table(_SITUATION_COLUMNS, (_situation_cells(v, campaign.records[v.row.name]) for v in situations)),
        "## Faults",
        "Largest error over stated sigma from the fault on, over all runs. Above 5 the filter does not know its error.",
        _table(_FAULT_COLUMNS, (_fault_cells(v, campaign.records[v.row.name]) for v in faults)),
        *_levels(levels, campaign.records),
        "## Checks outside their bounds",
        _table(("row", "check", "value", "bounds", "expected, because"), _failing([*rows, campaign.lines])),
        *_needless([*rows, campaign.lines]),
        "## NEES",
        _NEES_WORDS,
        _table(("row", "at", "runs", "bounds", *map(_title, ALL)), _nees_rows(situations, campaign.records)),
        "## Cost",
        _cost(campaign),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


_SITUATION_COLUMNS = (
    "row",
    "situation",
    "grade",
    "runs",
    *("position", "velocity", "tilt", "yaw", "accel. bias", "gyro bias"),
    "worst e/s",
    "smallest sigma of yaw [deg]",
    "heading known after [s]",
    "false headings",
    "events",
    "verdict",
)
_FAULT_COLUMNS = (
    "row",
    "fault",
    "runs",
    *("position", "velocity", "tilt", "yaw"),
    "reported",
    "false headings",
    "events",
    "verdict",
)
_LEVEL_COLUMNS = (
    "row",
    "fault",
    "runs",
    "epochs",
    "error beyond HPL",
    "beyond VPL",
    "largest error over HPL",
    "over VPL",
    "events",
    "verdict",
)
_LEVEL_WORDS = """\
Epochs whose error is beyond its protection level, whether an alert was raised or not. The risk stated for an epoch is
1e-7 without a fault, and that over the fault's probability with one: 1e-2 for a satellite, 0.1 for a constellation."""
_NEES_WORDS = f"""\
Mean over runs and axes of the squared error over sigma, at one instant of each run. The bounds are those of chi-square
for that many independent runs ({100 * CONFIDENCE:g} %), with the axes taken as fully correlated. Values outside are
bold. The filter assumes that pseudorange errors last 2.5 s; the simulated errors are white. The lower bound of position
is therefore divided by 2.5, that of velocity by 1.25. Where the stated sigma of yaw exceeds 60 deg only the upper bound
counts, because an error on a circle cannot exceed 180 deg. Biases are compared with the
simulated ones alone: scale factors, misalignments and the gyros' g-sensitivity are states of their own."""


def _summary(campaign: Campaign) -> str:
    words = [v.word for v in campaign.verdicts] + [r.verdict for r in campaign.lines.results]
    counts = ", ".join(f"{words.count(w)} {w}" for w in (OK, EXPECTED, FAILED) if words.count(w))
    runs = sum(v.runs for v in campaign.verdicts)
    return (
        f"insgnss {__version__}: {len(campaign.verdicts)} rows, {runs} runs, seeds from {campaign.seeds.start} on,"
        f" at least {len(campaign.seeds)} each; {campaign.took_s / 60.0:.1f} minutes in {campaign.workers} process(es)."
        f"\n\nOf the rows, and of the bounds over several rows: **{counts}**.\n\n"
        + _table(("kind", OK, EXPECTED, FAILED), _counts(campaign.verdicts))
    )


def _counts(verdicts: Sequence[Verdict]) -> Iterator[Sequence[str]]:
    for kind, fault in (("situations", False), ("faults", True)):
        words = [v.word for v in verdicts if v.row.fault is fault]
        yield (kind, *(str(words.count(word)) for word in (OK, EXPECTED, FAILED)))


def _line_cells(result: Result) -> Sequence[str]:
    return (result.name, _number(result.value), _bounds(result.low, result.high), _loud(result.verdict))


def _situation_cells(verdict: Verdict, records: Sequence[Record]) -> Sequence[str]:
    row = verdict.row
    last = list(row.looks)[-1] if row.looks else ""
    judged_blocks = {c.of for c in row.checks if c.statistic == "nees" and c.at == last}
    ratios = {b: r for b, r in rms_ratios(row, records).items() if b in judged_blocks}
    worst, block = worst_ratio(records, "all")
    least = min((float(r.get("all.yaw.least_sigma", math.nan)) for r in records), default=math.nan)
    known = [float(r.get("known_s", math.nan)) for r in records]
    return (
        f"`{row.name}`",
        row.title,
        row.grade,
        str(verdict.runs),
        *(_number(ratios[block]) if block in ratios else "" for block in ALL),
        f"{_number(worst)} {_title(block)}" if block else "",
        _number(least),
        _seconds(float(np.median(known))) if known else "",
        _count(records, "false_heading"),
        _events(records),
        _loud(verdict.word),
    )


def _fault_cells(verdict: Verdict, records: Sequence[Record]) -> Sequence[str]:
    row = verdict.row
    window = next(iter(row.windows), "all")
    reported = [float(r["reported"]) for r in records if "reported" in r]
    return (
        f"`{row.name}`",
        row.title + ("" if window in ("all", "since") else f" ({window})"),
        str(verdict.runs),
        *(_number(_worst_of(records, window, block)) for block in MOTION),
        f"{sum(reported):.0f} of {len(reported)}" if reported else "",
        _count(records, "false_heading"),
        _events(records),
        _loud(verdict.word),
    )


def _levels(verdicts: Sequence[Verdict], records: Mapping[str, Sequence[Record]]) -> Iterator[str]:
    if verdicts:
        yield "## Protection levels"
        yield _LEVEL_WORDS
        yield _table(_LEVEL_COLUMNS, (_level_cells(v, records[v.row.name]) for v in verdicts))


def _level_cells(verdict: Verdict, records: Sequence[Record]) -> Sequence[str]:
    sound = [record for record in records if not record.get("error")]
    rows, *beyond = (sum(float(record[key]) for record in sound) for key in ("rows", *BEYOND))
    largest = (_number(max((float(record[key]) for record in sound), default=math.nan)) for key in LARGEST)
    return (
        f"`{verdict.row.name}`",
        verdict.row.title,
        str(verdict.runs),
        f"{rows:.0f}",
        *(f"{count:.0f}" for count in beyond),
        *largest,
        _events(records),
        _loud(verdict.word),
    )


def _worst_of(records: Sequence[Record], window: str, block: str) -> float:
    values = [float(record.get(f"{window}.{block}.worst", math.nan)) for record in records]
    return float(np.max(values)) if values else math.nan


def _failing(verdicts: Sequence[Verdict]) -> Iterator[Sequence[str]]:
    for verdict in verdicts:
        for text in dict.fromkeys(verdict.errors):
            count = verdict.errors.count(text)
            yield (f"`{verdict.row.name}`", f"{count} run(s) raised", "", "", text.replace("|", "/"))
        for result in verdict.results:
            if not result.holds:
                why = result.reason or "**no**"
                bounds = _bounds(result.low, result.high)
                yield (f"`{verdict.row.name}`", result.name, _number(result.value), bounds, why)


def _needless(verdicts: Sequence[Verdict]) -> Iterator[str]:
    found = needless(verdicts)
    if found:
        yield "## Expected to fail, but passing: remove these marks"
        yield _table(("rows", "checks", "reason"), ((m.rows, m.checks, m.reason) for m in found))


def _nees_rows(
    verdicts: Sequence[Verdict], records: Mapping[str, Sequence[Record]]
) -> Iterator[Sequence[str]]:
    for verdict in verdicts:
        row = verdict.row
        sound = [record for record in records[row.name] if not record.get("error")]
        for look in row.looks:
            own = {check.of: check for check in row.checks if check.statistic == "nees" and check.at == look}
            if not own or not sound:
                continue
            low, high = mean_chi_square_bounds(1, len(sound), CONFIDENCE)
            cells = []
            for block in BLOCKS:
                if block not in own:
                    cells.append("")
                    continue
                value, least, most = nees_of(sound, block, look, own[block].modest)
                cells.append(_number(value) if least <= value <= most else f"**{_number(value)}**")
            yield (f"`{row.name}`", look, str(len(sound)), f"{_number(low)} to {_number(high)}", *cells)


def _cost(campaign: Campaign) -> str:
    took = {name: [float(r["took_s"]) for r in runs] for name, runs in campaign.records.items()}
    dearest = sorted(took, key=lambda name: -sum(took[name]))[:5]
    words = ", ".join(f"`{name}` {np.mean(took[name]):.1f} s a run" for name in dearest)
    return f"{sum(map(sum, took.values())):.0f} s of CPU in all. The most expensive rows: {words}."


def _events(records: Sequence[Record]) -> str:
    totals: dict[str, int] = {}
    for record in records:
        for key, value in record.items():
            if key.startswith("events.") and key[7:] not in _ORDINARY:
                totals[key[7:]] = totals.get(key[7:], 0) + int(float(value))
    return ", ".join(f"{kind} {count}" for kind, count in sorted(totals.items()))


def _count(records: Sequence[Record], key: str) -> str:
    values = [float(record[key]) for record in records if key in record]
    return f"{sum(values):.0f}" if values else ""


def _table(columns: Sequence[str], rows: Iterator[Sequence[str]] | Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join(lines)


def _title(block: str) -> str:
    return _SHORT.get(block, block)


def _bounds(low: float, high: float) -> str:
    if math.isinf(low):
        return f"at most {_number(high)}"
    return f"at least {_number(low)}" if math.isinf(high) else f"{_number(low)} to {_number(high)}"


def _number(value: float) -> str:
    if math.isnan(value):
        return "-"
    if abs(value) >= 1e5:
        return f"{value:.1g}"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.1f}" if abs(value) >= 10.0 else f"{value:.2f}"


def _seconds(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:.0f}"


def _loud(word: str) -> str:
    return word if word in (OK, EXPECTED) else f"**{word}**"
