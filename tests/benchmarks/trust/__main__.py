"""Run the trust campaign: ``python -m tests.benchmarks.trust``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from fnmatch import fnmatch
from pathlib import Path

import pandas as pd

from tests.benchmarks.trust.lines import LINES
from tests.benchmarks.trust.measuring import Record
from tests.benchmarks.trust.page import Campaign, page
from tests.benchmarks.trust.rows import Row
from tests.benchmarks.trust.running import cores, run_rows
from tests.benchmarks.trust.scoring import FAILED, judged, line_result, needless
from tests.benchmarks.trust.table import all_rows

PAGE, RUNS, CHECKS = "trust.md", "trust_runs.csv", "trust_checks.json"


def asked(arguments: list[str] | None = None) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.trust", description=__doc__)
    parser.add_argument("--seeds", type=int, default=16, help="of each row; some rows fly more")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--rows", default="*", help="names or patterns, parted by commas")
    parser.add_argument("--workers", type=int, default=cores())
    parser.add_argument("--output", type=Path, default=Path("out/trust"))
    parser.add_argument("--read", type=Path, help="a folder of results: judge its runs again, fly none")
    parser.add_argument("--list", action="store_true", help="say which rows there are")
    return parser.parse_args(arguments)


def chosen(patterns: str) -> list[Row]:
    """Return the rows that any of the patterns names."""
    wanted = [pattern.strip() for pattern in patterns.split(",")]
    return [row for name, row in all_rows().items() if any(fnmatch(name, pattern) for pattern in wanted)]


def main(arguments: list[str] | None = None) -> int:
    """Return 0 when every row is inside its bounds, or fails as it is expected to."""
    options = asked(arguments)
    rows = chosen(options.rows)
    if options.list or not rows:
        print("\n".join(f"{row.name:32} {row.title}" for row in all_rows().values()))
        return 0 if options.list else 2
    began = time.perf_counter()

    def tell(name: str, done: int, total: int) -> None:
        print(f"{time.perf_counter() - began:6.0f} s  {done} of {total}  {name}", file=sys.stderr, flush=True)

    if options.read is None:
        records = run_rows(rows, options.first_seed, options.seeds, options.workers, tell)
    else:
        records = read_runs(options.read / RUNS)
        rows = [row for row in rows if row.name in records]
    verdicts = [judged(row, records[row.name]) for row in rows]
    lines = [result for line in LINES if (result := line_result(line, records)) is not None]
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    took_s = time.perf_counter() - began
    text = page(Campaign(verdicts, lines, records, seeds, took_s, options.workers))
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / PAGE).write_text(text, encoding="utf-8")
    if options.read is None:
        table = pd.DataFrame([record for runs in records.values() for record in runs])
        table.to_csv(options.output / RUNS, index=False)
    checks = [
        {
            "row": v.row.name,
            "check": r.name,
            "value": r.value,
            "low": r.low,
            "high": r.high,
            "verdict": r.verdict,
        }
        for v in verdicts
        for r in v.results
    ]
    (options.output / CHECKS).write_text(json.dumps(checks, indent=1), encoding="utf-8")
    words = [v.word for v in verdicts] + [result.verdict for result in lines]
    for verdict in verdicts:
        took = sum(float(record["took_s"]) for record in records[verdict.row.name])
        print(f"{verdict.row.name:32} {verdict.runs:4} runs {took:6.1f} s CPU  {verdict.word}")
    print(f"{took_s:.0f} s; {options.output / PAGE}")
    return 1 if FAILED in words or needless(verdicts) else 0


def read_runs(path: Path) -> dict[str, list[Record]]:
    """Return the runs of an earlier campaign by their rows; a cell without a number is a number that was not kept."""
    table = pd.read_csv(path, low_memory=False, keep_default_na=False, na_values=[""])
    found: dict[str, list[Record]] = {}
    for record in table.to_dict("records"):
        kept = {str(name): value for name, value in record.items() if value == value}
        found.setdefault(str(kept["row"]), []).append({"error": "", **kept})
    return found


if __name__ == "__main__":
    sys.exit(main())
