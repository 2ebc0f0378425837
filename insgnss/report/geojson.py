"""A run as GeoJSON (RFC 7946): the track as one line, with its times and sigmas, events as points."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from insgnss.report.run_time import gps_week, utc_texts
from insgnss.report.sentences import name_of
from insgnss.results.nav_columns import EVENT
from insgnss.runs.result import Run
from insgnss.tables import Float64, Int64


def as_geojson(run: Run) -> bytes:
    """Return the run as a feature collection: longitude, latitude [deg], height above the ellipsoid [m], in this order.

    The line's properties hold ``time_utc`` and ``sd_horizontal_m`` of each of its points. A track over the antimeridian
    is a MultiLineString whose parts end and begin at it, and its properties are in the same parts.
    """
    week, nav = gps_week(run), run.nav
    times = nav["time_s"].to_numpy()
    dates, places = utc_texts(times, week), _places(nav)
    features: list[dict[str, Any]] = [_track(nav, week) | {"type": "Feature"}]
    features[0]["properties"]["name"] = name_of(run)
    if len(nav) == 1:  # a line needs two points
        features[0]["geometry"] = {"type": "Point", "coordinates": places[0]}
    for time_s, kind, detail in zip(*(run.events[c].tolist() for c in EVENT), strict=True):
        if times[0] <= time_s <= times[-1]:
            row = int(np.abs(times - time_s).argmin())
            point = {"type": "Point", "coordinates": places[row]}
            about = {"kind": kind, "detail": detail, "time_utc": dates[row]}
            features.append({"type": "Feature", "geometry": point, "properties": about})
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False).encode()


def _track(nav: pd.DataFrame, week: int) -> dict[str, Any]:
    """Return geometry and properties of the track, in parts where it crosses the antimeridian (RFC 7946, 3.1.9).

    Each part ends or begins at +-180 deg with the latitude, height, time and sigma interpolated straight.
    """
    points = nav[["lon_deg", "lat_deg", "h_m", "time_s"]].copy()
    points["sigma_m"] = np.hypot(nav["sd_n_m"].to_numpy(), nav["sd_e_m"].to_numpy())
    values = points.to_numpy(np.float64)
    before = np.flatnonzero(np.abs(np.diff(values[:, 0])) > 180.0)
    ends = _at_antimeridian(values, before)
    begins = ends * np.array([-1.0, 1.0, 1.0, 1.0, 1.0])
    inserted = np.insert(values, np.repeat(before + 1, 2), np.stack([ends, begins], 1).reshape(-1, 5), axis=0)
    points = pd.DataFrame(inserted, columns=points.columns)
    dates, places = utc_texts(points["time_s"].to_numpy(), week), _places(points)
    sigmas = np.round(inserted[:, 4], 4).tolist()
    cuts = [0, *(before + 2 + 2 * np.arange(len(before))).tolist(), len(inserted)]
    parts = [slice(*pair) for pair in pairwise(cuts)]
    if len(parts) == 1:
        geometry = {"type": "LineString", "coordinates": places}
        return {"geometry": geometry, "properties": {"time_utc": dates, "sd_horizontal_m": sigmas}}
    geometry = {"type": "MultiLineString", "coordinates": [places[part] for part in parts]}
    properties = {
        "time_utc": [dates[part] for part in parts],
        "sd_horizontal_m": [sigmas[part] for part in parts],
    }
    return {"geometry": geometry, "properties": properties}


def _at_antimeridian(values: Float64, before: Int64) -> Float64:
    """Return the points at which the steps after these rows reach the antimeridian, on the side that they leave."""
    one, two = values[before], values[before + 1]
    side = np.where(one[:, 0] > 0.0, 180.0, -180.0)
    way = np.abs(side - one[:, 0]) + np.abs(-side - two[:, 0])
    share = np.divide(np.abs(side - one[:, 0]), way, out=np.zeros(len(way)), where=way > 0.0)
    ends: Float64 = one + share[:, None] * (two - one)
    ends[:, 0] = side
    return ends


def _places(nav: pd.DataFrame) -> list[list[float]]:
    """Return longitude, latitude to 0.1 mm and height to 1 mm of each row."""
    rounded = nav[["lon_deg", "lat_deg", "h_m"]].round({"lon_deg": 9, "lat_deg": 9, "h_m": 3})
    places: list[list[float]] = rounded.to_numpy(np.float64).tolist()
    return places
