"""Where the satellites stood: in the local level and in the body, coloured by the antenna's gain where it is known."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pandas as pd

from insgnss.report.charts import Chart, Trace, packed
from insgnss.report.epochs import satellites_of
from insgnss.report.html import Section
from insgnss.report.sections.satellites import STATE_COLOURS
from insgnss.run import Run

_POINTS_EACH: Final = 200  # of a satellite's way
_POINTS_ALL: Final = 6000


def section(run: Run) -> Section | None:
    """Return both sky plots, None where no direction is known."""
    table = run.satellites
    table = table[np.isfinite(table["el_deg"]) & np.isfinite(table["body_el_deg"])]
    if table.empty:
        return None
    table = _thinned(table)
    with_gain = bool(np.isfinite(table["gain_dbi"]).any())
    coloured = "the gain of the best antenna" if with_gain else "whether the satellite was used"
    local = _chart(table, "", "chart-sky-local", "Sky in the local level (north up)", with_gain)
    body = _chart(table, "body_", "chart-sky-body", "Sky in body axes (forward up)", with_gain)
    about = (
        f"<p>Colour tells {coloured}. In the local level the rim is the horizon; in body axes the inner circle is the"
        " body's own horizon and the rim is straight below it.</p>"
    )
    return Section("sky", "Sky", before=about, charts=(local, body))


def _thinned(table: pd.DataFrame) -> pd.DataFrame:
    """Return every so-manieth row of each satellite."""
    place, names = satellites_of(table)
    each = min(_POINTS_EACH, _POINTS_ALL // max(len(names), 1))
    order = np.argsort(place, kind="stable")
    kept = []
    for rows in np.split(order, np.flatnonzero(np.diff(place[order])) + 1):
        kept.append(rows[np.unique(np.linspace(0, len(rows) - 1, min(each, len(rows))).astype(np.int64))])
    return table.iloc[np.concatenate(kept)]


def _chart(table: pd.DataFrame, prefix: str, name: str, title: str, with_gain: bool) -> Chart:
    traces = [_gain_trace(table, prefix)] if with_gain else _used_traces(table, prefix)
    traces.append(_names_trace(table, prefix))
    ticks = [0, 45, 90, 135, 180] if prefix else [0, 30, 60, 90]
    words = [f"{90 - down}°" for down in ticks]
    radial: dict[str, Any] = {"range": [0, ticks[-1]], "tickvals": ticks, "ticktext": words, "angle": 90}
    angular = {"rotation": 90, "direction": "clockwise"}
    if prefix:
        angular |= {"tickvals": [0, 90, 180, 270], "ticktext": ["forward", "right", "aft", "left"]}
    layout = {
        "polar": {"radialaxis": radial | {"tickfont": {"size": 10}}, "angularaxis": angular},
        "margin": {"l": 40, "r": 40, "t": 40, "b": 30},
        "legend": {"orientation": "h", "y": -0.08, "x": 0},
    }
    return Chart(name, title, traces, layout, 480)


def _gain_trace(table: pd.DataFrame, prefix: str) -> Trace:
    gain = table["gain_dbi"].to_numpy()
    known = np.isfinite(gain)
    marker = {"size": 4, "color": packed(gain[known]), "colorscale": "Viridis", "showscale": True}
    marker |= {"colorbar": {"title": {"text": "gain, dBi"}, "thickness": 12, "len": 0.8}}
    return _points(table[known], prefix, "gain", marker)


def _used_traces(table: pd.DataFrame, prefix: str) -> list[Trace]:
    used = (table["state"] == "tracked").to_numpy()
    groups = (("used", used, STATE_COLOURS["tracked"]), ("not used", ~used, STATE_COLOURS["gated"]))
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
