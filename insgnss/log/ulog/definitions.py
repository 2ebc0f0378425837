"""A ULog file's messages and definitions, looked through before a library unfolds them.

ULog file format, "Definitions section": messages of a size (two bytes), a type and a body; type F is a format,
``name:type field;type field;``, whose types may be formats again, each with a count. A damaged count could unfold into
more fields than memory holds.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from insgnss.errors import InputError
from insgnss.log.first_events import shortened
from insgnss.tables import Event

_HEADER: Final = 16
_FORMAT, _LAST = ord("F"), (ord("A"), ord("D"))
_FLAGS, _FLAGS_BYTES = ord("B"), 40
_SYNC: Final = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
_KINDS: Final = frozenset(b"BFIMPQARDLCSO")
MOST_FIELDS: Final = 65_535  # bytes of the largest message
_MOST_FORMATS: Final = 5000
_FIELD: Final = re.compile(rb"([A-Za-z0-9_]+)(?:\[(\d{1,12})\])? [^;]*")


def check_definitions(data: bytes, path: Path) -> None:
    """Raise where a format holds more fields than a message has bytes.

    Raises
    ------
    InputError : it does, or formats hold each other
    """
    formats: dict[bytes, list[tuple[bytes, int]]] = {}
    at = _HEADER
    while at + 3 <= len(data) and data[at + 2] not in _LAST and len(formats) < _MOST_FORMATS:
        size = int.from_bytes(data[at : at + 2], "little")
        if data[at + 2] == _FORMAT:
            name, _, fields = data[at + 3 : at + 3 + size].partition(b":")
            formats[name] = [(m[1], int(m[2] or 1)) for m in _FIELD.finditer(fields)]
        at += 3 + size
    counts: dict[bytes, int] = {}
    for name in formats:
        if _count(name, formats, counts, 0) > MOST_FIELDS:
            raise InputError(
                f"the ULog's format '{name.decode('latin-1')[:40]}' has more fields than a message has bytes",
                file=path,
                advice="the header of the file is damaged: copy it from the vehicle again",
            )


def sound_messages(data: bytes) -> tuple[bytes, list[Event]]:
    """Return the file with its sound messages alone, and where others stood.

    After a place where no message begins the search goes on at the next synchronisation message: the library's own
    search does not end in some damaged files. What was appended after a crash follows at the places that the flags
    at the head name; the flags are taken out, as the messages follow each other here.
    """
    events: list[Event] = []
    pieces, at, start, size = [data[:_HEADER]], _HEADER, _HEADER, len(data)
    appended: list[int] = []
    while at + 3 <= size:
        end = at + 3 + int.from_bytes(data[at : at + 2], "little")
        jump = next((place for place in appended if at < place < end), 0)
        if data[at + 2] in _KINDS and end <= size and not jump:
            if data[at + 2] == _FLAGS and end - at == 3 + _FLAGS_BYTES:
                appended = _appended(data[at + 3 : end], end)
                pieces += [data[start:at], data[at : at + 3 + 8], bytes(_FLAGS_BYTES - 8)]
                start = end
            at = end
            continue
        pieces.append(data[start:at])
        if not jump:
            where = "the file ends within a message" if data[at + 2] in _KINDS else "no message begins here"
            kind = "ulog_cut" if data[at + 2] in _KINDS and not events else "ulog_damaged"
            events.append(Event(None, kind, f"byte {at}: {where}, where the one before it ends"))
            jump = data.find(_SYNC, at + 1)
        if jump < 0:
            start = at = size
            break
        at = start = jump
    pieces.append(data[start:at])
    if 0 < size - at < 3:
        events.append(Event(None, "ulog_cut", f"byte {at}: the file ends within a message"))
    return b"".join(pieces), shortened(events, "ULog")


def _appended(flags: bytes, after: int) -> list[int]:
    """Return where data was appended, places behind ``after``."""
    places = [int.from_bytes(flags[k : k + 8], "little") for k in (16, 24, 32)] if flags[8] & 1 else []
    return [place for place in places if place > after]


def _count(
    name: bytes, formats: dict[bytes, list[tuple[bytes, int]]], counts: dict[bytes, int], depth: int
) -> int:
    """Return how many fields a format unfolds into; formats within themselves are without end."""
    if name not in formats:
        return 1
    if depth > 20:
        return MOST_FIELDS + 1
    if name not in counts:
        total = 0
        for inner, times in formats[name]:
            total += times * _count(inner, formats, counts, depth + 1)
        counts[name] = min(total, MOST_FIELDS + 1)
    return counts[name]
