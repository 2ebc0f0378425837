"""Duration of a campaign by number of workers: a simulated queue, the scheduler as one server, the workers as many.

Two numbers are measured on one machine, the seconds of a run on a worker and the seconds that scheduler and client
spend on a task; bytes are those of what travels and of what is written. Beyond the measured workers the queue is
simulated: a finished task waits until the scheduler is free, and its worker goes on with the next that it was sent
ahead.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import Final, NamedTuple

import pandas as pd

from insgnss.errors import ConfigError
from insgnss.studies.campaign.tasks import AHEAD

_PLAYED_TASKS: Final = 50  # a worker, at least: beyond, throughput does not change
_LEAST_TASKS: Final = 2000


class Costs(NamedTuple):
    """Costs of a campaign's runs and tasks."""

    run_s: float  # on a worker
    task_s: float  # of scheduler and client together, for one task
    sent_bytes: float  # to a worker and back, for one task
    result_bytes: float  # written, for one run


def scaling_table(costs: Costs, runs: int, runs_per_task: int, workers: Sequence[int]) -> pd.DataFrame:
    """Return, for each number of workers, the hours of a campaign and its bottleneck.

    Columns: workers hours efficiency (of the workers) scheduler_load sent_mb result_gb bottleneck

    Raises
    ------
    ConfigError : a number that is none
    """
    if runs < 1 or runs_per_task < 1 or min(workers) < 1 or not min(costs.run_s, costs.task_s) > 0.0:
        raise ConfigError("numbers of runs, workers and seconds must be above zero", key="costs")
    n_tasks = -(-runs // runs_per_task)
    rows = []
    for count in workers:
        rate, busy = throughput(costs.run_s * runs_per_task, costs.task_s, count)
        seconds = n_tasks / rate
        efficiency = runs * costs.run_s / (seconds * count)
        rows.append(
            {
                "workers": count,
                "hours": seconds / 3600.0,
                "efficiency": efficiency,
                "scheduler_load": busy,
                "sent_mb": n_tasks * costs.sent_bytes / 1e6,
                "result_gb": runs * costs.result_bytes / 1e9,
                "bottleneck": "scheduler" if busy > efficiency else "workers",
            }
        )
    return pd.DataFrame(rows)


def throughput(task_s: float, scheduler_s: float, workers: int) -> tuple[float, float]:
    """Return tasks per second and the scheduler's load, simulated from full queues on.

    Parameters
    ----------
    task_s : of a task on its worker
    scheduler_s : of the scheduler on a task
    """
    total = max(_LEAST_TASKS, _PLAYED_TASKS * workers)
    queued = [AHEAD - 1] * workers  # tasks sent ahead, besides the one that runs
    # as the workers started one after the other, the first tasks end spread over one task's time
    ends = [(task_s * (k + 1) / workers, k) for k in range(workers)]
    heapq.heapify(ends)
    free_s = busy_s = 0.0
    idle: dict[int, float] = {}
    for _ in range(total):
        end_s, worker = heapq.heappop(ends)
        free_s = max(free_s, end_s) + scheduler_s  # the report is taken, the next task sent
        busy_s += scheduler_s
        if queued[worker] > 0:
            heapq.heappush(ends, (end_s + task_s, worker))
            queued[worker] -= 1
        else:
            idle[worker] = end_s
        if worker in idle:
            heapq.heappush(ends, (free_s + task_s, worker))
            del idle[worker]
        else:
            queued[worker] += 1
    return total / free_s, busy_s / free_s
