"""How a study's tables, settings and pictures become files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeAlias

import pandas as pd

from insgnss.results.saving import STUDY_KIND, saving, writing

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

MOMENT_DECIMALS: Final = 6  # of moments in seconds
StudyContent: TypeAlias = (
    "pd.DataFrame | str | Callable[[], Figure]"  # of CSV, JSON or PNG; how to draw a picture
)


def write_study(folder: str | Path, files: Mapping[str, StudyContent], *, draws: bool) -> Path:
    """Write what each file of a study holds into ``folder``, all at once or none; return the folder.

    Pictures of an earlier study go where ``draws`` is not set. A command hands the names of the files to
    ``check_replaceable`` before the study begins.

    Raises
    ------
    ResultError : the folder cannot be written, a file of somebody else has one of the names, or matplotlib is not
        installed
    """
    path = Path(folder)
    with writing("the study", path), saving(path, files, STUDY_KIND) as new:
        for name, content in files.items():
            if isinstance(content, pd.DataFrame):
                content.to_csv(new / name, index=False, float_format="%.10g")
            elif isinstance(content, str):
                (new / name).write_text(content, encoding="utf-8")
            elif draws:
                content().savefig(new / name, dpi=120)
    return path
