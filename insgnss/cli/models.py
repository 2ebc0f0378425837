"""``insgnss models``: the content of the model library, and copies to change."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Final

import typer

from insgnss.cli.printing import AsJson, print_json
from insgnss.errors import ConfigError, ResultError
from insgnss.results.saving import check_writable

# how a model is named where it is used; {file} is the path of a copy, {name} its name
_USE: Final = {
    "imus": '{where}: grade = "{name}" in [imu]',
    "oscillators": '{where}: oscillator = "{name}" in [gnss]',
    "filters": "insgnss replay FLIGHT --filter {file}",
    "antennas": '{where}: pattern = "{name}" in [[gnss.antenna]]',
    "scenarios": "insgnss simulate {file}, insgnss receiver {file}",
    "campaigns": "insgnss campaign {file}",
    "vehicles": '{where}: vehicle = "{name}" in [attitude]',
    "emitters": "insgnss receiver --emitters {file}, insgnss margin RUN --emitters {file}",
}

# A scenario with satellites on given tracks describes a study, not a log
_STUDY: Final = 'masking_study("{file}") of insgnss.studies'

# The flight file's own key for a kind
_OTHER_NAMES: Final = {"grades": "imus"}

# Copies of these are named with their ending
_FILES: Final = ("antennas", "vehicles")


def models(
    kind: Annotated[
        str | None, typer.Argument(help=f"One of {', '.join(_USE)}; by default all. 'grades' are the imus.")
    ] = None,
    name: Annotated[
        str | None, typer.Argument(help="A model's name: its file is printed, or copied with --output.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Copy the model to this file or folder.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the models that files and options can name, print one of them, or copy it to change it."""
    from insgnss.config import library

    kind = kind and _OTHER_NAMES.get(kind, kind)
    if kind is not None and kind not in library.KINDS:
        raise ConfigError(
            f"unknown kind of model '{kind}'",
            key="KIND",
            advice=f"give one of {', '.join(library.KINDS)}",
        )
    if kind is None or name is None:
        if output is not None:
            raise ConfigError(
                "a copy needs the kind and name of one model",
                key="--output",
                advice="as in: insgnss models imus tactical --output my/",
            )
        _list(list(library.KINDS) if kind is None else [kind], as_json=as_json)
        return
    source = library.find(kind, name)
    written = None if output is None else _copied(source, output)
    if as_json:
        print_json({"kind": kind, "name": name, "file": source, "wrote": written})
    elif written is None:
        typer.echo(source.read_text(encoding="utf-8"), nl=False)
    else:
        called = written.name if kind in _FILES else written.stem
        use = _use_of(kind, source).format(where="next to the flight file", file=written, name=called)
        typer.echo(f"wrote {written}; {use}")


def _use_of(kind: str, source: Path) -> str:
    """Return how a model is used, with places for its file and name."""
    from insgnss.config.strict import read_toml

    return _STUDY if kind == "scenarios" and "satellites" in read_toml(source) else _USE[kind]


def _copied(source: Path, output: Path) -> Path:
    """Copy a model's file to a file, or under its own name into a folder; return where it is now."""
    # a folder that is there, or a name without the ending of a file
    path = output / source.name if output.is_dir() or output.suffix != source.suffix else output
    check_writable(path.parent)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as copy:
            copy.write(source.read_bytes())
    except FileExistsError:
        raise ResultError("the file exists already", file=path, advice="give another --output") from None
    except OSError as error:
        raise ResultError(
            f"the copy cannot be written: {error.strerror}", file=path, advice="give another --output"
        ) from error
    return path


def _list(kinds: list[str], *, as_json: bool) -> None:
    from insgnss.config import library

    if as_json:
        entries = [
            {"kind": kind, "name": name, "about": library.about(kind, name), "file": library.find(kind, name)}
            for kind in kinds
            for name in library.names(kind)
        ]
        print_json({"models": entries})
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    alike: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for kind in kinds:
        for name in library.names(kind):
            use = _use_of(kind, library.find(kind, name))
            alike.setdefault((kind, use), []).append((name, library.about(kind, name)))
    for (kind, use), rows in alike.items():
        called = use.format(where="in the flight file", file="FILE", name="NAME")
        table = Table(title=escape(f"{kind}: {called}"), title_justify="left")
        for head in ("name", "what it is"):
            table.add_column(head, no_wrap=head == "name")
        for row in rows:
            table.add_row(*map(escape, row))
        Console(file=sys.stdout, width=120).print(table)
    typer.echo("insgnss models KIND NAME prints a model's file; --output FILE copies it")
