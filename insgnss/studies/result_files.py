"""How a study's tables, settings and pictures become files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from insgnss.errors import ResultError

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure


def write_tables(folder: str | Path, tables: Mapping[str, pd.DataFrame], settings: Mapping[str, str]) -> Path:
    """Write each table as CSV and each text of settings as JSON, by their names, into ``folder``; return it.

    Raises
    ------
    ResultError : the folder cannot be written
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            table.to_csv(path / f"{name}.csv", index=False, float_format="%.10g")
        for name, text in settings.items():
            (path / f"{name}.json").write_text(text, encoding="utf-8")
    except OSError as error:
        raise _not_written(path, error) from error
    return path


def write_figures(folder: Path, pictures: Mapping[str, Callable[[], Figure]]) -> list[Path]:
    """Draw each picture and write it as PNG, by its name, into ``folder``, which exists; return the files.

    Raises
    ------
    ResultError : a file cannot be written
    """
    paths = []
    for name, draw in pictures.items():
        paths.append(folder / f"{name}.png")
        try:
            draw().savefig(paths[-1], dpi=120)
        except OSError as error:
            raise _not_written(folder, error) from error
    return paths


def _not_written(folder: Path, error: OSError) -> ResultError:
    return ResultError(
        f"the study cannot be written: {error.strerror}", file=folder, advice="give another folder"
    )
