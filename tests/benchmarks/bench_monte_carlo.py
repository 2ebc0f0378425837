"""What a run of the Monte Carlo costs, and what a second core brings: ``python -m tests.benchmarks.bench_monte_carlo``.

20 minutes, an IMU of 100 Hz, 11 satellites at 1 Hz. The efficiency is (time of one thread) / (n x time of n threads).
"""

from __future__ import annotations

import argparse
import os
import sys
import time

from insgnss.studies import MatchedFlight, monte_carlo

LEAST_EFFICIENCY = 0.85


def seconds(flight: MatchedFlight, runs: int, threads: int) -> float:
    """Return the wall time of a Monte Carlo."""
    began = time.perf_counter()
    monte_carlo(flight, runs, threads=threads)
    return time.perf_counter() - began


def main() -> int:
    """Return 0 when the cores are put to use."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    options = parser.parse_args()
    flight = MatchedFlight.of("tactical", duration_s=1200.0)
    seconds(flight, 2, 1)  # compiles
    one = min(seconds(flight, options.runs, 1) for _ in range(3))
    several = min(seconds(flight, options.runs, options.threads) for _ in range(3))
    efficiency = one / (options.threads * several)
    print(f"{one / options.runs * 1e3:.0f} ms a run; {options.threads} threads: efficiency {efficiency:.2f}")
    return 0 if efficiency >= LEAST_EFFICIENCY else 1


if __name__ == "__main__":
    sys.exit(main())
