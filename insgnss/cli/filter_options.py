"""The options that choose a filter: the same for every command that runs one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from insgnss.config.filter import FilterConfig

FilterName = Annotated[
    str, typer.Option("--filter", "-f", help="Name of a filter in the library, or a file (.toml).")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="KEY=VALUE: a setting of the filter, such as gates.pseudorange_sigma=4; repeatable."
    ),
]

Integrity = Annotated[
    bool,
    typer.Option(
        "--integrity", help="Also compute protection levels: one more filter run for each satellite."
    ),
]


def chosen_filter(filter: str, settings: list[str] | None) -> FilterConfig:
    """Return the filter of the options.

    Raises
    ------
    ConfigError, ModelError, MissingFileError : no such filter, or a setting that does not fit
    """
    # the schema takes a while to load, which a command that fails on its options does without
    from insgnss.config.changes import assignments
    from insgnss.config.library import filter_config

    return filter_config(filter, assignments(settings or ()))
