"""A chart of the page: traces and layout as plain data, numbers packed, the way Plotly's own script reads them."""

from __future__ import annotations

import base64
import colorsys
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from insgnss.report.thinning import breaks, envelope, line
from insgnss.tables import Float64

LINE_POINTS: Final = 1200  # of a line: more than one to each pixel
# Okabe and Ito's colours, which the colour-blind can distinguish; read on white and on black
PALETTE: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c8c8c", "#b8a800")
BAND_SIGMAS: Final = 3.0
_SYMBOLS: Final = ("circle", "diamond", "square", "triangle-up", "cross")
_DASHES: Final = ("solid", "dot", "dash", "dashdot", "longdash")
_FEW_DECADES: Final = 3  # of a logarithmic axis, with room for three ticks each
_NARROW: Final = 4.0  # largest by smallest, below which such an axis has no tick of its own to show
_MANY_DECADES: Final = 7  # without room for a tick at each

Trace = dict[str, Any]


@dataclass(frozen=True)
class Chart:
    """One drawing of the page, with its caption."""

    name: str  # letters, digits and dashes: the place on the page
    title: str
    traces: Sequence[Trace]
    layout: Mapping[str, Any]
    height_px: int = 320
    caption: str = ""
    linked: bool = False  # its x axis is the time, and moves with all the others
    on_request: str = ""  # words of a fold that it is drawn in once the reader opens it: what needs a network

    def data(self) -> dict[str, Any]:
        """Return the data for the page's script."""
        drawn = {"data": self.traces, "layout": dict(self.layout)}
        return {"name": self.name, "title": self.title, "linked": self.linked, **drawn}


@dataclass
class ChartRows:
    """The traces of a chart of several rows with one time axis, filled row by row."""

    labels: Sequence[str]  # of the rows' y axes, top first
    traces: list[Trace] = field(default_factory=list)
    ranges: dict[int, tuple[float, float]] = field(default_factory=dict)
    kinds: dict[int, str] = field(default_factory=dict)  # "log" where a row's axis is
    more: dict[int, dict[str, Any]] = field(default_factory=dict)  # of a row's y axis

    def add(self, row: int, trace: Trace) -> None:
        """Put a trace into a row, counted from 0."""
        place = "" if row == 0 else str(row + 1)
        self.traces.append({**trace, "xaxis": "x", "yaxis": f"y{place}"})

    def layout(self, **more: Any) -> dict[str, Any]:
        """Return the layout: rows of one height below each other, the time at the foot."""
        n, gap = len(self.labels), 0.04
        height = (1.0 - gap * (n - 1)) / n
        layout: dict[str, Any] = {"xaxis": TIME_AXIS | {"anchor": _y(n - 1)}}
        for row, text in enumerate(self.labels):
            top = 1.0 - row * (height + gap)
            axis: dict[str, Any] = {
                "title": {"text": text},
                "domain": [max(top - height, 0.0), top],
                "anchor": "x",
            }
            if row in self.ranges:
                axis["range"] = list(self.ranges[row])
            if row in self.kinds:
                axis |= {"type": self.kinds[row]} | log_ticks(self._values(row))
            axis |= self.more.get(row, {})
            layout["yaxis" + ("" if row == 0 else str(row + 1))] = axis
        return layout | more

    def _values(self, row: int) -> Float64:
        """Return all values drawn in a row."""
        mine = [t for t in self.traces if t["yaxis"] == _y(row)]
        return np.concatenate([unpacked(t["y"]) for t in mine]) if mine else np.empty(0)

    def chart(self, name: str, title: str, *, row_px: int = 170, caption: str = "", **layout: Any) -> Chart:
        """Return the chart."""
        height = 70 + row_px * len(self.labels)
        return Chart(name, title, self.traces, self.layout(**layout), height, caption, linked=True)


# plain seconds, as in the tables: 293800, not 293.8k
TIME_AXIS: Final[Trace] = {"title": {"text": "time, s of the GPS week"}, "tickformat": "d"}


def _y(row: int) -> str:
    return "y" if row == 0 else f"y{row + 1}"


def packed(values: npt.ArrayLike, double: bool = False) -> dict[str, Any]:
    """Return numbers as Plotly reads them packed: four bytes each, eight where ``double``."""
    array = np.ascontiguousarray(values, "<f8" if double else "<f4")
    data = {"dtype": "f8" if double else "f4", "bdata": base64.b64encode(array.tobytes()).decode()}
    return data if array.ndim == 1 else data | {"shape": ", ".join(str(size) for size in array.shape)}


def unpacked(values: Mapping[str, Any]) -> Float64:
    """Return the input of ``packed``, to the precision kept."""
    return np.frombuffer(base64.b64decode(values["bdata"]), "<" + values["dtype"]).astype(np.float64)


def log_ticks(values: Float64) -> dict[str, Any]:
    """Return the ticks of a logarithmic axis, written in full: 1, 2 and 5 of each decade, of many the decades alone."""
    shown = values[np.isfinite(values) & (values > 0.0)]
    if len(shown) == 0 or shown.max() < _NARROW * shown.min():
        return {}
    decades = np.arange(np.floor(np.log10(shown.min())), np.ceil(np.log10(shown.max())) + 1.0)
    steps = (1.0, 2.0, 5.0) if len(decades) <= _FEW_DECADES else (1.0,)
    if len(decades) > _MANY_DECADES:
        decades = decades[::2]
    ticks = [step * 10.0 ** float(decade) for decade in decades for step in steps]
    return {"tickvals": ticks, "ticktext": [f"{tick:g}".replace("e-0", "e-") for tick in ticks]}


def lines(name: str, x: Any, y: Any, line: dict[str, Any], **more: Any) -> Trace:
    """Return a line through points as they are given, packed or not."""
    return {"type": "scatter", "mode": "lines", "name": name, "x": x, "y": y, "line": line, **more}


def markers(name: str, x: Any, y: Any, marker: dict[str, Any], **more: Any) -> Trace:
    """Return points as they are given, packed or not."""
    return {"type": "scatter", "mode": "markers", "name": name, "x": x, "y": y, "marker": marker, **more}


def line_trace(
    time_s: Float64,
    values: Float64,
    name: str,
    colour: str,
    *,
    period: float | None = None,
    at_most: int = LINE_POINTS,
    **more: Any,
) -> Trace:
    """Return a line over time, thinned to ``at_most`` points with its envelope kept and broken at its gaps."""
    x, y = line(time_s, values, at_most, period)
    style = {"color": colour, "width": 1.5} | more.pop("line", {})
    return lines(name, packed(x, double=True), packed(y), style, **more)


def band_trace(
    time_s: Float64, middle: Float64, sigma: Float64, colour: str, *, period: float | None = None
) -> Trace:
    """Return the band of three sigma around ``middle``: one filled area from each break of the line to the next.

    The band of an angle is never wider than the circle.
    """
    half = BAND_SIGMAS * sigma if period is None else np.minimum(BAND_SIGMAS * sigma, period / 2.0)
    edges = np.unique(np.concatenate([[0], breaks(time_s, middle, period), [len(time_s)]]))
    at_most = max(LINE_POINTS // max(len(edges) - 1, 1), 20)
    x: list[Float64] = []
    y: list[Float64] = []
    for start, end in pairwise(edges.tolist()):
        piece = slice(start, end)
        t, low, high = time_s[piece], (middle - half)[piece], (middle + half)[piece]
        below, above = envelope(low, at_most), envelope(high, at_most)[::-1]
        x += [t[below], t[above], t[below[:1]], np.array([np.nan])]
        y += [low[below], high[above], low[below[:1]], np.array([np.nan])]
    fill = {"fill": "toself", "fillcolor": translucent(colour, 0.22)}
    ring = packed(np.concatenate(x), double=True), packed(np.concatenate(y))
    return lines("3 sigma", *ring, {"width": 0}, **fill, showlegend=False, hoverinfo="skip")


def marker_trace(time_s: Float64, values: Float64, name: str, colour: str, **more: Any) -> Trace:
    """Return points over time, without thinning."""
    marker = {"color": colour, "size": 3} | more.pop("marker", {})
    return markers(name, packed(time_s, double=True), packed(values), marker, **more)


def translucent(colour: str, opacity: float) -> str:
    """Return '#rrggbb' as a translucent colour."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{opacity:g})"


def colour_of(place: int) -> str:
    """Return the colour of a place in a list, all different: the palette's, then hues spread about the circle."""
    if place < len(PALETTE):
        return PALETTE[place]
    # the golden ratio spreads any number of hues evenly; light and dark in turn separate neighbours
    turn = place - len(PALETTE)
    hue, light = (0.07 + 0.6180339887498949 * turn) % 1.0, (0.42, 0.6, 0.5)[turn % 3]
    rgb = colorsys.hls_to_rgb(hue, light, 0.62)
    return "#" + "".join(f"{round(255.0 * part):02x}" for part in rgb)


def symbol_of(place: int) -> str:
    """Return the marker of a place in a list: another one each time the palette is through."""
    return _SYMBOLS[place // len(PALETTE) % len(_SYMBOLS)]


def dash_of(place: int) -> str:
    """Return the dashes of a line of a place in a list: others each time the palette is through."""
    return _DASHES[place // len(PALETTE) % len(_DASHES)]


def as_json(charts: Sequence[Chart]) -> str:
    """Return the charts as JSON that can stand inside a script element."""
    text = json.dumps([chart.data() for chart in charts], separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")
