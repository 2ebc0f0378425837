"""What a replay costs, whole and in parts: ``python -m tests.benchmarks.bench_replay``.

The command is run as users run it, in a process of its own, CSV in and Parquet out. Absolute times belong to the
machine; the CPU time tells what a busy machine hides. ``--limit PROGRAM`` times, in the same run, a program that
filters the same log without any of the surroundings: it is called as ``PROGRAM LOG.bin MODE REPETITIONS`` and its
output is shown beside ours.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from insgnss.config.library import filter_config
from insgnss.filter.whole_log import run_filter
from insgnss.kernels.jit import cache_root
from insgnss.log.flight import Flight, FlightLogs
from insgnss.runs.gnss_rows import corrected_rows
from insgnss.runs.result import Run
from insgnss.runs.setup import setup_filter
from tests.benchmarks.limit_log import write_limit_log
from tests.benchmarks.long_log import LongLog, write_log

REPOSITORY = Path(__file__).resolve().parents[2]
SAMPLE = REPOSITORY / "data" / "sample_flight" / "flight.toml"
MIB = 2**20
ON_LINUX_KIB = 1024  # ru_maxrss counts kibibytes there


@dataclass(frozen=True)
class Cost:
    """What one process took."""

    wall_s: float
    cpu_s: float
    peak_mib: float


# The peak of a process counts that of the one it was forked from: a small one stands between
_LAUNCHER = """
import json, resource, subprocess, sys, time
began = time.perf_counter()
code = subprocess.call(sys.argv[1:], stdout=subprocess.DEVNULL)
wall = time.perf_counter() - began
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([code, wall, used.ru_utime + used.ru_stime, used.ru_maxrss]))
"""


def command(flight: Path, output: Path, environment: Mapping[str, str] | None = None) -> Cost:
    """Return the cost of ``insgnss replay`` on a flight, processes that it starts included."""
    return process(
        "-m", "insgnss.cli", "replay", str(flight), "--output", str(output), environment=environment
    )


def process(*options: str, environment: Mapping[str, str] | None = None) -> Cost:
    """Return the cost of this Python with options, processes that it starts included."""
    arguments = [sys.executable, *options]
    done = subprocess.run(
        [sys.executable, "-S", "-c", _LAUNCHER, *arguments],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        env={**os.environ, **(environment or {})},
        check=True,
    )
    code, wall_s, cpu_s, peak_kib = json.loads(done.stdout)
    if code:
        raise SystemExit(f"{' '.join(arguments)} ended with {code}")
    return Cost(wall_s, cpu_s, peak_kib * ON_LINUX_KIB / MIB)


def best_command(flight: Path, output: Path, repetitions: int) -> Cost:
    """Return the least cost of several runs after one that fills the cache."""
    command(flight, output)
    costs = [command(flight, output) for _ in range(repetitions)]
    return Cost(min(c.wall_s for c in costs), min(c.cpu_s for c in costs), min(c.peak_mib for c in costs))


def whole_command(folder: Path, log: LongLog, repetitions: int) -> Cost:
    """Print and return the cost of the command on a log, with its split."""
    flight, output = folder / "flight.toml", folder / "out"
    cost = best_command(flight, output, repetitions)
    settings: dict[str, Any] = json.loads((output / "settings.json").read_text(encoding="utf-8"))
    took = settings["took"]
    size_in = sum(path.stat().st_size for path in Flight.load(flight).files()) / MIB
    size_out = sum(path.stat().st_size for path in output.iterdir()) / MIB
    print(
        f"command, {log.hours:g} h, {log.satellites} satellites at {log.gnss_hz:g} Hz: wall {cost.wall_s:.2f} s,"
        f" CPU {cost.cpu_s:.2f} s, peak {cost.peak_mib:.0f} MiB"
        f" (input {size_in:.0f} + output {size_out:.0f} + 200 = {size_in + size_out + 200:.0f})"
    )
    rest = cost.wall_s - sum(took.values())
    print(
        f"    last run: read and satellites {took['read_s']:.2f} s, filter {took['filter_s']:.2f} s,"
        f" tables {took['tables_s']:.2f} s; start, save and summary about {max(rest, 0.0):.2f} s"
    )
    return cost


def stages(flight: Path, output: Path) -> None:
    """Print the CPU time of each stage in this process, everything loaded."""
    laps = [("", time.process_time(), time.perf_counter())]

    def lap(name: str) -> None:
        laps.append((name, time.process_time(), time.perf_counter()))

    loaded = Flight.load(flight)
    logs = loaded.read()
    lap("read")
    setup = setup_filter(loaded, logs, filter_config("tight17"))
    rows, _ = corrected_rows(setup, logs, loaded)
    lap("rows")
    run_filter(setup, logs.imu, rows, "gnss")
    lap("filter")
    run = Run.load(output)
    lap("load")
    run.save(output)
    lap("save")
    text = ", ".join(f"{b[0]} {b[1] - a[1]:.2f} ({b[2] - a[2]:.2f})" for a, b in itertools.pairwise(laps))
    print(f"    stages, CPU s (wall s): {text}")


def filter_seconds(folder: Path, repetitions: int) -> tuple[float, FlightLogs]:
    """Return the CPU time of the compiled loop alone, the least of some runs, and the logs."""
    flight = Flight.load(folder / "flight.toml")
    logs = flight.read()
    setup = setup_filter(flight, logs, filter_config("tight17"))
    rows, _ = corrected_rows(setup, logs, flight)
    run_filter(setup, logs.imu, rows, "gnss")
    least = np.inf
    for _ in range(repetitions):
        began = time.process_time()
        run_filter(setup, logs.imu, rows, "gnss")
        least = min(least, time.process_time() - began)
    return float(least), logs


def loop(folder: Path, log: LongLog, repetitions: int, limit: Path | None, mode: str) -> float:
    """Print and return the time of the loop on a log; beside it that of the external program."""
    seconds, logs = filter_seconds(folder, repetitions)
    samples = len(logs.imu.t_ns)
    print(
        f"loop, {log.hours:g} h, {log.satellites} satellites at {log.gnss_hz:g} Hz: CPU {seconds:.3f} s,"
        f" {1e6 * seconds / samples:.3f} us per inertial sample"
    )
    if limit is not None:
        binary = folder / "log.bin"
        write_limit_log(binary, Flight.load(folder / "flight.toml"), logs)
        shown = subprocess.run(
            [str(limit), str(binary), mode, str(repetitions)], capture_output=True, text=True, check=True
        )
        print(f"    external program, mode {mode}: {shown.stdout.strip()}")
    return seconds


def starts(folder: Path, repetitions: int) -> None:
    """Print the time to the end of the sample flight with an empty cache and with a full one."""
    cache = folder / "cache"
    fresh = {"INSGNSS_CACHE": str(cache)}
    cold = command(SAMPLE, folder / "out", fresh)
    warm = [command(SAMPLE, folder / "out", fresh) for _ in range(repetitions)]
    print(f"sample flight, cold: wall {cold.wall_s:.1f} s, CPU {cold.cpu_s:.1f} s (limit 25 s)")
    print(
        f"sample flight, warm: wall {min(c.wall_s for c in warm):.2f} s,"
        f" CPU {min(c.cpu_s for c in warm):.2f} s (limit 2 s), peak {warm[0].peak_mib:.0f} MiB"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=Path, help="folder that keeps the logs between runs")
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--limit", type=Path, help="external program to time beside the loop")
    parser.add_argument("--mode", default="2:1:0", help="its second argument")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        base = options.logs or Path(temporary)
        long, short = LongLog(), LongLog(gnss_hz=1.0, satellites=12)
        logs = {"long": long, "twice": replace(long, hours=2.0), "short": short}
        for name, log in logs.items():
            if not (base / name / "flight.toml").exists():
                write_log(log, base / name)
        print(
            f"compiled code in {cache_root()}; load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
        )
        starts(Path(temporary), options.repetitions)
        one = whole_command(base / "long", long, options.repetitions)
        stages(base / "long" / "flight.toml", base / "long" / "out")
        two = whole_command(base / "twice", logs["twice"], options.repetitions)
        print(
            f"twice the log: {two.wall_s / one.wall_s / 2:.3f} of twice the wall time,"
            f" {two.cpu_s / one.cpu_s / 2:.3f} of the CPU time, {two.peak_mib - one.peak_mib:.0f} MiB more"
        )
        once = loop(base / "long", long, options.repetitions, options.limit, options.mode)
        twice = loop(base / "twice", logs["twice"], options.repetitions, None, options.mode)
        print(f"twice the log: {twice / once / 2:.3f} of twice the loop's CPU time")
        loop(base / "short", short, options.repetitions, options.limit, options.mode)
        own = resource.getrusage(resource.RUSAGE_SELF)
        print(f"(this process: {own.ru_maxrss * ON_LINUX_KIB / MIB:.0f} MiB at most)")


if __name__ == "__main__":
    main()
