"""The played-through queue has the limits that it must: workers alone, the scheduler alone, no free lunch between."""

from __future__ import annotations

import pytest

from insgnss.errors import ConfigError
from insgnss.studies.campaign.scaling import Costs, scaling_table, throughput

COSTS = Costs(run_s=0.05, task_s=0.004, sent_bytes=1000.0, result_bytes=1400.0)


@pytest.mark.parametrize("workers", [1, 2, 50])
def test_few_workers_are_all_busy(workers: int) -> None:
    rate, load = throughput(1.0, 0.001, workers)

    assert rate == pytest.approx(workers, rel=0.03)
    assert load == pytest.approx(workers * 0.001, rel=0.03)


def test_many_workers_wait_for_the_scheduler() -> None:
    rate, load = throughput(1.0, 0.01, 1000)

    assert rate == pytest.approx(100.0, rel=0.02)
    assert load > 0.98


def test_table_names_the_bottleneck_and_larger_tasks_move_it() -> None:
    small = scaling_table(COSTS, 1_000_000, 10, [1, 100, 1000]).set_index("workers")
    large = scaling_table(COSTS, 1_000_000, 100, [1, 100, 1000]).set_index("workers")

    assert small.loc[1, "hours"] == pytest.approx(50_000.0 / 3600.0, rel=0.03)
    assert small.loc[100, "bottleneck"] == "workers"
    assert small.loc[1000, "bottleneck"] == "scheduler"
    assert large.loc[1000, "bottleneck"] == "workers"
    assert large.loc[1000, "efficiency"] > 0.9
    assert large.loc[1, "sent_mb"] == pytest.approx(10.0)
    assert large.loc[1, "result_gb"] == pytest.approx(1.4)
    with pytest.raises(ConfigError):
        scaling_table(COSTS, 0, 10, [1])
