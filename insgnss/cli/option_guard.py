"""Options that a command would not use: refused, so that no one takes a result for what it is not."""

from __future__ import annotations

from collections.abc import Container

import typer

from insgnss.errors import ConfigError


def refuse_given(context: typer.Context, names: Container[str], when: str) -> None:
    """Refuse options that stand on the command line and are not used.

    Parameters
    ----------
    context : of the command
    names : of the options, as its function has them
    when : in which they are not used, as in "with a run"

    Raises
    ------
    ConfigError : one of them is given
    """
    given = [
        option.opts[0]
        for option in context.command.params
        if option.name in names and _stands_there(context, str(option.name))
    ]
    if given:
        verb = "is" if len(given) == 1 else "are"
        raise ConfigError(f"{', '.join(given)} {verb} not used {when}", key=given[0], advice="leave it out")


def _stands_there(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"
