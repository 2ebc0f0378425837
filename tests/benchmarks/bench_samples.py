"""Receivers on samples over a minute: ``python -m tests.benchmarks.bench_samples [--seeds 1 2 3]``.

60 s of eight GPS satellites at 4 MHz, made, rounded to int8, acquired, tracked and navigated with. Limits: less than
ten times real time on two cores for the aided and the unaided receiver together; the aided position within 10 m of the
truth at the scenario's C/N0 and with 10 dB less, where the unaided receiver must have lost its signals.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

import pandas as pd

from insgnss.runs.simulate import simulate
from insgnss.studies.samples.study import SampleStudy, sample_receiver

LIMIT_S = 600.0
LIMIT_M = 10.0
LEAST_LOST = 4  # of eight signals
SECONDS = 60.0


def flown(seed: int) -> SampleStudy:
    """Return the study of one seed."""
    return sample_receiver(simulate("steep_turns", seed, duration_s=SECONDS), duration_s=SECONDS, seed=seed)


def verdicts(summary: pd.DataFrame) -> dict[str, bool]:
    """Return what has to hold."""
    weak = summary["cn0_dbhz"] == summary["cn0_dbhz"].min()
    aided, unaided = (summary["receiver"] == name for name in ("aided", "unaided"))
    strong_unaided = summary[unaided & ~weak].iloc[0]
    weak_unaided = summary[unaided & weak].iloc[0]
    return {
        "aided within 10 m": bool((summary.loc[aided, "position_largest_m"] < LIMIT_M).all()),
        "aided keeps all signals": bool((summary.loc[aided, "on_signal_at_end"] == 8.0).all()),
        "unaided keeps them at the full C/N0": bool(strong_unaided["on_signal_at_end"] == 8.0),
        "unaided has lost them 10 dB below": bool(weak_unaided["on_signal_at_end"] <= 8.0 - LEAST_LOST),
    }


def main() -> int:
    """Print each seed's summary, the time and the verdicts; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    seeds = parser.parse_args().seeds
    pd.set_option("display.width", 160)
    failed = 0
    simulate("steep_turns", duration_s=1.0)
    for seed in seeds:
        began, cpu = time.perf_counter(), os.times()
        study = flown(seed)
        took_s, spent = time.perf_counter() - began, os.times()
        print(f"seed {seed}\n{study.summary.T.to_string()}")
        runs = len(study.summary) / 2.0  # both receivers of one C/N0 run at the same time
        print(
            f"{took_s / runs:.1f} s for each {SECONDS:.0f} s ({took_s / runs / SECONDS:.2f} times real time), ",
            end="",
        )
        print(f"{spent.user + spent.system - cpu.user - cpu.system:.1f} s of CPU in all")
        results = {"time": took_s / runs < LIMIT_S, **verdicts(study.summary)}
        for name, holds in results.items():
            print(f"{'holds' if holds else 'FAILS'}: {name}")
        failed += sum(not holds for holds in results.values())
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
