"""The display of a result: one line in a terminal, and in Jupyter its content with the first rows of each table."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Final

import pandas as pd

_ROWS: Final = 5  # of each table, in Jupyter
_PLAIN: Final = (str, int, float, bool, Path)


class ResultDisplay:
    """A dataclass with a one-line summary; ``_about`` gives the sentences, the tables are found."""

    def _about(self) -> Iterator[str]:
        """Yield the result's properties, in a few words each: by default its plain values."""
        for name, value in _values(self):
            if isinstance(value, Mapping):
                yield from (
                    f"{key}={field_value!r}"
                    for key, field_value in value.items()
                    if isinstance(field_value, _PLAIN)
                )
            elif isinstance(value, _PLAIN):
                yield f"{name}={str(value) if isinstance(value, Path) else value!r}"

    def _sentences(self) -> Iterator[str]:
        """Yield the lines that Jupyter shows above the tables."""
        yield from self._about()

    def _shown_tables(self) -> dict[str, pd.DataFrame]:
        return {name: value for name, value in _values(self) if isinstance(value, pd.DataFrame)}

    def __repr__(self) -> str:
        rows = ", ".join(f"{name} {len(table)}" for name, table in self._shown_tables().items())
        parts = [*self._about(), *([f"rows: {rows}"] if rows else [])]
        return f"{type(self).__name__}({'; '.join(parts)})"

    def _repr_html_(self) -> str:
        about = "".join(f"<li>{html.escape(part)}</li>" for part in self._sentences())
        tables = "".join(_folded(name, table) for name, table in self._shown_tables().items())
        return f"<b>{type(self).__name__}</b><ul>{about}</ul>{tables}"


def _values(result: object) -> Iterator[tuple[str, Any]]:
    if is_dataclass(result):
        yield from ((field.name, getattr(result, field.name)) for field in fields(result))


def _folded(name: str, table: pd.DataFrame) -> str:
    head = f"<summary>{html.escape(name)}: {len(table)} rows, {table.shape[1]} columns</summary>"
    return f"<details>{head}{table.head(_ROWS).to_html()}</details>"
