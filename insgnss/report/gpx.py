"""A run as GPX 1.1: one track, a new segment after each gap, times in UTC, heights above mean sea level."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Final

from insgnss.report.run_time import gps_week, utc_texts
from insgnss.report.sentences import name_of
from insgnss.report.thinning import breaks
from insgnss.report.xml_text import xml_bytes
from insgnss.runs.result import Run
from insgnss.version import __version__

_NAMESPACE: Final = "http://www.topografix.com/GPX/1/1"


def as_gpx(run: Run) -> bytes:
    """Return the run as GPX 1.1; ``ele`` is above mean sea level (EGM96), ``geoidheight`` is the geoid's height."""
    week, nav = gps_week(run), run.nav_with(sea_level=True)
    root = ET.Element("gpx", version="1.1", creator=f"insgnss {__version__}", xmlns=_NAMESPACE)
    track = ET.SubElement(root, "trk")
    ET.SubElement(track, "name").text = name_of(run)
    ET.SubElement(track, "cmt").text = "heights above mean sea level (EGM96)"
    time_s = nav["time_s"].to_numpy()
    begins = {0, *breaks(time_s, time_s).tolist()}
    places = nav[["lat_deg", "lon_deg", "h_msl_m", "geoid_m"]].to_numpy().tolist()
    dates = utc_texts(time_s, week)
    segment = track
    for row, ((lat_deg, lon_deg, h_msl_m, geoid_m), when) in enumerate(zip(places, dates, strict=True)):
        if row in begins:
            segment = ET.SubElement(track, "trkseg")
        point = ET.SubElement(segment, "trkpt", lat=f"{lat_deg:.9f}", lon=f"{lon_deg:.9f}")
        ET.SubElement(point, "ele").text = f"{h_msl_m:.3f}"
        ET.SubElement(point, "time").text = when
        ET.SubElement(point, "geoidheight").text = f"{geoid_m:.3f}"
    ET.indent(root, space=" ")
    return xml_bytes(root)
