"""A run as a file for another program: one writer for each format, each in a module of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from insgnss.errors import ConfigError, ResultError
from insgnss.report.geojson import as_geojson
from insgnss.report.gpx import as_gpx
from insgnss.report.kml import as_kml, as_kmz
from insgnss.report.matlab import as_mat
from insgnss.report.netcdf import WHOSE_PLACE, as_netcdf
from insgnss.report.nmea import as_nmea
from insgnss.report.rtklib_pos import as_pos
from insgnss.report.sbet import as_sbet, as_smrmsg
from insgnss.report.utc_csv import as_csv
from insgnss.results.saving import EXPORT_KIND, write_file, writing
from insgnss.runs.result import Run

# by the ending of the file, which --format may replace
FORMATS: Final[dict[str, Callable[[Run], bytes]]] = {
    "kml": as_kml,
    "kmz": as_kmz,
    "gpx": as_gpx,
    "geojson": as_geojson,
    "csv": as_csv,
    "pos": as_pos,
    "nmea": as_nmea,
    "sbet": as_sbet,
    "smrmsg": as_smrmsg,
    "mat": as_mat,
    "nc": as_netcdf,
}


def export_run(run: Run, path: str | Path, format: str | None = None, *, at_point: bool = False) -> Path:
    """Write the run in a format, by default the one that the file's ending names; return the path.

    Parameters
    ----------
    at_point : whether position, velocity and their sigmas are those of the further point of the body that the run was
        replayed with (``point=``), in place of the IMU's

    Raises
    ------
    ConfigError : no such format
    ResultError : the run has no navigation row, no such point or does not say its GPS week, a library that the format
        needs is not installed, or the file cannot be written
    """
    path = Path(path)
    wanted = (format or path.suffix.lstrip(".")).lower()
    if wanted not in FORMATS:
        known = ", ".join(FORMATS)
        raise ConfigError(f"unknown format '{wanted}'", key="--format", advice=f"write one of {known}")
    if run.nav.empty:
        raise ResultError("the run has no navigation row to write", advice="replay the flight again")
    content = FORMATS[wanted](_moved_to_point(run) if at_point else run)
    with writing("the file", path, "give another --output"):
        write_file(path, content, EXPORT_KIND)
    return path


def _moved_to_point(run: Run) -> Run:
    """Return the run with its further point in place of the IMU, without the covariances of the IMU's errors."""
    if "point_lat_deg" not in run.nav:
        advice = (
            "replay the flight with --point: insgnss replay FLIGHT --point FORWARD,RIGHT,DOWN --output FOLDER"
        )
        raise ResultError("the run has no further point of the body", advice=advice)
    names = {name: name.replace("point_", "", 1) for name in map(str, run.nav) if "point_" in name}
    of_imu = [name for name in map(str, run.nav) if name.startswith("cov_")]
    nav = run.nav.drop(columns=[*names, *of_imu]).assign(
        **{ours: run.nav[name].to_numpy() for name, ours in names.items()}
    )
    nav.attrs = run.nav.attrs | {WHOSE_PLACE: "the further point of the body"}
    return replace(run, nav=nav)
