"""RINEX observation headers with misaligned lines: read here, rewritten, or left out if nothing needs them."""

from __future__ import annotations

import re
from typing import Final

from insgnss.gnss import sidereon_on_demand as sidereon
from insgnss.log.rinex.text import FIRST_LABEL, LABEL_COLUMN
from insgnss.tables import Event

_QUOTED: Final = re.compile(r'in "(.*)"\s*$', re.DOTALL)  # the reader's error quotes the line
_TYPES: Final = "SYS / # / OBS TYPES"
# What the epochs cannot be read, dated or scaled without
_NEEDED: Final = (FIRST_LABEL, "# / TYPES OF OBSERV", _TYPES, "SYS / SCALE FACTOR", "END OF HEADER")
_MOST_LINES: Final = 20
_END: Final = "END OF HEADER"
_SLOTS: Final = "GLONASS SLOT / FRQ #"
# RINEX 3.05, table A2: I3, 8(1X, A1, I2.2, 1X, I2); Android's GnssLogger writes the first line one column short
_SLOT: Final = re.compile(r"R([ \d]\d) *([-+]?\d{1,2})(?!\d)")
_COMMENT: Final = f"{'':{LABEL_COLUMN}}COMMENT"  # in a line's place, it keeps the numbers of the lines
_PHONES: Final = "GnssLogger"  # the application, in the line of the marker and in that of the receiver
_BEIDOU_7Q: Final = re.compile(rf"^C (?=.*\b[CLDS]7Q\b).*{_TYPES}", re.MULTILINE)
_TIME: Final = re.compile(r"(\d+) +(\d+) +(\d+) +(\d+) +(\d+) +(\d+\.\d*) +([A-Z]{3})")


def mended_header(text: str, path: str) -> tuple[str, list[Event]]:
    """Return a text with its header lines repaired for the reader where possible, and the repairs."""
    events: list[Event] = []
    for _ in range(_MOST_LINES):
        try:
            sidereon.parse_rinex_obs(text)
            break
        except sidereon.SidereonError as problem:
            quoted = _QUOTED.search(str(problem))
        end = text.find("END OF HEADER")
        at = text.find(quoted[1], 0, max(end, 0)) if quoted and quoted[1].strip() else -1
        if at < 0:
            break
        start = text.rfind("\n", 0, at) + 1
        stop = text.find("\n", at)
        line = text[start:stop]
        label = line[LABEL_COLUMN:].strip()
        written = _written(line, label)
        if not label or label in _NEEDED or written == line:
            break
        what = "left out" if written is None else "rewritten in its columns"
        events.append(
            _mended(path, text.count("\n", 0, start) + 1, label, f"{what}: {line[:LABEL_COLUMN].strip()}")
        )
        text = text[:start] + (written or _COMMENT) + text[stop:]
    return text, events


def with_first_label(text: str, path: str) -> tuple[str, list[Event]]:
    """Return a text whose first label stands in its column, and an event if it had to be moved."""
    line, _, rest = text.partition("\n")
    at = line.find(FIRST_LABEL)
    if at < 0 or at == LABEL_COLUMN or len(line[:at].rstrip()) > LABEL_COLUMN:
        return text, []
    moved = f"{line[:at].rstrip():{LABEL_COLUMN}}{FIRST_LABEL}"
    return f"{moved}\n{rest}", [_mended(path, 1, FIRST_LABEL, f"moved from column {at} to {LABEL_COLUMN}")]


def phone_codes(text: str, path: str) -> tuple[str, list[Event]]:
    """Return a text in which BeiDou's B2a is called 5P, and an event if it was called 7Q, as Android's GnssLogger does.

    7Q is B2I at 1207.14 MHz; in the application's files the Doppler of 7Q is 0.7536 of that of 2I, as 1176.45 MHz is.
    """
    end = text.find(_END)
    line = _BEIDOU_7Q.search(text, 0, max(end, 0))
    if line is None or _PHONES not in text[:end]:
        return text, []
    renamed = re.sub(r"\b([CLDS])7Q\b", r"\g<1>5P", line[0])
    what = "BeiDou's 7Q read as 5P: GnssLogger calls B2a (1176.45 MHz) so"
    event = _mended(path, text.count("\n", 0, line.start()) + 1, _TYPES, what)
    return text[: line.start()] + renamed + text[line.end() :], [event]


def slot_channels(text: str, path: str, channels: dict[str, int]) -> tuple[str, list[Event]]:
    """Return a text with its lines of GLONASS channels made comments, and an event of each unread part.

    The channels are added to ``channels``. They are read in whatever columns they stand, in the header and in later
    header records.
    """
    events: list[Event] = []
    pieces, done = [], 0
    at = text.find(_SLOTS)
    while at >= 0:
        start, end = text.rfind("\n", 0, at) + 1, text.find("\n", at)
        body = text[start:at]
        channels.update((f"R{int(slot):02d}", int(channel)) for slot, channel in _SLOT.findall(body))
        unread = re.sub(r"^ *\d*", "", _SLOT.sub("", body)).split()
        if unread:
            line = text.count("\n", 0, start) + 1
            events.append(_mended(path, line, _SLOTS, f"left out: {' '.join(unread)}"))
        pieces += [text[done:start], _COMMENT]
        done = len(text) if end < 0 else end
        at = text.find(_SLOTS, done)
    return "".join([*pieces, text[done:]]), events


def without_skipped_lines(text: str, path: str) -> tuple[str, list[Event]]:
    """Return a text without the header lines that the reader cannot read and passes over, and an event of each."""
    begin = text.find(_END)
    if begin < 0:
        return text, []
    lines = text[:begin].split("\n")
    events: list[Event] = []
    try:
        skipped = sidereon.parse_rinex_obs(text[:begin] + _END).skipped_records
        if not skipped:  # of nearly all files: no copy of the text
            return text, []
        for k, line in enumerate(lines[1:], start=1):
            label = line[LABEL_COLUMN:].strip()
            if not skipped:
                break
            if not label or label in _NEEDED:
                continue
            lines[k] = _COMMENT
            left = sidereon.parse_rinex_obs("\n".join(lines) + _END).skipped_records
            if left < skipped:
                events.append(_mended(path, k + 1, label, f"left out: {line[:LABEL_COLUMN].strip()}"))
            else:
                lines[k] = line
            skipped = left
    except sidereon.SidereonError:  # the whole text's parse says what is wrong
        return text, []
    return "\n".join(lines) + text[begin:], events


def _mended(path: str, line: int, label: str, what: str) -> Event:
    return Event(None, "rinex_header_mended", f"{path}:{line}: {label}: {what}")


def _written(line: str, label: str) -> str | None:
    """Return a line in the columns of RINEX 2.11, table A1 (those of 3 and 4 are the same); None to leave it out."""
    if not label.startswith("TIME OF"):
        return None
    match = _TIME.search(line[:LABEL_COLUMN])
    if match is None:
        return None if label == "TIME OF LAST OBS" else line
    *civil, second, scale = match.groups()
    return (
        f"{''.join(f'{int(n):6d}' for n in civil)}{float(second):13.7f}     {scale}".ljust(LABEL_COLUMN)
        + label
    )
