"""RINEX observation headers with misaligned lines: rewritten, or left out if nothing needs them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from insgnss.tables import Event

_LABEL: Final = 60  # column where a line's label begins
_QUOTED: Final = re.compile(r'in "(.*)"\s*$', re.DOTALL)  # the reader's error quotes the line
# What the epochs cannot be read, dated or scaled without
_NEEDED: Final = (
    "RINEX VERSION / TYPE",
    "# / TYPES OF OBSERV",
    "SYS / # / OBS TYPES",
    "SYS / SCALE FACTOR",
    "END OF HEADER",
)
_MOST_LINES: Final = 20
_TIME: Final = re.compile(r"(\d+) +(\d+) +(\d+) +(\d+) +(\d+) +(\d+\.\d*) +([A-Z]{3})")


def mended_header(
    text: str, parse: Callable[[str], Any], error: type[Exception], path: Path
) -> tuple[str, list[Event]]:
    """Return a text with its header lines repaired for the reader, as far as possible, and the repairs."""
    events: list[Event] = []
    for _ in range(_MOST_LINES):
        try:
            parse(text)
            break
        except error as problem:
            quoted = _QUOTED.search(str(problem))
        end = text.find("END OF HEADER")
        at = text.find(quoted[1], 0, max(end, 0)) if quoted and quoted[1].strip() else -1
        if at < 0:
            break
        start = text.rfind("\n", 0, at) + 1
        stop = text.find("\n", at)
        line = text[start:stop]
        label = line[_LABEL:].strip()
        written = _written(line, label)
        if not label or label in _NEEDED or written == line:
            break
        what = "left out" if written is None else "rewritten in its columns"
        events.append(
            Event(
                None,
                "rinex_header_mended",
                f"{path}:{text.count(chr(10), 0, start) + 1}: {label}: {what}: {line[:_LABEL].strip()}",
            )
        )
        # a comment in its place keeps the numbers of the lines
        text = text[:start] + (written or f"{'':{_LABEL}}COMMENT") + text[stop:]
    return text, events


def _written(line: str, label: str) -> str | None:
    """Return a line in the columns of RINEX 2.11, table A1 (those of 3 and 4 are the same); None to leave it out."""
    if not label.startswith("TIME OF"):
        return None
    found = _TIME.search(line[:_LABEL])
    if found is None:
        return None if label == "TIME OF LAST OBS" else line
    *civil, second, scale = found.groups()
    return f"{''.join(f'{int(n):6d}' for n in civil)}{float(second):13.7f}     {scale}".ljust(_LABEL) + label
