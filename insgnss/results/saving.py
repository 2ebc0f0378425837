"""How results reach the disk: all files of a save at once or none, and never over a file of another program.

A save writes its files into a hidden folder beside their place. When the last one is whole, one renaming declares the
save done; then the files are moved to their names. A program killed before the renaming leaves the old files, one
killed after it leaves the new ones: the next process that reads or saves there finishes the moves (``settle``).

``.insgnss.json`` in the folder names the files that this program wrote, as what, and their SHA-256. Only such a file is
replaced without ``force``, only by a save of the same kind, and only if it has not changed since.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
import sys
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from insgnss.errors import ResultError
from insgnss.results.record import RECORD, Entries, entries_in, file_digest, require_sound_record

if sys.platform != "win32":
    import fcntl

_PENDING: Final = ".insgnss-pending"  # a save that is whole, whose files are not in their places yet
_NEW: Final = ".insgnss-new-"  # a save that is not whole; then host, process and a random number
_HOST: Final = hashlib.sha256(socket.gethostname().encode("utf-8", "replace")).hexdigest()[:8]
_MERGED: Final = f"{RECORD}-new"


@dataclass(frozen=True)
class _Save:
    """A save that is being written: its hidden folder, and of every file that belongs to it the kind."""

    new: Path
    kinds: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _Permission:
    """The files that may be replaced: all with ``force``, but never inputs."""

    force: bool = False
    inputs: frozenset[str] = frozenset()


# What the files of a save are together, as the record of a folder says it
PAGE_KIND: Final = "page"
PICTURE_KIND: Final = "picture"
EXPORT_KIND: Final = "export"
RECORDING_KIND: Final = "recording"
STUDY_KIND: Final = "study"
RUN_KIND: Final = "run"
CAMPAIGN_KIND: Final = "campaign"

_NOTHING_SPECIAL: Final = _Permission()
_NO_SAVES: Final[Mapping[str, _Save]] = MappingProxyType({})
_permission: Final = ContextVar("permission", default=_NOTHING_SPECIAL)
_open_saves: Final = ContextVar("open_saves", default=_NO_SAVES)


@contextmanager
def overwriting(
    force: bool = True, inputs: Iterable[Path] = (), output: Path | None = None
) -> Iterator[None]:
    """Let the saves of this block replace files of other programs, except ``inputs``, which are never replaced.

    Raises
    ------
    ResultError : nothing can be written into the folder ``output``; commands name it before they begin to work
    """
    if output is not None:
        check_writable(output)
    before = _permission.get()
    read = before.inputs | {os.path.realpath(path) for path in inputs}
    token = _permission.set(_Permission(force or before.force, read))
    try:
        yield
    finally:
        _permission.reset(token)


@contextmanager
def writing(what: str, file: str | Path, advice: str = "give another folder") -> Iterator[None]:
    """Say of an error of the system within the block what was written, where, and what to do.

    Raises
    ------
    ResultError : in place of an ``OSError``
    """
    try:
        yield
    except OSError as error:
        raise ResultError(f"{what} cannot be written: {error.strerror}", file=file, advice=advice) from error


@contextmanager
def saving(folder: Path, names: Iterable[str], kind: str) -> Iterator[Path]:
    """Yield an empty folder; at the end its files take their places in ``folder`` (made if needed), all at once.

    A save into the same folder inside the block becomes part of it.

    Parameters
    ----------
    names : of all files that belong to this kind of result here; those that are not written this time are removed
    kind : what the files are together, in one or two words: "run", "page"

    Raises
    ------
    ResultError : there is a file that may not be replaced
    OSError : the folder cannot be written; the old files are as they were
    """
    kinds = dict.fromkeys(names, kind)
    folder.mkdir(parents=True, exist_ok=True)
    place, others = os.path.realpath(folder), _open_saves.get()
    if place in others:
        check_replaceable(folder, set(kinds) - set(others[place].kinds), kind)
        others[place].kinds.update(kinds)
        yield others[place].new
        return
    check_replaceable(folder, kinds, kind)
    _remove_abandoned(folder)
    save = _Save(folder / f"{_NEW}{_HOST}-{os.getpid()}-{uuid.uuid4().hex[:8]}", kinds)
    save.new.mkdir()
    token = _open_saves.set({**others, place: save})
    try:
        yield save.new
        _commit(save, folder, kind)
    except BaseException:
        shutil.rmtree(save.new, ignore_errors=True)
        raise
    finally:
        _open_saves.reset(token)


@contextmanager
def saving_file(path: Path, kind: str) -> Iterator[Path]:
    """Yield where one file is to be written, whole or not at all, as ``saving`` does; a device or a pipe is itself.

    Raises
    ------
    ResultError : there is a file that may not be replaced
    OSError : it cannot be written
    """
    if _is_device(path):
        yield path
        return
    with saving(path.parent, (path.name,), kind) as new:
        yield new / path.name


def write_file(path: Path, content: bytes, kind: str) -> None:
    """Write one file as ``saving_file`` does.

    Raises
    ------
    ResultError : there is a file that may not be replaced
    OSError : it cannot be written
    """
    with saving_file(path, kind) as place:
        place.write_bytes(content)


def check_writable(folder: Path) -> None:
    """Refuse a folder that cannot be made or written; commands ask before they begin to work. Nothing is made.

    Raises
    ------
    ResultError : a file is in its way, or the system lets this user write nothing there
    """
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    why = ""
    if not there.is_dir():
        why = f"'{there}' is a file, so no file can be inside it"
    elif not os.access(there, os.W_OK | os.X_OK):
        why = f"the system does not let you write into '{there}'"
    if why:
        raise ResultError(why, file=folder, advice="give another --output")


def check_file_replaceable(path: Path, kind: str) -> None:
    """Refuse a file that ``saving_file`` could not write; commands ask before they begin to work.

    Raises
    ------
    ResultError : there is a file that may not be replaced, or nothing can be written there
    """
    if not _is_device(path):
        check_replaceable(path.parent, (path.name,), kind)


def _is_device(path: Path) -> bool:
    """Return whether a path is a device or a pipe, which takes what is written and is not replaced."""
    return path.exists() and not path.is_file() and not path.is_dir()


def check_replaceable(folder: Path, names: Iterable[str], kind: str) -> None:
    """Refuse names in a folder at which somebody else's file stands; commands ask before they begin to work.

    Raises
    ------
    ResultError : there is a file that this program did not write, or wrote as something else, that was changed
        since, or that is an input; or nothing can be written there
    """
    check_writable(folder)
    settle(folder)
    permission = _permission.get()
    known: Entries | None = None
    for name in names:
        path = folder / name
        if not os.path.lexists(path):
            continue
        if path.is_dir():
            raise ResultError("there is a folder in place of the file to write", file=path, advice=_MOVE_IT)
        if os.path.realpath(path) in permission.inputs:
            raise ResultError(f"the {kind} would replace an input", file=path, advice="give another --output")
        if permission.force:
            continue
        known = entries_in(folder) if known is None else known
        why = _why_not_ours(path, known.get(name), kind)
        if why:
            raise ResultError(f"the {kind} would replace this file, {why}", file=path, advice=_FORCE_IT)


_MOVE_IT: Final = "give another --output, or move it away"
_FORCE_IT: Final = (
    "give another --output, move the file away, or replace it: --force,"
    " in Python 'with insgnss.results.saving.overwriting():'"
)


def _why_not_ours(path: Path, entry: Mapping[str, str] | None, kind: str) -> str:
    """Return why a file may not be replaced, empty if it may."""
    if entry is None:
        return "which this program did not write"
    if entry.get("kind") != kind:
        return f"which belongs to another result ({entry.get('kind')})"
    try:
        return (
            ""
            if entry.get("sha256") == file_digest(path)
            else "which was changed after this program wrote it"
        )
    except OSError as error:
        return f"which cannot be read ({error.strerror})"


def settle(folder: Path) -> None:
    """Finish a save into ``folder`` that was interrupted after its files were whole.

    Raises
    ------
    ResultError : there is one, and it cannot be finished
    """
    if (folder / _PENDING).is_dir():
        with _locked(folder):
            _settle(folder)


@contextmanager
def _locked(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """Let one process at a time move files in a folder, or several read them; not on Windows."""
    if sys.platform == "win32":
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _settle(folder: Path) -> None:
    pending = folder / _PENDING
    if not pending.is_dir():
        return
    try:
        if (pending / RECORD).exists():
            wrote, removed = _told(json.loads((pending / RECORD).read_text(encoding="utf-8")))
            for name in removed:
                (folder / name).unlink(missing_ok=True)
            for name in wrote:
                with suppress(FileNotFoundError):  # moved before
                    os.replace(pending / name, folder / name)
            merged = {**entries_in(folder), **wrote}
            kept = {name: entry for name, entry in merged.items() if (folder / name).exists()}
            (pending / _MERGED).write_text(json.dumps(kept, indent=1), encoding="utf-8")
            os.replace(pending / _MERGED, folder / RECORD)
            (pending / RECORD).unlink()
        pending.rmdir()
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        advice = f"make the folder writable, or remove '{_PENDING}' in it and save again"
        raise ResultError(
            f"an interrupted save cannot be finished: {error}", file=folder, advice=advice
        ) from error


def _told(record: Any) -> tuple[Entries, list[str]]:
    """Return the files that a pending save wrote and removes: names in its folder, no paths that lead out of it."""
    wrote, removed = dict(record["wrote"]), list(record["removed"])
    strange = [name for name in (*wrote, *removed) if not isinstance(name, str) or Path(name).name != name]
    if strange:
        raise ValueError(f"'{strange[0]}' is not a file name")
    return wrote, removed


@contextmanager
def reading(folder: Path) -> Iterator[None]:
    """Keep other processes from moving files of a save into a folder while it is read.

    Raises
    ------
    ResultError : an interrupted save cannot be finished, or the folder's record is damaged
    OSError : the folder cannot be read
    """
    while True:
        settle(folder)
        with _locked(folder, shared=True):
            if not (folder / _PENDING).is_dir():
                require_sound_record(folder)
                yield
                return


def _commit(save: _Save, folder: Path, kind: str) -> None:
    """Declare a save whole, after one that is pending, and move its files to their places."""
    wrote = {
        path.name: {"kind": save.kinds.get(path.name, kind), "sha256": file_digest(path)}
        for path in sorted(save.new.iterdir())
    }
    record = {"wrote": wrote, "removed": sorted(set(save.kinds) - set(wrote))}
    (save.new / RECORD).write_text(json.dumps(record, indent=1), encoding="utf-8")
    with _locked(folder):
        _settle(folder)
        os.rename(save.new, folder / _PENDING)
        _settle(folder)


def _remove_abandoned(folder: Path) -> None:
    """Remove the files that ended processes of this machine left behind."""
    for path in folder.glob(f"{_NEW}{_HOST}-*"):
        if not _is_running(path.name.removeprefix(f"{_NEW}{_HOST}-").partition("-")[0]):
            shutil.rmtree(path, ignore_errors=True)


def _is_running(process: str) -> bool:
    """Return whether a process exists; True if the system cannot say so without ending it."""
    if os.name != "posix" or not process.isdigit():
        return True
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
