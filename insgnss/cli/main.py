"""The command line: one command for each job, each with an example in its help."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from typing import Annotated, Final

import typer

from insgnss.cli.acquire import acquire
from insgnss.cli.allan import allan
from insgnss.cli.campaign import campaign
from insgnss.cli.check import check
from insgnss.cli.columns import columns
from insgnss.cli.command import OwnCommand
from insgnss.cli.compare import compare
from insgnss.cli.consistency import consistency
from insgnss.cli.convert import convert
from insgnss.cli.demo import demo
from insgnss.cli.export import export
from insgnss.cli.interrupt import INTERRUPTED, raise_at_interrupt
from insgnss.cli.iq import iq
from insgnss.cli.margin import margin
from insgnss.cli.models import models
from insgnss.cli.outage import outage
from insgnss.cli.point import point
from insgnss.cli.receiver import receiver
from insgnss.cli.replay import replay
from insgnss.cli.report import report
from insgnss.cli.simulate import simulate
from insgnss.cli.smooth import smooth
from insgnss.cli.track import track
from insgnss.cli.visibility import visibility
from insgnss.version import __version__

app = typer.Typer(
    name="insgnss",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Tightly coupled INS/GNSS navigation: logs in, a navigation solution out.",
)
# what a script can rely on; the classes of insgnss.errors carry theirs
EXIT_CODES: Final = {
    0: "done",
    1: "a fault of the program",
    2: "a wrong option, flight, filter or model file",
    3: "a file that is missing, or a log that cannot be used",
    4: "the filter could not start",
    5: "a run or a result that cannot be read or written",
    INTERRUPTED: "interrupted",
}
_SAMPLE = "data/sample_flight/flight.toml"
# each works as pasted in the repository's folder, in this order
EXAMPLES: Final[dict[Callable[..., None], str]] = {
    demo: "insgnss demo --output out/demo",
    convert: "insgnss convert data/sample_receiver/rover.obs --output out/rover",
    check: f"insgnss check {_SAMPLE}",
    replay: f"insgnss replay {_SAMPLE} --output out/run",
    report: "insgnss report out/run --output out/run/report.html",
    smooth: f"insgnss smooth {_SAMPLE} --output out/smooth",
    compare: "insgnss compare out/run out/smooth --output out/compare.html",
    export: "insgnss export out/run --output out/run.kmz",
    consistency: "insgnss consistency out/run --output out/consistency",
    visibility: f"insgnss visibility out/run --flight {_SAMPLE} -a patch_l1",
    outage: f"insgnss outage {_SAMPLE} --every 120",
    point: f"insgnss point {_SAMPLE} --output out/point",
    simulate: "insgnss simulate at_rest --output out/rest --seed 1",
    allan: "insgnss allan out/rest/flight.toml --output out/allan",
    track: "insgnss track --cn0 38 --jerk 20 --frequency-bandwidth 5",
    iq: "insgnss iq steep_turns --duration 3 --record out/steep_turns.iq",
    acquire: "insgnss acquire out/steep_turns.iq --rate 4e6",
    margin: "insgnss margin --oscillator tcxo --imu tactical --output out/margin",
    receiver: "insgnss receiver --variants two_stage,one_stage --cn0 40,25 --runs 4",
    campaign: "insgnss campaign imu_grades --output out/campaign",
    columns: "insgnss columns nav",
    models: "insgnss models imus",
}
for _command, _example in EXAMPLES.items():
    # on a line of its own, and short enough for a terminal of 80 columns
    app.command(cls=OwnCommand, epilog=f"Example:\n\n{_example}")(_command)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"insgnss {__version__}")
        raise typer.Exit


@app.callback(
    epilog="Exit codes: " + ", ".join(f"{code} {words}" for code, words in EXIT_CODES.items()) + "."
)
def options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    """Tightly coupled INS/GNSS navigation: logs in, a navigation solution out."""
    raise_at_interrupt()
    # a file's name need not be a text, nor the terminal know every letter
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
