"""Files that settings or commands name: found, or reported with the nearest name in their folder."""

from __future__ import annotations

import difflib
from pathlib import Path

from insgnss.errors import MissingFileError


def existing_file(path: Path) -> Path:
    """Return ``path`` if it is a file.

    Raises
    ------
    MissingFileError : it is not; the advice names the nearest files of the folder, hidden ones aside
    """
    if path.is_file():
        return path
    if path.is_dir():
        raise MissingFileError("this is a folder, not a file", file=path, advice="name the file in it")
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
