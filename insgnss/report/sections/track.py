"""The track from above, without any map server: metres east and north of the start."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd
import pymap3d

from insgnss.report.charts import PALETTE, Chart, Trace, lines, markers, packed
from insgnss.report.epochs import used_at
from insgnss.report.html import Section
from insgnss.report.thinning import envelope
from insgnss.results.nav_columns import PLACE
from insgnss.runs.result import Run
from insgnss.tables import Float64

_POINTS: Final = 3000
_FROM_KM: Final = 5000.0  # m across, from which the axes are in kilometres
_TILE_CORNERS: Final = 500  # points of the track over tiles


def east_north(nav: pd.DataFrame) -> tuple[Float64, Float64]:
    """Return metres east and north of the first row, on the plane there."""
    first = nav.iloc[0]
    at = (first["lat_deg"], first["lon_deg"], first["h_m"])
    here = (nav[name].to_numpy() for name in PLACE)
    east, north, _ = pymap3d.geodetic2enu(*here, *at)
    return np.asarray(east, np.float64), np.asarray(north, np.float64)


def horizontal_sigma(nav: pd.DataFrame) -> Float64:
    """Return the sigma of the horizontal position [m]: the root of the sum of both variances."""
    return np.asarray(np.hypot(nav["sd_n_m"].to_numpy(), nav["sd_e_m"].to_numpy()))


def section(run: Run) -> Section:
    """Return the map: the track coloured by its sigma or by the satellites used, the reference below it."""
    nav = run.nav
    east, north = east_north(nav)
    scale = 1e-3 if max(np.ptp(east), np.ptp(north)) > _FROM_KM else 1.0
    east, north = scale * east, scale * north
    sigma, used = horizontal_sigma(nav), used_at(run, nav["time_s"].to_numpy())
    points = envelope(np.column_stack([east, north, sigma]), _POINTS)
    traces = [
        *_reference(run, east, north, scale),
        _track(nav, east, north, sigma, points),
        *_ends(east, north),
    ]
    chosen = traces.index(next(t for t in traces if t["name"] == "track"))
    by_sigma: dict[str, Any] = {
        "marker.color": [packed(sigma[points])],
        "marker.colorbar.title.text": "sigma, m",
    }
    by_sigma |= {"marker.cmin": [_low(sigma)], "marker.cmax": [_high(sigma)]}
    by_used: dict[str, Any] = {
        "marker.color": [packed(used[points])],
        "marker.colorbar.title.text": "satellites",
    }
    by_used |= {"marker.cmin": [float(used.min())], "marker.cmax": [float(max(used.max(), used.min() + 1))]}
    unit = "km" if scale != 1.0 else "m"
    layout = {
        "xaxis": {"title": {"text": f"east of the start, {unit}"}},
        "yaxis": {"title": {"text": f"north of the start, {unit}"}, "scaleanchor": "x"},
        "updatemenus": [_buttons([("by sigma", by_sigma), ("by satellites used", by_used)], chosen)],
        "margin": {"l": 66, "r": 12, "t": 44, "b": 44},
        "legend": {"orientation": "h", "y": -0.16, "x": 0},
    }
    caption = "Horizontal sigma is the root of the summed variances north and east; its colours end at the 98 % point."
    chart = Chart("chart-track", "Track from above", traces, layout, 520, caption)
    return Section("map", "Map", charts=(chart, _over_tiles(nav)))


def _track(nav: pd.DataFrame, east: Float64, north: Float64, sigma: Float64, points: Any) -> Trace:
    """Return the track as points, coloured by sigma."""
    place = nav[["lat_deg", "lon_deg", "time_s"]].to_numpy()[points]
    marker = {"size": 5, "color": packed(sigma[points]), "cmin": _low(sigma), "cmax": _high(sigma)}
    marker |= {"colorscale": "Viridis", "showscale": True}
    marker |= {"colorbar": {"title": {"text": "sigma, m"}, "thickness": 12, "len": 0.8}}
    where, when = "%{customdata[0]:.7f}°, %{customdata[1]:.7f}°", "%{customdata[2]:.2f} s"
    hover = f"{where}<br>{when}<br>%{{marker.color:.3g}}<extra></extra>"
    more = {"showlegend": False, "customdata": packed(place, double=True), "hovertemplate": hover}
    return markers("track", packed(east[points]), packed(north[points]), marker, **more)


def _over_tiles(nav: pd.DataFrame) -> Chart:
    """Return the track over street-map tiles, which the browser fetches once the reader opens the fold."""
    place = nav[["lat_deg", "lon_deg"]].to_numpy()
    lat, lon = place[envelope(place, _TILE_CORNERS)].T
    line = {"color": PALETTE[1], "width": 3}
    trace = {
        "type": "scattermap",
        "mode": "lines",
        "lat": packed(lat, True),
        "lon": packed(lon, True),
        "line": line,
    }
    # 360 degrees fill 512 pixels at zoom 0; a drawing of 500 pixels is left a fifth free
    across = max(float(np.ptp(lat)) / np.cos(np.radians(lat.mean())), float(np.ptp(lon)), 1e-5)
    zoom = min(np.log2(360.0 * 0.8 * 500.0 / 512.0 / across), 17.0)
    centre = {"lat": float(lat.min() + lat.max()) / 2.0, "lon": float(lon.min() + lon.max()) / 2.0}
    layout = {
        "map": {"style": "open-street-map", "center": centre, "zoom": float(zoom)},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "showlegend": False,
        "dragmode": "pan",
    }
    fold = "Over a street map (fetches tiles from openstreetmap.org)"
    return Chart("chart-tiles", "Over a street map", [trace], layout, 500, on_request=fold)


def _reference(run: Run, east: Float64, north: Float64, scale: float) -> list[Trace]:
    """Return the reference's track: the estimate less its error, where there is one."""
    if run.errors is None or run.errors.empty:
        return []
    at = np.searchsorted(run.nav["time_s"].to_numpy(), run.errors["time_s"].to_numpy())
    at = np.minimum(at, len(east) - 1)
    x = east[at] - scale * run.errors["d_e_m"].to_numpy()
    y = north[at] - scale * run.errors["d_n_m"].to_numpy()
    points = envelope(np.column_stack([x, y]), _POINTS)
    line = {"color": PALETTE[6], "width": 1}
    return [lines("reference", packed(x[points]), packed(y[points]), line, hoverinfo="skip")]


def _ends(east: Float64, north: Float64) -> list[Trace]:
    return [
        markers(
            *(name, [float(east[row])], [float(north[row])]),
            {"size": 12, "symbol": symbol, "color": colour},
            hoverinfo="name",
        )
        for name, row, symbol, colour in (
            ("start", 0, "triangle-up", PALETTE[2]),
            ("end", -1, "square", PALETTE[1]),
        )
    ]


def _buttons(choices: list[tuple[str, dict[str, Any]]], trace: int) -> dict[str, Any]:
    buttons = [{"label": word, "method": "restyle", "args": [change, [trace]]} for word, change in choices]
    # the active button is light whatever the page is: dark letters on both
    return {
        "type": "buttons",
        "direction": "right",
        "buttons": buttons,
        "x": 0,
        "y": 1.02,
        "xanchor": "left",
        "yanchor": "bottom",
        "font": {"color": "#1b1f24"},
        "bgcolor": "#d5dae0",
    }


def _low(sigma: Float64) -> float:
    return float(np.nanmin(sigma))


def _high(sigma: Float64) -> float:
    return max(float(np.nanquantile(sigma, 0.98)), _low(sigma) * 1.01 + 1e-9)
