"""What runs a campaign's tasks: processes of this machine, or Dask, embedded or on a cluster that runs elsewhere."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from multiprocessing import get_context
from typing import Any, Final

from insgnss.errors import ResultError
from insgnss.kernels.compiled_ahead import usable_cores
from insgnss.studies.campaign.tasks import AHEAD, Task, TaskReport, run_task

PATIENCE_S: Final = 10.0  # for a scheduler to answer
_RETRIES: Final = 3  # of a task whose worker died


def on_processes(tasks: Sequence[Task], workers: int | None) -> Iterator[TaskReport]:
    """Yield the report of each task as it is finished, in no order.

    When a process dies, the tasks that were in work run again, each in a process of its own; one that dies there too
    gives a report with the error.
    """
    waiting, count = deque(tasks), workers or usable_cores()
    while waiting:
        with _processes(min(count, len(waiting))) as pool:
            lost = yield from _until_one_dies(pool, waiting, AHEAD * count)
        for task in lost:
            with _processes(1) as pool:
                yield _report(task.key, pool.submit(run_task, task))


@contextmanager
def _processes(count: int) -> Iterator[ProcessPoolExecutor]:
    # a forked process would share the threads' locks of Numba and pyarrow
    pool = ProcessPoolExecutor(count, mp_context=get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _until_one_dies(
    pool: ProcessPoolExecutor, waiting: deque[Task], ahead: int
) -> Generator[TaskReport, None, list[Task]]:
    """Yield reports and take tasks from the left of ``waiting``; return those in work when a process died."""
    running: dict[Future[TaskReport], Task] = {}
    lost: list[Task] = []
    while True:
        while waiting and not lost and len(running) < ahead:
            try:
                running[pool.submit(run_task, waiting[0])] = waiting[0]
            except BrokenProcessPool:
                lost.append(waiting.popleft())
            else:
                waiting.popleft()
        if not running:
            return lost
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            task = running.pop(future)
            if isinstance(future.exception(), BrokenProcessPool):
                lost.append(task)
            else:
                yield _report(task.key, future)


def _report(key: str, future: Any) -> TaskReport:  # of this machine or of Dask
    """Return what a worker said of its task, or why none could."""
    error = future.exception()
    if error is not None:
        return TaskReport(key, 0, 0, 0.0, f"{type(error).__name__}: {error}")
    report: TaskReport = future.result()
    return report


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
            report = _report(str(future.key).removeprefix("insgnss-"), future)
            future.release()  # the scheduler forgets the task either way
            yield report
            following = next(waiting, None)
            if following is not None:
                running.add(_submit(client, following))


def is_installed() -> bool:
    """Return whether Dask is installed."""
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
