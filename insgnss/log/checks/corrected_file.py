"""A corrected flight file: the user's own text with the proposed keys changed, each with a comment that says why."""

from __future__ import annotations

import os
from collections.abc import Iterable, MutableMapping
from pathlib import Path
from typing import Any, Final

import tomlkit
from tomlkit.items import Item

from insgnss.config.files import existing_file
from insgnss.config.flight import FlightConfig
from insgnss.errors import ConfigError, ResultError
from insgnss.log.checks.report import Proposal
from insgnss.log.flight import Flight

# every key of a flight file that names files, and whether a value may also be a name in the library
PATHS: Final = (
    ("imu", "files"),
    ("imu", "grade"),
    ("gnss", "files"),
    ("gnss", "navigation"),
    ("gnss", "precise"),
    ("gnss", "antennas"),
    ("gnss", "oscillator"),
    ("gnss", "receiver_events"),
    ("gnss", "base", "files"),
    ("gnss", "antenna", "pattern"),
    ("gnss", "antenna", "obstruction"),
    ("reference", "file"),
)
LIBRARY: Final = frozenset({"grade", "oscillator", "pattern"})


def corrected_flight(flight: Flight, proposals: Iterable[Proposal]) -> Flight:
    """Return the flight with the proposals taken, in memory.

    Raises
    ------
    ConfigError : the proposals contradict each other or the rest of the file
    """
    data = flight.config.model_dump(mode="json")
    if not flight.config.gnss.files:  # a flight without raw GNSS data
        del data["gnss"]
    for proposal in proposals:
        table = data
        *parents, last = proposal.key.split(".")
        for name in parents:
            table = table[name]
        table[last] = list(proposal.value) if isinstance(proposal.value, tuple) else proposal.value
    return Flight(flight.path, FlightConfig.model_validate(data), flight.imu_grade, flight.oscillator)


def corrected_text(flight: Flight, proposals: Iterable[Proposal], folder: Path) -> str:
    """Return the flight file's text with the proposals written in, its paths counted from ``folder``.

    Everything else, comments and order included, stays as it stands. A key that was there keeps its former value in
    its comment.

    Raises
    ------
    ConfigError : the file is no longer valid TOML
    """
    path = existing_file(flight.path)
    try:
        document = tomlkit.parse(path.read_bytes().decode("utf-8-sig"))
    except (UnicodeDecodeError, tomlkit.exceptions.TOMLKitError) as error:
        raise ConfigError(f"invalid TOML: {error}", file=path, advice="check the file again") from error
    here = flight.path.absolute().parent
    if here != folder.absolute():
        for keys in PATHS:
            _move_paths(document, keys, here, folder.absolute())
    for proposal in proposals:
        _write(document, proposal)
    return tomlkit.dumps(document)


def check_new_file(path: Path) -> None:
    """Refuse a corrected flight file that exists or cannot be made; the command asks before it works.

    Raises
    ------
    ResultError : there is such a file already, or nothing can be written in its folder
    """
    if os.path.lexists(path):
        raise ResultError(
            "the file exists already", file=path, advice="give another name: nothing is overwritten"
        )
    if not path.absolute().parent.is_dir() or not os.access(path.absolute().parent, os.W_OK | os.X_OK):
        raise ResultError("its folder is missing or cannot be written", file=path, advice="give another name")


def write_corrected(flight: Flight, proposals: Iterable[Proposal], path: Path) -> Path:
    """Write the corrected flight file; return its path.

    Raises
    ------
    ResultError : there is such a file already, or it cannot be written
    """
    check_new_file(path)
    text = corrected_text(flight, proposals, path.absolute().parent)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultError(
            f"cannot be written: {error.strerror}", file=path, advice="give another name"
        ) from error
    return path


def _write(document: tomlkit.TOMLDocument, proposal: Proposal) -> None:
    """Set one key, in its table, with a comment behind it."""
    *parents, last = proposal.key.split(".")
    table: Any = document
    for name in parents:
        if name not in table:
            table[name] = tomlkit.table()
        table = table[name]
    value = list(proposal.value) if isinstance(proposal.value, tuple) else proposal.value
    former = ", was not given"
    if last in table:
        there = table[last].unwrap() if hasattr(table[last], "unwrap") else table[last]
        former = f", was {_one_line(str(tomlkit.item(there).as_string()))}"
    item = tomlkit.item(value)
    item.comment(f"corrected{former}: {_one_line(proposal.why)}")
    _set(table, last, item, at_top=not parents)


def _set(table: MutableMapping[str, Any], key: str, item: Item, *, at_top: bool) -> None:
    if isinstance(table, tomlkit.items.InlineTable):
        table[key] = item.unwrap()  # an inline table has no room for a comment
    elif key in table or not at_top:
        table[key] = item
    else:  # behind the tables a key of the file's top would belong to the last of them
        raise ConfigError("the key is missing", key=key, advice="give it at the top of the file")


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _move_paths(table: Any, keys: tuple[str, ...], here: Path, there: Path) -> None:
    """Rewrite the relative paths under a key so that they hold from another folder."""
    name, rest = keys[0], keys[1:]
    if isinstance(table, list):
        for one in table:
            _move_paths(one, keys, here, there)
    elif not isinstance(table, MutableMapping) or name not in table:
        return
    elif rest:
        _move_paths(table[name], rest, here, there)
    elif isinstance(table[name], list):
        for k, part in enumerate(table[name]):
            table[name][k] = _moved(str(part), here, there)
    elif isinstance(table[name], str) and (name not in LIBRARY or (here / str(table[name])).is_file()):
        table[name] = _moved(str(table[name]), here, there)


def _moved(path: str, here: Path, there: Path) -> str:
    return path if Path(path).is_absolute() else Path(os.path.relpath(here / path, there)).as_posix()
