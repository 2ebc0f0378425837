"""A direct look at RINEX 3 text, column by column as its tables lay them out: the oracle of the reader's tests.

RINEX 3.05, tables A3 (observations) and A6, A8, A14 (navigation: 4X,4D19.12 after the first line's 23X,3D19.12).
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass

LINES_OF_MESSAGE = {"G": 8, "E": 8, "C": 8, "J": 8, "R": 4, "S": 4}


@dataclass(frozen=True)
class Message:
    """One navigation message: the satellite, its clock epoch, and the numbers of all lines in order."""

    sv: str
    toc: dt.datetime  # in the system's own time
    numbers: tuple[float | None, ...]  # af0 af1 af2, then four of each orbit line


def _number(text: str) -> float | None:
    text = text.strip().replace("D", "E").replace("d", "e")
    return float(text) if text else None


def navigation_messages(text: str) -> list[Message]:
    """Return the Keplerian messages of a RINEX 3 navigation file, in its order."""
    lines = text[text.index("END OF HEADER") :].splitlines()[1:]
    messages = []
    i = 0
    while i < len(lines):
        count = LINES_OF_MESSAGE[lines[i][0]]
        block = lines[i : i + count]
        i += count
        if count != 8:
            continue
        head = block[0]
        toc = dt.datetime.strptime(" ".join(head[4:23].split()), "%Y %m %d %H %M %S")
        numbers = [_number(head[23 + 19 * k : 42 + 19 * k]) for k in range(3)]
        for line in block[1:]:
            numbers += [_number(line[4 + 19 * k : 23 + 19 * k]) for k in range(4)]
        messages.append(Message(f"{head[0]}{int(head[1:3]):02d}", toc, tuple(numbers)))
    return messages


def observations(text: str) -> dict[tuple[dt.datetime, str, str], float]:
    """Return every value of a RINEX 3 observation file by epoch, satellite and code."""
    header, body = text.split("END OF HEADER", 1)
    codes: dict[str, list[str]] = {}
    system = ""
    for line in header.splitlines():
        if line[60:].strip() == "SYS / # / OBS TYPES":
            system = line[0].strip() or system
            codes.setdefault(system, []).extend(line[6:60].split())
    values = {}
    epoch = dt.datetime.min
    for line in body.splitlines()[1:]:
        if line.startswith(">"):
            minute = dt.datetime.strptime(" ".join(line[2:18].split()), "%Y %m %d %H %M")
            epoch = minute + dt.timedelta(microseconds=round(float(line[18:29]) * 1e6))
            continue
        sv = f"{line[0]}{int(line[1:3]):02d}"
        for k, code in enumerate(codes[line[0]]):
            cell = line[3 + 16 * k : 17 + 16 * k].strip()
            if cell:
                values[epoch, sv, code] = float(cell)
    return values


def indicators(text: str) -> dict[tuple[dt.datetime, str, str], int]:
    """Return every loss-of-lock indicator of a RINEX 3 observation file that is not blank."""
    header, body = text.split("END OF HEADER", 1)
    codes = {
        line[0]: line[6:60].split() for line in header.splitlines() if line[60:].startswith("SYS / # / OBS")
    }
    flags = {}
    epoch = dt.datetime.min
    for line in body.splitlines()[1:]:
        if line.startswith(">"):
            minute = dt.datetime.strptime(" ".join(line[2:18].split()), "%Y %m %d %H %M")
            epoch = minute + dt.timedelta(microseconds=round(float(line[18:29]) * 1e6))
            continue
        for k, code in enumerate(codes[line[0]]):
            flag = line[17 + 16 * k : 18 + 16 * k].strip()
            if flag:
                flags[epoch, f"{line[0]}{int(line[1:3]):02d}", code] = int(flag)
    return flags
