"""``insgnss demo``: makes the sample flight, replays it and draws its page; nothing but the package is needed."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Final

import typer

from insgnss.cli.file_options import Force
from insgnss.cli.memory import give_back_what_is_freed
from insgnss.cli.printing import AsJson
from insgnss.cli.progress import telling
from insgnss.cli.replay import check_outputs, tell_run, write_run
from insgnss.errors import ResultError
from insgnss.log.flight import Flight
from insgnss.results.saving import check_writable, overwriting, writing
from insgnss.runs.replay import replay as run_replay

FLIGHT_FOLDER: Final = "flight"
PAGE: Final = "report.html"


def demo(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the sample flight's logs, the run and its page."),
    ] = Path("insgnss-demo"),
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a flight of 20 minutes, replay it against its truth, and write its report page."""
    began = time.perf_counter()
    give_back_what_is_freed()
    with overwriting(force):
        check_writable(output / FLIGHT_FOLDER)
        check_outputs(output, output / PAGE)
        with telling("simulating the sample flight") as tell:
            flight = Flight.load(_sample_flight(output / FLIGHT_FOLDER))
            run = run_replay(flight, progress=tell)
            written = write_run(run, output, output / PAGE, "parquet", tell)
    tell_run(flight, run, written, began, as_json=as_json)
    if not as_json:
        typer.echo(
            f"open {output / PAGE} in a browser; the logs and their flight file are in {flight.path.parent}"
        )


def _sample_flight(folder: Path) -> Path:
    """Write the sample flight where it is not yet; return its flight file."""
    # late: the simulation's libraries take every other command half a second and 60 MB
    from insgnss.simulation.sample_flight import FILES, flight_file, write_sample_flight

    path = folder / "flight.toml"
    if all((folder / name).is_file() for name in FILES) and path.read_text(encoding="utf-8") == flight_file():
        return path
    if folder.exists() and any(folder.iterdir()):
        raise ResultError("the folder holds other files", file=folder, advice="give an empty --output folder")
    with writing("the sample flight", folder, "give another --output folder"):
        write_sample_flight(folder)
    return path
