"""``insgnss export``: a saved run as a file for maps, GNSS tools, lidar software, MATLAB or xarray."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from insgnss.cli.file_options import Force, SavedRun, run_files
from insgnss.cli.printing import AsJson, print_json
from insgnss.results.saving import EXPORT_KIND, check_file_replaceable, overwriting


def export(
    run: SavedRun,
    output: Annotated[Path, typer.Option("--output", "-o", help="The file to write.")],
    format: Annotated[
        str | None,
        typer.Option("--format", help="One of the formats above; by default that of the file's ending."),
    ] = None,
    at_point: Annotated[
        bool,
        typer.Option(
            "--at-point",
            help="Write the point of the run's --point (a camera, a radar) in place of the IMU.",
        ),
    ] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write a run for another program.

    Maps: kml, kmz, gpx (UTC, height above mean sea level), geojson (height above the ellipsoid).

    Tables: csv (UTC, both heights), mat (MATLAB), nc (NetCDF).

    GNSS tools: pos (RTKLIB), nmea (GGA, RMC, VTG, HDT, GST).

    Lidar and cameras: sbet, and smrmsg for its sigmas (POSPac).

    Mean sea level is the geoid of EGM96.
    """
    began = time.perf_counter()
    with overwriting(force, run_files(run)):
        check_file_replaceable(output, EXPORT_KIND)
        # pandas is loaded only when the command runs
        from insgnss.report.export import export_run
        from insgnss.runs.result import Run

        loaded = Run.load(run)
        written = export_run(loaded, output, format, at_point=at_point)
    if as_json:
        print_json({"rows": len(loaded.nav), "bytes": written.stat().st_size, "wrote": written})
        return
    typer.echo(
        f"wrote {len(loaded.nav)} rows into {written} ({written.stat().st_size / 1e6:.2f} MB);"
        f" {time.perf_counter() - began:.2f} s in all"
    )
