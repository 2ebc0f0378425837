"""The events on every chart over time: a line across it, and a mark at its top edge that names it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import pandas as pd

from insgnss.report.charts import PALETTE, Chart, Trace, markers, packed
from insgnss.report.html import Section
from insgnss.report.sentences import QUIET
from insgnss.runs.result import Run

MOST: Final = 60  # events that are marked: more would hide what they mark
_AXIS: Final = "yaxis99"  # beyond the rows of any chart
_DETAIL: Final = 160  # letters of an event's words that a mark shows


def marked_events(run: Run) -> pd.DataFrame:
    """Return the events that are marked, in the order of time: of very many those of trouble, and of each kind some."""
    events, time_s = run.events, run.nav["time_s"]
    inside = events[events["time_s"].between(time_s.iloc[0], time_s.iloc[-1])]
    quiet = inside["kind"].isin(QUIET).to_numpy()
    inside = inside.assign(quiet=quiet)
    if len(inside) > MOST:
        # of each kind the first ones: a thousand gaps must not hide the one reset
        inside = inside.assign(nth=inside.groupby("kind").cumcount())
        inside = inside.sort_values(["quiet", "nth"], kind="stable").head(MOST)
    return inside.sort_values("time_s", kind="stable")


def with_events(sections: Sequence[Section], events: pd.DataFrame) -> list[Section]:
    """Return the sections with the events marked on every chart whose x axis is the time."""
    if events.empty:
        return list(sections)
    pairs = zip(events["time_s"].tolist(), events["quiet"].tolist(), strict=True)
    lines = [_line(time_s, _colour(quiet)) for time_s, quiet in pairs]
    marks = _marks(events)
    return [
        replace(section, charts=[_marked(chart, lines, marks) for chart in section.charts])
        for section in sections
    ]


def _marked(chart: Chart, lines: list[dict[str, Any]], marks: Trace) -> Chart:
    if not chart.linked:
        return chart
    first = chart.layout.get("yaxis", {}).get("domain", [0.0, 1.0])
    axis = {"overlaying": "y", "domain": first, "range": [0.0, 1.0], "visible": False, "fixedrange": True}
    layout = {**chart.layout, _AXIS: axis, "shapes": [*chart.layout.get("shapes", []), *lines]}
    return replace(chart, traces=[*chart.traces, marks], layout=layout)


def _colour(quiet: bool) -> str:
    return PALETTE[6] if quiet else PALETTE[1]


def _line(time_s: float, colour: str) -> dict[str, Any]:
    style = {"color": colour, "width": 1, "dash": "dot"}
    ends = {"x0": time_s, "x1": time_s, "y0": 0.0, "y1": 1.0}
    return {"type": "line", "xref": "x", "yref": "paper", "layer": "below", "line": style, **ends}


def _marks(events: pd.DataFrame) -> Trace:
    words = [f"{row.kind}: {row.detail}" for row in events.itertuples()]
    x, y = packed(events["time_s"].to_numpy(), double=True), packed([0.97] * len(events))
    colours = [_colour(quiet) for quiet in events["quiet"]]
    marker = {"symbol": "triangle-down", "size": 9, "color": colours}
    hover = {
        "text": [_for_hover(text) for text in words],
        "hovertemplate": "%{x:.2f} s: %{text}<extra></extra>",
    }
    return markers("events", x, y, marker, **hover, yaxis=_AXIS.replace("axis", ""), showlegend=False)


def _for_hover(words: str) -> str:
    """Return words cut to length that Plotly cannot take for its own marks of bold or links."""
    short = words if len(words) <= _DETAIL else f"{words[: _DETAIL - 3]}..."
    return short.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
