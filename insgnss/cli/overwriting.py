"""``--force``, and which files a command reads: those it never replaces."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from insgnss.results.saving import check_replaceable

Force: TypeAlias = Annotated[
    bool, typer.Option("--force", help="Replace files that this program did not write, or that were changed.")
]


def run_files(*runs: Path | None) -> list[Path]:
    """Return the files that saved runs may be made of, and any other source as it is."""
    from insgnss.runs.result import FILES  # with pandas, late

    return [path for run in runs if run is not None for path in (run, *(run / name for name in FILES))]


def check_files(output: Path | None, names: Iterable[str], kind: str) -> None:
    """Refuse an output folder in which a file of another program has one of the names; None: nothing is written.

    Raises
    ------
    ResultError : there is such a file, or nothing can be written there
    """
    if output is not None:
        check_replaceable(output, names, kind)
