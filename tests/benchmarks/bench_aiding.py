"""What the loop aiding adds to a replay: ``python -m tests.benchmarks.bench_aiding``.

One hour, an IMU of 200 Hz, 12 satellites, their aiding at 100 Hz: at most 30 % of the time of the replay without it,
from the call to the tables (4.3 million rows of aiding). What a row takes of memory, and what writing the run takes
with and without it, is shown beside.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
import resource
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import insgnss
from insgnss.constants import NS_PER_S
from insgnss.runs.result import Run
from insgnss.simulation.rinex_nav import write_rinex_navigation
from insgnss.simulation.sky import nominal_constellation
from tests.benchmarks.long_log import LongLog, start_ns, write_log

LIMIT = 0.30
RATE_HZ = 100.0
PLANES, PER_PLANE = 8, 4  # 12 of these stand above the horizon on average


def write_flight(log: LongLog, folder: Path) -> Path:
    """Write the log and messages of a constellation to aid: as many satellites in view as the log has."""
    path = write_log(log, folder)
    toe_ns = start_ns() + round(0.5 * log.duration_s) * NS_PER_S
    navigation = nominal_constellation(toe_ns, PLANES, PER_PLANE)
    write_rinex_navigation(folder / "nav.rnx", navigation, dt.datetime(2025, 1, 1, tzinfo=dt.UTC))
    text = path.read_text(encoding="utf-8")
    path.write_text(
        text.replace('files = ["gnss.csv"]', 'files = ["gnss.csv"]\nnavigation = ["nav.rnx"]'),
        encoding="utf-8",
    )
    return path


class Spent(NamedTuple):
    """CPU seconds; what the system takes to find fresh memory depends on the machine more than on the program."""

    user: float
    system: float

    @property
    def both(self) -> float:
        """Return the sum."""
        return self.user + self.system


def replayed(flight: Path, aiding: float | None) -> tuple[Run, Spent]:
    """Return a run and the CPU time from the call to the tables."""
    began = os.times()
    run = insgnss.replay(flight, aiding=aiding)
    ended = os.times()
    return run, Spent(ended.user - began.user, ended.system - began.system)


def ratio(flight: Path, repetitions: int) -> float:
    """Print and return what the aiding adds, relative to the replay without it."""
    replayed(flight, RATE_HZ)  # everything compiled
    plain, aided = [], []
    for _ in range(repetitions):  # in turns: both see the same load of the machine
        run, spent = replayed(flight, None)
        plain.append(spent)
        filter_s = run.settings["took"]["filter_s"]
        run, spent = replayed(flight, RATE_HZ)
        aided.append(spent)
    assert run.aiding is not None
    took = run.settings["took"]
    rows, size = len(run.aiding), run.aiding.memory_usage(index=False).sum()
    without, with_it = (min(every, key=lambda spent: spent.both) for every in (plain, aided))
    user = min(s.user for s in aided) / min(s.user for s in plain) - 1.0
    added = with_it.both / without.both - 1.0
    print(
        f"{rows} rows of aiding, {rows / run.aiding['time_s'].nunique():.1f} satellites at {RATE_HZ:g} Hz:"
        f" CPU user + system {without.user:.2f} + {without.system:.2f} s without, {with_it.user:.2f} +"
        f" {with_it.system:.2f} s with it: {100.0 * added:.0f} % more, {100.0 * user:.0f} % of the user's"
        f" (limit {100.0 * LIMIT:.0f} %)"
    )
    print(
        f"    last run: filter {filter_s:.2f} s without, {took['filter_s']:.2f} s with the trace, aiding"
        f" {took['aiding_s']:.2f} s; {size / rows:.0f} bytes a row, {size / 2**20:.0f} MiB;"
        f" peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB"
    )
    return added


def main() -> int:
    """Return 0 when the ratio is within the limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--gnss-hz", type=float, default=10.0)
    parser.add_argument("--repetitions", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        log = LongLog(options.hours, gnss_hz=options.gnss_hz, satellites=12)
        added = ratio(write_flight(log, Path(folder)), options.repetitions)
    return 0 if added <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main())
