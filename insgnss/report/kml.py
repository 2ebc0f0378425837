"""A run as KML and KMZ: the track at its height, over time and on the ground, and the events that have a place."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
import zipfile
from typing import Final

import numpy as np
import pandas as pd

from insgnss.report.run_time import gps_week, utc_texts
from insgnss.report.sentences import name_of, sentences
from insgnss.report.xml_text import xml_bytes
from insgnss.results.nav_columns import EVENT
from insgnss.runs.result import Run

_NAMESPACE: Final = "http://www.opengis.net/kml/2.2"
_GOOGLE: Final = "http://www.google.com/kml/ext/2.2"  # of gx:Track
_PLACE: Final = ["lon_deg", "lat_deg", "h_msl_m"]
_NEVER_ZIPPED_BEFORE: Final = (1980, 1, 1, 0, 0, 0)  # the same run gives the same bytes


def as_kml(run: Run) -> bytes:
    """Return the run as a KML 2.2 document: lines in the air and on the ground, a track over time, start, end, events.

    Heights are above mean sea level (EGM96), as viewers take them, and drawn there. A car may then be below the
    viewer's terrain: the line on the ground shows it all the same. Times are UTC.
    """
    week, nav = gps_week(run), run.nav_with(sea_level=True)
    root = ET.Element("kml", {"xmlns": _NAMESPACE, "xmlns:gx": _GOOGLE})
    document = ET.SubElement(root, "Document")
    ET.SubElement(document, "name").text = name_of(run)
    ET.SubElement(document, "description").text = "\n".join(sentences(run))
    style = ET.SubElement(ET.SubElement(document, "Style", id="track"), "LineStyle")
    ET.SubElement(style, "color").text = "ffb27200"  # alpha, blue, green, red
    ET.SubElement(style, "width").text = "3"
    dates = utc_texts(nav["time_s"].to_numpy(), week)
    for name, mode in (("track", "absolute"), ("track on the ground", "clampToGround")):
        _line(document, name, mode, nav, dates)
    _track(document, nav, dates)
    _points(document, run, nav, dates)
    ET.indent(root)
    return xml_bytes(root)


def as_kmz(run: Run) -> bytes:
    """Return the KML document as the one file of a ZIP archive, as viewers expect it."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as files:
        files.writestr(zipfile.ZipInfo("doc.kml", _NEVER_ZIPPED_BEFORE), as_kml(run), zipfile.ZIP_DEFLATED)
    return archive.getvalue()


def _placemark(document: ET.Element, name: str) -> ET.Element:
    mark = ET.SubElement(document, "Placemark")
    ET.SubElement(mark, "name").text = name
    return mark


def _line(document: ET.Element, name: str, altitude_mode: str, nav: pd.DataFrame, dates: list[str]) -> None:
    """Add the whole track as a line."""
    mark = _placemark(document, name)
    span = ET.SubElement(mark, "TimeSpan")
    ET.SubElement(span, "begin").text = dates[0]
    ET.SubElement(span, "end").text = dates[-1]
    ET.SubElement(mark, "styleUrl").text = "#track"
    line = ET.SubElement(mark, "LineString")
    ET.SubElement(line, "tessellate").text = "1"
    ET.SubElement(line, "altitudeMode").text = altitude_mode
    places = nav[_PLACE].to_numpy().tolist()
    ET.SubElement(line, "coordinates").text = " ".join(_place(*place) for place in places)


def _track(document: ET.Element, nav: pd.DataFrame, dates: list[str]) -> None:
    """Add the track with the time of each place, which viewers play; all times first, as the schema wants."""
    mark = _placemark(document, "track over time")
    track = ET.SubElement(mark, "gx:Track")
    ET.SubElement(track, "altitudeMode").text = "absolute"
    for date in dates:
        ET.SubElement(track, "when").text = date
    for place in nav[_PLACE].to_numpy().tolist():
        ET.SubElement(track, "gx:coord").text = _place(*place).replace(",", " ")


def _points(document: ET.Element, run: Run, nav: pd.DataFrame, dates: list[str]) -> None:
    """Add start, end, and the events inside the run at the nearest row."""
    times = nav["time_s"].to_numpy()
    points = [("start", "", 0), ("end", "", len(nav) - 1)]
    for time_s, kind, detail in zip(*(run.events[c].tolist() for c in EVENT), strict=True):
        if times[0] <= time_s <= times[-1]:
            points.append((kind, detail, int(np.abs(times - time_s).argmin())))
    for name, detail, row in points:
        mark = _placemark(document, name)
        if detail:
            ET.SubElement(mark, "description").text = detail
        stamp = ET.SubElement(mark, "TimeStamp")
        ET.SubElement(stamp, "when").text = dates[row]
        point = ET.SubElement(mark, "Point")
        ET.SubElement(point, "altitudeMode").text = "absolute"
        ET.SubElement(point, "coordinates").text = _place(*nav[_PLACE].iloc[row].tolist())


def _place(lon_deg: float, lat_deg: float, h_msl_m: float) -> str:
    return f"{lon_deg:.9f},{lat_deg:.9f},{h_msl_m:.3f}"
