"""Events of the readers: counts of what was left out; of many events of one kind the first, the others counted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from insgnss.tables import Bool, Event

MAX_EVENTS_EACH: Final = 20


def counted(kind: str, count: int | Bool | np.bool_, what: str, file: object = None) -> list[Event]:
    """Return an event that says how many there are of something, none for zero.

    Parameters
    ----------
    count : their number, or which rows they are
    what : they are, behind the number
    file : named before the number, where it is given
    """
    number = int(np.sum(count))
    return in_file(file, [Event(None, kind, f"{number} {what}")] if number else [])


def listed(kind: str, what: str, counts: Mapping[str, int], file: object = None) -> list[Event]:
    """Return an event that lists how many there are of each ("what: 3 of this, 1 of that"), none for an empty list."""
    return in_file(file, [Event(None, kind, f"{what}: {listing(counts)}")] if counts else [])


def listing(counts: Mapping[str, int]) -> str:
    """Return how many there are of each, as they come: "3 of this, 1 of that"."""
    return ", ".join(f"{count} {what}" for what, count in counts.items())


def in_file(file: object, events: Iterable[Event]) -> list[Event]:
    """Return the events with the file named before their details; as they are where it is None."""
    return [Event(e.t_ns, e.kind, e.detail if file is None else f"{file}: {e.detail}") for e in events]


def first_events(kind: str, details: Iterable[str], source: object, outcome: str = "") -> list[Event]:
    """Return an event for each of the first details, and one that counts them where there are more (``shortened``)."""
    return shortened([Event(None, kind, detail) for detail in details], source, outcome)


def shortened(events: Sequence[Event], source: object, outcome: str = "") -> list[Event]:
    """Return the first events of each kind, and for each kind with more one that counts them.

    Parameters
    ----------
    source : the file, named in the count
    outcome : the common outcome, named there too
    """
    short: list[Event] = []
    for kind in dict.fromkeys(event.kind for event in events):
        same = [event for event in events if event.kind == kind]
        short += same[:MAX_EVENTS_EACH]
        if len(same) > MAX_EVENTS_EACH:
            count = f"{source}: {len(same) - MAX_EVENTS_EACH} more such, {len(same)} in all"
            ending = f"; {outcome}" if outcome else ""
            short.append(Event(same[MAX_EVENTS_EACH].t_ns, kind, count + ending))
    return short


class FrameSearch(Protocol):
    """One file, and the defects found while its frames were searched."""

    path: Path
    foreign_bytes: int  # between the frames
    bad_checksums: list[int]  # offsets
    cut_at: int | None  # offset of a frame that the end of the file cuts


def framing_events(file: FrameSearch, protocol: str, unit: str, foreign: str, size: int) -> list[Event]:
    """Return the events of one file.

    Parameters
    ----------
    protocol : begins the kind of each event ("ubx")
    unit : what the protocol calls a frame ("frame", "message")
    foreign : what the bytes between the frames are, behind "of n bytes are"
    size : of the file [bytes]
    """
    wrong = (f"{file.path}: byte {at}: wrong checksum; {unit} refused" for at in file.bad_checksums)
    events = first_events(f"{protocol}_checksum", wrong, file.path, f"{unit}s refused")
    if file.cut_at is not None:
        detail = f"{file.path}: byte {file.cut_at}: the file ends within a {unit}"
        events.append(Event(None, f"{protocol}_cut", detail))
    foreign_bytes = f"of {size} bytes are {foreign}"
    return events + counted(f"{protocol}_foreign_bytes", file.foreign_bytes, foreign_bytes, file.path)
