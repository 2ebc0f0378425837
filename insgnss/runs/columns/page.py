"""The page of column names, ``COLUMNS.md``, and the same in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from insgnss.runs.columns.inputs import INPUT_SHEETS
from insgnss.runs.columns.run_tables import POINT_SHEETS, RUN_SHEETS
from insgnss.runs.columns.sheet import Sheet
from insgnss.runs.columns.statuses import STATUS_MEANINGS

SHEETS: Final = {sheet.name: sheet for sheet in (*INPUT_SHEETS, *RUN_SHEETS, *POINT_SHEETS)}
_HEAD: Final = """# Column names

Every table that goes in or comes out, column by column. `insgnss columns > COLUMNS.md` makes this page; a test compares
it with the tables that a replay gives. Names end in their unit; a name with a `*` is a family.

`run.nav`, `run.measurements`, ... are pandas tables; `run.save(folder)` and `insgnss replay --output folder` write each
as `<table>.parquet` or, with `--format csv`, `<table>.csv`. `insgnss columns nav` prints one table's part. Conventions
of frames and signs are in [conventions](docs/conventions.md).
"""


def columns_page() -> str:
    """Return the whole page as Markdown."""
    groups = (
        ("What goes in", INPUT_SHEETS),
        ("A run", RUN_SHEETS),
        ("A point solution", POINT_SHEETS),
    )
    parts = [_HEAD]
    for title, sheets in groups:
        parts.append(f"## {title}\n")
        parts += [sheet_text(sheet) for sheet in sheets]
    parts.append("## Status of a measurement\n\nThe column `status`, and `state` of `satellites`.\n")
    parts.append(
        _rows(("status", "meaning"), [(f"`{word}`", meaning) for word, meaning in STATUS_MEANINGS.items()])
    )
    return "\n".join(parts)


def sheet_text(sheet: Sheet) -> str:
    """Return one table's columns as Markdown."""
    rows = [
        (", ".join(f"`{column.name}`" for column in columns), _units([c.unit for c in columns]), meaning)
        for columns, meaning in sheet.lines()
    ]
    intro = f" {sheet.intro}" if sheet.intro else ""
    return f"### {sheet.name}\n\nOne row for each {sheet.row}.{intro}\n\n" + _rows(
        ("column", "unit", "meaning"), rows
    )


def _units(units: list[str]) -> str:
    """Return the unit of several columns: once where they share it."""
    words = [unit or "-" for unit in units]
    return words[0] if len(set(words)) == 1 else ", ".join(words)


def _rows(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"
