"""Where the epochs of a Hatanaka-compressed (CRINEX) file begin, so that its start can be read when the end cannot.

Each line holds differences to the line before it of the same kind: what follows a damage cannot be known. Format:
Y. Hatanaka, "A compression format and tools for GNSS observation data", Bulletin of the Geographical Survey Institute
55 (2008), 21-30.
"""

from __future__ import annotations

from typing import Final

from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.log.rinex.text import version_of

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
