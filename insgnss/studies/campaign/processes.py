"""A campaign's tasks in processes of this machine: what runs them where Dask is not installed."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context

from insgnss.kernels.compiled_ahead import usable_cores
from insgnss.studies.campaign.tasks import AHEAD, Task, TaskReport, run_task


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
                yield _report(task, pool.submit(run_task, task))


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
                yield _report(task, future)


def _report(task: Task, future: Future[TaskReport]) -> TaskReport:
    """Return what a process said of its task, or why it could not."""
    error = future.exception()
    if error is None:
        return future.result()
    return TaskReport(task.key, 0, 0, 0.0, f"{type(error).__name__}: {error}")
