"""How a study's tables, settings and pictures become files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pandas as pd

from insgnss.results.saving import saving, writing

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

MOMENT_DECIMALS: Final = 6  # of moments in seconds


def write_study(
    folder: str | Path,
    tables: Mapping[str, pd.DataFrame],
    settings: Mapping[str, str],
    pictures: Mapping[str, Callable[[], Figure]],
    *,
    draws: bool,
) -> Path:
    """Write each table as CSV, each text of settings as JSON and each picture as PNG into ``folder``; return it.

    All files by their names, all at once or none. Pictures of an earlier study go where ``draws`` is not set.

    Raises
    ------
    ResultError : the folder cannot be written, a file of somebody else has one of the names, or matplotlib is not
        installed
    """
    path = Path(folder)
    names = [*(f"{name}.csv" for name in tables), *(f"{name}.json" for name in settings)]
    names += [f"{name}.png" for name in pictures]
    with writing("the study", path), saving(path, names, "study") as new:
        for name, table in tables.items():
            table.to_csv(new / f"{name}.csv", index=False, float_format="%.10g")
        for name, text in settings.items():
            (new / f"{name}.json").write_text(text, encoding="utf-8")
        for name, draw in pictures.items() if draws else ():
            draw().savefig(new / f"{name}.png", dpi=120)
    return path
