"""A run as GPX 1.1: one track, a new segment after each gap, times in UTC."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Final

from insgnss.report.run_time import gps_week, utc_texts
from insgnss.report.sentences import name_of
from insgnss.report.thinning import breaks
from insgnss.report.xml_text import xml_bytes
from insgnss.run import Run
from insgnss.version import __version__

_NAMESPACE: Final = "http://www.topografix.com/GPX/1/1"


def as_gpx(run: Run) -> bytes:
    """Return the run as GPX 1.1; ``ele`` is the height above the ellipsoid, the geoid being unknown to the run."""
    week = gps_week(run)
    root = ET.Element("gpx", version="1.1", creator=f"insgnss {__version__}", xmlns=_NAMESPACE)
    track = ET.SubElement(root, "trk")
    ET.SubElement(track, "name").text = name_of(run)
    ET.SubElement(track, "cmt").text = "heights above the WGS-84 ellipsoid"
    time_s = run.nav["time_s"].to_numpy()
    begins = {0, *breaks(time_s, time_s).tolist()}
    places = run.nav[["lat_deg", "lon_deg", "h_m"]].to_numpy().tolist()
    segment = track
    for row, ((lat_deg, lon_deg, h_m), when) in enumerate(zip(places, utc_texts(time_s, week), strict=True)):
        if row in begins:
            segment = ET.SubElement(track, "trkseg")
        point = ET.SubElement(segment, "trkpt", lat=f"{lat_deg:.9f}", lon=f"{lon_deg:.9f}")
        ET.SubElement(point, "ele").text = f"{h_m:.3f}"
        ET.SubElement(point, "time").text = when
    ET.indent(root, space=" ")
    return xml_bytes(root)
