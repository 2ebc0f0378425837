"""In which line of a TOML file a key stands: ``tomllib`` does not say, and an error should."""

from __future__ import annotations

import re
from typing import Final

_TABLE: Final = re.compile(r"^\s*\[(\[?)\s*([^\[\]]+?)\s*\]\]?\s*(?:#.*)?$")
_KEY: Final = re.compile(
    r"""^\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*="""
)
_PART: Final = re.compile(r"""[A-Za-z0-9_-]+|"[^"]*"|'[^']*'""")


Path = tuple[str | int, ...]


def key_lines(text: str) -> dict[Path, int]:
    """Return the 1-based line of each key and table header, by its full path.

    An entry of an array of tables is found by its number, from 0, after the array's name: ``("fault", 2, "sv")``;
    without the number the first one is meant. Keys inside inline tables are not looked into: their parent's line is
    found instead.
    """
    lines: dict[Path, int] = {}
    entries: dict[Path, int] = {}  # of each array of tables so far
    table: tuple[str, ...] = ()
    for number, line in enumerate(text.splitlines(), start=1):
        header = _TABLE.match(line)
        key = None if header else _KEY.match(line)
        path: tuple[str, ...]
        if header:
            table = path = _parts(header[2])
            if header[1]:
                entries[table] = entries.get(table, 0) + 1
        elif key:
            path = table + _parts(key[1])
        else:
            continue
        lines.setdefault(path, number)
        lines.setdefault(_numbered(path, entries), number)
    return lines


def _numbered(path: tuple[str, ...], entries: dict[Path, int]) -> Path:
    """Return the path with the number of the present entry after each name of an array of tables."""
    numbered: list[str | int] = []
    for length, part in enumerate(path, start=1):
        numbered.append(part)
        if path[:length] in entries:
            numbered.append(entries[path[:length]] - 1)
    return tuple(numbered)


def line_of(path: Path, lines: dict[Path, int]) -> int | None:
    """Return the line of a key, that of its nearest parent when it stands inside an inline table."""
    for length in range(len(path), 0, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return None


def _parts(dotted: str) -> tuple[str, ...]:
    return tuple(part.strip("\"'") for part in _PART.findall(dotted))
