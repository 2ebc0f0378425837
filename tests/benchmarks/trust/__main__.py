"""Run the trust campaign: ``python -m tests.benchmarks.trust``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from fnmatch import fnmatch
from pathlib import Path

from tests.benchmarks.trust.expected import marks_of
from tests.benchmarks.trust.lines import LINES
from tests.benchmarks.trust.measuring import Record
from tests.benchmarks.trust.page import Campaign, page
from tests.benchmarks.trust.rows import Row
from tests.benchmarks.trust.running import cores, run_rows
from tests.benchmarks.trust.scoring import FAILED, judged, judged_lines, needless
from tests.benchmarks.trust.scoring import LINES as LINES_ROW
from tests.benchmarks.trust.table import all_rows

PAGE, RUNS, CHECKS = "trust.md", "trust_runs.jsonl", "trust_checks.json"


def asked(arguments: list[str] | None = None) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.trust", description=__doc__)
    parser.add_argument("--seeds", type=int, default=12, help="of each row; some rows fly more")
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

    options.output.mkdir(parents=True, exist_ok=True)

    def tell(name: str, found: list[Record], done: int, total: int) -> None:
        print(f"{time.perf_counter() - began:6.0f} s  {done} of {total}  {name}", file=sys.stderr, flush=True)
        with (options.output / RUNS).open("a", encoding="utf-8") as kept:
            kept.writelines(json.dumps(record) + "\n" for record in found)

    if options.read is None:
        (options.output / RUNS).unlink(missing_ok=True)
        records = run_rows(rows, options.first_seed, options.seeds, options.workers, tell)
    else:
        records = read_runs(options.read / RUNS)
        rows = [row for row in rows if row.name in records]
    verdicts = [judged(row, records[row.name]) for row in rows]
    lines = judged_lines(LINES, records, marks_of(LINES_ROW))
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    took_s = time.perf_counter() - began
    text = page(Campaign(verdicts, lines, records, seeds, took_s, options.workers))
    (options.output / PAGE).write_text(text, encoding="utf-8")
    checks = [
        {
            "row": v.row.name,
            "check": r.name,
            "value": r.value,
            "low": r.low,
            "high": r.high,
            "verdict": r.verdict,
        }
        for v in (*verdicts, lines)
        for r in v.results
    ]
    (options.output / CHECKS).write_text(json.dumps(checks, indent=1), encoding="utf-8")
    words = [v.word for v in (*verdicts, lines)]
    for verdict in verdicts:
        took = sum(float(record["took_s"]) for record in records[verdict.row.name])
        print(f"{verdict.row.name:32} {verdict.runs:4} runs {took:6.1f} s CPU  {verdict.word}")
    print(f"{took_s:.0f} s; {options.output / PAGE}")
    return 1 if FAILED in words or needless([*verdicts, lines]) else 0


def read_runs(path: Path) -> dict[str, list[Record]]:
    """Return the runs of an earlier campaign, or of a part of one, by their rows."""
    found: dict[str, list[Record]] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        record: Record = json.loads(line)
        found.setdefault(str(record["row"]), []).append(record)
    return found


if __name__ == "__main__":
    sys.exit(main())
