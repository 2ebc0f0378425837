"""Sky plots of the satellites: in the local level and in body axes, with the antenna's gain where it is known."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.report.charts import Chart, Trace, packed
from insgnss.report.epochs import satellites_of
from insgnss.report.html import Section
from insgnss.report.sections.pattern import pattern_traces
from insgnss.report.sections.satellites import state_colour
from insgnss.runs.result import Run

_POINTS_EACH: Final = 200  # of a satellite's way
_POINTS_ALL: Final = 6000
_SCALE_DB: Final = 20.0  # that a scale of gains spans at most
_WAY: Final = "#1b1f24"


def section(run: Run) -> Section | None:
    """Return both sky plots, None where no direction is known."""
    table = run.satellites
    table = table[np.isfinite(table["el_deg"]) & np.isfinite(table["body_el_deg"])]
    if table.empty:
        return None
    table = _thinned(table)
    with_gain = bool(np.isfinite(table["gain_dbi"]).any())
    scale = _scale(table) if with_gain else {}
    behind = pattern_traces(run, scale) if with_gain else []
    local = _chart(table, "", "chart-sky-local", "Local level, north up", scale, [])
    body = _chart(table, "body_", "chart-sky-body", "Body axes, forward up", scale, behind)
    about = (
        f"<p>Colour shows {_told_by_colour(with_gain, bool(behind))}. In the local level the rim is the horizon; in"
        " body axes the middle is straight up and the circle marked 0° is the body's own horizon.</p>"
    )
    return Section("sky", "Sky", before=about, charts=(local, body))


def _told_by_colour(with_gain: bool, with_pattern: bool) -> str:
    if with_pattern:
        return (
            "the gain of the best antenna; in body axes its whole pattern lies behind the satellites' tracks"
        )
    return "the gain of the best antenna" if with_gain else "whether the satellite was used"


def _scale(table: pd.DataFrame) -> dict[str, Any]:
    """Return the colours of the gain: one scale for both plots and the pattern, 20 dB below the best at most."""
    gain = table["gain_dbi"].to_numpy()
    high = float(np.nanmax(gain))
    low = max(min(float(np.nanmin(gain)), high - 1.0), high - _SCALE_DB)
    bar = {"title": {"text": "gain, dBic"}, "thickness": 12, "len": 0.8, "x": 1.1}
    return {"colorscale": "Viridis", "cmin": low, "cmax": high, "colorbar": bar}


def _thinned(table: pd.DataFrame) -> pd.DataFrame:
    """Return every so-manieth row of each satellite."""
    place, names = satellites_of(table)
    each = min(_POINTS_EACH, _POINTS_ALL // max(len(names), 1))
    order = np.argsort(place, kind="stable")
    parts = []
    for rows in np.split(order, np.flatnonzero(np.diff(place[order])) + 1):
        parts.append(rows[np.unique(np.linspace(0, len(rows) - 1, min(each, len(rows))).astype(np.int64))])
    return table.iloc[np.concatenate(parts)]


def _chart(
    table: pd.DataFrame, prefix: str, name: str, title: str, scale: dict[str, Any], behind: list[Trace]
) -> Chart:
    if scale and behind:
        # over a coloured pattern the ways are dark, with the scale's bar
        ways = [_points(table, prefix, "way", {"size": 3, "color": _WAY}), _bar_alone(scale)]
    else:
        ways = [_gain_trace(table, prefix, scale)] if scale else _used_traces(table, prefix)
    traces = [*behind, *ways, _names_trace(table, prefix) | ({"textfont": {"color": _WAY}} if behind else {})]
    deepest = float((90.0 - table[f"{prefix}el_deg"]).max())
    # the half of the sky below the body's horizon only where a satellite stood there
    ticks = [0, 30, 60, 90] if deepest <= 90.0 else [0, 30, 60, 90, 120, 150]
    radial: dict[str, Any] = {
        "range": [0, 90.0 if deepest <= 90.0 else min(30.0 * np.ceil(deepest / 30.0), 180.0)],
        "tickvals": ticks[1:],
        "ticktext": [f"{90 - down}°" for down in ticks[1:]],
        "angle": 67.5,
        "tickangle": 0,
        "showline": False,
        "ticks": "",
        "layer": "above traces",
    }
    words = ("forward", "right", "aft", "left") if prefix else ("N", "E", "S", "W")
    angular = {"rotation": 90, "direction": "clockwise", "tickvals": [0, 90, 180, 270], "ticktext": words}
    layout = {
        "polar": {"radialaxis": radial | {"tickfont": {"size": 10}}, "angularaxis": angular, "bargap": 0},
        "margin": {"l": 44, "r": 44, "t": 30, "b": 30},
        "legend": {"orientation": "h", "y": -0.06, "x": 0},
        "showlegend": not scale,
    }
    return Chart(name, title, traces, layout, 400)


def _bar_alone(scale: dict[str, Any]) -> Trace:
    """Return a trace without a point, which carries the bar of the colours."""
    marker = {"color": [scale["cmin"]], "showscale": True, **scale}
    return {"type": "scatterpolar", "mode": "markers", "r": [None], "theta": [None], "marker": marker}


def _gain_trace(table: pd.DataFrame, prefix: str, scale: dict[str, Any]) -> Trace:
    gain = table["gain_dbi"].to_numpy()
    known = np.isfinite(gain)
    marker = {"size": 5, "color": packed(gain[known]), "showscale": True, **scale}
    return _points(table[known], prefix, "gain", marker)


def _used_traces(table: pd.DataFrame, prefix: str) -> list[Trace]:
    used = (table["state"] == "tracked").to_numpy()
    groups = (("used", used, state_colour("tracked")), ("not used", ~used, state_colour("gated")))
    return [
        _points(table[rows], prefix, name, {"size": 4, "color": c}) for name, rows, c in groups if rows.any()
    ]


def _points(table: pd.DataFrame, prefix: str, name: str, marker: dict[str, Any]) -> Trace:
    return {
        "type": "scatterpolar",
        "mode": "markers",
        "name": name,
        "r": packed(90.0 - table[f"{prefix}el_deg"].to_numpy(np.float64)),
        "theta": packed(table[f"{prefix}az_deg"].to_numpy(np.float64)),
        "text": [f"{sv}, {time_s:.0f} s" for sv, time_s in zip(table["sv"], table["time_s"], strict=True)],
        "hovertemplate": "%{text}<extra></extra>",
        "marker": marker,
    }


def _names_trace(table: pd.DataFrame, prefix: str) -> Trace:
    """Return each satellite's name at its last place."""
    last = table.drop_duplicates("sv", keep="last")
    return {
        "type": "scatterpolar",
        "mode": "text",
        "name": "names",
        "showlegend": False,
        "r": [float(v) for v in 90.0 - last[f"{prefix}el_deg"]],
        "theta": [float(v) for v in last[f"{prefix}az_deg"]],
        "text": [str(sv) for sv in last["sv"]],
        "textposition": "top center",
        "hoverinfo": "skip",
    }
