"""The campaign's runs, shared out among processes, and what they cost."""

from __future__ import annotations

import os
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context

from tests.benchmarks.trust.flying import fly
from tests.benchmarks.trust.live import stream
from tests.benchmarks.trust.measuring import Record, record_of
from tests.benchmarks.trust.rows import Row
from tests.benchmarks.trust.table import all_rows

Tell = Callable[[str, list[Record], int, int], None]
SEEDS_AT_ONCE = 4  # the truth of a scenario is computed once for them


@dataclass(frozen=True)
class Share:
    """Some seeds of one row: what goes to a process at once."""

    row: str
    seeds: tuple[int, ...]


def one(row: Row, seed: int) -> Record:
    """Return what is kept of one run; a run that raises is a record with its error."""
    start: Record = {"row": row.name, "seed": float(seed), "error": ""}
    began = time.process_time()
    try:
        with warnings.catch_warnings(record=True) as raised:
            warnings.simplefilter("always")
            found = stream(row, seed) if row.live else record_of(fly(row, seed))
        found["warnings"] = float(len(raised))
    except Exception as error:  # whatever a run does, the campaign goes on and says so
        found = {"error": "".join(traceback.format_exception_only(error)).strip()[:300]}
    return {**start, **found, "took_s": time.process_time() - began}


def run_share(share: Share) -> list[Record]:
    """Return the records of a share."""
    row = all_rows()[share.row]
    return [one(row, seed) for seed in share.seeds]


def seeds_of(row: Row, first: int, count: int) -> range:
    """Return the seeds of a row."""
    return range(first, first + count * row.times)


def shares(rows: Sequence[Row], first: int, count: int) -> list[Share]:
    """Return what is to be done: some seeds of every row, then further ones, so that a part of a campaign says much."""
    found = []
    for row in rows:
        seeds = tuple(seeds_of(row, first, count))
        parts = [seeds[k : k + SEEDS_AT_ONCE] for k in range(0, len(seeds), SEEDS_AT_ONCE)]
        found += [(number, Share(row.name, part)) for number, part in enumerate(parts)]
    return [share for _, share in sorted(found, key=lambda numbered: numbered[0])]


def run_rows(
    rows: Sequence[Row], first: int, count: int, workers: int, tell: Tell
) -> Mapping[str, list[Record]]:
    """Return the records of each row, in the order of their seeds."""
    found: dict[str, list[Record]] = {row.name: [] for row in rows}
    todo = shares(rows, first, count)
    for number, (share, records) in enumerate(_done(todo, workers), 1):
        found[share.row] += records
        tell(share.row, records, number, len(todo))
    return {name: sorted(runs, key=lambda record: float(record["seed"])) for name, runs in found.items()}


def _done(todo: Sequence[Share], workers: int) -> Iterator[tuple[Share, list[Record]]]:
    if workers <= 1:
        yield from ((share, run_share(share)) for share in todo)
        return
    run_share(Share(todo[0].row, todo[0].seeds[:1]))  # compiles, once for all
    left = list(todo)
    while left:
        for share, records in _in_pool(left, workers):
            left.remove(share)
            yield share, records
        # a process died, which none may: the runs of then are among the first, and each share gets a pool of its own
        for share in left[: 2 * workers]:
            left.remove(share)
            records = next(iter(_in_pool([share], 1)), (share, []))[1]
            yield share, records or [_died(share.row, seed) for seed in share.seeds]


def _in_pool(todo: Sequence[Share], workers: int) -> Iterator[tuple[Share, list[Record]]]:
    """Yield what gets done until all is done or a process dies."""
    # each process is started anew: the compiled loop's threads do not survive a fork
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(run_share, share): share for share in todo}
        for future in as_completed(futures):
            try:
                yield futures[future], future.result()
            except BrokenProcessPool:
                return


def _died(row: str, seed: int) -> Record:
    return {"row": row, "seed": float(seed), "error": "the process died", "took_s": 0.0}


def cores() -> int:
    """Return how many processes to use."""
    return max(1, min(8, os.cpu_count() or 1))
