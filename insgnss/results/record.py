"""The record of the files that this program wrote into a folder: each one's kind and hash (see ``saving``)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from insgnss.errors import ResultError

RECORD: Final = ".insgnss.json"
Entries = dict[str, dict[str, str]]  # of each file: its kind and its hash


def entries_in(folder: Path) -> Entries:
    """Return the record of the files in a folder; an unreadable record is empty."""
    try:
        record: Any = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    entries = record.items() if isinstance(record, dict) else ()
    return {str(name): entry for name, entry in entries if isinstance(entry, dict)}


def require_sound_record(folder: Path) -> None:
    """Refuse a record that does not state the kind and the hash of each of its files: nothing could be compared.

    Raises
    ------
    ResultError : it was cut or changed
    OSError : it cannot be read
    """
    path = folder / RECORD
    damage = _damage(path) if path.exists() else ""
    if damage:
        raise ResultError(
            f"the record of the files in this folder is damaged: {damage}",
            file=path,
            advice="copy the whole folder again, or write its results again into a new folder; to use the files"
            " without comparing them with what was saved, remove this record",
        )


def _damage(path: Path) -> str:
    """Return what a record lacks, empty where it states the kind and the hash of each file."""
    try:
        record: Any = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        return str(error)
    if not isinstance(record, dict):
        return "it is not a table of files"
    for name, entry in record.items():
        stated = entry if isinstance(entry, dict) else {}
        if not all(isinstance(stated.get(key), str) for key in ("kind", "sha256")):
            return f"the entry of '{name}' lacks its kind or hash"
    return ""


def first_changed(folder: Path, names: Iterable[str], kind: str) -> Path | None:
    """Return the first of these files that is not the one that was saved here as ``kind``, None where all are.

    A file that is missing is not compared, and none where the folder's record has no file of this kind.

    Raises
    ------
    OSError : a file cannot be read
    """
    entries = entries_in(folder)
    if all(entry.get("kind") != kind for entry in entries.values()):
        return None
    for name in names:
        path, stated = folder / name, entries.get(name, {}).get("sha256")
        if path.is_file() and stated != file_digest(path):
            return path
    return None


def saved_as(kind: str, folder: Path) -> tuple[str, ...]:
    """Return the names of the files that were saved in a folder as ``kind``, as its record states."""
    return tuple(name for name, entry in entries_in(folder).items() if entry.get("kind") == kind)


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
