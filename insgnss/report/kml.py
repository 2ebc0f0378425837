"""A run as KML and KMZ: the track and the events that have a place, for Google Earth and its like."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
import zipfile
from typing import Final

import numpy as np

from insgnss.report.run_time import gps_week, utc_texts
from insgnss.report.sentences import name_of, sentences
from insgnss.report.xml_text import xml_bytes
from insgnss.run import Run

_NAMESPACE: Final = "http://www.opengis.net/kml/2.2"
_NEVER_ZIPPED_BEFORE: Final = (1980, 1, 1, 0, 0, 0)  # the same run gives the same bytes


def as_kml(run: Run) -> bytes:
    """Return the run as a KML 2.2 document: a line, start, end and the events at their places.

    Heights are above the ellipsoid, while viewers take them as above the sea: they are drawn clamped to the ground and
    stand in the file all the same. Times are UTC.
    """
    week = gps_week(run)
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = ET.SubElement(root, "Document")
    ET.SubElement(document, "name").text = name_of(run)
    ET.SubElement(document, "description").text = "\n".join(sentences(run))
    style = ET.SubElement(ET.SubElement(document, "Style", id="track"), "LineStyle")
    ET.SubElement(style, "color").text = "ffb27200"  # alpha, blue, green, red
    ET.SubElement(style, "width").text = "3"
    track = ET.SubElement(document, "Placemark")
    ET.SubElement(track, "name").text = "track"
    nav = run.nav
    span = ET.SubElement(track, "TimeSpan")
    first, last = utc_texts(nav["time_s"].to_numpy()[[0, -1]], week)
    ET.SubElement(span, "begin").text = first
    ET.SubElement(span, "end").text = last
    ET.SubElement(track, "styleUrl").text = "#track"
    line = ET.SubElement(track, "LineString")
    ET.SubElement(line, "tessellate").text = "1"
    ET.SubElement(line, "altitudeMode").text = "clampToGround"
    places = nav[["lon_deg", "lat_deg", "h_m"]].to_numpy().tolist()
    ET.SubElement(line, "coordinates").text = " ".join(_place(*place) for place in places)
    _points(document, run, week)
    ET.indent(root)
    return xml_bytes(root)


def as_kmz(run: Run) -> bytes:
    """Return the KML document as the one file of a ZIP archive, as viewers expect it."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as files:
        files.writestr(zipfile.ZipInfo("doc.kml", _NEVER_ZIPPED_BEFORE), as_kml(run), zipfile.ZIP_DEFLATED)
    return archive.getvalue()


def _points(document: ET.Element, run: Run, week: int) -> None:
    """Add start, end, and the events inside the run at the nearest row."""
    nav, times = run.nav, run.nav["time_s"].to_numpy()
    points = [("start", "", 0), ("end", "", len(nav) - 1)]
    for time_s, kind, detail in zip(
        *(run.events[c].tolist() for c in ("time_s", "kind", "detail")), strict=True
    ):
        if times[0] <= time_s <= times[-1]:
            points.append((kind, detail, int(np.abs(times - time_s).argmin())))
    for name, detail, row in points:
        mark = ET.SubElement(document, "Placemark")
        ET.SubElement(mark, "name").text = name
        if detail:
            ET.SubElement(mark, "description").text = detail
        stamp = ET.SubElement(mark, "TimeStamp")
        ET.SubElement(stamp, "when").text = utc_texts(times[row : row + 1], week)[0]
        place = nav[["lon_deg", "lat_deg", "h_m"]].iloc[row]
        ET.SubElement(ET.SubElement(mark, "Point"), "coordinates").text = _place(*place.tolist())


def _place(lon_deg: float, lat_deg: float, h_m: float) -> str:
    return f"{lon_deg:.9f},{lat_deg:.9f},{h_m:.3f}"
