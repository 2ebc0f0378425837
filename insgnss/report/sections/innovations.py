"""Innovations of each kind: over time, against their sigma, as a histogram, and the mean NIS of each satellite."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
from scipy.special import gammaincinv

from insgnss.report.charts import (
    PALETTE,
    Chart,
    ChartRows,
    Trace,
    colour_of,
    lines,
    marker_trace,
    markers,
    packed,
    symbol_of,
    translucent,
)
from insgnss.report.epochs import satellites_of
from insgnss.report.html import Section, table, text
from insgnss.report.labels import number, own_kinds, unit_of
from insgnss.report.thinning import envelope
from insgnss.runs.result import Run
from insgnss.tables import Float64

_POINTS: Final = 7000  # of a kind's innovations, all satellites together
_REFUSED_POINTS: Final = 1500
_BOUND: Final = 1.959963984540054  # of a standard normal variable: 95 % lie inside
_SHOWN: Final = 6.0  # sigma to either side of the histogram
_BINS: Final = 48


def section(run: Run) -> Section | None:
    """Return the innovations of every kind that was used, None where there is none."""
    ledger = run.measurements
    ledger = ledger[np.isfinite(ledger["innovation"]) & (ledger["sd_innovation"] > 0.0)]
    own = own_kinds(run)
    charts: list[Chart] = []
    for kind in ledger["kind"].cat.categories:
        rows = ledger[ledger["kind"] == kind]
        if (rows["status"] == "used").any():
            charts += _charts(rows, str(kind), unit_of(run, str(kind)), of_satellites=kind not in own)
    if not charts:
        return None
    about = (
        "<p>An innovation is measured minus predicted. Divided by its predicted sigma, 95 % should lie within ±1.96;"
        " its square, NIS, should be 1 on average. Below 1 the filter is more careful than necessary, above 1 it"
        " trusts too much.</p>"
    )
    paragraphs = "".join(f"<p>{text(_about_own(name, entry))}</p>" for name, entry in own.items())
    return Section("innovations", "Innovations", before=about + _summary(run) + paragraphs, charts=charts)


def _about_own(name: str, entry: Mapping[str, Any]) -> str:
    gate = entry.get("gate_sigma")
    gated = {None: "the gate of the pseudoranges", "none": "no gate"}.get(gate, f"a gate of {gate} sigma")
    times, source = entry.get("times", 0), entry.get("class", "unknown")
    return f"{name}: a measurement of the user's own ({source}), rows at {times} times, {gated}."


def nis_bounds(n: int, share: float = 0.95) -> tuple[float, float]:
    """Return the bounds that ``share`` of the means of ``n`` independent NIS lie in.

    Equation: n mean(NIS) is chi-square with n degrees of freedom. [Bar-Shalom, Li, Kirubarajan 2001, 5.4.2]
    """
    tail = (1.0 - share) / 2.0
    # the quantile of chi-square by the inverse of the incomplete gamma function; scipy.stats takes a second to load
    low, high = (2.0 * float(gammaincinv(0.5 * n, p)) / n for p in (tail, 1.0 - tail))
    return low, high


def histogram(values: Float64) -> tuple[Float64, Float64]:
    """Return the middles of the bins and the density of ``values`` in each; values outside count at the edge."""
    edges = np.linspace(-_SHOWN, _SHOWN, _BINS + 1)
    count, _ = np.histogram(np.clip(values, -_SHOWN, _SHOWN), edges)
    width = edges[1] - edges[0]
    return 0.5 * (edges[1:] + edges[:-1]), count / (max(len(values), 1) * width)


def _summary(run: Run) -> str:
    rows = [
        [
            str(kind).replace("_", " "),
            int(row["used"]),
            number(float(row["mean_nis"])),
            number(100.0 * float(row["share_95"])),
        ]
        for kind, row in run.nis_summary().iterrows()
    ]
    return table(("kind", "used", "mean NIS (1)", "within 95 % bound, %"), rows)


def _charts(rows: pd.DataFrame, kind: str, unit: str, *, of_satellites: bool) -> list[Chart]:
    used = rows[rows["status"] == "used"]
    words = kind.replace("_", " ")
    charts = [_over_time(rows, used, kind, unit), _histogram(used, kind, words)]
    return [*charts, _by_satellite(used, kind, words)] if of_satellites else charts


def _over_time(rows: pd.DataFrame, used: pd.DataFrame, kind: str, unit: str) -> Chart:
    """Return innovations in their unit, and divided by their sigma, with the 95 % bound."""
    chart, words = ChartRows([f"innovation, {unit}", "innovation / sigma"]), kind.replace("_", " ")
    place_of, names = satellites_of(used)
    each = max(_POINTS // max(len(names), 1), 40)
    for place, name in enumerate(names):
        _add(chart, used[place_of == place], name or "used", each, _marker(place), name or "used")
    refused = rows[rows["status"] != "used"]
    if len(refused):
        marker = {"color": PALETTE[1], "size": 6, "symbol": "x-thin-open"}
        _add(chart, refused, "refused", _REFUSED_POINTS, marker, "refused")
    for bound in (-_BOUND, _BOUND):
        chart.add(1, _level(rows["time_s"].to_numpy(), bound))
    sizes = (
        np.abs(used["innovation"].to_numpy()),
        np.abs((used["innovation"] / used["sd_innovation"]).to_numpy()),
    )
    for row, size in enumerate(sizes):
        limit = 1.25 * float(np.quantile(size, 0.995)) + 1e-9
        chart.ranges[row] = (-limit, limit) if row == 0 else (-max(limit, 3.5), max(limit, 3.5))
    caption = "Click a satellite's name to hide it, double-click to see it alone. The axes first show the used rows."
    return chart.chart(f"chart-innovation-{kind}", f"Innovations: {words}", row_px=190, caption=caption)


def _marker(place: int) -> dict[str, Any]:
    symbol = symbol_of(place)
    return {"color": colour_of(place), "size": 3 if symbol == "circle" else 4, "symbol": symbol}


def _add(
    chart: ChartRows, rows: pd.DataFrame, name: str, at_most: int, marker: dict[str, Any], group: str
) -> None:
    innovation = rows["innovation"].to_numpy()
    points = envelope(innovation, at_most)
    time_s, values = rows["time_s"].to_numpy()[points], innovation[points]
    normalised = values / rows["sd_innovation"].to_numpy()[points]
    chart.add(0, marker_trace(time_s, values, name, marker["color"], marker=marker, legendgroup=group))
    second = {"marker": marker, "legendgroup": group, "showlegend": False}
    chart.add(1, marker_trace(time_s, normalised, name, marker["color"], **second))


def _level(time_s: Float64, value: float) -> Trace:
    ends, style = (
        [float(time_s.min()), float(time_s.max())],
        {"color": PALETTE[6], "width": 1, "dash": "dash"},
    )
    return lines("95 % bound", ends, [value, value], style, showlegend=False, hoverinfo="skip")


def _histogram(used: pd.DataFrame, kind: str, words: str) -> Chart:
    middle, density = histogram((used["innovation"] / used["sd_innovation"]).to_numpy())
    bell = np.linspace(-_SHOWN, _SHOWN, 121)
    normal = packed(np.exp(-0.5 * bell**2) / np.sqrt(2.0 * np.pi))
    bars = {"type": "bar", "name": "innovations used", "x": packed(middle), "y": packed(density)}
    traces: list[Trace] = [
        bars | {"marker": {"color": PALETTE[5]}},
        lines("standard normal", packed(bell), normal, {"color": PALETTE[1], "width": 2}),
    ]
    layout = {"bargap": 0, "xaxis": {"title": {"text": "innovation / sigma"}}}
    layout |= {"yaxis": {"title": {"text": "density"}}}
    return Chart(f"chart-histogram-{kind}", f"Distribution: {words}", traces, layout, 260)


def _by_satellite(used: pd.DataFrame, kind: str, words: str) -> Chart:
    """Return the mean NIS of each satellite with the bounds for as many independent values."""
    place_of, names = satellites_of(used)
    groups = used["nis"].groupby(place_of)
    means, counts = groups.mean(), groups.count()
    bounds = np.array([nis_bounds(int(n)) for n in counts])
    colours = [
        PALETTE[2] if low <= mean <= high else PALETTE[4] if mean < low else PALETTE[1]
        for mean, (low, high) in zip(means, bounds, strict=True)
    ]
    width = bounds[:, 1] - bounds[:, 0]
    interval: Trace = {
        "type": "bar",
        "name": "95 % bounds",
        "x": names,
        "base": packed(bounds[:, 0]),
        "y": packed(width),
        "width": [0.5] * len(names),
        "marker": {"color": translucent(PALETTE[6], 0.45)},
        "hoverinfo": "skip",
    }
    hover = {
        "text": [f"{n} values" for n in counts],
        "hovertemplate": "%{x}: %{y:.2f}, %{text}<extra></extra>",
    }
    style = {"color": colours, "size": 10}
    trace = markers("mean NIS", names, packed(means.to_numpy()), style, **hover, showlegend=False)
    layout = {
        "xaxis": {"type": "category", "title": {"text": "satellite"}},
        "yaxis": {"title": {"text": "mean NIS"}, "rangemode": "tozero", "zeroline": True},
    }
    caption = (
        "Grey: the 95 % bounds of the mean if the values were independent; errors that last for seconds (multipath)"
        " exceed them without being a defect. Green lies inside, amber below (too careful), red above (too trusting)."
    )
    title = f"Mean NIS by satellite: {words}"
    return Chart(f"chart-nis-{kind}", title, [interval, trace], layout, 280, caption)
