"""How fast receivers in closed loops are, against their targets: ``python -m tests.benchmarks.bench_receivers``.

One stage with 17 states, 8 channels and integrations of 1 ms on one core: 20 times real time at least. 40 runs of 220 s
of five receivers, integrations of 5 ms, on two cores: 60 s at most.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from insgnss.studies import RECEIVERS, ReceiverOptions
from insgnss.studies.receiver.runs import Setting, run_many
from insgnss.studies.receiver.scene import scene_of
from insgnss.studies.receiver.variants import USUAL_VARIANTS

LEAST_TIMES_REAL_TIME, MOST_S = 20.0, 60.0
ROUNDS, RUNS, THREADS = 3, 40, 2
MILLISECOND_S, STUDY_S = 30.0, 220.0  # durations of the two measurements


def setting(scenario: str, duration_s: float, step_s: float) -> Setting:
    """Return a setting with phase tracking, "industrial" and "tcxo"."""
    options = ReceiverOptions(duration_s=duration_s, settle_s=5.0, average_s=5.0, step_s=step_s)
    return scene_of(scenario, "coherent", "industrial", "tcxo", options).setting


def seconds(of: Setting, name: str, runs: int, threads: int) -> float:
    """Return the wall time of runs at 40 dBHz."""
    began = time.perf_counter()
    run_many(of, RECEIVERS[name], np.asarray(40.0), runs, 1, threads)
    return time.perf_counter() - began


def main() -> int:
    """Return 0 when both targets are met."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    runs = parser.parse_args().runs
    short, long = (
        setting("manoeuvring_5g", MILLISECOND_S, 1e-3),
        setting("manoeuvring_5g_long", STUDY_S, 5e-3),
    )
    for of in (short, long):  # compile, and tabulate discriminators
        for name in USUAL_VARIANTS:
            seconds(of, name, 1, 1)
    fastest = MILLISECOND_S / min(seconds(short, "one_stage", 1, 1) for _ in range(ROUNDS))
    began = time.process_time()
    each = {name: seconds(long, name, runs, THREADS) for name in USUAL_VARIANTS}
    cpu_s = (time.process_time() - began) * RUNS / runs
    total_s = sum(each.values()) * RUNS / runs
    print(f"one stage, 8 channels, 17 states, 1 ms, one core: {fastest:.0f} times real time")
    shares = ", ".join(f"{name} {wall_s * RUNS / runs:.1f}" for name, wall_s in each.items())
    print(
        f"{RUNS} runs of {STUDY_S:g} s of five receivers, two cores: {total_s:.0f} s, {cpu_s:.0f} s of CPU ({shares})"
    )
    return 0 if fastest >= LEAST_TIMES_REAL_TIME and total_s <= MOST_S else 1


if __name__ == "__main__":
    sys.exit(main())
