"""Files that settings or commands name: found, or reported with the nearest name in their folder."""

from __future__ import annotations

import difflib
from pathlib import Path

from insgnss.errors import MissingFileError
from insgnss.results.record import entries_in
from insgnss.results.saving import RUN_KIND


def existing_file(path: Path) -> Path:
    """Return ``path`` if it is a file.

    Raises
    ------
    MissingFileError : it is not; the advice names the nearest files of the folder, hidden ones aside
    """
    if path.is_file():
        return path
    if path.is_dir():
        raise MissingFileError("this is a folder, not a file", file=path, advice=_in_place_of(path))
    folder = path.parent
    if not folder.is_dir():
        advice = (
            f"no folder '{folder}' exists; a relative path in a flight file starts at its own folder,"
            " one on the command line at the current folder"
        )
        raise MissingFileError("file not found", file=path, advice=advice)
    present = sorted(
        entry.name for entry in folder.iterdir() if entry.is_file() and not entry.name.startswith(".")
    )
    near = difflib.get_close_matches(path.name, present, n=3, cutoff=0.4)
    advice = (
        f"nearest in that folder: {', '.join(near)}"
        if near
        else f"no file in the folder '{folder}' has a similar name"
    )
    raise MissingFileError("file not found", file=path, advice=advice)


def _in_place_of(folder: Path) -> str:
    """Return which file to name in place of a folder."""
    if any(entry.get("kind") == RUN_KIND for entry in entries_in(folder).values()):
        return "it holds a saved run: name the flight file from which the run was made"
    settings = sorted(path.name for path in folder.glob("*.toml"))
    return f"name the file in it: {', '.join(settings[:3])}" if settings else "name the file in it"
