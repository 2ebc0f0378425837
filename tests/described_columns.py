"""What a page of columns says against the columns that a table has."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable

from insgnss.runs.columns.sheet import Sheet


def undescribed(sheet: Sheet, names: Iterable[str]) -> list[str]:
    """Return which of these columns have no meaning on the sheet."""
    known = [column.name for column in sheet.columns() if column.meaning]
    return [name for name in names if not any(fnmatch.fnmatchcase(name, pattern) for pattern in known)]


def absent(sheet: Sheet, names: Iterable[str]) -> list[str]:
    """Return which of the columns that the sheet describes are not among these."""
    present = list(names)
    return [column.name for column in sheet.columns() if not fnmatch.filter(present, column.name)]
