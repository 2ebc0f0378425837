"""A campaign's tasks on Dask: an embedded cluster of this machine's cores, or one that is running elsewhere."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from typing import Any, Final

from insgnss.errors import ResultError
from insgnss.kernels.compiled_ahead import usable_cores
from insgnss.studies.campaign.tasks import AHEAD, Task, TaskReport, run_task

PATIENCE_S: Final = 10.0  # for a scheduler to answer
_RETRIES: Final = 3  # of a task whose worker died


def on_cluster(tasks: Sequence[Task], workers: int | None, scheduler: str | None) -> Iterator[TaskReport]:
    """Yield the report of each task as it is finished, in no order.

    A task whose workers keep dying, or that cannot be written, gives a report with the error.

    Raises
    ------
    ResultError : Dask is not installed, or the scheduler does not answer
    """
    dask = _dask()
    with ExitStack() as stack:
        if scheduler is None:
            count = workers or usable_cores()
            # a worker that died shows in the results; one that is slow to end on a busy machine does not; a second
            # campaign at the same time must not want the same port for its pages
            quiet = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.ERROR}
            cluster = stack.enter_context(dask.LocalCluster(n_workers=count, threads_per_worker=1, **quiet))
            client = stack.enter_context(dask.Client(cluster))
        else:
            client = stack.enter_context(_connected(dask.Client, scheduler))
            count = max(len(client.scheduler_info()["workers"]), 1)
        waiting = iter(tasks)
        running = dask.as_completed([])
        for _, task in zip(range(AHEAD * count), waiting, strict=False):
            running.add(_submit(client, task))
        for future in running:
            yield _report(future)
            following = next(waiting, None)
            if following is not None:
                running.add(_submit(client, following))


def is_installed() -> bool:
    """Return whether Dask is there."""
    return find_spec("distributed") is not None


def _dask() -> Any:  # its calls are not typed
    try:
        import distributed
    except ImportError as error:
        raise ResultError(
            "a campaign on a cluster needs Dask, which is not installed",
            advice="pip install 'insgnss[campaign]', or leave the scheduler out: this machine's cores need no Dask",
        ) from error
    return distributed


def _connected(client: Any, scheduler: str) -> Any:
    try:
        return client(scheduler, timeout=f"{PATIENCE_S} s")
    except (OSError, TimeoutError, ValueError) as error:
        raise ResultError(
            f"no scheduler answers at {scheduler}",
            advice="start one with 'dask scheduler', workers with 'dask worker ADDRESS', and give its address",
        ) from error


def _submit(client: Any, task: Task) -> Any:
    return client.submit(run_task, task, key=f"insgnss-{task.key}", pure=False, retries=_RETRIES)


def _report(future: Any) -> TaskReport:
    """Return what a worker said, or why none could; the scheduler forgets the task either way."""
    error = future.exception()
    if error is None:
        report: TaskReport = future.result()
    else:
        report = TaskReport(
            str(future.key).removeprefix("insgnss-"), 0, 0, 0.0, f"{type(error).__name__}: {error}"
        )
    future.release()
    return report
