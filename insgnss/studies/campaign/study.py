"""Campaigns: a grid of cases times seeds, run on as many workers as there are, and resumable at any moment.

A campaign file::

    name = "grades"
    case = "matched"            # a name in ``cases.CASES``, or "package.module:function"
    seeds = 500                 # 0 .. 499; or a list
    seeds_per_task = 25         # runs that go to a worker at once, and into one file
    [fixed]                     # the same in every case
    duration_s = 120
    [grid]                      # every combination
    imu = ["tactical", "industrial"]
    noise_factor = [1.0, 1.4]

A case function takes (case, seed) and returns rows: it is pure, so that a result does not depend on where, when and
beside what it was computed. A task writes its own file into ``results/`` of the folder, under another name until it is
whole: what is there is done, and a campaign that was killed goes on where it was. A case that raises becomes a row with
its error. With workers on other machines the folder must be one that all of them see.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field

from insgnss.config.library import file_of
from insgnss.config.strict import StrictModel, load_toml
from insgnss.errors import ConfigError, ResultError
from insgnss.results.record import entries_in
from insgnss.results.saving import CAMPAIGN_KIND, check_writable, write_file
from insgnss.results.shown import ResultDisplay
from insgnss.studies.campaign import task_runners
from insgnss.studies.campaign.cases import require_used
from insgnss.studies.campaign.tasks import CAMPAIGN_FILE, RESULTS, Task, TaskReport, case_function, run_task

Value = bool | int | float | str
_MOST_RUNS: Final = 100_000_000  # more is a mistake in the file
Report = Callable[[TaskReport, int, int], None]


class CampaignConfig(StrictModel):
    """A campaign file."""

    lists_keys = "every key with its meaning: docs/campaign-file.md"

    name: str
    case: str = Field(
        description="'matched', 'outage', 'masking', 'receiver', or a function of your own, 'package.module:function'"
    )
    seeds: Annotated[int, Field(ge=1, le=_MOST_RUNS)] | tuple[Annotated[int, Field(ge=0)], ...]
    seeds_per_task: Annotated[int, Field(ge=1, le=_MOST_RUNS)] = 10
    fixed: dict[str, Value] = Field(default_factory=dict)
    grid: dict[str, Annotated[tuple[Value, ...], Field(min_length=1)]] = Field(default_factory=dict)

    @property
    def seed_list(self) -> tuple[int, ...]:
        """The seeds of every case."""
        return tuple(range(self.seeds)) if isinstance(self.seeds, int) else self.seeds

    def cases(self) -> Iterator[dict[str, Value]]:
        """Yield every case: the fixed values and one combination of the grid's, the last key running fastest."""
        for values in itertools.product(*self.grid.values()):
            yield {**self.fixed, **dict(zip(self.grid, values, strict=True))}

    @property
    def n_cases(self) -> int:
        """How many cases there are."""
        count = 1
        for values in self.grid.values():
            count *= len(values)
        return count

    @property
    def n_runs(self) -> int:
        """How many runs there are: cases times seeds."""
        return self.n_cases * len(self.seed_list)


@dataclass(frozen=True, repr=False)
class CampaignDone(ResultDisplay):
    """Outcome of a campaign: its folder, runs, those found done and those that failed."""

    folder: Path
    n_tasks: int
    n_found: int  # tasks that were there already
    n_runs: int  # of the tasks done now
    n_failed: int  # of those
    lost: tuple[str, ...]  # tasks that no worker could finish: run the campaign again


def load_campaign(path: str | Path) -> CampaignConfig:
    """Read and check a campaign file (a path ending in .toml), or one of ``models/campaigns`` by its name.

    Raises
    ------
    MissingFileError, ConfigError : there is no such file; it does not fit, or names no case function
    ModelError : the library has no campaign of this name
    """
    path = file_of("campaigns", path)
    config = load_toml(path, CampaignConfig)
    both = sorted(set(config.fixed) & set(config.grid))
    if both:
        raise ConfigError(f"{both[0]!r} is fixed and in the grid", file=path, key=both[0], advice="keep one")
    if config.n_runs > _MOST_RUNS:
        raise ConfigError(f"{config.n_runs} runs are too many", file=path, key="grid", advice="thin it out")
    case_function(config.case)
    return config


def tasks_of(config: CampaignConfig, folder: Path) -> list[Task]:
    """Return the tasks of a campaign, each some seeds of one case; a task's key names the file it writes."""
    seeds, size = config.seed_list, config.seeds_per_task
    tasks = []
    for number, case in enumerate(config.cases()):
        for first in range(0, len(seeds), size):
            part = seeds[first : first + size]
            key = f"case-{number:05d}_part-{first // size:05d}"
            tasks.append(Task(key, config.case, number, case, part, str(folder)))
    return tasks


def prepare(
    config: CampaignConfig, folder: str | Path, *, retry_failed: bool = False
) -> tuple[Path, list[Task]]:
    """Make or recognise a campaign's folder; return it and the tasks that are still to be done.

    Parameters
    ----------
    retry_failed : tasks with a failed run count as not done

    Raises
    ------
    ResultError : the folder holds another campaign, or cannot be written
    """
    path = Path(folder).absolute()
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError as error:
        raise ResultError(
            "the folder's name is not UTF-8, which Parquet data sets need",
            file=path,
            advice="give another --output",
        ) from error
    stamp = _stamp(config)
    _require_own_folder(path)
    try:
        (path / RESULTS).mkdir(parents=True, exist_ok=True)
        settings_file = path / CAMPAIGN_FILE
        if not settings_file.exists():
            write_file(settings_file, json.dumps(stamp, indent=1).encode(), CAMPAIGN_KIND)
        elif _hash_in(settings_file) != stamp["hash"]:
            raise ResultError(
                "the folder holds the results of another campaign",
                file=path,
                advice="give another --output, or the campaign file of these results",
            )
    except OSError as error:
        advice = "give another --output folder"
        raise ResultError(f"cannot be written: {error.strerror}", file=path, advice=advice) from error
    tasks = tasks_of(config, path)
    return path, [task for task in tasks if not task.is_done(retry_failed=retry_failed)]


def _require_own_folder(path: Path) -> None:
    """Refuse a folder in which a campaign would stand beside another result, or write among the user's files.

    Raises
    ------
    ResultError : it holds another result, or a folder of results that no campaign wrote; or it cannot be made
    """
    check_writable(path)
    advice = "give another --output"
    others = sorted({entry.get("kind", "result") for entry in entries_in(path).values()} - {CAMPAIGN_KIND})
    if others:
        raise ResultError(f"the folder holds another result ({others[0]})", file=path, advice=advice)
    results = path / RESULTS
    if not (path / CAMPAIGN_FILE).exists() and results.is_dir() and any(results.iterdir()):
        raise ResultError("the folder holds files that no campaign wrote", file=results, advice=advice)


def _hash_in(path: Path) -> str:
    """Return of which campaign a folder's results are."""
    try:
        return str(json.loads(path.read_text(encoding="utf-8"))["hash"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        advice = "give another --output; if the results are of this campaign, remove the file"
        raise ResultError(f"the file is damaged: {error}", file=path, advice=advice) from error


def _stamp(config: CampaignConfig) -> Mapping[str, Any]:
    """Return what a folder's results are of; how they were cut into tasks is part of it."""
    content = config.model_dump(mode="json")
    text = json.dumps(content, sort_keys=True)
    return {"hash": hashlib.sha256(text.encode()).hexdigest(), "campaign": content}


def run_campaign(
    config: CampaignConfig | str | Path,
    folder: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    retry_failed: bool = False,
    report: Report | None = None,
) -> CampaignDone:
    """Run a campaign, or the remainder of it.

    A script that calls this with workers must do so under ``if __name__ == "__main__"``: its workers are
    processes that import it.

    Parameters
    ----------
    config : the campaign or its file
    folder : of the results, made if needed
    workers : processes of this machine, under Dask where it is installed; 0: one run after the other in this process;
        None: one a core
    scheduler : address of a running cluster's, "tcp://host:8786"; then ``workers`` does not count
    retry_failed : also run the tasks again in which a run failed
    report : is called for each finished task with the numbers of tasks done and in total

    Raises
    ------
    ConfigError, ResultError : as ``load_campaign`` and ``prepare``; ConfigError too where receivers have an option
        that no case uses or there are fewer workers than none, ResultError where a scheduler is given and Dask is not
        installed
    """
    config = config if isinstance(config, CampaignConfig) else load_campaign(config)
    if workers is not None and workers < 0:
        advice = "give 1 or more; 0: this process only; left out: one per core"
        raise ConfigError(f"invalid number of workers {workers}", key="workers", advice=advice)
    require_used(config.case, config.cases())
    path, left = prepare(config, folder, retry_failed=retry_failed)
    n_tasks = len(tasks_of(config, path))
    tell = report or (lambda *_: None)
    n_runs = n_failed = done = 0
    finished: set[str] = set()
    for task_report in _reports(left, workers, scheduler):
        done += 1
        if task_report.error:
            tell(task_report, n_tasks - len(left) + done, n_tasks)
            continue
        finished.add(task_report.key)
        n_runs, n_failed = n_runs + task_report.n_runs, n_failed + task_report.n_failed
        tell(task_report, n_tasks - len(left) + done, n_tasks)
    lost = tuple(task.key for task in left if task.key not in finished)
    return CampaignDone(path, n_tasks, n_tasks - len(left), n_runs, n_failed, lost)


def _reports(tasks: list[Task], workers: int | None, scheduler: str | None) -> Iterator[TaskReport]:
    if workers == 0 and scheduler is None:
        return (run_task(task) for task in tasks)
    if not tasks:
        return iter(())
    if scheduler is None and not task_runners.is_installed():
        return task_runners.on_processes(tasks, workers)
    return task_runners.on_cluster(tasks, workers, scheduler)
