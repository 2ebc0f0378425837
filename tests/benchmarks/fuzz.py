"""A million damaged files through every reader and saved run: ``python -m tests.benchmarks.fuzz --count 1000000``.

Each case is made from the seed and its number alone. A failure is written with its file into the folder, and told by
the place that raised it; the process that runs cases is started again after a crash.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

from tests.fuzz.cases import failures
from tests.fuzz.targets import targets

_PER_PROCESS = 10_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="cases")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--only", default="", help="regular expression of targets' names")
    parser.add_argument("--output", type=Path, default=Path("out/fuzz"), help="folder of the failures' files")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    asked.output.mkdir(parents=True, exist_ok=True)
    if asked.inside:
        _run(asked)
    else:
        _supervise(asked)


def _run(asked: argparse.Namespace) -> None:
    warnings.simplefilter("error")
    numbers = range(asked.first, asked.first + asked.count)
    with tempfile.TemporaryDirectory() as runs:
        wanted = [target for target in targets(Path(runs)) if re.search(asked.only, target.name)]
        for found in failures(wanted, asked.seed, numbers, asked.output):
            last = [line.strip() for line in found.told.splitlines() if line.startswith("  File")][-1:]
            told = found.told.strip().splitlines()[-1]
            print(f"{found.target} | {' '.join(last)} | {told} | {found.file}", flush=True)


def _supervise(asked: argparse.Namespace) -> None:
    began, done, places = time.perf_counter(), 0, Counter[str]()
    while done < asked.count:
        count = min(_PER_PROCESS, asked.count - done)
        options = ["--count", str(count), "--first", str(asked.first + done), "--only", asked.only]
        options += ["--seed", str(asked.seed), "--output", str(asked.output), "--inside"]
        command = [sys.executable, "-m", "tests.benchmarks.fuzz", *options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as ended:
            for line in ended.stdout or ():
                place = " | ".join(line.split(" | ")[:3])
                places[place] += 1
                if places[place] <= 3:
                    print(line.rstrip(), flush=True)
        if ended.returncode != 0:
            died = (asked.output / "number").read_text()
            places[f"the process died: {ended.returncode}"] += 1
            print(f"the process died with {ended.returncode} in case {died}", flush=True)
            done = int(died.split()[1]) + 1 - asked.first
        else:
            done += count
        print(
            f"{done} cases, {sum(places.values())} failures, {time.perf_counter() - began:.0f} s", flush=True
        )
    for place, times in places.most_common():
        print(f"{times} times {place}")
    sys.exit(1 if places else 0)


if __name__ == "__main__":
    main()
