"""The command line: each command in a module of its own."""

from __future__ import annotations

from typing import Annotated

import typer

from insgnss.cli.allan import allan
from insgnss.cli.campaign import campaign
from insgnss.cli.check import check
from insgnss.cli.consistency import consistency
from insgnss.cli.convert import convert
from insgnss.cli.margin import margin
from insgnss.cli.outage import outage
from insgnss.cli.point import point
from insgnss.cli.replay import replay
from insgnss.cli.simulate import simulate
from insgnss.cli.track import track
from insgnss.cli.visibility import visibility
from insgnss.version import __version__

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Tightly coupled INS/GNSS navigation: logs in, a navigation solution out.",
)
app.command()(allan)
app.command()(campaign)
app.command()(check)
app.command()(consistency)
app.command()(convert)
app.command()(margin)
app.command()(outage)
app.command()(point)
app.command()(replay)
app.command()(simulate)
app.command()(track)
app.command()(visibility)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"insgnss {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version and end.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    """Tightly coupled INS/GNSS navigation: logs in, a navigation solution out."""
