"""How a study's tables, settings and pictures become files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import pandas as pd

from insgnss.results.saving import STUDY_KIND, saving, writing
from insgnss.results.shown import ResultDisplay

if TYPE_CHECKING:
    from insgnss.studies.figures import Figure

MOMENT_DECIMALS: Final = 6  # of moments in seconds


class SavedStudy(ResultDisplay):
    """Result of a study; its names determine the files that ``save`` writes."""

    PREFIX: ClassVar[str] = ""  # of the names of tables and settings
    TABLES: ClassVar[tuple[str, ...]]  # attributes, a CSV file each
    SETTINGS: ClassVar[str] = "settings"  # the JSON file
    PICTURES: ClassVar[Mapping[str, str]]  # a PNG file's name without its ending: the method that draws it

    @classmethod
    def files(cls) -> tuple[str, ...]:
        """Return the names of all files, which a command looks at before the study begins (``check_replaceable``)."""
        tables = (f"{cls.PREFIX}{name}.csv" for name in cls.TABLES)
        return (*tables, f"{cls.PREFIX}{cls.SETTINGS}.json", *(f"{name}.png" for name in cls.PICTURES))

    def figures(self) -> Mapping[str, Callable[[], Figure]]:
        """Return the drawing function of each picture, by file name."""
        return {name: getattr(self, method) for name, method in self.PICTURES.items()}

    def _table(self, name: str) -> pd.DataFrame:
        table: pd.DataFrame = getattr(self, name)
        return table

    def _settings(self) -> Mapping[str, Any]:
        """Return what the JSON file holds."""
        raise NotImplementedError

    def save(self, folder: str | Path, *, pictures: bool = True) -> Path:
        """Write tables, settings and pictures into ``folder`` (made if needed), all at once or none; return it.

        Pictures of an earlier study go where ``pictures`` is not set.

        Raises
        ------
        ResultError : the folder cannot be written, another program's file has one of the names, or matplotlib is not
            installed
        """
        path = Path(folder)
        with writing("the study", path), saving(path, self.files(), STUDY_KIND) as new:
            for name in self.TABLES:
                table, file = self._table(name), new / f"{self.PREFIX}{name}.csv"
                table.to_csv(file, index=False, float_format="%.10g")
            text = json.dumps(self._settings(), indent=1, default=str)
            (new / f"{self.PREFIX}{self.SETTINGS}.json").write_text(text, encoding="utf-8")
            for name, draw in self.figures().items() if pictures else ():
                draw().savefig(new / f"{name}.png", dpi=120)
        return path
