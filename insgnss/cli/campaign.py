"""``insgnss campaign``: runs a grid of cases and seeds on many workers, goes on where it was, and sums up."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from insgnss.cli.option_values import names_in
from insgnss.cli.printing import AsJson, print_json, records, result_console, text_table
from insgnss.cli.progress import counting
from insgnss.errors import ResultError

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from insgnss.studies.campaign.study import CampaignConfig, CampaignDone

_SHOWN = ("n", "mean", "sd", "p05", "p50", "p95", "max")
_FAILURES_SHOWN = 5


def campaign(
    campaign: Annotated[str, typer.Argument(help="A campaign file (.toml), or a name in models/campaigns.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", help="Folder of the results; an unfinished campaign in it is resumed."
        ),
    ],
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers", help="Processes on this machine; by default one per core; 0: this process only."
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            "--scheduler",
            help="Address of a running Dask scheduler, such as tcp://host:8786 (needs the extra 'campaign').",
        ),
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Also repeat the tasks in which a run failed.")
    ] = False,
    by: Annotated[
        str, typer.Option("--by", help="Columns by which the summary is grouped, such as case,way.")
    ] = "case",
    as_json: AsJson = False,
) -> None:
    """Run or resume a campaign, write one Parquet file per task, and print a summary of all results."""
    began = time.perf_counter()
    from insgnss.studies.campaign.columns import require_columns
    from insgnss.studies.campaign.results import failures, summary, with_parameters
    from insgnss.studies.campaign.study import load_campaign

    config = load_campaign(campaign)
    columns = names_in(by)
    require_columns(config, output, columns)
    done = _run(config, output, workers, scheduler, columns, retry_failed=retry_failed)
    console = result_console(140)
    table = with_parameters(summary(output, columns), config)
    failed = failures(output)
    if as_json:
        answer: dict[str, Any] = {
            "runs": done.n_runs,
            "cases": config.n_cases,
            "tasks": done.n_tasks,
            "tasks_found": done.n_found,
        }
        answer |= {"failed": len(failed), "lost": len(done.lost), "summary": records(table)}
        print_json({**answer, "failures": records(failed.head(_FAILURES_SHOWN)), "wrote": output})
        _end(done)
        return
    if not table.empty:
        console.print(_table(table))
    for row in failed.head(_FAILURES_SHOWN).to_dict("records"):
        text = f"case {row['case']}, seed {row['seed']} failed: {row['error']}"
        console.print(text, highlight=False, markup=False, soft_wrap=True)
    reused = f", {done.n_found} of {done.n_tasks} tasks were there" if done.n_found else ""
    typer.echo(
        f"{done.n_runs} runs of {config.n_cases} cases{reused}; {len(failed)} failed in all; wrote {output};"
        f" {time.perf_counter() - began:.2f} s in all"
    )
    _end(done)


def _end(done: CampaignDone) -> None:
    """End with the code of a result where tasks were lost."""
    if done.lost:
        typer.echo(f"{len(done.lost)} tasks were lost with their workers: run the command again", err=True)
        raise typer.Exit(ResultError.exit_code)


def _run(
    config: CampaignConfig,
    output: Path,
    workers: int | None,
    scheduler: str | None,
    columns: Sequence[str],
    *,
    retry_failed: bool,
) -> CampaignDone:
    """Run the campaign behind a progress bar; refuse ``columns`` that its first results do not have.

    Raises
    ------
    ConfigError : there is one
    """
    from insgnss.studies.campaign.columns import require_columns
    from insgnss.studies.campaign.study import run_campaign
    from insgnss.studies.campaign.tasks import TaskReport

    with counting() as bar:
        shown = bar.add_task(f"{config.name}: tasks", total=None)

        known = False

        def tell(report: TaskReport, done: int, total: int) -> None:
            nonlocal known
            known = known or require_columns(config, output, columns)
            bar.update(shown, completed=done, total=total)
            if report.error:
                bar.console.print(f"{report.key}: {report.error}", highlight=False, markup=False)

        return run_campaign(
            config, output, workers=workers, scheduler=scheduler, retry_failed=retry_failed, report=tell
        )


def _table(summary: pd.DataFrame) -> Table:
    shown = [name for name in _SHOWN if name in summary]
    groups = [name for name in summary.columns[: list(summary.columns).index("column") + 1]]
    rows = (
        (
            *(str(row[name]) for name in groups),
            *("" if row[name] != row[name] else f"{row[name]:.4g}" for name in shown),
        )
        for row in summary.to_dict("records")
    )
    return text_table(None, (*groups, *shown), rows, left=groups)
