"""A run as GeoJSON (RFC 7946): the track as one line, with its times and sigmas, events as points."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pandas as pd

from insgnss.report.run_time import gps_week, utc_texts
from insgnss.report.sentences import name_of
from insgnss.runs.result import Run


def as_geojson(run: Run) -> bytes:
    """Return the run as a feature collection: longitude, latitude [deg], height above the ellipsoid [m], in this order.

    The line's properties hold ``time_utc`` and ``sd_horizontal_m`` of each of its points.
    """
    week, nav = gps_week(run), run.nav
    times = nav["time_s"].to_numpy()
    dates, places = utc_texts(times, week), _places(nav)
    sigma = np.hypot(nav["sd_n_m"].to_numpy(), nav["sd_e_m"].to_numpy())
    line = {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": places},
        "properties": {
            "name": name_of(run),
            "time_utc": dates,
            "sd_horizontal_m": np.round(sigma, 4).tolist(),
        },
    }
    features: list[dict[str, Any]] = [line]
    if len(nav) == 1:  # a line needs two points
        line["geometry"] = {"type": "Point", "coordinates": places[0]}
    for time_s, kind, detail in zip(
        *(run.events[c].tolist() for c in ("time_s", "kind", "detail")), strict=True
    ):
        if times[0] <= time_s <= times[-1]:
            row = int(np.abs(times - time_s).argmin())
            point = {"type": "Point", "coordinates": places[row]}
            about = {"kind": kind, "detail": detail, "time_utc": dates[row]}
            features.append({"type": "Feature", "geometry": point, "properties": about})
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False).encode()


def _places(nav: pd.DataFrame) -> list[list[float]]:
    """Return longitude, latitude to 0.1 mm and height to 1 mm of each row."""
    rounded = nav[["lon_deg", "lat_deg", "h_m"]].round({"lon_deg": 9, "lat_deg": 9, "h_m": 3})
    places: list[list[float]] = rounded.to_numpy(np.float64).tolist()
    return places
