"""NovAtel's ASCII messages and RANGECMP3 to RANGECMP5 become binary RANGE and the like, by NovAtel's own library.

The library, ``novatel_edie``, is an optional extra and runs in a process of its own (``library.py``).
"""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Final

from insgnss.errors import InputError
from insgnss.log.novatel.frames import SHORT_HEADER, SYNC, NovatelFrames, check_sum, frames_in
from insgnss.log.novatel.ranges import COMPRESSED_FURTHER, RANGE
from insgnss.tables import Event

INSTALL: Final = "pip install 'insgnss[novatel]'"
_PROGRAM: Final = Path(__file__).with_name("library.py")
_KINDS: Final = (
    rb"(RANGE|RAWIMU|RAWEPHEM|INSPVA|INSCONFIG|BESTPOS|BESTVEL|BESTXYZ|HEADING|[A-Z]{3,6}EPHEM|IONUTC)"
)
# "#RANGEA,COM1,...;...*crc", with short headers "%RAWIMUSA,...;...*crc", abbreviated "<RANGE COM1 ..."
_ASCII: Final = re.compile(rb"[#%%]%b[A-Z0-9]*A,|<%b[A-Z0-9]*[ \t]" % (_KINDS, _KINDS))
_SOUND: Final = re.compile(rb"[#%]([A-Z0-9_]+A,[^\r\n#%*]{8,}?)\*([0-9a-fA-F]{8})\r?\n?")
_BYTES_PER_S: Final = 1_000_000  # at least; fifty times as many are usual
_NOT_INSTALLED: Final = b"No module named 'novatel_edie'"
_NO_REFERENCE: Final = b"No reference data exists"


def ascii_bytes(data: bytes) -> int:
    """Return how many bytes lie in ASCII messages with a valid checksum."""
    return sum(len(match[0]) for match in _SOUND.finditer(data) if _is_sound(match))


def _is_sound(match: re.Match[bytes]) -> bool:
    return check_sum(match[1]) == int(match[2], 16)


def rewritten(frames: NovatelFrames) -> tuple[NovatelFrames, list[Event]]:
    """Return the file's messages with those that the library turns into binary ones, and those it cannot.

    A file that needs no library comes back as it is; the library gets what it alone reads.

    Raises
    ------
    InputError : the file is ASCII alone, and the library is not installed or does not read it
    """
    needed = _needed(frames)
    if not needed:
        return frames, []
    # behind each ASCII message the line end that the library waits for, CR and LF
    given = _SOUND.sub(
        lambda match: match[0].rstrip() + b"\r\n" if _is_sound(match) else match[0],
        _left_to_the_library(frames),
    )
    limit_s = 60.0 + len(given) / _BYTES_PER_S
    try:
        ended = subprocess.run(
            [sys.executable, "-P", str(_PROGRAM)], input=given, capture_output=True, timeout=limit_s
        )
    except subprocess.TimeoutExpired:
        return frames, [_unread(frames, f"took more than {limit_s:.0f} s")]
    if _NOT_INSTALLED in ended.stderr:
        return frames, [_unread(frames, f"is not installed: {INSTALL}")]
    turned = frames_in(frames.path, ended.stdout)
    if ended.returncode != 0 and not turned.count:
        return frames, [_unread(frames, f"ended with {ended.returncode}")]
    return _joined(frames, turned), _losses(frames, turned, ended)


def _left_to_the_library(frames: NovatelFrames) -> bytes:
    """Return everything except the messages read here, in the order of the file."""
    pieces = list(frames.gaps)
    for frame in frames.of(*COMPRESSED_FURTHER):
        pieces.append(
            (frames.data.rfind(SYNC, 0, frame.offset - SHORT_HEADER + 1), frame.offset + frame.length + 4)
        )
    return b"".join(frames.data[a:b] for a, b in sorted(pieces))


def _joined(frames: NovatelFrames, turned: NovatelFrames) -> NovatelFrames:
    """Return the messages of a file with those that were turned behind them; sound ASCII counts as foreign no more."""
    behind = len(frames.data)
    kinds = {kind: [*messages] for kind, messages in frames.frames.items() if kind not in COMPRESSED_FURTHER}
    for kind, messages in turned.frames.items():
        kinds.setdefault(kind, []).extend(f._replace(offset=f.offset + behind) for f in messages)
    return replace(
        frames,
        data=frames.data + turned.data,
        frames=kinds,
        count=frames.count + turned.count,
        foreign_bytes=frames.foreign_bytes - ascii_bytes(frames.data),
    )


def _needed(frames: NovatelFrames) -> str:
    """Return the messages of the file that only the library reads, "" for none."""
    counts = {name: len(frames.of(kind)) for kind, name in COMPRESSED_FURTHER.items()}
    counts["ASCII"] = len(_ascii_kinds(frames))
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count)


def _ascii_kinds(frames: NovatelFrames) -> list[bytes]:
    if not frames.foreign_bytes:
        return []
    return [match[1] or match[2] for match in _ASCII.finditer(frames.data)]


def _losses(
    frames: NovatelFrames, turned: NovatelFrames, ended: subprocess.CompletedProcess[bytes]
) -> list[Event]:
    """Return the events of messages that the library did not turn."""
    events = []
    if ended.returncode != 0:
        detail = (
            f"the library ended with {ended.returncode} after {turned.count} message(s); the rest is not read"
        )
        events.append(_event(frames, detail))
    epochs = len(frames.of(*COMPRESSED_FURTHER)) + _ascii_kinds(frames).count(b"RANGE")
    lost = epochs - len(turned.of(RANGE))
    if lost > 0:
        events.append(_event(frames, f"epochs not read: {lost} of {epochs} ({_needed(frames)})"))
    missing = ended.stderr.count(_NO_REFERENCE)
    if missing:
        detail = f"{missing} differences without the full epoch that they refer to left out"
        events.append(_event(frames, detail))
    return events


def _unread(frames: NovatelFrames, why: str) -> Event:
    """Return the event of messages that were left to the library."""
    detail = f"{_needed(frames)} not read: NovAtel's own library, novatel-edie, {why}"
    if not frames.count:
        advice = "log the binary messages instead: RANGEB, RAWEPHEMB, RAWIMUSXB"
        raise InputError(detail, file=frames.path, advice=advice)
    return _event(frames, detail)


def _event(frames: NovatelFrames, detail: str) -> Event:
    return Event(None, "novatel_compressed", f"{frames.path}: {detail}")
