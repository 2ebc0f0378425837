"""``insgnss acquire``: which GPS satellites a recording of raw samples holds, with their delay, Doppler and C/N0."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from insgnss.cli.command import at_least
from insgnss.cli.printing import AsJson, print_json, records, result_console, text_table
from insgnss.cli.progress import telling
from insgnss.constants import S_PER_WEEK


def acquire(
    recording: Annotated[Path, typer.Argument(help="A file of raw samples; see --skip if it has a header.")],
    rate: Annotated[float, typer.Option("--rate", callback=at_least(1.0, 1e10), help="Samples per second.")],
    intermediate: Annotated[
        float,
        typer.Option(
            "--intermediate",
            callback=at_least(-1e10, 1e10),
            help="Frequency of the L1 carrier in the samples, Hz.",
        ),
    ] = 0.0,
    real: Annotated[
        bool, typer.Option("--real", help="Real samples; complex ones are interleaved I, Q.")
    ] = False,
    sample_type: Annotated[str, typer.Option("--type", help="'int8' or 'int16'.")] = "int8",
    order: Annotated[str, typer.Option("--order", help="'iq' or 'qi'.")] = "iq",
    skip: Annotated[
        int,
        typer.Option(
            "--skip", min=0, help="Number of bytes to skip at the start of the file, as of a header."
        ),
    ] = 0,
    start: Annotated[
        float,
        typer.Option(
            "--start",
            callback=at_least(0.0, S_PER_WEEK),
            help="Start of the search, in seconds of the recording.",
        ),
    ] = 0.0,
    look: Annotated[
        int, typer.Option("--look", min=1, max=20, help="Coherent integration in milliseconds.")
    ] = 2,
    looks: Annotated[
        int, typer.Option("--looks", min=1, max=1000, help="Number of looks summed non-coherently.")
    ] = 20,
    doppler: Annotated[
        float, typer.Option("--doppler", callback=at_least(0.0, 1e5), help="Largest Doppler, Hz.")
    ] = 7000.0,
    pfa: Annotated[
        float,
        typer.Option(
            "--pfa", callback=at_least(1e-300, 1.0), help="False-alarm probability of one satellite's search."
        ),
    ] = 1e-3,
    every: Annotated[
        bool,
        typer.Option(
            "--all", help="Also show satellites not found, and peaks that may be cross-correlations."
        ),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Search a recording of GPS L1 samples for all satellites; list C/N0, Doppler and code delay."""
    began = time.perf_counter()
    from insgnss.log.iq_file import IqFile
    from insgnss.studies.samples.search import acquire_recording
    from insgnss.tracking.signal import Sampling

    sampling = Sampling(rate, intermediate, not real)
    with telling("searching"):
        file = IqFile(recording, sampling, sample_type, order, skip)
        table = acquire_recording(file, start, 1e-3 * look, looks, doppler, pfa)
    shown = table if every else table[table["status"] == "found"]
    if as_json:
        print_json({"duration_s": file.duration_s, "satellites": records(shown)})
        return
    rows = (
        (
            *(str(row["sv"]), str(row["status"]), f"{row['cn0_dbhz']:.1f}", f"{row['doppler_hz']:.0f}"),
            *(f"{row['delay_chips']:.2f}", f"{row['statistic'] / row['threshold']:.2f}"),
        )
        for row in shown.to_dict("records")
    )
    heads = ("satellite", "status", "C/N0 dBHz", "Doppler Hz", "delay chips", "over threshold")
    result_console(100).print(text_table(None, heads, rows, left=("satellite", "status")))
    n_satellites = int((table["status"] == "found").sum())
    doubtful = int((table["status"] == "cross_correlation").sum())
    typer.echo(
        f"{file.duration_s:.3f} s of samples; {n_satellites} satellites found; {doubtful} more peaks may be"
        " cross-correlation of the strong ones (--all); nothing was written"
    )
    typer.echo(f"{time.perf_counter() - began:.2f} s in all")
