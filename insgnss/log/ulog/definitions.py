"""A ULog file's messages and definitions, looked through before a library unfolds them.

ULog file format, "Definitions section": messages of a size (two bytes), a type and a body; type F is a format,
``name:type field;type field;``, whose types may be formats again, each with a count. A damaged count could unfold into
more fields than memory holds.
"""

from __future__ import annotations

import re
from collections import deque
from pathlib import Path
from typing import Final

from insgnss.errors import InputError
from insgnss.log.events import shortened
from insgnss.tables import Event

_HEADER: Final = 16
_FORMAT, _LAST = ord("F"), (ord("A"), ord("D"))
_FLAGS, _FLAGS_BYTES = ord("B"), 40
_SYNC: Final = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
_SIZES: Final = {  # bytes of each kind of message, least and most
    ord("B"): (40, 255), ord("F"): (3, 65_535), ord("I"): (2, 65_535), ord("M"): (3, 65_535), ord("P"): (6, 65_535),
    ord("Q"): (7, 65_535), ord("A"): (4, 65_535), ord("R"): (2, 2), ord("D"): (10, 65_535), ord("L"): (9, 65_535),
    ord("C"): (11, 65_535), ord("S"): (8, 8), ord("O"): (2, 2),
}  # fmt: skip
_DATA, _TOPIC = ord("D"), ord("A")
_CANDIDATE: Final = re.compile(rb"(?s)(?=..[BFIMPQARDLCSO])")
_BODIES: Final = {  # how the body begins, of the kinds of which it says more than the size
    ord("F"): re.compile(rb"[A-Za-z0-9_/-]+:"),
    ord("A"): re.compile(rb"(?s)...[A-Za-z0-9_/-]+$"),
    ord("I"): re.compile(rb"(?s).[a-zA-Z]"),
    ord("P"): re.compile(rb"(?s).(?:int32_t|float) "),
    ord("Q"): re.compile(rb"(?s)..(?:int32_t|float) "),
    ord("M"): re.compile(rb"(?s)[\x00\x01].[a-zA-Z]"),
    ord("L"): re.compile(rb"[0-7]"),
    ord("C"): re.compile(rb"[0-7]"),
    ord("S"): re.compile(re.escape(_SYNC[3:])),
}
_IN_A_ROW: Final = 4  # messages after damage, each where the one before ends: by chance only one does
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
    """Return the file's valid messages, and the places of the others.

    After a place where no message begins reading goes on where several messages follow each other again. That place may
    lie within the messages before, one of which then has a wrong size and is left out. What was appended after a crash
    follows at the places that the flags at the head name; the flags are taken out, as the messages follow each other
    here.

    The library steps back into a message of an unknown kind that is empty or longer than 10 000 bytes, and takes what
    it finds there as a message. Before the first topic, where data are of an unknown kind to it, it steps back behind
    the place it came from at the end of the file: it never ends. Messages of such sizes, and data before the first
    topic, are therefore not sound.
    """
    events: list[Event] = []
    pieces, at, start, size = [data[:_HEADER]], _HEADER, _HEADER, len(data)
    appended: list[int] = []
    topics: set[bytes] = set()
    recent: deque[tuple[int, int]] = deque(maxlen=_IN_A_ROW)  # where the messages before begin and end
    while at + 3 <= size:
        end = at + 3 + int.from_bytes(data[at : at + 2], "little")
        jump = next((place for place in appended if at < place < end), 0)
        if not jump and end <= size and _has_size(data[at + 2], end - at - 3, topics):
            if data[at + 2] == _FLAGS and end - at == 3 + _FLAGS_BYTES:
                appended = _appended(data[at + 3 : end], end)
                pieces += [data[start:at], data[at : at + 3 + 8], bytes(_FLAGS_BYTES - 8)]
                start = end
            elif data[at + 2] == _TOPIC:
                topics.add(data[at + 4 : at + 6])
            recent.append((at, end))
            at = end
            continue
        sound_until = at
        if not jump:
            first = max(start, recent[0][0] + 1 if recent else at + 1)
            candidates = (found.start() for found in _CANDIDATE.finditer(data, first))
            jump = next((place for place in candidates if _follow_each_other(data, place, topics)), -1)
            events.append(_damage(data, at, jump, cut=end > size and not events))
            if 0 < jump < at:
                sound_until = max((after for _, after in recent if after <= jump), default=recent[0][0])
        pieces.append(data[start:sound_until])
        recent.clear()
        at = start = jump if jump > 0 else size
    pieces.append(data[start:at])
    if 0 < size - at < 3:
        events.append(Event(None, "ulog_cut", f"byte {at}: the file ends within a message"))
    return b"".join(pieces), shortened(events, "ULog")


def _has_size(kind: int, size: int, topics: set[bytes]) -> bool:
    """Return whether a message may have this size; data need a topic before them."""
    least, most = _SIZES.get(kind, (1, 0))
    return least <= size <= most and (kind != _DATA or bool(topics))


def _follow_each_other(data: bytes, at: int, topics: set[bytes]) -> bool:
    """Return whether several sound messages begin here, or as many as the file has to its end."""
    for _ in range(_IN_A_ROW):
        size, kind = int.from_bytes(data[at : at + 2], "little"), data[at + 2]
        body = data[at + 3 : at + 3 + size]
        if len(body) < size or not _has_size(kind, size, topics) or not _is_body(kind, body, topics):
            return False
        if kind == _TOPIC:
            topics = topics | {body[1:3]}
        at += 3 + size
        if at + 3 > len(data):
            return at == len(data)
    return True


def _is_body(kind: int, body: bytes, topics: set[bytes]) -> bool:
    """Return whether a body begins as one of its kind does; that of data with the number of a topic."""
    if kind == _DATA:
        return body[:2] in topics
    pattern = _BODIES.get(kind)
    return pattern is None or pattern.match(body) is not None


def _damage(data: bytes, at: int, resumed: int, *, cut: bool) -> Event:
    """Return the event of a place where no sound message begins; a file that was cut off is not damaged there."""
    if cut and resumed < 0 and data[at + 2] in _SIZES:
        return Event(None, "ulog_cut", f"byte {at}: the file ends within a message")
    goes_on = f"reading goes on at byte {resumed}" if resumed > 0 else "no message follows"
    return Event(None, "ulog_damaged", f"byte {at}: no message begins where the previous one ends; {goes_on}")


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
