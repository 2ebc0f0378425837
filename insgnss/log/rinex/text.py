"""RINEX text: files joined in one cut apart, observations cut into header and epochs, tabs read as blanks.

And where the epochs of a Hatanaka-compressed (CRINEX) file begin, so that its start can be read when the end cannot.
Each line holds differences to the line before it of the same kind: what follows a damage cannot be known. Format:
Y. Hatanaka, "A compression format and tools for GNSS observation data", Bulletin of the Geographical Survey Institute
55 (2008), 21-30.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.log.files import file_text
from insgnss.tables import Event

_LINE_END: Final = re.compile(r"\r*\n|\r")
LABEL_COLUMN: Final = 60  # column where a header line's label begins
FIRST_LABEL: Final = "RINEX VERSION / TYPE"
_FIRST_PACKED_LABEL: Final = "CRINEX VERS   / TYPE"

# RINEX 3 and 4 mark each epoch with ">"; RINEX 2.11, table A2: "1X,I2.2,4(1X,I2),F11.7,2X,I1,I3"
EPOCH_3: Final = re.compile(r"^>", re.MULTILINE)
EPOCH_2: Final = re.compile(r"^ \d\d(?: [ \d]\d){4}[ \d]{3}\.\d{7}  \d[ \d]{2}\d", re.MULTILINE)


# what says how the epochs after it are read; it may come again among the epochs, in an event of flag 4
_TYPES: Final = re.compile(
    r"^.{60}(?:# / TYPES OF OBSERV|SYS / # / OBS TYPES|SYS / SCALE FACTOR).*$", re.MULTILINE
)


class JoinedFile(NamedTuple):
    """One of the files in a text, and what messages call it."""

    name: str  # the path; of a later file of the same text with the line where it begins
    text: str


def rinex_files(path: Path) -> tuple[list[JoinedFile], list[Event]]:
    """Return the RINEX files in a file, with one kind of line end, and an event if there are several.

    Hourly files are often joined into one, each with its own header. A later header may list other observations, in
    another order, than the first.

    Raises
    ------
    InputError or a subclass : the file cannot be read
    """
    text = file_text(path)
    if "\r" in text:
        text = _LINE_END.sub("\n", text)
    packed = _FIRST_PACKED_LABEL in text[: 2 * LABEL_COLUMN]
    starts = [0, *_later_headers(text, _FIRST_PACKED_LABEL if packed else FIRST_LABEL)]
    if len(starts) == 1:
        return [JoinedFile(str(path), text)], []
    lines = [text.count("\n", 0, start) + 1 for start in starts]
    files = [
        JoinedFile(str(path) if line == 1 else f"{path}, joined at line {line}", text[begin:end])
        for line, (begin, end) in zip(lines, pairwise([*starts, len(text)]), strict=True)
    ]
    listed = ", ".join(map(str, lines[1:6])) + (", ..." if len(lines) > 6 else "")
    detail = f"{path}: {len(files)} RINEX files joined; further headers at line(s) {listed}"
    return files, [Event(None, "rinex_joined", detail)]


def _later_headers(text: str, label: str) -> Iterator[int]:
    """Yield where the header of each file after the first begins."""
    at = text.find(label, 2 * LABEL_COLUMN)
    while at >= 0:
        start = text.rfind("\n", 0, at) + 1
        if len(text[start:at].expandtabs()) == LABEL_COLUMN:
            yield start
        at = text.find(label, at + len(label))


@dataclass(frozen=True)
class ObservationText:
    """The header and the text of each epoch, with the file line at which it starts."""

    header: str
    epochs: tuple[str, ...]
    lines: tuple[int, ...]
    # lists of observations among the epochs: number of the epoch, line
    later_types: tuple[tuple[int, str], ...] = ()

    def header_at(self, index: int) -> str:
        """Return the header that holds at an epoch: the file's, with the lists of observations that came since."""
        later = [line for epoch, line in self.later_types if epoch < index]
        if not later:
            return self.header
        renewed = {_whose_types(line) for line in later if line[:6].strip()}
        lines: list[str] = []
        whose = ("", "")
        for line in self.header.splitlines():
            if line[LABEL_COLUMN:].startswith("END OF HEADER"):
                lines += later
            if line[:6].strip():  # others go on with the list above
                whose = _whose_types(line)
            if not (_TYPES.match(line) and whose in renewed):
                lines.append(line)
        return "\n".join(lines) + "\n"

    def part(self, start: int, end: int) -> str:
        """Return a RINEX text of the epochs ``start`` to ``end`` (excluded)."""
        return self.header_at(start) + "".join(self.epochs[start:end])


def _whose_types(line: str) -> tuple[str, str]:
    """Return the label and the system of a list of observations."""
    return line[LABEL_COLUMN:].strip(), line[:1]


def numbers_in(line: str, start: int, width: int, n: int) -> list[float]:
    """Return the ``n`` numbers of a line in columns of a width from ``start`` on; a blank one counts as zero."""
    fields = (line[start + width * k : start + width * (k + 1)].strip() for k in range(n))
    return [float(field.replace("D", "E").replace("d", "E")) if field else 0.0 for field in fields]


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
    pattern = EPOCH_3 if version_of(text) >= 3.0 else EPOCH_2
    starts = [match.start() for match in pattern.finditer(body)]
    epochs = [body[a:b] for a, b in pairwise([*starts, len(body)])]
    line = header.count("\n") + body[: starts[0] if starts else 0].count("\n") + 1
    lines = []
    for epoch in epochs:
        lines.append(line)
        line += epoch.count("\n")
    later = tuple((bisect_right(starts, match.start()) - 1, match[0]) for match in _TYPES.finditer(body))
    return ObservationText(header, tuple(epochs), tuple(lines), later)


def without_tabs(
    text: str, path: str, is_in_columns: Callable[[str], bool], name_width: int, lost: str
) -> tuple[str, list[Event]]:
    """Return a RINEX text with blanks for its tabs, and an event of it.

    A tab stands for blanks up to the next of every eight columns, as editors write it, or for one blank: for that with
    which the fields of its line are in their columns. A line that is so with neither keeps only its satellite.

    Parameters
    ----------
    is_in_columns : whether the fields of a line after the header are where they belong
    name_width : columns at the start of a line that name its satellite
    lost : what a line holds that is refused, in the plural
    """
    if "\t" not in text:
        return text, []
    lines = text.split("\n")
    body = next((k for k, line in enumerate(lines) if "END OF HEADER" in line), len(lines)) + 1
    tabbed = [k for k, line in enumerate(lines) if "\t" in line]
    unclear = []
    for k in tabbed:
        ways = (lines[k].expandtabs(), lines[k].replace("\t", " "))
        lines[k] = next((way for way in ways if k < body or is_in_columns(way)), "")
        if not lines[k] and ways[1].strip():
            lines[k] = ways[1][:name_width]
            unclear.append(str(k + 1))
    detail = f"{path}:{tabbed[0] + 1}: tabs in {len(tabbed)} line(s) read as blanks"
    if unclear:
        detail += f"; the columns of {len(unclear)} of them are not clear, their {lost} are refused: line(s) "
        detail += ", ".join(unclear[:5]) + (", ..." if unclear[5:] else "")
    return "\n".join(lines), [Event(None, "rinex_tabs", detail)]


# Where the epoch line, its differences applied, names the flag and the number of satellites or lines, and what makes
# it restart: (flag, first column, last column, mark)
_EPOCH_LINE: Final = {1: (28, 29, 32, "&"), 3: (31, 32, 35, ">")}


def epoch_starts(lines: list[str]) -> list[int]:
    """Return the index of the line at which each whole epoch begins, and the one after the last whole epoch."""
    flag_at, first, last, mark = _EPOCH_LINE[1 if version_of(lines[0]) < 3.0 else 3]
    header = next((k + 1 for k, line in enumerate(lines) if "END OF HEADER" in line), len(lines))
    starts = [header]
    described = ""
    while starts[-1] < len(lines):
        line = lines[starts[-1]].rstrip("\n")
        described = mark + line[1:] if line[:1] == mark else differenced(described, line)
        count = described[first:last].strip()
        if not (count.isascii() and count.isdigit()):
            break
        is_event = described[flag_at : flag_at + 1] in "2345" and described[flag_at : flag_at + 1] != ""
        # the clock's line stands before the satellites
        end = starts[-1] + 1 + int(count) + (0 if is_event else 1)
        if end > len(lines):
            break
        starts.append(end)
    return starts


def differenced(before: str, line: str) -> str:
    """Return a text line from the one before: a blank keeps a character, "&" makes it blank, others replace it."""
    longest = max(len(before), len(line))
    pairs = zip(before.ljust(longest), line.ljust(longest), strict=True)
    return "".join(old if new == " " else " " if new == "&" else new for old, new in pairs)


def sound_start(text: str) -> tuple[str, int] | None:
    """Decode as many whole epochs from the start of the file as can be decoded, by halving.

    Returns
    -------
    The decoded text and the file line at which the first epoch left out begins, None when not one epoch can be decoded.
    """
    lines = text.splitlines(keepends=True)
    starts = epoch_starts(lines)
    best: tuple[str, int] | None = None
    sound, unsound = 0, len(starts)
    while unsound - sound > 1:
        middle = (sound + unsound) // 2
        try:
            best = sidereon.decode_crinex("".join(lines[: starts[middle]])), starts[middle] + 1
            sound = middle
        except sidereon.SidereonError:
            unsound = middle
    return best
