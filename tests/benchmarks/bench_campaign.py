"""What a campaign costs on one and two workers, and a million runs: ``python -m tests.benchmarks.bench_campaign``.

Measured on this machine: seconds of a run on one worker and on two; what scheduler and client spend on a task that does
nothing; bytes of a task and of a run's result. From there on the queue is played through (``campaign_scaling``).
"""

from __future__ import annotations

import argparse
import pickle
import tempfile
import time
from pathlib import Path

from insgnss.studies.campaign.scaling import Costs, scaling_table
from insgnss.studies.campaign.study import CampaignConfig, run_campaign
from insgnss.studies.campaign.tasks import RESULTS, Task

RUNS = 1_000_000
WORKERS = (1, 2, 16, 100, 400, 1000)


def idle(case: object, seed: int) -> list[dict[str, float]]:
    """Return a row at once: what is left is the scheduler."""
    return [{"seed_again": float(seed)}]


def campaign(case: str, seeds: int, per_task: int) -> CampaignConfig:
    """Return runs of 20 minutes of the matched flight, or of nothing."""
    fixed = {"duration_s": 1200.0} if case == "matched" else {}
    return CampaignConfig(name="costs", case=case, seeds=seeds, seeds_per_task=per_task, fixed=fixed)


def seconds(config: CampaignConfig, workers: int) -> tuple[float, float]:
    """Return seconds from the first task's report to the last's, and bytes of a run's result."""
    told: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        run_campaign(config, folder, workers=workers, report=lambda *_: told.append(time.perf_counter()))
        written = sum(path.stat().st_size for path in (Path(folder) / RESULTS).glob("*.parquet"))
    return (told[-1] - told[workers - 1]) / (len(told) - workers), written / config.n_runs


def main() -> None:
    """Print what was measured and the plan."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=16)
    parser.add_argument("--runs-per-task", type=int, default=10)
    options = parser.parse_args()
    runs = campaign("matched", options.tasks * options.runs_per_task, options.runs_per_task)
    one, result_bytes = seconds(runs, 1)
    two, _ = seconds(runs, 2)
    nothing, _ = seconds(campaign("tests.benchmarks.bench_campaign:idle", 400, 1), 2)
    task = Task("0-0", "matched", 0, {"duration_s": 1200.0}, tuple(range(options.runs_per_task)), "folder")
    costs = Costs(one / options.runs_per_task, nothing, 2.0 * len(pickle.dumps(task)), result_bytes)
    print(
        f"one worker {1e3 * costs.run_s:.0f} ms a run, two {1e3 * two / options.runs_per_task:.0f} ms:"
        f" efficiency {one / (2.0 * two):.2f}; scheduler and client {1e3 * nothing:.1f} ms a task;"
        f" {costs.sent_bytes:.0f} bytes a task sent, {result_bytes:.0f} bytes a run written"
    )
    print(scaling_table(costs, RUNS, options.runs_per_task, WORKERS).to_string(index=False))


if __name__ == "__main__":
    main()
