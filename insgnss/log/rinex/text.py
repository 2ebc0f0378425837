"""RINEX observation text cut into its header and epochs."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

# RINEX 3 and 4 mark each epoch with ">"; RINEX 2.11, table A2: "1X,I2.2,4(1X,I2),F11.7,2X,I1,I3"
_EPOCH_3: Final = re.compile(r"^>", re.MULTILINE)
_EPOCH_2: Final = re.compile(r"^ \d\d(?: [ \d]\d){4}[ \d]{3}\.\d{7}  \d[ \d]{2}\d", re.MULTILINE)


@dataclass(frozen=True)
class ObservationText:
    """The header and the text of each epoch, with the file line at which it starts."""

    header: str
    epochs: tuple[str, ...]
    lines: tuple[int, ...]

    def part(self, start: int, end: int) -> str:
        """Return a RINEX text of the epochs ``start`` to ``end`` (excluded)."""
        return self.header + "".join(self.epochs[start:end])


def version_of(text: str) -> float:
    """Return the RINEX version of the first line, 0.0 when there is none."""
    try:
        return float(text[:9])
    except ValueError:
        return 0.0


def split_epochs(text: str) -> ObservationText:
    """Cut a RINEX observation text before each epoch line."""
    mark = text.find("END OF HEADER")
    end = text.find("\n", mark) + 1 if mark >= 0 else 0
    header, body = text[:end], text[end:]
    pattern = _EPOCH_3 if version_of(text) >= 3.0 else _EPOCH_2
    starts = [match.start() for match in pattern.finditer(body)]
    epochs = [body[a:b] for a, b in pairwise([*starts, len(body)])]
    line = header.count("\n") + body[: starts[0] if starts else 0].count("\n") + 1
    lines = []
    for epoch in epochs:
        lines.append(line)
        line += epoch.count("\n")
    return ObservationText(header, tuple(epochs), tuple(lines))
