"""Events of a binary protocol's framing: wrong check sums, a cut end, bytes between the frames."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from insgnss.log.first_events import first_events
from insgnss.tables import Event


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
    events = first_events(
        file.bad_checksums,
        lambda offset: Event(
            None, f"{protocol}_checksum", f"{file.path}: byte {offset}: wrong check sum; {unit} refused"
        ),
        file.path,
        f"{unit}s refused",
    )
    if file.cut_at is not None:
        detail = f"{file.path}: byte {file.cut_at}: the file ends within a {unit}"
        events.append(Event(None, f"{protocol}_cut", detail))
    if file.foreign_bytes:
        detail = f"{file.path}: {file.foreign_bytes} of {size} bytes are {foreign}"
        events.append(Event(None, f"{protocol}_foreign_bytes", detail))
    return events
