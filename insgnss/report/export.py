"""A run as a file for another program: KML, KMZ, GPX, GeoJSON, CSV."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from insgnss.errors import ConfigError, ResultError
from insgnss.report.geojson import as_geojson
from insgnss.report.gpx import as_gpx
from insgnss.report.kml import as_kml, as_kmz
from insgnss.run import Run
from insgnss.saving import write_file


def as_csv(run: Run) -> bytes:
    """Return the navigation table as CSV, numbers to the last bit."""
    return str(run.nav.to_csv(index=False, float_format="%.17g", lineterminator="\n")).encode()


FORMATS: Final[dict[str, Callable[[Run], bytes]]] = {
    "kml": as_kml,
    "kmz": as_kmz,
    "gpx": as_gpx,
    "geojson": as_geojson,
    "csv": as_csv,
}


def export_run(run: Run, path: str | Path, format: str | None = None) -> Path:
    """Write the run's track in a format, by default the one that the file's ending names; return the path.

    Raises
    ------
    ConfigError : no such format
    ResultError : the run has no navigation row or does not say its GPS week, or the file cannot be written
    """
    path = Path(path)
    wanted = (format or path.suffix.lstrip(".")).lower()
    if wanted not in FORMATS:
        known = ", ".join(FORMATS)
        raise ConfigError(f"'{wanted}' is no format", key="--format", advice=f"write one of {known}")
    if run.nav.empty:
        raise ResultError("the run has no navigation row to write", advice="replay the flight again")
    content = FORMATS[wanted](run)
    try:
        write_file(path, content, "export")
    except OSError as error:
        raise ResultError(
            f"the file cannot be written: {error.strerror}", file=path, advice="give another --output"
        ) from error
    return path
