"""``insgnss consistency``: whether a run's filter is consistent, and what to change if it is not."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Annotated

import typer

from insgnss.cli.command import at_least
from insgnss.cli.file_options import Force, Pictures, SavedRun, StudyFolder, check_files, run_files, tell_end
from insgnss.cli.printing import AsJson, print_json, records, result_console, text_table
from insgnss.cli.progress import telling
from insgnss.constants import S_PER_WEEK
from insgnss.results.saving import STUDY_KIND, overwriting

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table


def consistency(
    run: SavedRun,
    output: StudyFolder = None,
    confidence: Annotated[
        float, typer.Option("--confidence", help="Probability that a consistent filter is within each bound.")
    ] = 0.99,
    lags: Annotated[
        int, typer.Option("--lags", min=1, help="Number of lags of the autocorrelation, in epochs.")
    ] = 20,
    start: Annotated[
        float | None,
        typer.Option(
            "--from",
            callback=at_least(0.0, 2.0 * S_PER_WEEK),
            help="Start time in seconds of the week; by default when the heading becomes known.",
        ),
    ] = None,
    pictures: Pictures = True,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Test innovations, errors and sigmas of a run against each other, and state the result in words."""
    began = time.perf_counter()
    with overwriting(force, run_files(run), output):
        from insgnss.studies.consistency.study import Consistency, consistency_study

        check_files(output, Consistency.files(), STUDY_KIND)
        with telling("studying the run"):
            study = consistency_study(run, confidence=confidence, lags=lags, from_s=start)
            if output is not None:
                study.save(output, pictures=pictures)
    if as_json:
        tables = {"kinds": records(study.kinds), "states": records(study.states)}
        results = {"from_s": study.asked["from_s"], **tables, "verdict": list(study.verdict)}
        print_json({**results, "wrote": output})
        return
    console = result_console()
    console.print(_table("innovations", "kind", study.kinds, ("used", "refused", "mean_nis", "low", "high",
                                                              "share_95", "factor")))  # fmt: skip
    if not study.states.empty:
        console.print(_table("errors against the reference", "component", study.states,
                             ("rms", "mean_sigma", "nees", "low", "high")))  # fmt: skip
    for sentence in study.verdict:
        console.print(f"- {sentence}", highlight=False, markup=False, soft_wrap=True)
    tell_end(began, output, f"from {study.asked['from_s']:.1f} s on; ")


def _table(title: str, key: str, values: pd.DataFrame, columns: tuple[str, ...]) -> Table:
    rows = ((str(row[key]), *(number_cell(row[c]) for c in columns)) for row in values.to_dict("records"))
    return text_table(title, (key, *columns), rows, left=(key,))


def number_cell(number: float) -> str:
    """Return a number as a table shows it: a count with all its digits, a missing one as an empty cell."""
    if math.isnan(number):
        return ""
    return f"{number:.0f}" if float(number).is_integer() else f"{number:.4g}"
